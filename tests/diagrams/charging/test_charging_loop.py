"""How the charging loop is wired, and what its cycle may know."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from chamfer.diagrams.charging.charging_loop import make_charging_diagram
from chamfer.diagrams.charging.charging_scenario import (
    CrucibleChargingScenario,
    FaultParams,
    make_scenes,
    resolve_charging,
)
from chamfer.diagrams.charging.wrist_control import BaseCompensationParams
from chamfer.models.charging.packing import PlanItem
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_sensor import BaseSensorParams

ONE = CrucibleChargingScenario(plan=(PlanItem(mass=0.14, azimuth=0.4),))
WORLD = "manipulator and contact"


def test_cycle_knows_the_world_by_its_sensors_alone(wires: Any) -> None:
    diagram = make_charging_diagram(resolve_charging(replace(ONE, sensing="realistic")))
    seen = {wire[1:3] for wire in wires(diagram) if wire[0] == WORLD}
    assert seen == {
        ("encoders", "encoders"),
        ("tool_force", "force sensor"),
        ("contact", "grasp"),
        ("contact_force", "force on the layer"),
        ("tip", "tip on the layer"),
    }
    sources = {wire[0] for wire in wires(diagram) if wire[2] == "charging chart"}
    sensed = {"path", "endpoint motion", "tare", "mean force", "homing", "grasp"}
    assert sources == {*sensed, "surface observer"}
    observed = {wire[0] for wire in wires(diagram) if wire[2] == "along the wall"}
    assert observed == {"mean force", "mean motion", "charging chart"}
    blind = make_charging_diagram(resolve_charging(replace(ONE, observer=None)))
    assert {wire[0] for wire in wires(blind) if wire[2] == "charging chart"} == sensed
    assert {wire[1] for wire in wires(diagram) if wire[0] == "grasp"} == {"scene", "held"}


@pytest.mark.parametrize(
    ("kind", "wire"),
    [
        ("halt", ("fault", "active", "charging chart", "halt")),
        ("part_dropped", ("fault", "active", "grasp", "drop")),
        ("sensor_dead", ("sensor's line", "alive", "charging chart", "alive")),
        ("contact_lost", ("blow", "y0", WORLD, "disturbance")),
    ],
)
def test_faults_act_where_they_should(
    kind: str, wire: tuple[str, str, str, str], wires: Any
) -> None:
    fault = FaultParams(kind=kind, state="wall.slide")  # type: ignore[arg-type]
    assert wire in wires(make_charging_diagram(resolve_charging(replace(ONE, fault=fault))))


def test_blow_takes_the_nugget_off_the_wall() -> None:
    fault = FaultParams(kind="contact_lost", state="wall.slide", force=4.0)
    blow = make_charging_diagram(resolve_charging(replace(ONE, fault=fault))).GetSubsystemByName(
        "blow"
    )
    azimuth = ONE.plan[0].azimuth
    away = [[-4.0 * np.cos(azimuth)], [-4.0 * np.sin(azimuth)], [0.0]]
    np.testing.assert_allclose(blow.D(), away, rtol=0, atol=1e-12)


def test_item_at_its_place_touches_wall_and_layer() -> None:
    scenario = resolve_charging(ONE)
    _, held = make_scenes(scenario)
    nugget, station = scenario.nuggets[0], scenario.station.true
    middle = station.place(0.4, station.crucible_radius - nugget.reach)
    grip = np.array([*middle, station.bed_height + nugget.height])
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for point in held.points:
        at = grip + turn @ np.array(point.offset)
        assert locate(point.surface, at).gap == pytest.approx(0.0, abs=1e-12)
    assert held.load is not None
    assert held.load.mass == scenario.plan[0].mass


def test_item_at_its_place_touches_what_was_laid_and_that_is_drawn() -> None:
    laid = (PlanItem(kind="crown", azimuth=0.4, radius=0.1, tilt=0.3, tilt_azimuth=1.0),)
    plan = (PlanItem(kind="crown", azimuth=0.4, radius=0.105),)
    scenario = resolve_charging(replace(ONE, plan=plan, laid=laid))
    (goal,), layer = scenario.places(believed=False), make_scenes(scenario)[1].points[1].surface
    lowest = np.array([*goal.position, goal.layer])
    found = locate(layer, lowest)
    assert found.gap == pytest.approx(0.0, abs=1e-12)
    assert found.normal[2] < 0.99
    # As far over the bed as the nugget that is drawn is high there, to within its tilt.
    (drawn,) = goal.laid
    assert 0 < drawn.middle[2] + drawn.nugget.semi_axes[2] - goal.layer < 2e-3


@pytest.mark.parametrize("kind", ["part_missing", "wall_missing", "layer_missing"])
def test_what_is_missing_is_not_there(kind: str) -> None:
    fault = FaultParams(kind=kind)  # type: ignore[arg-type]
    station = ONE.station.true
    at = {
        "part_missing": np.add(station.feeder, (0.0, 0.0, 0.01)),
        "wall_missing": np.array([*station.place(0.4, station.crucible_radius), 0.4]),
        "layer_missing": np.array([*station.crucible_centre, station.bed_height]),
    }[kind]
    index, point = {"part_missing": (0, 0), "wall_missing": (1, 0), "layer_missing": (1, 1)}[kind]
    gaps = [
        locate(make_scenes(one)[index].points[point].surface, at).gap
        for one in (ONE, replace(ONE, fault=fault))
    ]
    assert gaps[0] <= 1e-12
    assert gaps[1] >= 0.01 - 1e-12


WALL = CrucibleChargingScenario(plan=(PlanItem(kind="wall", azimuth=0.3),), sensing="realistic")


def test_a_sensor_under_the_base_is_filled_in_and_its_joints_are_checked() -> None:
    given = BaseCompensationParams(sensor=BaseSensorParams(noise=3.0))
    found = resolve_charging(replace(WALL, friction_compensation=given))
    assert found.friction_compensation is not None
    sensor = found.friction_compensation.sensor
    assert sensor.noise == 3.0
    assert None not in asdict(sensor).values()
    wrong = replace(given, joints=(7,))
    with pytest.raises(ParameterError, match=r"^friction_compensation.joints is \(7,\)"):
        resolve_charging(replace(WALL, friction_compensation=wrong))


def test_torques_are_resolved_from_what_the_base_sensor_and_the_encoders_read(wires: Any) -> None:
    compensated = replace(WALL, friction_compensation=BaseCompensationParams())
    diagram = make_charging_diagram(resolve_charging(compensated))
    found = {wire[:3] for wire in wires(diagram)}
    assert ("commanded torque", "sum", "friction compensation") in found
    assert {wire[:2] for wire in found if wire[2] == "base wrench to torque"} == {
        ("base force sensor", "reading"),
        ("homing", "encoders"),
    }
    assert (WORLD, "base_wrench", "base force sensor") in found
    assert {wire[:2] for wire in found if wire[2] == "joints to move"} == {
        ("homing", "encoders"),
        ("path", "desired_velocity"),
    }
    assert ("joints to move", "moving", "friction compensation") in found
    # Not the ideal torque that the world could give.
    assert not any(wire[:2] == (WORLD, "base_torque") for wire in found)
