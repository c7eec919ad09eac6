"""The rows of an item in a mode, and how its values are said."""

import numpy as np

from chamfer.analysis.charging.charging_figures import colour_of, off_command, parts, said
from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.models.charging.packing import PlanItem

STATES = ("home.out", "wall.slide", "wall.lost", "release.open", "done")
SCENARIO = CrucibleChargingScenario(
    plan=(PlanItem(), PlanItem(kind="bulk", mass=0.4, azimuth=0.0), PlanItem(azimuth=1.0))
)
TRACES = {
    "time": np.array([1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]),
    "state": np.array([0.0, 1.0, 2.0, 1.0, 3.0, 1.0, 4.0]),
    "item": np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 2.0]),
}


def test_parts_are_an_items_rows_in_some_modes() -> None:
    first, third = parts(SCENARIO, TRACES, STATES, "wall", "release")
    assert (first.item, third.item) == (0, 2)
    np.testing.assert_array_equal(first.rows, [1, 2, 3, 4])
    np.testing.assert_allclose(first.time, [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_array_equal(third.rows, [5])
    assert (first.label, third.label) == ("1: wall, 85 g", "3: wall, 85 g")
    assert first.style["color"] == colour_of(0) != third.style["color"]


def test_a_legend_is_not_longer_than_there_is_room() -> None:
    many = CrucibleChargingScenario(plan=(PlanItem(kind="bulk"),) * 12)
    rows = np.arange(12.0)
    traces = {"time": rows, "state": np.ones(12), "item": rows}
    labels = [part.label for part in parts(many, traces, STATES, "wall")]
    assert labels[7:] == ["8: bulk, 85 g", "", "", "", ""]


def test_a_part_may_begin_with_a_state() -> None:
    (found,) = parts(SCENARIO, TRACES, STATES, "wall", first="wall.lost")
    np.testing.assert_array_equal(found.rows, [2, 3])


def test_off_the_command_is_a_distance() -> None:
    traces = {f"nugget_{axis}": np.array([1.0]) for axis in "xyz"}
    traces |= {
        f"desired_{axis}": np.array([one]) for axis, one in zip("xyz", (1, 4, 5), strict=True)
    }
    np.testing.assert_allclose(off_command(traces), [5.0])


def test_values_are_said_with_their_scale_and_without_a_minus_zero() -> None:
    metrics = {"a": Metric(value=-0.0, unit=""), "b": Metric(value=None, unit="m")}
    metrics["c"] = Metric(value=0.01234, unit="m")
    outcome = Outcome(metrics=metrics, traces={}, simulated_seconds=0.0)
    assert [said(outcome, name, 1e3) for name in "abcd"] == ["0", "-", "12.3", "-"]
