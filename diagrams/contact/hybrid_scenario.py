"""Scenarios of hybrid position/force loops for any arm, and their derived fields."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.contact.sensing import (
    ControllerSettings,
    Sensing,
    SensingValues,
    computer_of,
    encoders_of,
    push_errors,
    sensor_of,
)
from chamfer.models.arms.arm import Arm, Elbow, JointFrictionParams
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.planes import RippledPlane, Unevenness
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
    within,
)
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.arm_in_contact import ArmInContactParams, ContactParams
from chamfer.systems.force.contact_detection_law import ContactDetectionParams
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.force.projection import unit
from chamfer.systems.force.surface_motion import ApproachParams, GuardedMotionParams
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams, LoadCellParams

_MOST_HELD: Final = 5000  # steps in a period
_REFRESH: Final = 1e-3  # s, at most, over which the torque and the surface's shape are held
_MOST_PERIODS: Final = 1_000_000  # of a run; its traces have a row for each


def require_steps(step: float, period: float) -> None:
    """Raise :class:`ParameterError` unless a period is a whole number of steps, s."""
    held = round(period / step)
    if not (1 <= held <= _MOST_HELD and abs(held * step / period - 1) < 1e-9):
        allowed = f"a whole part of the period, {period:g}, down to {period / _MOST_HELD:g}"
        raise ParameterError("step", step, allowed)


def require_periods(duration: float, period: float) -> None:
    """Raise :class:`ParameterError` unless a run has 10 to a million periods, s."""
    if not 10 <= duration / period <= _MOST_PERIODS:
        allowed = f"10 to {_MOST_PERIODS} periods of {period:g} s"
        raise ParameterError("duration", duration, allowed)


def updates_of(step: float, period: float) -> tuple[int, int]:
    """Return steps in an update and updates in a period: the longest ones, up to a millisecond."""
    steps = round(period / step)
    most = max(1, round(_REFRESH / step))
    held = max(count for count in range(1, most + 1) if steps % count == 0)
    return held, steps // held


Array = NDArray[np.float64]

_MOST_TRIALS = 1000


@dataclass(frozen=True, kw_only=True)
class FreeArmSettings:
    """The arm's elbow and friction; the rest is in its URDF."""

    joint_friction: JointFrictionParams
    elbow: Elbow = "negative"  # sign of the elbow joint

    def __post_init__(self) -> None:
        require_one_of(self, "elbow", ("negative", "positive"))


@dataclass(frozen=True, kw_only=True)
class ContactArmSettings(FreeArmSettings):
    """An arm that touches with one point."""

    contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # m, of the point that touches, in the endpoint's frame


@dataclass(frozen=True, kw_only=True)
class UnevenPlane(ContactParams, Unevenness):
    """A surface's material, and its difference from the controller's belief."""

    def __post_init__(self) -> None:
        ContactParams.__post_init__(self)
        Unevenness.__post_init__(self)


@dataclass(frozen=True, kw_only=True)
class ContactTask(ApproachParams):
    """Task of the arm: approach, touch and push."""

    force: float  # N, desired
    nugget_mass: float = 0.185  # kg, of the nugget that must not damage the surface (appendix C)
    kick_time: float | None = None  # s, of a blow that lifts the tip off; None: none
    kick_speed: float = 0.2  # m/s, of the tip after the blow

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "force", "nugget_mass", "kick_speed", "kick_time")

    @property
    def ways(self) -> tuple[float, ...]:
        """Directions in which the tip slides, 1 for ahead and -1 for back."""
        return ()


@dataclass(frozen=True, kw_only=True)
class SlidingTask(GuardedMotionParams, ContactTask):
    """The same, with a slide along the surface."""

    @property
    def ways(self) -> tuple[float, ...]:
        """Directions in which the tip slides, 1 for ahead and -1 for back."""
        return (1.0, -1.0) if self.amplitude else ()


@dataclass(frozen=True, kw_only=True)
class PlaneTask(SlidingTask):
    """The same on a plane at the task's distance."""

    distance: float  # m, from the start to the plane

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "distance")


