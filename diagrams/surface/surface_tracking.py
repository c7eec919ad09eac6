"""Hybrid control along an unknown surface, with the observer in the loop (Fig. 5-7)."""

from dataclasses import dataclass, fields, replace
from typing import TypeVar

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource

from diagrams.surface.surface_scenario import (
    SurfaceScenario,
    add_observed_contact,
    require_whole,
    told,
)
from models.cartesian_manipulator import CartesianManipulatorParams, cartesian_kinematics
from models.validation import ParameterError, require_not_negative, within
from systems.contact.cartesian_manipulator import make_cartesian_manipulator
from systems.force.contact_detection import CONTACT
from systems.force.hybrid_controller import HybridController, HybridControllerParams, HybridGains
from systems.force.surface_motion import SurfaceMotion, SurfaceMotionParams
from systems.sensing.force_rate_sensor import ForceRateSensorParams


@dataclass(frozen=True, kw_only=True)
class TrackingTask(SurfaceMotionParams):
    """What is to be done along the surface (5-6), and where that begins.

    The motion is along n x z in the plane, and along n x -y in space.
    """

    depth: float = 0.1  # m, of the start below the surface's origin

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "depth")


@dataclass(frozen=True, kw_only=True)
class TrackingScenario(SurfaceScenario):
    """Typical noise (Fig. 5-8)."""

    manipulator: CartesianManipulatorParams = CartesianManipulatorParams()
    task: TrackingTask = TrackingTask()
    # Not published: calibrated; the manipulator has damping of its own.
    controller: HybridGains = HybridGains(
        stiffness=100.0, integral=0.0, damping=0.0, force_integral=1.0
    )
    duration: float = 10.0  # s
    step: float = 2.5e-3  # s, of contact and manipulator

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole(self.controller.period, self.step, "step")
        require_whole(self.observer.period, self.controller.period, "controller.period")

    @property
    def start(self) -> tuple[float, ...]:
        """Where the gripper begins, m."""
        return (*(0.0,) * (self.dimension - 1), -self.task.depth)


@dataclass(frozen=True, kw_only=True)
class NoiseFreeTrackingScenario(TrackingScenario):
    """The sensor has no noise, and the observer knows (Fig. 5-9)."""

    sensor: ForceRateSensorParams = ForceRateSensorParams(force_noise=0.0, force_rate_noise=0.0)
    trials: int = 1


TrackingScenarioT = TypeVar("TrackingScenarioT", bound=TrackingScenario)


def resolve_tracking(scenario: TrackingScenarioT) -> TrackingScenarioT:
    """Return the scenario with the surface's defaults and the observer's assumptions filled in.

    Raises:
        ParameterError: If a block refuses its parameters.
    """
    with within("controller"):
        scenario.controller.for_joints(scenario.dimension)
    level = scenario.surface.make().level(scenario.up * -scenario.task.depth)
    if level > 0:
        raise ParameterError("task.depth", scenario.task.depth, "a start below the surface")
    return replace(
        scenario,
        surface=scenario.surface.resolved(),
        observer=told(scenario),
    )


def make_tracking_diagram(scenario: TrackingScenario) -> Diagram:
    """Return the closed loop of Fig. 5-7.

    Outputs: those of :func:`diagrams.surface.surface_estimation.make_estimation_diagram`, and the
    controller's ``effort`` (N), ``position_error`` and ``force_error``.

    Raises:
        ParameterError: As :func:`resolve_tracking`.
    """
    scenario = resolve_tracking(scenario)
    d, period = scenario.dimension, scenario.controller.period
    builder = DiagramBuilder()
    connect = builder.Connect
    manipulator = builder.AddNamedSystem(
        "manipulator dynamics",
        make_cartesian_manipulator(scenario.manipulator, start=scenario.start, step=scenario.step),
    )
    encoders = manipulator.get_output_port()
    contact, sensor, observer = add_observed_contact(
        builder, scenario, encoders, noise_period=period
    )
    task = builder.AddNamedSystem(
        "task",
        SurfaceMotion(
            scenario.task,
            start=scenario.start,
            axis=(0.0, 0.0, 1.0) if d == 2 else (0.0, -1.0, 0.0),
            period=period,
        ),
    )
    mode = builder.AddNamedSystem("in contact", ConstantVectorSource([float(CONTACT)]))
    controller = builder.AddNamedSystem(
        "hybrid controller",
        HybridController(cartesian_kinematics(d), _always_in_contact(scenario.controller)),
    )
    forces = builder.AddNamedSystem("sum of forces", Adder(2, d))
    connect(encoders, task.GetInputPort("endpoint_motion"))
    connect(observer.GetOutputPort("normal"), task.GetInputPort("normal"))
    connect(encoders, controller.GetInputPort("encoders"))
    for name in ("selection", "desired_force", "desired_position"):
        connect(task.GetOutputPort(name), controller.GetInputPort(name))
    connect(sensor.GetOutputPort("measured_force"), controller.GetInputPort("measured_force"))
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


def _always_in_contact(gains: HybridGains) -> HybridControllerParams:
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
