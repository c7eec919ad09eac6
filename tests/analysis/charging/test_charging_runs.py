"""The columns of a charging run, the limits of section 1.1.2, and the experiment's rows."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from chamfer.analysis.charging import crucible_charging
from chamfer.analysis.charging.charging_runs import (
    LIMITS,
    ChargingRun,
    Item,
    clearance,
    item_limits,
    nugget_points,
    traces_of,
)
from chamfer.analysis.charging.crucible_charging import measure, placed, worst
from chamfer.analysis.linear.simulate import Run
from chamfer.analysis.published.hybrid_force_position_charging import CHARGING
from chamfer.analysis.report.checks import check
from chamfer.diagrams.charging.charging_scenario import (
    CrucibleChargingScenario,
    chart_of,
    resolve_charging,
)
from chamfer.models.arms.adept_wrist import ADEPT_WRIST, joint_positions
from chamfer.models.charging.packing import PlanItem, nugget_of
from chamfer.models.charging.station import Station
from chamfer.systems.charging.charging_params import ChargingParams
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS

AZIMUTH = 0.6
SCENARIO = CrucibleChargingScenario(plan=(PlanItem(), PlanItem(mass=0.14, azimuth=AZIMUTH)))
ENDPOINT = (0.5, 0.1, 0.5, AZIMUTH, 0.0, 0.0, 0.2)  # m and rad
WALL_PUSH, LAYER_PUSH = 1.5, 0.7  # N
SIZE = len(CONTACT_SIGNALS)


@pytest.fixture(scope="module")
def traces() -> dict[str, np.ndarray]:
    """Two rows of the second item: the gripper empty over the feeder, then with the item."""
    n = SCENARIO.ARM.num_joints
    q = joint_positions(np.array(ENDPOINT), "positive")
    inwards = -np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    nugget = SCENARIO.nuggets[1]
    c, s = np.cos(AZIMUTH), np.sin(AZIMUTH)
    out, down = nugget.wall_point[0], nugget.wall_point[2]
    wall_point = np.add(ENDPOINT[:3], (c * out, s * out, down))
    ones = {name: np.ones(2) for name in ("state", "mode", "item", "grip", "finished")}
    contact = np.tile(0.01 * np.arange(2.0 * SIZE), (2, 1))
    outputs = ones | {
        "held": np.array([0.0, 1.0]),
        "scene": np.array([2.0, 3.0]),
        "encoders": np.tile([*q, *np.arange(1.0, n + 1)], (2, 1)),
        "torque": np.tile(np.arange(n) + 0.5, (2, 1)),
        "desired_position": np.tile(np.arange(7) + 0.25, (2, 1)),
        "tip": np.array([[*ENDPOINT[:3], 0, 0, 0], [*wall_point, 0, 0, 0]]),
        "contact": contact,
        "contact_force": np.array(
            [[0.7, 0.4, 5.0, *0 * up], [*WALL_PUSH * inwards + 0.4 * up, *LAYER_PUSH * up]]
        ),
        "measured_force": np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0], (2, 1)),
        "desired_force": np.tile([1.1, 1.2, 1.3, 0.0, 0.0, 0.0, 0.0], (2, 1)),
        "layer_shift": np.array([[0.0, 0.0], [3e-4, 4e-4]]),
        "below": np.tile([0.0, 0.6, -0.8], (2, 1)),
        "layer_deviation": np.array([[0.2], [0.1]]),
    }
    return traces_of(SCENARIO, Run(time=np.array([0.0, 0.005]), outputs=outputs))


def test_forces_are_those_on_what_the_scene_has(traces: dict[str, np.ndarray]) -> None:
    np.testing.assert_allclose(traces["feeder_force"], [5.0, 0.0])
    # Along the wall's normal alone: friction, which carries the item, is none of it.
    np.testing.assert_allclose(traces["wall_force"], [0.0, WALL_PUSH])
    np.testing.assert_allclose(traces["layer_force"], [0.0, LAYER_PUSH])


def test_other_contact_signals_are_of_their_own_point(traces: dict[str, np.ndarray]) -> None:
    peak, gap = CONTACT_SIGNALS.index("peak_force"), CONTACT_SIGNALS.index("gap")
    np.testing.assert_allclose(traces["feeder_peak_force"], [0.01 * peak, 0.0])
    np.testing.assert_allclose(traces["wall_peak_force"], [0.0, 0.01 * peak])
    np.testing.assert_allclose(traces["layer_peak_force"], [0.0, 0.01 * (SIZE + peak)])
    # What is not there is far, not touched.
    assert traces["wall_gap"][0] > 0.5 < traces["layer_gap"][0]
    assert traces["feeder_gap"][1] > 0.5
    np.testing.assert_allclose(traces["layer_gap"][1], 0.01 * (SIZE + gap))


def test_grip_point_is_the_tip_without_its_offset(traces: dict[str, np.ndarray]) -> None:
    found = np.stack([traces[f"nugget_{axis}"] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(found, [ENDPOINT[:3]] * 2, atol=1e-12)


def test_coordinates_joints_and_shift_have_their_columns(traces: dict[str, np.ndarray]) -> None:
    for i, name in enumerate(SCENARIO.ARM.coordinates):
        assert traces[name][0] == pytest.approx(ENDPOINT[i], abs=1e-9)
        assert traces[f"desired_{name}"][0] == i + 0.25
    last = SCENARIO.ARM.joint_names[-1]
    assert traces[f"{last}.velocity"][0] == SCENARIO.ARM.num_joints
    assert traces[f"{last}.torque"][0] == SCENARIO.ARM.num_joints - 0.5
    np.testing.assert_allclose(traces["layer_shift"], [0.0, 5e-4])
    assert (traces["measured_force_z"][0], traces["desired_force_y"][0]) == (0.3, 1.2)
    # What is pressed into, turned outwards; nothing is met, and level is what is not met.
    assert (traces["normal_y"][1], traces["normal_z"][1]) == (-0.6, 0.8)
    assert (traces["true_normal_y"][1], traces["true_normal_z"][1]) == (0.0, 1.0)
    np.testing.assert_allclose(traces["normal_deviation"], [0.2, 0.1])


STATION = Station()
NUGGET = nugget_of(0.14)
NAMES = ("acquire.descend", "scan.pass", "slew.over", "wall.slide", "wall.lost", "wall.set_down")


def made(states: Sequence[int], **columns: Sequence[float]) -> dict[str, np.ndarray]:
    """Return traces in which nothing happens but what is told, a row a tenth of a second."""
    n = len(states)
    names = ["item", "layer_shift", *ADEPT_WRIST.coordinates]
    spaces = ("nugget", "desired", "normal", "true_normal")
    names += [f"{what}_{axis}" for what in spaces for axis in "xyz"]
    for place in ("feeder", "wall", "layer"):
        names += [f"{place}_{what}" for what in ("force", "gap", "peak_force", "impact_speed")]
    traces = {name: np.zeros(n) for name in names}
    traces |= {"time": 0.1 * np.arange(n), "state": np.array(states, dtype=float)}
    traces |= {"normal_z": np.ones(n), "true_normal_z": np.ones(n)}
    return traces | {name: np.array(values, dtype=float) for name, values in columns.items()}


def measured(traces: dict[str, np.ndarray]) -> dict[str, float]:
    item = Item("wall", NUGGET, (0.0, 0.0, 0.0), 0.0)
    return item_limits(traces, NAMES, item, 0, STATION)


@pytest.mark.parametrize(("kind", "error"), [("wall", 0.3), ("crown", 0.5)])
def test_the_normal_s_error_is_along_the_wall_at_the_wall(kind: str, error: float) -> None:
    # Off by 0.3 rad along the wall, which is at +x; with what it is off across it by 0.5.
    across = math.sqrt((math.cos(0.3) / math.cos(0.5)) ** 2 - 1)
    normal = np.array([across, math.sin(0.3), math.cos(0.3)]) / math.hypot(1.0, across)
    columns = {f"true_normal_{axis}": [one] * 2 for axis, one in zip("xyz", normal, strict=True)}
    item = Item(kind, NUGGET, (0.0, 0.0, 0.0), 0.0)
    names = ("crown.set_down", *NAMES[1:])
    rows = made([NAMES.index("wall.set_down") if kind == "wall" else 0] * 2, **columns)
    found = item_limits(rows, names, item, 0, STATION)
    assert found[f"{kind}.normal_error"] == pytest.approx(error, abs=1e-9)


def test_what_was_not_reached_is_missing() -> None:
    found = measured(made([0, 0, 0]))
    assert "acquire.descent_speed" in found
    assert "acquire.grip_force" not in found  # it was not gripped
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


VISITS = (  # item and state, a row each
    *((0, name) for name in ("acquire.grip", "slew.over", "wall.slide", "retreat.up")),
    *((1, name) for name in ("acquire.touch", "acquire.grip", "slew.over")),
)


@pytest.fixture(scope="module")
def scenario() -> CrucibleChargingScenario:
    plan = (PlanItem(azimuth=0.3), PlanItem(kind="crown", mass=0.14, azimuth=1.0))
    return resolve_charging(CrucibleChargingScenario(plan=plan))


@pytest.fixture(scope="module")
def run(scenario: CrucibleChargingScenario) -> ChargingRun:
    names = chart_of(scenario).state_names
    traces = made(
        [names.index(name) for _, name in VISITS],
        item=[item for item, _ in VISITS],
        feeder_peak_force=[3.0, 0, 0, 0, 4.0, 5.0, 0],
        wall_force=[9.0, 9.0, 0.8, 9.0, 9.0, 9.0, 9.0],
    )
    targets = np.array(["slew.over", "retreat.up", "acquire.touch", "stopped"])
    return ChargingRun(traces, {"target": targets}, "off its path")


def test_each_item_is_measured_in_its_own_rows(
    scenario: CrucibleChargingScenario, run: ChargingRun
) -> None:
    first, second = measure(scenario, run)
    assert (first["acquire.grip_force"], second["acquire.grip_force"]) == (3.0, 5.0)
    assert first["wall.slide_force_min"] == 0.8
    assert not any(name.startswith("wall.") for name in second)


def test_the_worst_is_the_most_or_the_least() -> None:
    items = (
        {"acquire.grip_force": 3.0, "slew.clearance": 0.02, "wall.slide_force_min": 0.3},
        {"acquire.grip_force": 5.0, "slew.clearance": 0.01},
    )
    plan = tuple(PlanItem(kind=kind) for kind in ("wall", "wall"))
    found = worst(plan, items)
    assert list(found) == [
        name
        for name in LIMITS
        if not name.startswith(("crown.", "bulk."))  # not in the plan
    ]
    assert found["acquire.grip_force"].value == 5.0
    assert found["slew.clearance"].value == 0.01
    slide = found["wall.slide_force_min"]
    assert (slide.value, slide.unit, slide.note) == (0.3, "N", "by item: 0.3, -")
    missed = found["wall.position_error"]
    assert (missed.value, missed.note) == (None, "no item came to it")


@pytest.mark.parametrize(
    ("column", "value", "broken"),
    [
        ("layer_shift", 0.0004, set()),
        ("layer_shift", 0.0126, {"wall.layer_shift"}),
        ("wall_peak_force", 3.1, {"wall.slide_force", "wall.peak_force"}),
    ],
)
def test_a_limit_that_is_broken_is_said_whatever_the_scenario(
    column: str, value: float, broken: set[str]
) -> None:
    states = [NAMES.index(name) for name in ("wall.slide", "wall.slide", "wall.set_down")]
    found = measured(made(states, wall_force=[1.0] * 3, **{column: [0.0, value, 0.0]}))
    checks = check(CHARGING, worst((PlanItem(),), (found,)), default=False)
    assert not {one.published.metric for one in checks} & {"crown.layer_shift"}  # not planned
    assert {one.published.metric for one in checks if one.measured is None} == {
        one.metric for one in CHARGING if one.metric.startswith(("acquire.", "scan.", "slew."))
    } | {"wall.approach_speed"}  # did not happen, which is not within limits
    measured_ones = [one for one in checks if one.measured is not None]
    assert {one.published.metric for one in measured_ones if not one.ok} == broken


def test_what_lies_elsewhere_is_not_placed() -> None:
    items = (
        {"wall.position_error": 0.009, "slew.position_error": 0.001},
        {"crown.position_error": 0.011},
        {"slew.position_error": 0.001},
    )
    assert placed(items) == 1


def test_a_run_says_how_many_it_laid_and_why_it_stopped(
    scenario: CrucibleChargingScenario, run: ChargingRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crucible_charging, "run_charging", lambda *_: run)
    monkeypatch.setattr(crucible_charging, "charging_stability", lambda _: None)
    outcome = crucible_charging.run_crucible_charging(scenario, 0, lambda *_: None)
    laid = outcome.metrics["cycle.laid"]
    assert (laid.value, laid.note) == (1, "off its path")
    assert outcome.metrics["cycle.time"].value == outcome.simulated_seconds == pytest.approx(0.6)
    table = outcome.tables["nuggets"]
    assert (table["kind"].tolist(), table["mass"].tolist()) == (["wall", "crown"], [0.085, 0.14])
    np.testing.assert_array_equal(table["wall.slide_force_min"], [0.8, np.nan])
