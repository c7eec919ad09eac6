"""The limits of section 1.1.2, on made-up cycles."""

import numpy as np
import pytest

from chamfer.analysis.charging.charging_runs import Item, clearance, item_limits, nugget_points
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.charging.packing import nugget_of
from chamfer.models.charging.station import Station
from chamfer.systems.charging.charging_params import ChargingParams

STATION = Station()
NUGGET = nugget_of(0.14)
NAMES = ("acquire.descend", "scan.pass", "slew.over", "wall.slide", "wall.lost", "wall.set_down")


def made(states: list[int], **columns: list[float]) -> dict[str, np.ndarray]:
    """Return traces in which nothing happens but what is told, a row a tenth of a second."""
    n = len(states)
    names = ["item", "layer_shift", *ADEPT_WRIST.coordinates]
    names += [f"{what}_{axis}" for what in ("nugget", "desired") for axis in "xyz"]
    for place in ("feeder", "wall", "layer"):
        names += [f"{place}_{what}" for what in ("force", "gap", "peak_force", "impact_speed")]
    traces = {name: np.zeros(n) for name in names}
    traces |= {"time": 0.1 * np.arange(n), "state": np.array(states, dtype=float)}
    return traces | {name: np.array(values, dtype=float) for name, values in columns.items()}


def measured(traces: dict[str, np.ndarray]) -> dict[str, float]:
    item = Item("wall", NUGGET, (0.0, 0.0, 0.0), 0.0)
    return item_limits(traces, NAMES, item, 0, STATION)


def test_what_was_not_reached_is_missing() -> None:
    found = measured(made([0, 0, 0]))
    assert "acquire.grip_force" in found
    assert not any(name.startswith(("scan", "slew", "wall.slide")) for name in found)


def test_scan_counts_between_its_ends_alone() -> None:
    y = STATION.scanner[1] + np.array([-0.045, -0.012, -0.009, -0.006, 0.045])
    errors = [0.01, 1e-4, -3e-4, 0.0, 0.01]
    traces = made([1] * 5, nugget_y=y.tolist(), desired_y=y.tolist(), nugget_x=errors)
    assert measured(traces)["scan.position_error"] == pytest.approx(3e-4)


def test_losses_and_least_force_of_a_slide() -> None:
    traces = made(
        [3, 3, 4, 4, 3, 4, 3, 5],
        wall_force=[1.0, 0.9, 0.0, 0.0, 1.2, 0.1, 1.0, 9.0],
        wall_peak_force=[1.0, 0.9, 0.0, 0.0, 1.7, 0.1, 1.0, 9.0],
    )
    found = measured(traces)
    assert found["wall.losses"] == 1  # the chart saw one more than there was
    assert found["wall.losses_seen"] == 2
    assert found["wall.slide_force"] == 1.7
    assert found["wall.slide_force_min"] == 0.0
    assert found["wall.peak_force"] == 9.0


def test_what_presses_on_the_rim_scratches_too() -> None:
    # There nothing pushes outwards.
    traces = made([3, 3, 3, 3], wall_peak_force=[4.0, 6.0, 6.0, 1.0])
    assert measured(traces)["wall.scratch_time"] == pytest.approx(0.2)


def test_impact_is_measured_against_the_mass() -> None:
    traces = made([3, 3], wall_impact_speed=[0.0, 0.11])
    assert measured(traces)["wall.impact_share"] == pytest.approx(25.0)


def test_clearance_over_the_rim_and_inside() -> None:
    rim, height = STATION.rim_height, NUGGET.height

    def clear(grip: tuple[float, float, float], yaw: float) -> float:
        points = nugget_points(NUGGET, np.array([grip]), np.array([yaw]))
        return clearance(points, STATION)

    x, y = STATION.place(0.0, STATION.crucible_radius + 0.004)
    assert clear((x, y, rim + height + 0.01), 0.0) == pytest.approx(0.01)
    x, y = STATION.place(0.7, STATION.crucible_radius - NUGGET.reach - 0.005)
    assert clear((x, y, rim), 0.7) == pytest.approx(0.005)
    assert clear((x, y, rim + 2 * height), 0.7) > height


@pytest.mark.parametrize("mass", [0.014, 0.185])
def test_gripper_leans_off_the_wall(mass: float) -> None:
    # The smallest nugget, laid at the wall: upright, the gripper's body would stand in the glass.
    nugget = nugget_of(mass)
    place = STATION.place(0.7, STATION.crucible_radius - nugget.reach)

    def clear(lean: float) -> float:
        endpoint = (*place, STATION.bed_height + nugget.height, 0.7, 0.0, 0.0, lean)
        columns = dict(zip(ADEPT_WRIST.coordinates, ([one] * 2 for one in endpoint), strict=True))
        return measured(made([3, 3], **columns))["wall.gripper_clearance"]

    assert clear(ChargingParams().lean) > 0.001
    assert (clear(0.0) < 0) == (mass == 0.014)
