"""Fig. 2 for the paper's parts and its figure."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell.alignment_runs import RepeatabilityScenario, resolve_repeatability
from chamfer.analysis.cell.wedging_diagram import InitialErrors, WedgingScenario
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, quiet, select
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_statics import Contact, equilibrium
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.models.validation import ParameterError

WEDGING_DIAGRAM, REPEATABILITY = map(
    load, select(CATALOGUE.entries, ["wedging-diagram", "repeatability"])
)

SCENARIO = WedgingScenario(alignment=None)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return WEDGING_DIAGRAM.run(WEDGING_DIAGRAM.resolve(SCENARIO), 0, quiet)


def test_published_values(outcome: Outcome) -> None:
    asked = [one for one in PUBLISHED if one.experiment == "wedging-diagram"]
    checks = check(asked, outcome.metrics)
    assert len(checks) == 7
    failed = {one.published.metric for one in checks if not one.ok}
    assert failed == {"published_worst.parallelogram_margin"}  # the finding


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("wedging_depth", 0.0088011),
        ("chamfer_limit", 0.004256),
        ("tilt_per_error", 0.1 / (0.01 + 5 / 400)),
        ("largest_tilt_per_error", 4.472),
        ("chamfer_needed", 0.002944),
        ("chamfer_needed_for_limit", 0.019558),
        ("published_mean.box_margin.lateral", 100 * (1 - 0.0025 / 0.019814)),
        ("published_mean.box_margin.rotation", 100 * (1 - 0.022 / 0.0581745)),
        ("published_worst.parallelogram_margin", 8.61),
        ("published_worst.exact_margin", 12.476),
        ("published_worst.margin", 13.299),
        ("published_worst.onset", 0.0093665),
        ("published_worst.wedges", 0.0),
        ("wedging_prone.wedges", 1.0),
        ("published_worst.enters", 1.0),
        ("published_worst.onset_simple", 0.009464),
        ("published_worst.peak_force", 13.215),
        ("published_worst.peak_force_simple", 10.88),
        ("published_worst.peak_force_depth", 0.0153),
        ("published_worst.chamfer_force", 1.8886),
    ],
)
def test_metrics(outcome: Outcome, name: str, expected: float) -> None:
    assert metric_value(outcome.metrics, name) == pytest.approx(expected, rel=2e-3)


def test_traces_follow_the_peg_down_the_chamfer_into_the_bore(outcome: Outcome) -> None:
    traces = outcome.traces
    for i, start in enumerate(SCENARIO.starts().values()):
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
        for form in ("exact", "simple"):
            bounds = rotation_bounds(parts, there, lateral, form)  # type: ignore[arg-type]
            for side, expected in zip(("lower", "upper"), bounds, strict=True):
                np.testing.assert_array_equal(table[f"{form}_{side}"][of], expected)
    assert table["centre_distance"][0] == 0.1  # the parts' own comes first


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"centre_distances": (0.1, math.nan)}, "centre_distances is (0.1, nan), allowed: finite"),
        ({"parts": ColouredParts(peg_length=0.07)}, "parts.peg_length is 0.07, allowed: 0.06, "),
        ({"support": Support(angular_stiffness=0.01)}, "support.angular_stiffness is 0.01, allo"),
    ],
)
def test_scenarios_that_are_none(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}"):
        replace(SCENARIO, **values)


SHORT: dict[str, Any] = {"trials": 2, "begin": 0.1, "compensation_time": 0.1}
BRIEF = RepeatabilityScenario(**SHORT)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:in [12] of 2 trials")  # they are short
def test_simulated_alignments_end_in_the_diagram() -> None:
    scenario = WEDGING_DIAGRAM.resolve(replace(SCENARIO, alignment=BRIEF, points=5))
    aligned = WEDGING_DIAGRAM.run(scenario, 3, quiet)
    (figure,) = WEDGING_DIAGRAM.plot(scenario, aligned).values()
    (line,) = (
        one for one in figure.axes[0].get_lines() if one.get_label() == "simulated alignments"
    )
    ends = aligned.tables["ends"]
    np.testing.assert_allclose(line.get_data(), [1e3 * values for values in ends.values()])
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


def test_a_start_that_no_push_slides_has_no_peak() -> None:
    stuck = InitialErrors(lateral=0.0, rotation=0.1)
    outcome = WEDGING_DIAGRAM.run(replace(SCENARIO, wedging_prone=stuck), 0, quiet)
    peak = outcome.metrics["wedging_prone.peak_force"]
    assert peak.value is None
    assert peak.note.startswith("no push slides it at ")
    WEDGING_DIAGRAM.plot(SCENARIO, outcome)
