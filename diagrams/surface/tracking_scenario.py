"""What may be set where a gripper is controlled along an unknown surface (chapter 5)."""

from dataclasses import dataclass, fields

from chamfer.diagrams.surface.surface_scenario import (
    ObserverSettings,
    SurfaceScenario,
    require_calibration,
    require_whole,
)
from chamfer.models.arms.cartesian_manipulator import CartesianManipulatorParams
from chamfer.models.validation import ParameterError, require_not_negative
from chamfer.systems.force.hybrid_controller import HybridControllerParams, HybridGains
from chamfer.systems.force.surface_motion import SurfaceMotionParams
from chamfer.systems.sensing.force_rate import ForceRateSensorParams


@dataclass(frozen=True, kw_only=True)
class TrackingGains(HybridGains):
    """The controller's gains, and whether it may run where it is unstable."""

    allow_unstable: bool = False  # True: run a loop that is unstable


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


@dataclass(frozen=True, kw_only=True)
class NoiseFreeTrackingScenario(TrackingScenario):
    """The sensor has no noise, and the observer knows (Fig. 5-9)."""

    sensor: ForceRateSensorParams = ForceRateSensorParams(force_noise=0.0, force_rate_noise=0.0)
    trials: int = 1


@dataclass(frozen=True, kw_only=True)
class AdaptiveTrackingScenario(TrackingScenario):
    """The adaptive observer, given the mean of the sensor's samples in its period."""

    observer: ObserverSettings = ObserverSettings(average=10)
    trials: int = 20  # 200 for the docs' numbers


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
