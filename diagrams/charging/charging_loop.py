"""The loop that charges a crucible: the chart over the hybrid controller, and the world."""

from typing import Final

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, MatrixGain

from chamfer.diagrams.charging.base_compensation import add_base_compensation
from chamfer.diagrams.charging.charging_cycle import beliefs_of
from chamfer.diagrams.charging.charging_resolve import resolve
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.diagrams.charging.charging_scenes import make_scenes
from chamfer.diagrams.charging.charging_world import add_line, add_world
from chamfer.diagrams.contact.sensing import (
    add_delay,
    add_encoders,
    add_force_in_world,
    add_force_sensor,
)
from chamfer.systems.charging.charging_machine import ChargingMachine
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.force.hybrid_controller import AccelerationFeedforward, HybridController
from chamfer.systems.sensing.encoders import EndpointMotion, Homing
from chamfer.systems.sensing.force_rate import MovingAverage
from chamfer.systems.sensing.force_sensor import Tare
from chamfer.systems.trajectory.path_follower import PathFollower, PathFollowerParams

SIGNALS: Final = (
    "encoders",
    "contact_force",
    "contact",
    "tip",
    "energy",
    "torque",
    "desired_position",
    "desired_force",
    "measured_force",
    "mode",
    "state",
    "item",
    "finished",
    "grip",
    "held",
    "scene",
    "layer_shift",
)


def make_charging_diagram(scenario: CrucibleChargingScenario) -> Diagram:
    """Build the loop; it exports :data:`SIGNALS`.

    The cycle knows the world by what it believes of the station and the nuggets, by the encoders,
    the wrist's force sensor and the gripper's part sensor.

    Raises:
        ParameterError: As :func:`chamfer.diagrams.charging.charging_resolve.resolve`.
    """
    scenario = resolve(scenario)
    arm, control, plant = scenario.ARM, scenario.controller, scenario.plant
    builder = DiagramBuilder()
    add, connect = builder.AddNamedSystem, builder.Connect
    start = arm.joint_positions(scenario.start, scenario.arm.elbow)
    world = add("manipulator and contact", ArmInContact(arm, make_scenes(scenario), plant, start))
    encoders = add_encoders(
        builder,
        scenario.encoders,
        world.GetOutputPort("encoders"),
        start,
        period=control.period,
    )
    homing = add("homing", Homing(scenario.homing, start, period=control.period))
    connect(encoders, homing.GetInputPort("motion"))
    encoders = homing.GetOutputPort("encoders")
    torque = add_delay(builder, control, world.GetInputPort("torque"), step=plant.period)
    beliefs = beliefs_of(scenario)
    machine = add("charging chart", ChargingMachine(scenario.charging, beliefs))
    cut = add_world(builder, scenario, world, machine)
    following = PathFollowerParams(period=control.period)
    follower = add("path", PathFollower(following, np.array(beliefs.start)))
    motion = add("endpoint motion", EndpointMotion(arm, dimension=3))
    tare = add("tare", Tare(period=control.period))
    readings = scenario.charging.detection.readings
    mean = add("mean force", MovingAverage(samples=readings, period=control.period, size=3))
    wrench = add("force in coordinates", MatrixGain(np.eye(arm.num_coordinates, 3)))
    controller = add(
        "hybrid control", HybridController(arm, control, dynamics=scenario.dynamics())
    )
    reading = add_force_sensor(
        builder,
        scenario.sensor,
        world.GetOutputPort("tool_force"),
        scenario.nuggets[0].wall_point,
        step=plant.period,
        period=control.period,
    )
    force = add_force_in_world(
        builder,
        scenario.sensor,
        scenario.dynamics(),
        add_line(builder, reading, machine, cut),
        encoders,
        coordinates=3,
    )
    connect(force, tare.GetInputPort("force"))
    measured = tare.GetOutputPort("tared_force")
    connect(measured, wrench.get_input_port())
    connect(encoders, motion.GetInputPort("encoders"))
    connect(homing.GetOutputPort("homed"), machine.GetInputPort("homed"))
    out = machine.GetOutputPort
    for name in ("desired_position", "desired_velocity", "progress"):
        connect(follower.GetOutputPort(name), machine.GetInputPort(name))
    connect(motion.GetOutputPort("endpoint_motion"), machine.GetInputPort("endpoint_motion"))
    connect(measured, machine.GetInputPort("measured_force"))
    connect(measured, mean.GetInputPort("signal"))
    connect(mean.GetOutputPort("mean"), machine.GetInputPort("mean_force"))
    connect(out("segment"), follower.GetInputPort("segment"))
    connect(out("hold"), follower.GetInputPort("halt"))
    connect(out("tare"), tare.GetInputPort("tare"))
    connect(encoders, controller.GetInputPort("encoders"))
    connect(wrench.get_output_port(), controller.GetInputPort("measured_force"))
    for name in ("desired_position", "desired_velocity"):
        connect(follower.GetOutputPort(name), controller.GetInputPort(name))
    for name in ("mode", "desired_force", "selection"):
        connect(out(name), controller.GetInputPort(name))
    ahead = add(
        "acceleration feed-forward",
        AccelerationFeedforward(arm, scenario.dynamics(), period=control.period),
    )
    for source, name in (
        (encoders, "encoders"),
        (follower.GetOutputPort("desired_acceleration"), "desired_acceleration"),
        (out("selection"), "selection"),
    ):
        connect(source, ahead.GetInputPort(name))
    total = add("commanded torque", Adder(2, arm.num_joints))
    connect(controller.GetOutputPort("torque"), total.get_input_port(0))
    connect(ahead.GetOutputPort("torque"), total.get_input_port(1))
    command = total.get_output_port()
    if scenario.friction_compensation is not None:
        command = add_base_compensation(
            builder,
            scenario.friction_compensation,
            scenario.dynamics(),
            command,
            world.GetOutputPort("base_wrench"),
            encoders,
            follower.GetOutputPort("desired_velocity"),
            step=plant.period,
            period=control.period,
        )
    connect(command, torque)
    for name in ("encoders", "contact_force", "contact", "tip", "energy"):
        builder.ExportOutput(world.GetOutputPort(name), name)
    builder.ExportOutput(total.get_output_port(), "torque")
    builder.ExportOutput(follower.GetOutputPort("desired_position"), "desired_position")
    builder.ExportOutput(measured, "measured_force")
    for name in ("desired_force", "mode", "state", "item", "finished", "grip"):
        builder.ExportOutput(out(name), name)
    diagram = builder.Build()
    diagram.set_name("Charging a crucible")
    return diagram
