"""The loop that charges a crucible: the chart over the hybrid controller, and the world."""

import math
from typing import Final

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain

from chamfer.diagrams.charging.charging_scenario import (
    ResolvedCrucibleChargingScenario,
    beliefs_of,
    make_scenes,
)
from chamfer.diagrams.charging.wrist_control import add_base_compensation
from chamfer.diagrams.contact.sensing import (
    add_delay,
    add_encoders,
    add_force_in_world,
    add_sensor,
)
from chamfer.systems.charging.charging_chart import ChargingMachine
from chamfer.systems.charging.crucible_world import (
    CutOff,
    FaultTrigger,
    FaultTriggerParams,
    Grasp,
    LayerMotion,
    LayerMotionParams,
)
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.force.hybrid_controller import (
    AccelerationFeedforward,
    HybridController,
    require_hybrid_ports,
)
from chamfer.systems.ports import require_ports
from chamfer.systems.sensing.encoders import EndpointMotion, Homing
from chamfer.systems.sensing.force_rate import MovingAverage
from chamfer.systems.sensing.force_sensor import Tare, gauges
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


def make_charging_diagram(
    scenario: ResolvedCrucibleChargingScenario, *, controller: LeafSystem | None = None
) -> Diagram:
    """Build the loop; it exports :data:`SIGNALS`.

    The cycle knows the world by what it believes of the station and the nuggets, by the encoders,
    the wrist's force sensor and the gripper's part sensor.

    Args:
        scenario: What the blocks are like.
        controller: A user's own, in place of the
            :class:`chamfer.systems.force.hybrid_controller.HybridController`; with its ports, as
            :func:`chamfer.systems.force.hybrid_controller.require_hybrid_ports` lists them, and
            the input ``desired_velocity`` (7), m/s and rad/s.

    Raises:
        ParameterError: If the controller's ports are others.
    """
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
    if controller is None:
        controller = HybridController(arm, control, dynamics=scenario.dynamics())
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


LAYER: Final = 1  # index of the contact point that meets the layer below
_TIMED: Final = ("part_dropped", "sensor_dead", "contact_lost", "halt")  # begin in a state


def add_world(
    builder: DiagramBuilder,
    scenario: ResolvedCrucibleChargingScenario,
    arm: ArmInContact,
    machine: ChargingMachine,
) -> OutputPort | None:
    """Add gripper, layer and faults about the arm; return the port that cuts the sensor's line.

    Args:
        builder: Of the loop.
        scenario: What the world is like.
        arm: With the scenario's scenes.
        machine: The chart that commands the gripper.
    """
    fault, connect = scenario.fault, builder.Connect
    missing = fault.item if fault.kind == "part_missing" else None
    contact = arm.GetOutputPort("contact")
    grasp = builder.AddNamedSystem(
        "grasp",
        Grasp(
            scenario.grasp,
            tuple(index != missing for index in range(len(scenario.plan))),
            contacts=contact.size(),
        ),
    )
    connect(contact, grasp.GetInputPort("contact"))
    for name in ("grip", "item"):
        connect(machine.GetOutputPort(name), grasp.GetInputPort(name))
    connect(grasp.GetOutputPort("scene"), arm.GetInputPort("scene"))
    connect(grasp.GetOutputPort("held"), machine.GetInputPort("held"))
    for name in ("scene", "held"):
        builder.ExportOutput(grasp.GetOutputPort(name), name)
    _add_layer(builder, scenario, arm, machine)
    if fault.kind not in _TIMED:
        return None
    active = _add_trigger(builder, scenario, machine)
    if fault.kind == "part_dropped":
        connect(active, grasp.GetInputPort("drop"))
    elif fault.kind == "halt":
        connect(active, machine.GetInputPort("halt"))
    elif fault.kind == "contact_lost":
        azimuth = scenario.plan[fault.item].azimuth
        away = -fault.force * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        blow = builder.AddNamedSystem("blow", MatrixGain(away[:, np.newaxis]))
        connect(active, blow.get_input_port())
        connect(blow.get_output_port(), arm.GetInputPort("disturbance"))
    return active if fault.kind == "sensor_dead" else None


def add_line(
    builder: DiagramBuilder, reading: OutputPort, machine: ChargingMachine, cut: OutputPort | None
) -> OutputPort:
    """Put a line that can be cut behind a sensor, if any; return what the computer reads."""
    if cut is None:
        return reading
    line = builder.AddNamedSystem("sensor's line", CutOff(reading.size()))
    builder.Connect(reading, line.GetInputPort("signal"))
    builder.Connect(cut, line.GetInputPort("cut"))
    builder.Connect(line.GetOutputPort("alive"), machine.GetInputPort("alive"))
    return line.GetOutputPort("reading")


def _add_layer(
    builder: DiagramBuilder,
    scenario: ResolvedCrucibleChargingScenario,
    arm: ArmInContact,
    machine: ChargingMachine,
) -> None:
    given = scenario.layer
    forces = arm.GetOutputPort("contact_force")
    pick = np.zeros((3, forces.size()))
    pick[:, 3 * LAYER : 3 * LAYER + 3] = np.eye(3)
    force = builder.AddNamedSystem("force on the layer", MatrixGain(pick))
    layer = builder.AddNamedSystem(
        "layer below",
        LayerMotion(
            LayerMotionParams(
                stiffness=given.stiffness,
                mass=given.mass,
                friction=given.slip_friction,
                period=scenario.plant.period,
            )
        ),
    )
    builder.Connect(forces, force.get_input_port())
    builder.Connect(force.get_output_port(), layer.GetInputPort("force"))
    builder.Connect(machine.GetOutputPort("item"), layer.GetInputPort("item"))
    builder.ExportOutput(layer.GetOutputPort("shift"), "layer_shift")


def _add_trigger(
    builder: DiagramBuilder, scenario: ResolvedCrucibleChargingScenario, machine: ChargingMachine
) -> OutputPort:
    fault, states = scenario.fault, machine.chart.state_names
    trigger = builder.AddNamedSystem(
        "fault",
        FaultTrigger(
            FaultTriggerParams(
                state=states.index(fault.state),
                item=fault.item,
                delay=fault.delay,
                duration=fault.lasting,
                period=scenario.controller.period,
            )
        ),
    )
    for name in ("state", "item"):
        builder.Connect(machine.GetOutputPort(name), trigger.GetInputPort(name))
    return trigger.GetOutputPort("active")
