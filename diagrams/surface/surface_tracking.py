"""Hybrid control along an unknown surface, with the observer in the loop (Fig. 5-7)."""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Adder, ConstantVectorSource

from chamfer.diagrams.contact.hybrid_loop_stability import (
    LinearLoop,
    Stability,
    refuse_or_warn,
    stability_of,
)
from chamfer.diagrams.surface.surface_scenario import (
    ObserverSettings,
    ResolvedSurfaceScenario,
    SurfaceScenario,
    add_observed_contact,
    require_calibration,
    require_whole,
    resolved_fields,
)
from chamfer.models.arms.cartesian_manipulator import (
    CartesianManipulatorParams,
    cartesian_kinematics,
)
from chamfer.models.validation import ParameterError, require_not_negative, within
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.force.hybrid_controller import HybridController, require_hybrid_ports
from chamfer.systems.force.hybrid_law import HybridControllerParams, HybridGains
from chamfer.systems.force.hybrid_linear import Pose, linear_law
from chamfer.systems.force.projection import position_selection
from chamfer.systems.force.sampled_loop import NEUTRAL, Plant
from chamfer.systems.force.surface_motion import SurfaceMotion, SurfaceMotionParams
from chamfer.systems.sensing.force_rate import ForceRateSensorParams

_SWINGS: Final = 2.0  # s, within which a start swings furthest


@dataclass(frozen=True, kw_only=True)
class TrackingGains(HybridGains):
    """The controller's gains, and whether it may run where it is unstable."""

    allow_unstable: bool = False  # True: run a loop that is unstable


@dataclass(frozen=True, kw_only=True)
class TrackingTask(SurfaceMotionParams):
    """Task along the surface (5-6), and its start.

    The motion is along n x z in the plane, and along n x -y in space.
    """

    depth: float = 0.1  # m, of the start below the surface's origin

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "depth")


@dataclass(frozen=True, kw_only=True)
class TrackingScenario(SurfaceScenario):
    """Typical noise, and the thesis' observer by default."""

    manipulator: CartesianManipulatorParams = CartesianManipulatorParams()
    task: TrackingTask = TrackingTask()
    # Not published: calibrated; the manipulator has damping of its own.
    controller: TrackingGains = TrackingGains(
        stiffness=100.0, integral=0.0, damping=0.0, force_integral=1.0
    )
    duration: float = 10.0  # s
    step: float = 2.5e-3  # s, of contact and manipulator

    def __post_init__(self) -> None:
        super().__post_init__()
        require_calibration(self.observer, free=0.0, pressed=0.0)
        require_whole(self.controller.period, self.step, "step")
        require_whole(self.observer.period, self.controller.period, "controller.period")
        samples = round(self.observer.period / self.controller.period)
        if not 1 <= self.observer.average <= samples:
            allowed = f"1 to {samples}, the sensor's samples in a period of the observer"
            raise ParameterError("observer.average", self.observer.average, allowed)

    @property
    def sensor_period(self) -> float:
        """How often the force is sensed, s."""
        return self.controller.period

    @property
    def start(self) -> tuple[float, ...]:
        """Where the gripper begins, m."""
        return (*(0.0,) * (self.dimension - 1), -self.task.depth)


SURFACE_CONTROL: Final = TrackingScenario()  # typical noise (Fig. 5-8)
SURFACE_CONTROL_NOISE_FREE: Final = TrackingScenario(
    sensor=ForceRateSensorParams(force_noise=0.0, force_rate_noise=0.0), trials=1
)  # and the observer knows (Fig. 5-9)
SURFACE_CONTROL_ADAPTIVE: Final = TrackingScenario(
    observer=ObserverSettings(average=10),  # all samples of the sensor in its period
    trials=20,  # 200 for the docs' numbers
)


@dataclass(frozen=True, kw_only=True)
class ResolvedTrackingScenario(ResolvedSurfaceScenario, TrackingScenario):
    """The same, with nothing left open."""


def resolve_tracking(scenario: TrackingScenario) -> ResolvedTrackingScenario:
    """Return the scenario with the surface's defaults and the observer's assumptions filled in.

    Raises:
        ParameterError: If a block refuses its parameters, the loop would be unstable and
            ``controller.allow_unstable`` is not set, or the start is so deep that the tip would
            rebound.
    """
    with within("controller"):
        scenario.controller.for_joints(scenario.dimension)
    level = scenario.surface.make().level(scenario.up * -scenario.task.depth)
    if level > 0:
        raise ParameterError("task.depth", scenario.task.depth, "a start below the surface")
    growth = tracking_loop(scenario).growth_rate()
    if growth > NEUTRAL:
        refuse_or_warn(
            f"the loop is unstable in contact, it grows at {growth:.3g} 1/s",
            "force_integral",
            scenario.controller,
            "a lower one, or other gains",
        )
    else:
        _require_bearable(scenario)
    return ResolvedTrackingScenario(**resolved_fields(scenario))