@dataclass(frozen=True, kw_only=True)
class HybridScenario(ABC):
    """An arm, its controller, surface and task."""

    ARM: ClassVar[Arm]
    SENSING: ClassVar[Mapping[Sensing, SensingValues]]

    arm: ContactArmSettings
    gripper: GripperCompliance | None = None  # between wrist and tip; None: rigid
    surface: ContactParams
    task: ContactTask
    controller: ControllerSettings
    sensing: Sensing = "ideal"
    # as the paper's figure has it; realistic: what is open of sensors and computer, as they are
    sensor: ForceSensorParams | LoadCellParams = field(default_factory=ForceSensorParams)
    encoders: EncoderParams = field(default_factory=EncoderParams)
    detection: ContactDetectionParams = field(default_factory=ContactDetectionParams)
    friction_compensation: FrictionCompensationParams | None = None  # None: none
    duration: float = 15.0  # s, of the run
    measure_after: float = 6.0  # s, from then on deviations count
    step: float = 1e-4  # s, of the arm's dynamics, friction and contact

    def __post_init__(self) -> None:
        require_positive(self, "duration", "step")
        require_not_negative(self, "measure_after")
        require_one_of(self, "sensing", ("ideal", "realistic"))
        period = self.controller.period
        require_steps(self.step, period)
        require_periods(self.duration, period)
        arm, friction = self.ARM, self.arm.joint_friction
        if len(self.task.start) != arm.num_coordinates:
            raise ParameterError("task.start", self.task.start, f"{arm.num_coordinates} numbers")
        if len(friction.coulomb) != arm.num_joints:
            name = "arm.joint_friction.coulomb"
            raise ParameterError(name, friction.coulomb, f"{arm.num_joints} numbers")
        if self.gripper is not None:
            with within("gripper"):
                self.gripper.matrix(3)
                self.gripper.damping_matrix(3)
        with within("controller"):
            self.controller.for_joints(arm.num_joints)

    @property
    @abstractmethod
    def distance(self) -> float:
        """Distance from the start to the desired contact point, m."""

    @abstractmethod
    def make_surface(self) -> Surface:
        """Return the surface that the tip touches."""

    @property
    def direction(self) -> Array:
        """Unit vector of approach and push in endpoint coordinates, shape (m,)."""
        return unit(np.array(self.task.direction), "task.direction")

    @property
    def along(self) -> Array:
        """Unit vector of the motion in contact in endpoint coordinates, shape (m,)."""
        return unit(np.array(self.task.along), "task.along")

    @property
    def touching(self) -> Array:
        """The endpoint at the desired contact, shape (m,)."""
        return np.array(self.task.start) + self.distance * self.direction

    def joint_positions(self, endpoint: Array) -> Array:
        """Return q, shape (n,), at an endpoint, with the scenario's elbow."""
        return self.ARM.joint_positions(endpoint, self.arm.elbow)

    def dynamics(self) -> ArmDynamics:
        """Return the arm's equations of motion, with the scenario's contact point."""
        return ArmDynamics(self.ARM, contact_offset=self.arm.contact_offset)

    @property
    def plant(self) -> ArmInContactParams:
        """The arm and its contact."""
        held, window = updates_of(self.step, self.controller.period)
        return ArmInContactParams(
            joint_friction=self.arm.joint_friction,
            contact=self.surface,
            contact_offset=self.arm.contact_offset,
            gripper=self.gripper,
            step=self.step,
            held=held,
            window=window,
        )


@dataclass(frozen=True, kw_only=True)
class OnPlane(HybridScenario):
    """A loop at a plane that nearly agrees with the controller's belief."""

    surface: UnevenPlane
    task: PlaneTask

    @property
    def distance(self) -> float:
        """Distance from the start to the desired contact point, m."""
        return self.task.distance

    def make_surface(self) -> Surface:
        """Return the plane through the desired contact point."""
        task, surface = self.task, self.surface
        q = self.joint_positions(self.touching)
        normal, along = -_spatial(task.direction), _spatial(task.along)
        return RippledPlane(
            point=tuple(self.dynamics().evaluate(q, np.zeros(len(q))).p_WC.tolist()),
            normal=tuple(normal.tolist()),
            along=tuple(along.tolist()),
            tilt=surface.tilt,
            ripple=surface.ripple,
            wavelength=surface.wavelength,
        )


@dataclass(frozen=True, kw_only=True)
class HybridTrials(HybridScenario):
    """A loop that runs several times, each with a seed of its own."""

    trials: int = 1  # seeds over which the metrics are averaged

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")


HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


def fill(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return the scenario with its open fields filled in, stable or not.

    Sensors and computer are what ``sensing`` says. The controller knows gravity at the start, as
    a constant (section 2.1.2), and with full dynamics the inertia where it should touch.
    """
    values, dynamics = scenario.SENSING[scenario.sensing], scenario.dynamics()
    control = scenario.controller
    if control.feedforward_torque is None:
        gravity = dynamics.gravity_torque(scenario.joint_positions(np.array(scenario.task.start)))
        control = replace(control, feedforward_torque=tuple(gravity.tolist()))
    q = scenario.joint_positions(scenario.touching)
    if control.full_dynamics and control.inertia is None:
        mass = dynamics.evaluate(q, np.zeros(len(q))).mass
        control = replace(control, inertia=tuple(np.diag(mass).tolist()))
    control = computer_of(control, values)
    with within("sensor"):
        sensor = sensor_of(scenario.sensor, values)
    with within("encoders"):
        encoders = encoders_of(scenario.encoders, values)
        encoders.quanta(len(q))
    with within("detection"):
        errors = push_errors(sensor, scenario.direction, dynamics.orientation(q))
        detection = scenario.detection.resolved(*errors)
    surface = scenario.surface
    if surface.friction_noise is None:
        surface = replace(surface, friction_noise=values.friction_noise)
    return replace(
        scenario,
        controller=control,
        sensor=sensor,
        encoders=encoders,
        detection=detection,
        surface=surface,
    )


def _spatial(vector: tuple[float, ...]) -> Array:
    """Return the first three entries of an endpoint vector as a unit vector."""
    return unit(np.array([*vector, 0.0, 0.0, 0.0][:3]))
