"""The loop that charges a crucible: the chart over the hybrid controller, and the cell."""

import math
from typing import Final

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain

from chamfer.diagrams.charging.charging_scenario import (
    TIMED,
    ResolvedCrucibleChargingScenario,
    beliefs_of,
    make_scenes,
)
from chamfer.diagrams.contact.sensing import (
    add_delay,
    add_encoders,
    add_force_in_world,
    add_sensor,
)
from chamfer.systems.charging.along_wall import AlongWall
from chamfer.systems.charging.charging_machine import ChargingMachine
from chamfer.systems.charging.crucible_world import (
    CutOff,
    FaultTrigger,
    Grasp,
    LayerMotion,
)
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.estimation.surface_observer import SurfaceObserver
from chamfer.systems.force.friction_compensation import (
    BaseWrenchTorque,
    FrictionCompensation,
    JointsToMove,
)
from chamfer.systems.force.hybrid_controller import (
    AccelerationFeedforward,
    HybridController,
    require_hybrid_ports,
)
from chamfer.systems.ports import require_ports
from chamfer.systems.sensing.encoders import EndpointMotion, Homing
from chamfer.systems.sensing.force_rate import ForceRate, MovingAverage
from chamfer.systems.sensing.force_sensor import Tare, base_gauges, gauges
from chamfer.systems.trajectory.path_follower import PathFollower, PathFollowerParams


