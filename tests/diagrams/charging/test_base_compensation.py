"""Friction compensation by a base sensor: what is filled in, and what it may know."""

from dataclasses import asdict, replace

import pytest

from chamfer.diagrams.charging.charging_loop import make_charging_diagram
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario, resolve
from chamfer.diagrams.charging.wrist_control import BaseCompensationParams
from chamfer.models.charging.packing import PlanItem
from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_sensor import BaseSensorParams

WALL = CrucibleChargingScenario(plan=(PlanItem(kind="wall", azimuth=0.3),), sensing="realistic")


def test_a_sensor_under_the_base_is_filled_in_and_its_joints_are_checked() -> None:
    given = BaseCompensationParams(sensor=BaseSensorParams(noise=3.0))
    found = resolve(replace(WALL, friction_compensation=given))
    assert found.friction_compensation is not None
    sensor = found.friction_compensation.sensor
    assert sensor.noise == 3.0
    assert None not in asdict(sensor).values()
    with pytest.raises(ParameterError, match=r"^rest_speed is -1"):
        BaseCompensationParams(rest_speed=-1.0)
    wrong = replace(given, joints=(7,))
    with pytest.raises(ParameterError, match=r"^friction_compensation.joints is \(7,\)"):
        resolve(replace(WALL, friction_compensation=wrong))


def test_torques_are_resolved_from_what_the_base_sensor_and_the_encoders_read() -> None:
    compensated = replace(WALL, friction_compensation=BaseCompensationParams())
    diagram = make_charging_diagram(compensated)
    wires = {
        (source.get_name(), source.get_output_port(output).get_name(), target.get_name())
        for (target, _), (source, output) in diagram.connection_map().items()
    }
    world = "manipulator and contact"
    assert ("commanded torque", "sum", "friction compensation") in wires
    assert {wire[:2] for wire in wires if wire[2] == "base wrench to torque"} == {
        ("base force sensor", "reading"),
        ("homing", "encoders"),
    }
    assert (world, "base_wrench", "base force sensor") in wires
    assert {wire[:2] for wire in wires if wire[2] == "joints to move"} == {
        ("homing", "encoders"),
        ("path", "desired_velocity"),
    }
    assert ("joints to move", "moving", "friction compensation") in wires
    # Not the ideal torque that the world could give.
    assert not any(wire[:2] == (world, "base_torque") for wire in wires)
