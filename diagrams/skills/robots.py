"""The robots that may carry a gripper: an ideal Cartesian carriage, or a WAM.

Both follow a Cartesian velocity, and measure their pose as a displacement, rad above m. The
carriage does so exactly. The WAM is an arm under impedance control whose desired pose is the
velocity's integral; the load of the gripper's springs deflects it.
"""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import LinearSystem, Multiplexer, PassThrough

from chamfer.diagrams.cell.work_cell import CellArmSettings, add_simulated_arm, connect_arm
from chamfer.models.arms.wrist import SIZE, tip_pose
from chamfer.systems.force.arm_model import Placement, ToolForce, ToolParams
from chamfer.systems.force.impedance_controller import ImpedanceController
from chamfer.systems.force.impedance_law import ImpedanceControllerParams
from chamfer.systems.primitives.carriage import CarriedPoses, PoseDisplacement, TrueMotion

Array = NDArray[np.float64]
RobotName = Literal["carriage", "wam"]

# Elbow up, the flange downwards; assumed.
_POSTURE: Final = (0.0, 0.75, 0.0, 1.75, 0.0, 0.64, 0.0)
ARM: Final = CellArmSettings(
    base=Placement(position=(-0.64, 0.017, 0.03)),
    posture=_POSTURE,
    tool=ToolParams(
        mass=0.25,
        centre_of_mass=(0.0, 0.0, 0.05),
        inertia=(2e-4, 2e-4, 1e-4),
        frame=Placement(position=(0.0, 0.0, 0.1), rpy=(0.0, np.pi, 0.0)),
    ),
    payload_error=0.0,
    payload_position=(0.0, 0.0, 0.0),
)


class Robot(NamedTuple):
    """The ports of a robot that was added to a builder."""

    velocity: InputPort  # rad/s above m/s, shape (6,)
    motion: OutputPort  # true displacement and its rate, shape (12,); for gripper and logs alone
    encoders: OutputPort  # displacement by encoders, rad above m, shape (6,)
    reaction: InputPort | None  # of the gripper's springs on it, N m above N; None: no effect


def add_carriage(builder: DiagramBuilder, start: Array, step: float) -> Robot:
    """Add a carriage that follows a velocity exactly, from a displacement, rad above m, (6,)."""
    carriage = _add_integrator(builder, "carriage", start, step)
    motion = builder.AddNamedSystem("carriage and rate", Multiplexer([SIZE, SIZE]))
    rate = builder.AddNamedSystem("V_ref", PassThrough(SIZE))
    builder.Connect(carriage.get_output_port(), motion.get_input_port(0))
    builder.Connect(rate.get_output_port(), carriage.get_input_port())
    builder.Connect(rate.get_output_port(), motion.get_input_port(1))
    return Robot(rate.get_input_port(), motion.get_output_port(), carriage.get_output_port(), None)


def add_wam(
    builder: DiagramBuilder,
    settings: CellArmSettings,
    impedance: ImpedanceControllerParams,
    start: Array,
    step: float,
) -> Robot:
    """Add a WAM whose tool frame has the world's axes where the displacement has no turn.

    ``start`` is the tool's initial displacement, rad above m, shape (6,), ``step``, s, that of
    the arm's plant at most.
    """
    # A plant as slow as its controller would act on a torque a whole period after it was sensed,
    # one more than the controller's gains stand.
    plant = builder.AddNamedSystem("arm", MultibodyPlant(min(step, impedance.period / 2)))
    instance = add_simulated_arm(plant, "wam", settings)
    plant.Finalize()
    model = settings.known_arm()
    q = model.joint_positions(tip_pose(start), settings.near)
    plant.SetDefaultPositions(instance, q)
    controller = ImpedanceController(model, q, impedance)
    arm = connect_arm(builder, plant, "wam", instance, controller)
    goal = _add_integrator(builder, "desired displacement", start, impedance.period)
    pose = builder.AddNamedSystem("desired pose", CarriedPoses({"tool": RigidTransform()}))
    rate = builder.AddNamedSystem("V_ref", PassThrough(SIZE))
    tool = plant.GetBodyByName("tool", instance)
    motion = builder.AddNamedSystem("true motion of the tool", TrueMotion(tool.index()))
    encoders = builder.AddNamedSystem("displacement by encoders", PoseDisplacement())
    reaction = builder.AddNamedSystem("reaction on the tool", ToolForce(tool.index()))
    connect = builder.Connect
    connect(rate.get_output_port(), goal.get_input_port())
    connect(goal.get_output_port(), pose.get_input_port())
    connect(pose.GetOutputPort("tool_pose"), arm.desired_pose)
    connect(rate.get_output_port(), arm.desired_velocity)
    connect(arm.tool_pose, encoders.get_input_port())
    connect(plant.get_body_poses_output_port(), motion.GetInputPort("body_poses"))
    connect(
        plant.get_body_spatial_velocities_output_port(), motion.GetInputPort("body_velocities")
    )
    connect(reaction.get_output_port(), plant.get_applied_spatial_force_input_port())
    return Robot(
        rate.get_input_port(),
        motion.get_output_port(),
        encoders.get_output_port(),
        reaction.get_input_port(),
    )


def _add_integrator(builder: DiagramBuilder, name: str, start: Array, step: float) -> LinearSystem:
    one, none = np.eye(SIZE), np.zeros((SIZE, SIZE))
    integrator = LinearSystem(A=one, B=step * one, C=one, D=none, time_period=step)
    integrator.configure_default_state(start)
    return builder.AddNamedSystem(name, integrator)