def _require_bearable(scenario: TrackingScenario) -> None:
    """Refuse a start from which the linear loop swings so far that the force passes 0.

    The force goes from F_0 to F_d as ``F_d + (F_0 - F_d) g(t)``, whatever F_0 is.
    """
    loop, normal = tracking_loop(scenario), scenario.up
    moves, d = loop.period_map(), scenario.dimension
    pressed = -np.append(normal, np.zeros(len(moves) - d))
    felt = -np.append(normal @ loop.arm.late, np.zeros(len(moves) - 2 * d))
    stiffness, least = float(felt @ pressed), 0.0
    for _ in range(round(_SWINGS / loop.period)):
        pressed = moves @ pressed
        least = min(least, float(felt @ pressed) / stiffness)
    depth, force = scenario.task.depth, scenario.task.force
    if least * (stiffness * depth - force) < -force:
        largest = force - force / least
        allowed = (
            f"at most {largest / stiffness:.3g} m, {largest:.3g} N; "
            f"from {stiffness * depth:.3g} N the force would pass 0"
        )
        raise ParameterError("task.depth", depth, allowed)


def always_in_contact(gains: HybridGains) -> HybridControllerParams:
    """Return the controller's parameters for a loop that begins in contact, without gravity.

    A Cartesian manipulator's Jacobian is the identity, so that all laws are the same.
    """
    return HybridControllerParams(
        **{one.name: getattr(gains, one.name) for one in fields(HybridGains)},
        law="transpose",
        feedforward_torque=(),
        loss_mode=False,
        bumpless=False,
    )


def tracking_loop(scenario: TrackingScenario) -> LinearLoop:
    """Return the loop at its start, sliding along the surface, with a known normal.

    Left out is the observer: what its normal does with the force is not linear. The tip slides,
    so that Coulomb's friction is in it. The contact force acts at once; the block updates it
    every step.
    """
    d, manipulator = scenario.dimension, scenario.manipulator
    normal = scenario.up
    along = np.eye(d)[0] * np.sign(scenario.task.speed)
    mu = scenario.friction.at(np.array(scenario.start))
    acts = normal - mu * along  # the contact force per newton of normal force
    gives = normal @ np.linalg.solve(np.array(scenario.gripper.matrix(d)), acts)
    zero, free = np.zeros((d, d)), np.eye(d)
    force = np.hstack([-np.outer(acts, normal) / gives, zero])
    slowing = np.hstack([zero, -manipulator.damping * free])
    flow = np.vstack([np.hstack([zero, free]), (force + slowing) / manipulator.mass])
    drive = np.vstack([zero, free / manipulator.mass])
    control = always_in_contact(scenario.controller)
    pose = Pose(manipulator.mass * free, free, zero, zero)
    law = linear_law(pose, position_selection(normal), control, CONTACT)
    plant = Plant(flow, drive, np.eye(2 * d), -force, scenario.force_delay)
    return LinearLoop("contact", CONTACT, plant, law, control.period)


def tracking_stability(scenario: TrackingScenario) -> Stability:
    """Return growth and margins of the loop."""
    return stability_of((tracking_loop(scenario),))


def surface_motion(scenario: TrackingScenario) -> SurfaceMotion:
    """Return the block that computes the task from the normal."""
    axis = (0.0, 0.0, 1.0) if scenario.dimension == 2 else (0.0, -1.0, 0.0)
    return SurfaceMotion(
        scenario.task, start=scenario.start, axis=axis, period=scenario.controller.period
    )


def make_tracking_diagram(
    scenario: ResolvedTrackingScenario, *, controller: LeafSystem | None = None
) -> Diagram:
    """Return the closed loop of Fig. 5-7.

    Outputs: those of :func:`chamfer.diagrams.surface.surface_estimation.make_estimation_diagram`,
    and the controller's ``effort`` (N), ``position_error`` and ``force_error``.

    Args:
        scenario: Parameters of the blocks.
        controller: Your own, in place of the hybrid law; with its ports, as
            :func:`chamfer.systems.force.hybrid_controller.require_hybrid_ports` lists them, of an
            arm whose d joints are its d coordinates.

    Raises:
        ParameterError: If the controller has other ports.
    """
    kinematics = cartesian_kinematics(scenario.dimension)
    if controller is None:
        controller = HybridController(kinematics, always_in_contact(scenario.controller))
    require_hybrid_ports(controller, kinematics)
    d, builder = scenario.dimension, DiagramBuilder()
    connect = builder.Connect
    manipulator = builder.AddNamedSystem(
        "manipulator dynamics",
        make_cartesian_manipulator(scenario.manipulator, start=scenario.start, step=scenario.step),
    )
    encoders = manipulator.get_output_port()
    contact, force, observer = add_observed_contact(builder, scenario, encoders)
    task = builder.AddNamedSystem("task", surface_motion(scenario))
    mode = builder.AddNamedSystem("in contact", ConstantVectorSource([float(CONTACT)]))
    builder.AddNamedSystem("hybrid controller", controller)
    forces = builder.AddNamedSystem("sum of forces", Adder(2, d))
    connect(encoders, task.GetInputPort("endpoint_motion"))
    connect(observer.GetOutputPort("normal"), task.GetInputPort("normal"))
    connect(encoders, controller.GetInputPort("encoders"))
    for name in ("selection", "desired_force", "desired_position"):
        connect(task.GetOutputPort(name), controller.GetInputPort(name))
    connect(force, controller.GetInputPort("measured_force"))
    connect(mode.get_output_port(), controller.GetInputPort("mode"))
    connect(controller.GetOutputPort("torque"), forces.get_input_port(0))
    connect(contact.GetOutputPort("contact_force"), forces.get_input_port(1))
    connect(forces.get_output_port(), manipulator.get_input_port())
    builder.ExportOutput(controller.GetOutputPort("torque"), "effort")
    for name in ("position_error", "force_error"):
        builder.ExportOutput(controller.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("Control along an unknown surface")
    return diagram