def make_charging_diagram(
    scenario: ResolvedCrucibleChargingScenario, *, controller: LeafSystem | None = None
) -> Diagram:
    """Build the loop; it exports the state of the cell, and the chart's and controller's outputs.

    The cycle knows the cell only by its beliefs of the station and the nuggets, the encoders, the
    wrist's force sensor and the gripper's part sensor.

    Args:
        scenario: Parameters of the blocks.
        controller: Your own, in place of the
            :class:`chamfer.systems.force.hybrid_controller.HybridController`; with its ports, as
            :func:`chamfer.systems.force.hybrid_controller.require_hybrid_ports` lists them, and
            the input ``desired_velocity`` (7), m/s and rad/s.

    Raises:
        ParameterError: If the controller has other ports.
    """
    arm, control, plant = scenario.ARM, scenario.controller, scenario.plant
    model = scenario.believed_dynamics()
    builder = DiagramBuilder()
    add, connect = builder.AddNamedSystem, builder.Connect

    def wire(source: LeafSystem, target: LeafSystem, *names: str) -> None:
        for name in names:
            connect(source.GetOutputPort(name), target.GetInputPort(name))

    start = arm.joint_positions(scenario.start, scenario.arm.elbow)
    world = add("manipulator and contact", ArmInContact(arm, make_scenes(scenario), plant, start))
    read = add_encoders(
        builder, scenario.encoders, world.GetOutputPort("encoders"), start, period=control.period
    )
    homing = add("homing", Homing(scenario.homing, start, period=control.period))
    connect(read, homing.GetInputPort("motion"))
    encoders = homing.GetOutputPort("encoders")
    torque = add_delay(builder, control, world.GetInputPort("torque"), step=plant.period)
    beliefs = beliefs_of(scenario)
    machine = add("charging chart", ChargingMachine(scenario.charging, beliefs))
    cut = _add_world(builder, scenario, world, machine)
    following = PathFollowerParams(period=control.period)
    follower = add("path", PathFollower(following, np.array(beliefs.start)))
    motion = add("endpoint motion", EndpointMotion(arm, dimension=3))
    tare = add("tare", Tare(period=control.period))
    readings = scenario.charging.detection.readings
    mean = add("mean force", MovingAverage(samples=readings, period=control.period, size=3))
    wrench = add("force in coordinates", MatrixGain(np.eye(arm.num_coordinates, 3)))
    if controller is None:
        controller = HybridController(
            arm, control, dynamics=model if control.full_dynamics else None
        )
    require_hybrid_ports(controller, arm)
    velocity = {"desired_velocity": arm.num_coordinates}
    require_ports("controller", controller, inputs=velocity, outputs={})
    add("hybrid control", controller)
    reading = add_sensor(
        builder,
        "",
        scenario.sensor,
        gauges(scenario.sensor, scenario.nuggets[0].wall_point),
        world.GetOutputPort("tool_force"),
        step=plant.period,
        period=control.period,
    )
    if cut is not None:
        line = add("sensor's line", CutOff(reading.size()))
        connect(reading, line.GetInputPort("signal"))
        connect(cut, line.GetInputPort("cut"))
        wire(line, machine, "alive")
        reading = line.GetOutputPort("reading")
    force = add_force_in_world(builder, scenario.sensor, model, reading, encoders, coordinates=3)
    connect(force, tare.GetInputPort("force"))
    measured = tare.GetOutputPort("tared_force")
    connect(measured, wrench.get_input_port())
    connect(encoders, motion.GetInputPort("encoders"))
    wire(homing, machine, "homed")
    wire(follower, machine, "desired_position", "desired_velocity", "progress")
    wire(motion, machine, "endpoint_motion")
    connect(measured, machine.GetInputPort("measured_force"))
    connect(measured, mean.GetInputPort("signal"))
    connect(mean.GetOutputPort("mean"), machine.GetInputPort("mean_force"))
    if scenario.observer is not None:
        _add_observer(builder, scenario, machine, motion, mean)
    wire(machine, follower, "segment")
    connect(machine.GetOutputPort("hold"), follower.GetInputPort("halt"))
    wire(machine, tare, "tare")
    connect(wrench.get_output_port(), controller.GetInputPort("measured_force"))
    wire(homing, controller, "encoders")
    wire(follower, controller, "desired_position", "desired_velocity")
    wire(machine, controller, "mode", "desired_force", "selection")
    ahead = add(
        "acceleration feed-forward",
        AccelerationFeedforward(
            arm, model, period=control.period, diagonal=not control.full_dynamics
        ),
    )
    wire(homing, ahead, "encoders")
    wire(follower, ahead, "desired_acceleration")
    wire(machine, ahead, "selection")
    total = add("commanded torque", Adder(2, arm.num_joints))
    connect(controller.GetOutputPort("torque"), total.get_input_port(0))
    connect(ahead.GetOutputPort("torque"), total.get_input_port(1))
    command = total.get_output_port()
    if (given := scenario.friction_compensation) is not None:
        reading = add_sensor(
            builder,
            "base ",
            given.sensor,
            base_gauges(given.sensor),
            world.GetOutputPort("base_wrench"),
            step=plant.period,
            period=control.period,
        )
        resolved = add("base wrench to torque", BaseWrenchTorque(model))
        compensation = add(
            "friction compensation",
            FrictionCompensation(given, joints=arm.num_joints, period=control.period),
        )
        moved = add("joints to move", JointsToMove(arm, rest_speed=given.rest_speed))
        wire(homing, moved, "encoders")
        wire(follower, moved, "desired_velocity")
        wire(moved, compensation, "moving")
        connect(reading, resolved.GetInputPort("base_wrench"))
        wire(homing, resolved, "encoders")
        wire(resolved, compensation, "base_torque")
        connect(command, compensation.GetInputPort("command"))
        command = compensation.GetOutputPort("torque")
    connect(command, torque)
    for name in ("encoders", "contact_force", "contact", "tip", "energy"):
        builder.ExportOutput(world.GetOutputPort(name), name)
    builder.ExportOutput(total.get_output_port(), "torque")
    builder.ExportOutput(follower.GetOutputPort("desired_position"), "desired_position")
    builder.ExportOutput(measured, "measured_force")
    for name in ("desired_force", "mode", "state", "item", "finished", "grip", "below"):
        builder.ExportOutput(machine.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("Charging a crucible")
    return diagram


def _add_observer(
    builder: DiagramBuilder,
    scenario: ResolvedCrucibleChargingScenario,
    machine: ChargingMachine,
    motion: EndpointMotion,
    mean: MovingAverage,
) -> None:
    """Add the observer that estimates the normal below from the mean force (chapter 4)."""
    params, period, add = scenario.observer, scenario.controller.period, builder.AddNamedSystem
    connect, readings = builder.Connect, scenario.charging.detection.readings
    assert params is not None
    # The motion is as late as the force.
    moved = add("mean motion", MovingAverage(samples=readings, period=period, size=6))
    along = add("along the wall", AlongWall())
    rate = add("force rate", ForceRate(scenario.force_rate, dimension=3, period=period))
    observer = add("surface observer", SurfaceObserver(params, np.array([0.0, 0.0, 1.0])))
    connect(motion.GetOutputPort("nominal_motion"), moved.GetInputPort("signal"))
    connect(mean.GetOutputPort("mean"), along.GetInputPort("force"))
    connect(moved.GetOutputPort("mean"), along.GetInputPort("motion"))
    connect(machine.GetOutputPort("wall"), along.GetInputPort("wall"))
    force = along.GetOutputPort("force_along")
    connect(force, rate.GetInputPort("measured_force"))
    for source, name in (
        (force, "measured_force"),
        (rate.GetOutputPort("measured_force_rate"), "measured_force_rate"),
        (along.GetOutputPort("motion_along"), "nominal_motion"),
        (machine.GetOutputPort("restart"), "restart"),
    ):
        connect(source, observer.GetInputPort(name))
    connect(observer.GetOutputPort("normal"), machine.GetInputPort("layer_normal"))
    for name in ("normal", "deviation"):
        builder.ExportOutput(observer.GetOutputPort(name), f"layer_{name}")


_LAYER: Final = 1  # index of the contact point that meets the layer below


def _add_world(
    builder: DiagramBuilder,
    scenario: ResolvedCrucibleChargingScenario,
    arm: ArmInContact,
    machine: ChargingMachine,
) -> OutputPort | None:
    """Add gripper, layer and faults about the arm; return the port that cuts the sensor's line."""
    fault, connect, add = scenario.fault, builder.Connect, builder.AddNamedSystem
    contact, forces = arm.GetOutputPort("contact"), arm.GetOutputPort("contact_force")
    item = machine.GetOutputPort("item")
    missing = fault.item if fault.kind == "part_missing" else None
    present = tuple(index != missing for index in range(len(scenario.plan)))
    grasp = add("grasp", Grasp(scenario.grasp, present, contacts=contact.size()))
    connect(contact, grasp.GetInputPort("contact"))
    connect(machine.GetOutputPort("grip"), grasp.GetInputPort("grip"))
    connect(item, grasp.GetInputPort("item"))
    connect(grasp.GetOutputPort("scene"), arm.GetInputPort("scene"))
    connect(grasp.GetOutputPort("held"), machine.GetInputPort("held"))
    for name in ("scene", "held"):
        builder.ExportOutput(grasp.GetOutputPort(name), name)
    layer = add("layer below", LayerMotion(scenario.layer_contact, period=scenario.plant.period))
    tip = arm.GetOutputPort("tip")
    for name, port, size in (("force", forces, 3), ("tip", tip, 6)):
        pick = np.eye(3, port.size(), size * _LAYER)
        picked = add(f"{name} on the layer", MatrixGain(pick))
        connect(port, picked.get_input_port())
        connect(picked.get_output_port(), layer.GetInputPort(name))
    connect(item, layer.GetInputPort("item"))
    builder.ExportOutput(layer.GetOutputPort("shift"), "layer_shift")
    if fault.kind not in TIMED:
        return None
    trigger = add(
        "fault",
        FaultTrigger(
            (machine.chart.state_names.index(fault.state), fault.item),
            delay=fault.delay,
            lasting=fault.lasting,
            period=scenario.controller.period,
        ),
    )
    connect(machine.GetOutputPort("state"), trigger.GetInputPort("state"))
    connect(item, trigger.GetInputPort("item"))
    active = trigger.GetOutputPort("active")
    if fault.kind == "part_dropped":
        connect(active, grasp.GetInputPort("drop"))
    elif fault.kind == "halt":
        connect(active, machine.GetInputPort("halt"))
    elif fault.kind == "contact_lost":
        azimuth = scenario.plan[fault.item].azimuth
        away = -fault.force * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        blow = add("blow", MatrixGain(away[:, np.newaxis]))
        connect(active, blow.get_input_port())
        connect(blow.get_output_port(), arm.GetInputPort("disturbance"))
    return active if fault.kind == "sensor_dead" else None
