"""Fig. 2 for the paper's parts and its figure."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell.alignment_runs import RepeatabilityScenario, resolve_repeatability
from chamfer.analysis.cell.wedging_diagram import (
    STARTS,
    InitialErrors,
    WedgingScenario,
    plot_wedging,
)
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_statics import Contact, equilibrium
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.models.validation import ParameterError

WEDGING_DIAGRAM, REPEATABILITY = map(
    load, select(CATALOGUE.entries, ["wedging-diagram", "repeatability"])
)

SCENARIO = WedgingScenario(alignment=None)


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return WEDGING_DIAGRAM.run(WEDGING_DIAGRAM.resolve(SCENARIO), 0, quiet)


def value(outcome: Outcome, name: str) -> float:
    measured = outcome.metrics[name].value
    assert measured is not None
    return measured


def test_published_values(outcome: Outcome) -> None:
    asked = [one for one in PUBLISHED if one.experiment == "wedging-diagram"]
    checks = check(asked, outcome.metrics)
    assert len(checks) == 7
    failed = {one.published.metric for one in checks if not one.ok}
    assert failed == {"published_worst.parallelogram_margin"}  # the finding


@pytest.mark.parametrize(
    ("name", "expected", "unit"),
    [
        ("rotation_limit", 0.0581745, "rad"),
        ("lateral_limit", 0.019814, "m"),
        ("clearance_ratio", 0.0255107, ""),
        ("wedging_depth", 0.0088011, "m"),
        ("chamfer_limit", 0.004256, "m"),
        ("tilt_per_error", 0.1 / (0.01 + 5 / 400), "rad/m"),
        ("largest_tilt_per_error", 4.472, "rad/m"),
        ("chamfer_needed", 0.002944, "m"),
        ("chamfer_needed_for_limit", 0.019558, "m"),
        ("published_mean.box_margin.lateral", 100 * (1 - 0.0025 / 0.019814), "%"),
        ("published_mean.box_margin.rotation", 100 * (1 - 0.022 / 0.0581745), "%"),
        ("published_worst.parallelogram_margin", 8.61, "%"),
        ("published_worst.exact_margin", 12.476, "%"),
        ("published_worst.margin", 13.299, "%"),
        ("published_worst.onset", 0.0093665, "m"),
        ("published_worst.onset_ratio", 0.0093665 / 0.0088011, ""),
        ("published_worst.wedges", 0.0, ""),
        ("wedging_prone.wedges", 1.0, ""),
        ("published_worst.enters", 1.0, ""),
        ("published_worst.onset_simple", 0.009464, "m"),
        ("published_worst.peak_force", 13.215, "N"),
        ("published_worst.peak_force_simple", 10.88, "N"),
        ("published_worst.peak_force_depth", 0.0153, "m"),
        ("published_worst.chamfer_force", 1.8886, "N"),
    ],
)
def test_metrics(outcome: Outcome, name: str, expected: float, unit: str) -> None:
    assert value(outcome, name) == pytest.approx(expected, rel=2e-3)
    assert outcome.metrics[name].unit == unit


def test_traces_follow_the_peg_down_the_chamfer_into_the_bore(outcome: Outcome) -> None:
    traces = outcome.traces
    assert set(traces) == {"start", "depth", "force", "tilt", "contact"}
    for i, start in enumerate(SCENARIO.starts()):
        of = traces["start"] == i
        depth, contact = traces["depth"][of], traces["contact"][of]
        assert np.all(np.diff(depth) > 0)
        assert depth[-1] == SCENARIO.depth
        assert len(depth) == 2 * SCENARIO.points
        found = equilibrium(SCENARIO.parts, Support(), start.lateral, start.rotation, depth)
        finite = np.where(np.isinf(found.insertion_force), np.nan, found.insertion_force)
        np.testing.assert_array_equal(traces["force"][of], finite)
        np.testing.assert_array_equal(traces["tilt"][of], found.tilt)
        assert traces["force"][of][0] == 0.0  # before the first touch
        assert contact[-1] == Contact.TWO_POINT
        on_chamfer = depth[contact == Contact.CHAMFER]
        needed = start.lateral - SCENARIO.parts.clearance
        assert on_chamfer[-1] - on_chamfer[0] == pytest.approx(needed, rel=0.25)  # 45 degrees


def test_boundaries_of_every_compliance_centre(outcome: Outcome) -> None:
    table = outcome.tables["boundaries"]
    parts = SCENARIO.parts
    for distance in (0.1, 0.0, 0.03):
        of = table["centre_distance"] == distance
        lateral = table["lateral"][of]
        assert np.all(np.diff(lateral) > 0)
        assert lateral[-1] == -lateral[0] > parts.lateral_limit
        for limit in (parts.clearance, parts.chamfer_limit, parts.lateral_limit):
            assert {-limit, limit} <= set(lateral.tolist())
        there = Support(centre_distance=distance)
        lower, upper = rotation_bounds(parts, there, lateral)
        np.testing.assert_array_equal(table["exact_lower"][of], lower)
        np.testing.assert_array_equal(table["exact_upper"][of], upper)
        lower, upper = rotation_bounds(parts, there, lateral, "simple")
        np.testing.assert_array_equal(table["simple_lower"][of], lower)
        np.testing.assert_array_equal(table["simple_upper"][of], upper)
    assert table["centre_distance"][0] == 0.1  # the parts' own comes first


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"depth": 0.0}, "depth is 0.0, allowed: a finite number > 0"),
        ({"points": 1}, "points is 1, allowed: 2 to 100000"),
        ({"points": 100_001}, "points is 100001, allowed: 2 to 100000"),
        (
            {"centre_distances": (0.1, -0.1)},
            "centre_distances is (0.1, -0.1), allowed: finite numbers >= 0, or none",
        ),
        (
            {"centre_distances": (math.nan,)},
            "centre_distances is (nan,), allowed: finite numbers >= 0, or none",
        ),
    ],
)
def test_scenarios_that_are_none(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        WedgingScenario(**values)


@pytest.mark.parametrize("name", ["lateral", "rotation"])
def test_starts_are_finite(name: str) -> None:
    message = f"{name} is nan, allowed: a finite number"
    with pytest.raises(ParameterError, match=f"^{message}$"):
        replace(SCENARIO.published_mean, **{name: math.nan})


SHORT: dict[str, Any] = {"trials": 2, "begin": 0.1, "compensation_time": 0.1}
BRIEF = RepeatabilityScenario(**SHORT)


@pytest.fixture(scope="module")
def aligned() -> Outcome:
    return run(replace(SCENARIO, alignment=BRIEF, points=5))


def run(scenario: WedgingScenario) -> Outcome:
    return WEDGING_DIAGRAM.run(WEDGING_DIAGRAM.resolve(scenario), 3, quiet)


def test_without_alignments_nothing_is_simulated(outcome: Outcome) -> None:
    assert outcome.simulated_seconds == 0.0
    assert set(outcome.tables) == {"boundaries"}
    assert not [name for name in outcome.metrics if name.startswith("aligned.")]
    assert WedgingScenario().alignment == RepeatabilityScenario(trials=10)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:in 2 of 2 trials")  # they are short
def test_simulated_alignments_end_in_the_diagram(aligned: Outcome) -> None:
    ends = aligned.tables["ends"]
    assert set(ends) == {"lateral_error", "rotational_error"}
    alone = REPEATABILITY.run(REPEATABILITY.resolve(RepeatabilityScenario(**SHORT)), 3, quiet)
    for name, values in ends.items():
        np.testing.assert_array_equal(values, alone.traces[name])
    assert aligned.simulated_seconds == pytest.approx(0.4)
    held = resolve_repeatability(BRIEF).held()
    arms = aligned.tables["arms"]
    for bound, of in zip(
        ("lower", "upper"), rotation_bounds(SCENARIO.parts, held, arms["lateral"]), strict=True
    ):
        np.testing.assert_array_equal(arms[f"exact_{bound}"], of)
    for name in ("box_margin.lateral", "box_margin.rotation", "margin", "wedging"):
        assert aligned.metrics[f"aligned.{name}"] == alone.metrics[name]


def test_without_alignments_nobody_sees_the_parts() -> None:
    with pytest.raises(ParameterError, match=r"^parts\.peg_length is 0\.07, allowed: 0\.06, nob"):
        replace(SCENARIO, parts=ColouredParts(peg_length=0.07))


def test_a_support_that_turns_over_is_refused() -> None:
    with pytest.raises(
        UserError, match=r"^support\.angular_stiffness is 0\.01, allowed: > 0\.0174"
    ):
        make_scenario(WedgingScenario(), settings=["support.angular_stiffness=0.01"])


def test_a_start_that_no_push_slides_has_no_peak() -> None:
    stuck = InitialErrors(lateral=0.0, rotation=0.1)
    outcome = WEDGING_DIAGRAM.run(replace(SCENARIO, wedging_prone=stuck), 0, quiet)
    peak = outcome.metrics["wedging_prone.peak_force"]
    assert peak.value is None
    assert peak.note.startswith("no push slides it at ")
    WEDGING_DIAGRAM.plot(SCENARIO, outcome)


WEDGING_DIAGRAM_WEDGING_DIAGRAM_FIGURES = load(select(CATALOGUE.entries, ["wedging-diagram"])[0])

Array = NDArray[np.float64]
SCENARIO_WEDGING_DIAGRAM_FIGURES = WedgingScenario(points=51, alignment=None)


def run_of_wedging_diagram_figures(scenario: WedgingScenario) -> Outcome:
    return WEDGING_DIAGRAM_WEDGING_DIAGRAM_FIGURES.run(
        scenario, 0, lambda fraction, doing="": None
    )


@pytest.fixture(scope="module")
def outcome_of_wedging_diagram_figures() -> Outcome:
    return run_of_wedging_diagram_figures(SCENARIO_WEDGING_DIAGRAM_FIGURES)


@pytest.fixture(scope="module")
def figure(outcome_of_wedging_diagram_figures: Outcome) -> Figure:
    figures = WEDGING_DIAGRAM_WEDGING_DIAGRAM_FIGURES.plot(
        SCENARIO_WEDGING_DIAGRAM_FIGURES, outcome_of_wedging_diagram_figures
    )
    assert set(figures) == {"wedging-diagram"}
    return drawn(figures["wedging-diagram"])


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    return figure


def labels(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


def line(axes: Axes, label: str) -> tuple[Array, Array]:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def test_sides_in_millimetres_and_milliradians(
    figure: Figure, outcome_of_wedging_diagram_figures: Outcome
) -> None:
    table = outcome_of_wedging_diagram_figures.tables["boundaries"]
    x, y = line(figure.axes[0], "exact sides, $L_g$ 100 mm")
    inside = (table["centre_distance"] == 0.1) & (np.abs(table["lateral"]) <= 0.019814)
    np.testing.assert_allclose(x, 1e3 * table["lateral"][inside])
    np.testing.assert_allclose(y, 1e3 * table["exact_upper"][inside])
    assert x[-1] == pytest.approx(19.814)
    box = figure.axes[0].patches[-1].get_bbox()
    np.testing.assert_allclose(box.extents, [-19.814, -58.1745, 19.814, 58.1745], atol=1e-4)


def test_starts_and_their_margins(figure: Figure) -> None:
    for axes in figure.axes[:2]:
        x, y = line(axes, "largest of the ten runs")
        assert (x.item(), y.item()) == pytest.approx((3.2, 40.0))
        left, right = axes.get_xlim()
        assert left <= 3.2 <= right
    assert [text.get_text() for text in figure.axes[1].texts] == ["49 %", "13 %", "-4 %"]


def test_force_over_depth_in_millimetres(
    figure: Figure, outcome_of_wedging_diagram_figures: Outcome
) -> None:
    force = figure.axes[2]
    x, y = line(force, "mean of the ten runs")
    of = outcome_of_wedging_diagram_figures.traces["start"] == 0
    np.testing.assert_allclose(x, 1e3 * outcome_of_wedging_diagram_figures.traces["depth"][of])
    np.testing.assert_array_equal(y, outcome_of_wedging_diagram_figures.traces["force"][of])
    assert force.get_ylim()[1] > outcome_of_wedging_diagram_figures.traces["force"].max()
    band = force.patches[0].get_bbox()
    assert (band.x0, band.x1) == pytest.approx((0.0, 8.8011))


def test_ends_of_simulated_runs_are_drawn_and_in_view(
    outcome_of_wedging_diagram_figures: Outcome,
) -> None:
    starts = dict.fromkeys(STARTS, (0.001, 0.01))
    ends = np.array([-0.002, 0.006]), np.array([-0.03, 0.02])
    x = np.array([-0.004, 0.0, 0.004])
    arms = {"lateral": x, "exact_lower": x - 0.06, "exact_upper": x + 0.06}
    outcome_of_wedging_diagram_figures = replace(
        outcome_of_wedging_diagram_figures,
        tables={**outcome_of_wedging_diagram_figures.tables, "arms": arms},
    )
    figure = drawn(
        plot_wedging(
            SCENARIO_WEDGING_DIAGRAM_FIGURES.parts,
            starts,
            outcome_of_wedging_diagram_figures,
            ends,
        )
    )
    for axes in figure.axes[:2]:
        x, y = line(axes, "exact sides, the arms of the simulation")
        np.testing.assert_allclose(x, [-4.0, 0.0, 4.0])
        np.testing.assert_allclose(y, [56.0, 60.0, 64.0])
        x, y = line(axes, "simulated alignments")
        np.testing.assert_allclose(x, [-2.0, 6.0])
        np.testing.assert_allclose(y, [-30.0, 20.0])
        for low, high, values in ((*axes.get_xlim(), x), (*axes.get_ylim(), y)):
            assert low < values.min()
            assert high > values.max()
    assert "simulated alignments" in labels(figure.axes[0])
