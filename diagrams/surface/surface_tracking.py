"""Hybrid control along an unknown surface, with the observer in the loop (Fig. 5-7)."""

from dataclasses import dataclass, field, replace
from typing import TypeVar

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource

from diagrams.surface.surface_scenario import (
    NoiseSettings,
    SurfaceScenario,
    add_observed_contact,
    fill_in,
    require_whole,
)
from models.cartesian_manipulator import CartesianManipulatorParams, cartesian_kinematics
from models.validation import ParameterError, require_not_negative, require_positive
from systems.contact.cartesian_manipulator import make_cartesian_manipulator
from systems.force.contact_detection import CONTACT
from systems.force.hybrid_controller import HybridController, HybridControllerParams
from systems.force.surface_motion import SurfaceMotion, SurfaceMotionParams


@dataclass(frozen=True, kw_only=True)
class ManipulatorSettings:
    """Mass and damping of the manipulator (5-7), the same in every direction; not published."""

    mass: float = 0.5  # kg, assumed
    damping: float = 10.0  # N s/m, assumed

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        require_not_negative(self, "damping")


@dataclass(frozen=True, kw_only=True)
class TrackingTask:
    """What is to be done along the surface (5-6)."""

    force: float = 5.0  # N, F_d, section 5.3.4
    speed: float = 0.5  # m/s, V_d along n x z (5-6), section 5.3.4; in space along n x y
    depth: float = 0.1  # m, of the start below the surface's origin

    def __post_init__(self) -> None:
        require_positive(self, "force")
        require_not_negative(self, "depth")


@dataclass(frozen=True, kw_only=True)
class GainSettings:
    """Gains of the hybrid controller with the transposed Jacobian; not published, calibrated."""

    stiffness: float = 100.0  # N/m, Kp
    integral: float = 0.0  # N/(m s), Ki
    damping: float = 0.0  # N s/m, Kd; the manipulator has damping of its own
    force_integral: float = 1.0  # 1/s, Kif
    period: float = 0.005  # s, section 1.1.2

    def __post_init__(self) -> None:
        require_positive(self, "period")


@dataclass(frozen=True, kw_only=True)
class TrackingScenario(SurfaceScenario):
    """Typical noise (Fig. 5-8)."""

    manipulator: ManipulatorSettings = field(default_factory=ManipulatorSettings)
    task: TrackingTask = field(default_factory=TrackingTask)
    controller: GainSettings = field(default_factory=GainSettings)
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

    @property
    def plant(self) -> CartesianManipulatorParams:
        """The manipulator's parameters."""
        d, given = self.dimension, self.manipulator
        return CartesianManipulatorParams(mass=(given.mass,) * d, damping=(given.damping,) * d)

    @property
    def control(self) -> HybridControllerParams:
        """The hybrid controller's parameters; the loop begins in contact."""
        d, given = self.dimension, self.controller
        return HybridControllerParams(
            law="transpose",
            stiffness=(given.stiffness,) * d,
            integral=(given.integral,) * d,
            damping=(given.damping,) * d,
            force_integral=given.force_integral,
            feedforward_torque=(),
            loss_mode=False,
            bumpless=False,
            period=given.period,
        )

    @property
    def motion(self) -> SurfaceMotionParams:
        """The task along the estimated surface."""
        return SurfaceMotionParams(
            dimension=self.dimension,
            start=self.start,
            force=self.task.force,
            speed=self.task.speed,
            axis=(0.0, 0.0, 1.0) if self.dimension == 2 else (0.0, -1.0, 0.0),
            period=self.controller.period,
        )


@dataclass(frozen=True, kw_only=True)
class NoiseFreeTrackingScenario(TrackingScenario):
    """The sensor has no noise, and the observer knows (Fig. 5-9)."""

    noise: NoiseSettings = field(default_factory=lambda: NoiseSettings(force=0.0, force_rate=0.0))
    trials: int = 1


TrackingScenarioT = TypeVar("TrackingScenarioT", bound=TrackingScenario)


def resolve_tracking(scenario: TrackingScenarioT) -> TrackingScenarioT:
    """Return the scenario with the surface's defaults and the observer's assumptions filled in.

    Raises:
        ParameterError: If a block refuses its parameters.
    """
    scenario.estimation  # noqa: B018 - checks
    scenario.plant  # noqa: B018
    scenario.control  # noqa: B018
    scenario.motion  # noqa: B018
    level = scenario.surface.make().level(scenario.up * -scenario.task.depth)
    if level > 0:
        raise ParameterError("task.depth", scenario.task.depth, "a start below the surface")
    return replace(
        scenario,
        surface=scenario.surface.resolved(),
        observer=fill_in(scenario.observer, scenario.noise),
    )


def make_tracking_diagram(scenario: TrackingScenario) -> Diagram:
    """Return the closed loop of Fig. 5-7.

    Outputs: those of :func:`diagrams.surface.surface_estimation.make_estimation_diagram`, and the
    controller's ``effort`` (N), ``position_error`` and ``force_error``.
    """
    d, period = scenario.dimension, scenario.controller.period
    builder = DiagramBuilder()
    connect = builder.Connect
    manipulator = builder.AddNamedSystem(
        "manipulator dynamics",
        make_cartesian_manipulator(scenario.plant, start=scenario.start, step=scenario.step),
    )
    encoders = manipulator.get_output_port()
    contact, sensor, observer = add_observed_contact(
        builder, scenario, encoders, noise_period=period
    )
    task = builder.AddNamedSystem("task", SurfaceMotion(scenario.motion))
    mode = builder.AddNamedSystem("in contact", ConstantVectorSource([float(CONTACT)]))
    controller = builder.AddNamedSystem(
        "hybrid controller", HybridController(cartesian_kinematics(d), scenario.control)
    )
    forces = builder.AddNamedSystem("sum of forces", Adder(2, d))
    connect(encoders, task.GetInputPort("encoders"))
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
