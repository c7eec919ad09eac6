"""Fig. 11 and its figure."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell import vertical_tracking
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, select
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


def test_curves_are_in_millimetres(outcome: Outcome) -> None:
    scenario = TRACKING.resolve(SHORT)
    (figure,) = TRACKING.plot(scenario, outcome).values()
    height, error = figure.axes
    ends = {
        (axes, line.get_label()): float(np.asarray(line.get_ydata())[-1])
        for axes in (height, error)
        for line in axes.get_lines()
    }
    last = {name: 1e3 * values[-1] for name, values in outcome.traces.items()}
    for name, label in (
        ("uncompensated", "without compensation"),
        ("compensated", "with compensation by sight"),
    ):
        reached = last[f"{name}_height"]
        assert ends[height, label] == pytest.approx(reached)
        assert ends[error, label] == pytest.approx(reached - last["desired_height"])
    assert ends[height, "desired"] == pytest.approx(last["desired_height"])
    assert ends[error, "published: 1.5 mm low"] == pytest.approx(-1.5)
    assert ends[error, "compensation added"] == pytest.approx(last["compensation"])
    (band,) = error.patches
    zone = scenario.compensator.axes[0].dead_zone * 0.5
    low, high = error.transData.inverted().transform(band.get_extents())[:, 1]
    assert (low, high) == pytest.approx((-zone, zone))
