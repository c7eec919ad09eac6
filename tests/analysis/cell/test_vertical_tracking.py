"""Fig. 11 and its figure."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell import vertical_tracking
from chamfer.analysis.cell.vertical_tracking import RUNS, plot_heights
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import VERTICAL_TRACKING, AlignmentScenario
from chamfer.systems.vision.cell_error import AXES

TRACKING = load(select(CATALOGUE.entries, ["vertical-tracking"])[0])

SHORT = replace(
    VERTICAL_TRACKING, motion_time=0.3, start_offset=(0.0, 0.0, -0.005), compensation_time=0.65
)


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def value(outcome: Outcome, name: str) -> float:
    measured = outcome.metrics[name].value
    assert measured is not None
    return measured


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return TRACKING.run(TRACKING.resolve(SHORT), 0, quiet)


def test_traces(outcome: Outcome) -> None:
    kinds = ("height", "encoder_height", "hole_height", "valid")
    expected = {"time", "desired_height", "compensation"} | {
        f"{run}_{kind}" for run in RUNS for kind in kinds
    }
    assert set(outcome.traces) == expected
    for name, values in outcome.traces.items():
        assert values.shape == (61,), name
        assert np.isfinite(values).all(), name
    desired = outcome.traces["desired_height"]
    assert desired[0] == pytest.approx(0.153)
    assert desired[-1] == pytest.approx(0.158)
    # Compensation lifts the peg, and the hole stays where it is.
    assert outcome.traces["compensation"][-1] > 5e-4
    higher = outcome.traces["compensated_height"] - outcome.traces["uncompensated_height"]
    assert higher[-1] > 2e-4
    np.testing.assert_allclose(outcome.traces["compensated_hole_height"], 0.158, atol=1e-4)


def test_errors_are_signed_means_of_the_end_and_rms_on_the_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []

    def fake(scenario: AlignmentScenario, seed: int) -> dict[str, NDArray[np.float64]]:
        asked.append((scenario.compensated, seed))
        time = np.arange(321) / 80
        low = 0.0015 if scenario.compensated == "none" else -0.0002
        height = np.interp(time, [0.0, 2.0], [0.128, 0.158]) - np.where(time < 2.0, 0.003, low)
        height[-1] += 0.004  # one of the 41 rows of the last half second
        names = ("peg_tool_z", "hole_true_z", "blind", "diverged", "lateral_error")
        names += ("rotational_error", *(f"compensation_{axis}" for axis in AXES))
        traces = dict.fromkeys(names, np.zeros(321))
        traces["valid"] = np.ones(321)
        desired = np.interp(time, [0.0, 2.0], [0.128, 0.158])
        return {"time": time, "peg_true_z": height, "peg_desired_z": desired, **traces}

    monkeypatch.setattr(vertical_tracking, "run_alignment", fake)
    scenario = TRACKING.resolve(VERTICAL_TRACKING)
    outcome = TRACKING.run(scenario, 6, quiet)
    assert asked == [("none", 6), ("peg", 6)]
    assert value(outcome, "uncompensated.height_error") == pytest.approx(-0.0015 + 0.004 / 41)
    assert value(outcome, "compensated.height_error") == pytest.approx(0.0002 + 0.004 / 41)
    assert value(outcome, "uncompensated.height_error_max") == pytest.approx(0.0025)
    rms = np.sqrt((160 * 0.003**2 + 0.0015**2) / 161)
    assert value(outcome, "uncompensated.tracking_rms") == pytest.approx(rms)


@pytest.mark.slow
def test_published_values() -> None:
    scenario = TRACKING.resolve(VERTICAL_TRACKING)
    whole = TRACKING.run(scenario, 0, quiet)
    asked = [one for one in PUBLISHED if one.experiment == "vertical-tracking"]
    assert all(one.ok for one in check(asked, whole.metrics))
    # It moves on the way as with a wrong payload, and comes to rest.
    assert value(whole, "compensated.height_error_max") < 2.5e-4
    assert value(whole, "compensated.tracking_rms") < value(whole, "uncompensated.tracking_rms")


SCENARIO = resolve(VERTICAL_TRACKING)
TIME = np.arange(321) / 80
GOAL = np.interp(TIME, [0.0, 2.0], [0.128, 0.158])
LIFT = np.interp(TIME, [0.1, 1.2], [0.0, 0.0015])


@pytest.fixture(scope="module")
def figure() -> Figure:
    traces = {
        "time": TIME,
        "desired_height": GOAL,
        "uncompensated_height": GOAL - 0.0015,
        "compensated_height": GOAL - 0.0015 + LIFT,
        "compensation": LIFT,
    }
    made = plot_heights(SCENARIO, Outcome(metrics={}, traces=traces, simulated_seconds=8.0))
    FigureCanvasAgg(made)
    made.canvas.draw()
    return made


def end(axes: Axes, label: str) -> float:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return float(np.asarray(found.get_ydata())[-1])


def test_curves_are_in_millimetres(figure: Figure) -> None:
    height, error = figure.axes
    assert end(height, "desired") == pytest.approx(158.0)
    assert end(height, "without compensation") == pytest.approx(156.5)
    assert end(height, "with compensation by sight") == pytest.approx(158.0)
    assert end(error, "published: 1.5 mm low") == pytest.approx(-1.5)
    assert end(error, "without compensation") == pytest.approx(-1.5)
    assert end(error, "with compensation by sight") == pytest.approx(0.0, abs=1e-9)
    assert end(error, "compensation added") == pytest.approx(1.5)
    (band,) = error.patches
    low, high = error.transData.inverted().transform(band.get_extents())[:, 1]
    zone = SCENARIO.compensator.axes[0].dead_zone * 0.5
    assert (low, high) == pytest.approx((-zone, zone))
    assert error.get_xlim() == (0.0, 4.0)
