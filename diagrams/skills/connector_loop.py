"""A skill inserts a connector: primitives, accommodation, carriage, gripper and contact (Fig. 4).

Source: Morrow, Nelson and Khosla, section 4. The strategy commands ``V_cmd``; accommodation
perturbs it, ``V_ref``; the carriage follows it. World frame: origin in the middle of the socket's
face, Z up, against the direction of insertion. The paper prints no parameters: all are assumed.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    MultibodyPlant,
)
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import (
    Adder,
    LogVectorOutput,
    MatrixGain,
    PassThrough,
)

from chamfer.diagrams.cell.sprung_tool import add_springs
from chamfer.diagrams.contact.sensing import add_sensor
from chamfer.diagrams.skills.connector_scenario import ResolvedConnectorScenario
from chamfer.diagrams.skills.connector_sight import add_sight
from chamfer.diagrams.skills.robots import add_carriage, add_wam
from chamfer.models.arms.wrist import (
    SIZE,
    WristParams,
    add_wrist,
    in_joint_order,
    moved,
)
from chamfer.models.connectors.connector import Connector, ContactMaterial, ConvexPiece, add_pieces
from chamfer.models.validation import ParameterError, within
from chamfer.systems.contact.contact_approximation import Approximation, approximate
from chamfer.systems.force.accommodation import AccommodationController
from chamfer.systems.force.admittance import AdmittanceController
from chamfer.systems.force.arm_model import TruePose
from chamfer.systems.ports import require_ports
from chamfer.systems.primitives.carriage import DivergenceGuard, PartGripper, add_gripper
from chamfer.systems.primitives.primitive import sensed_signals
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_law import check_forces
from chamfer.systems.primitives.skill_machine import SkillMachine
from chamfer.systems.sensing.force_sensor import Tare
from chamfer.systems.strategies.grasp_and_transport import PARTS

LOADS: Final = "loads"  # the block that logs the true wrench at every step of the plant
# Sizes and largest elements, N and N m, or rad, m, rad/s and m/s, of what is no divergence.
_PHYSICAL: Final = {"wrench": (SIZE, 1e4), "displacement": (2 * SIZE, 1e3)}

# What a skill tells all others, and its size.
_DECISIONS: Final = {
    **dict.fromkeys(("velocity", "damping"), SIZE),
    **dict.fromkeys(("closed", "looks", "tares", "retries", "state"), 1),
}


def make_connector_diagram(
    scenario: ResolvedConnectorScenario,
    skill: Skill | LeafSystem | None = None,
    *,
    controller: LeafSystem | None = None,
) -> Diagram:
    """Return the loop of a skill that inserts a connector.

    Outputs:

    - ``V_cmd`` and ``V_ref``, shape (6,), rad/s above m/s.
    - ``wrench``, shape (6,), N m above N: measured and tared.
    - ``carriage``, shape (6,), rad above m.
    - ``plug``, shape (12,): true displacement of the tip, rad above m, and its rate.
    - ``true_wrench``, shape (6,): true contact wrench of the plug.
    - ``holding``, ``retries`` and ``state``.

    Args: scenario: Robot, wrist, sensors and part. skill: The skill to run; None: the part's own
        strategy. Your own block has all ports of a
        :class:`~chamfer.systems.primitives.skill_machine.SkillMachine` but ``cross_section``, and
        outputs that don't follow its inputs at once. Without cameras the plug is held from the
        start. controller: Your own law in place of accommodation. Its inputs are ``command``,
        V_cmd, rad/s above m/s, ``wrench`` on the tool, N m above N, and ``damping``. The skill's
        state sets the damping, N m s/rad above N s/m, 0 for the law's own. Its outputs are
        ``velocity``, V_ref, and ``perturbed``, the command that it was computed from; shape (6,)
        each. As accommodation it updates by an unrestricted event, before which the skill's
        command of the same tick does not come.

    Raises:
        ChartError: If the skill can't be run.
        ParameterError: If the part has no strategy, or your own block lacks one of these ports.
    """
    skill = skill or scenario.make_skill()
    connector, period = scenario.connector, scenario.accommodation.period
    if isinstance(skill, Skill):
        check_forces(skill, scenario.accommodation.damping, connector)
        for state in skill.states:
            with within(f"skill {skill.name!r}: {state.name!r}"):
                scenario.accommodation.with_damping(state.damping or ())
        held = skill.held
        decides: LeafSystem = SkillMachine(skill, parts=PARTS, period=period)
    else:
        inputs = {name: one.size for name, one in sensed_signals(PARTS).items()}
        del inputs["cross_section"]
        require_ports("skill", skill, inputs=inputs, outputs=_DECISIONS)
        held, decides = scenario.sight is None, skill
    if controller is None:
        gives = scenario.accommodation
        block = AccommodationController if gives.is_accommodation else AdmittanceController
        controller = block(gives)
    else:
        require_ports(
            "controller",
            controller,
            inputs=dict.fromkeys(("command", "wrench", "damping"), SIZE),
            outputs=dict.fromkeys(("velocity", "perturbed"), SIZE),
        )
    builder = DiagramBuilder()
    connect = builder.Connect
    start, resting = scenario.start, scenario.resting
    plant = add_connector_plant(
        builder,
        connector,
        scenario.wrist,
        X_WS=RigidTransform(),
        X_TP=scenario.plug_in_tool,
        start=resting,
        step=scenario.step,
        approximation=scenario.approximation,
        obstacle=scenario.obstacle,
    )
    guard = builder.AddNamedSystem(
        "divergence", DivergenceGuard("connectors", limits=_PHYSICAL, period=period)
    )
    connect(plant.wrench, guard.GetInputPort("wrench"))
    connect(plant.displacement, guard.GetInputPort("displacement"))
    machine = builder.AddNamedSystem("skill", decides)
    accommodation = builder.AddNamedSystem("accommodation", controller)
    if scenario.robot == "carriage":
        robot = add_carriage(builder, start, scenario.step)
    else:
        robot = add_wam(builder, scenario.arm, scenario.impedance, start, scenario.step)
    gripper = add_gripper(
        builder,
        PartGripper(scenario.gripper, resting=resting, offset=resting - start if held else None),
        carriage=robot.motion,
        closed=machine.GetOutputPort("closed"),
    )
    sensor = scenario.sensor
    channels = add_sensor(
        builder, "", sensor, sensor.gauges, plant.wrench, step=scenario.step, period=period
    )
    reading = builder.AddNamedSystem(
        "wrist sensor's reading", MatrixGain(scenario.believed_sensor.undoing)
    )
    tare = builder.AddNamedSystem("tare", Tare(period=period, size=SIZE))
    wrench = tare.GetOutputPort("tared_force")
    tip = builder.AddNamedSystem("tip by encoders and stiffness", Adder(2, SIZE))
    given_way = builder.AddNamedSystem(
        "deflection of the wrist", MatrixGain(scenario.believed_wrist.compliance)
    )
    connect(channels, reading.get_input_port())
    connect(reading.get_output_port(), tare.GetInputPort("force"))
    connect(machine.GetOutputPort("tares"), tare.GetInputPort("tare"))
    connect(tare.GetOutputPort("spread"), machine.GetInputPort("spread"))
    connect(machine.GetOutputPort("velocity"), accommodation.GetInputPort("command"))
    connect(machine.GetOutputPort("damping"), accommodation.GetInputPort("damping"))
    connect(wrench, accommodation.GetInputPort("wrench"))
    connect(accommodation.GetOutputPort("velocity"), robot.velocity)
    if robot.reaction is not None:
        connect(plant.wrench, robot.reaction)
    if scenario.gripper.senses:
        part_sensor = builder.AddNamedSystem("gripper's part sensor", PassThrough(1))
        connect(gripper.holding, part_sensor.get_input_port())
        connect(part_sensor.get_output_port(), machine.GetInputPort("holding"))
    touched = add_weight(builder, plant, connector.mass, gripper.holding)
    connect(gripper.part, plant.desired)
    connect(wrench, given_way.get_input_port())
    connect(robot.encoders, tip.get_input_port(0))
    connect(given_way.get_output_port(), tip.get_input_port(1))
    connect(tip.get_output_port(), machine.GetInputPort("carriage"))
    connect(wrench, machine.GetInputPort("wrench"))
    connect(accommodation.GetOutputPort("velocity"), machine.GetInputPort("motion"))
    connect(accommodation.GetOutputPort("perturbed"), machine.GetInputPort("perturbed"))
    if scenario.sight is not None:
        add_sight(
            builder,
            scenario.sight,
            connector,
            X_TP=scenario.plug_in_tool,
            motion=robot.motion,
            tool_pose=plant.plug_pose,
            trigger=machine.GetOutputPort("looks"),
            detections={
                "xz": machine.GetInputPort("xz_detections"),
                "yz": machine.GetInputPort("yz_detections"),
            },
        )
    for name, port in (
        ("V_cmd", machine.GetOutputPort("velocity")),
        ("V_ref", accommodation.GetOutputPort("velocity")),
        ("wrench", wrench),
        ("carriage", robot.encoders),
        ("plug", plant.displacement),
        ("true_wrench", touched),
        ("holding", gripper.holding),
        ("retries", machine.GetOutputPort("retries")),
        ("state", machine.GetOutputPort("state")),
    ):
        builder.ExportOutput(port, name)
    loads = LogVectorOutput(touched, builder, publish_period=scenario.step)
    loads.set_name(LOADS)
    diagram = builder.Build()
    diagram.set_name(f"Insertion of a {connector.name}")
    return diagram


_OBSTACLE: Final = ContactMaterial(stiffness=1e6, dissipation=20.0, friction=0.2)


class ConnectorPlant(NamedTuple):
    """The ports that :func:`add_connector_plant` adds."""

    plant: MultibodyPlant
    desired: InputPort  # displacement of the tip, rad above m, and its rate, shape (12,)
    wrench: OutputPort  # of the tool on the wrist's springs, about the tip, N m above N, (6,)
    displacement: OutputPort  # of the tip and its rate, shape (12,); for logs alone
    plug_pose: OutputPort  # of the tool's frame, shape (7,); for cameras and logs alone


def add_connector_plant(
    builder: DiagramBuilder,
    connector: Connector,
    wrist: WristParams,
    *,
    X_WS: RigidTransform,
    X_TP: RigidTransform,
    start: NDArray[np.float64] | None = None,
    step: float = 0.001,
    approximation: Approximation = "tamsi",
    obstacle: float | None = None,
) -> ConnectorPlant:
    """Add a plant in which a carriage in the world's axes holds a plug by the wrist.

    X_WS is the pose of the socket, X_TP that of the plug in the tool's frame: the error of the
    grasp. The tip starts at a displacement, rad above m, shape (6,), by default 0. An obstacle
    is in the way at a depth in the socket, m. The plant's step is in s.
    """
    if not 0 < step < math.inf:
        raise ParameterError("step", step, "a finite number > 0")
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, step)
    plant.set_name("connectors")
    scene_graph.set_name("geometry")
    approximate(plant, approximation)
    # Springs and poses are known of the state at once: a step copies nothing, all blocks see it
    # as it is at their tick.
    plant.SetUseSampledOutputPorts(False)
    held = add_wrist(plant, plant.world_frame(), wrist)
    connector.add_plug(plant, held.body, X_TP)
    connector.add_socket(plant, X_WS)
    if obstacle is not None:
        _add_obstacle(plant, X_WS, obstacle)
    plant.Finalize()
    if start is not None:
        plant.SetDefaultPositions(held.instance, in_joint_order() @ moved(start, wrist.centre))
    springs = add_springs(builder, plant, held, wrist)
    pose = builder.AddNamedSystem("true pose", TruePose(held.body.index()))
    builder.Connect(plant.get_body_poses_output_port(), pose.get_input_port())
    return ConnectorPlant(plant, *springs, pose.get_output_port())


def add_weight(
    builder: DiagramBuilder, added: ConnectorPlant, mass: float, held: OutputPort
) -> OutputPort:
    """Let the wrist carry the weight of a plug, mass in kg, at its centre while ``held`` is 1.

    Return the contact wrench of the plug, N m above N, (6,): the wrist's, less the weight.
    """
    plant = added.plant
    weight = mass * plant.gravity_field().gravity_vector()[2]  # N, along z
    force = np.zeros((plant.num_velocities(), 1))
    force[plant.GetJointByName("z").velocity_start()] = weight
    carried = builder.AddNamedSystem("weight of the plug", MatrixGain(force))
    rest = builder.AddNamedSystem(
        "support of the plug", MatrixGain(-weight * np.eye(SIZE)[:, -1:])
    )
    touched = builder.AddNamedSystem("what the plug touches", Adder(2, SIZE))
    for gain in (carried, rest):
        builder.Connect(held, gain.get_input_port())
    builder.Connect(carried.get_output_port(), plant.get_applied_generalized_force_input_port())
    builder.Connect(added.wrench, touched.get_input_port(0))
    builder.Connect(rest.get_output_port(), touched.get_input_port(1))
    return touched.get_output_port()


def _add_obstacle(plant: MultibodyPlant, X_WS: RigidTransform, depth: float) -> None:
    """Add a plate all around the socket."""
    size = (0.08, 0.08, 0.002)
    X_SO = RigidTransform([0.0, 0.0, -depth - size[2] / 2])
    plate = [ConvexPiece("obstacle", Box(*size), X_SO)]
    add_pieces(plant, plant.world_body(), X_WS, plate, _OBSTACLE, np.array([0.2, 0.2, 0.2, 1.0]))
