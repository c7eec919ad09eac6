"""What may be set in a hybrid position/force loop, whatever the arm."""

import warnings
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from models.arms.arm import Arm, Elbow
from models.joint_friction import JointFrictionParams
from models.surfaces import RippledPlane, Surface
from models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_one_of,
    require_positive,
)
from systems.contact.arm_dynamics import ArmDynamics
from systems.contact.arm_in_contact import ArmInContactParams, ContactParams
from systems.force.contact_detection import ContactDetectionParams
from systems.force.guarded_motion import GuardedMotionParams
from systems.force.hybrid_controller import HybridControllerParams, Law
from systems.force.hybrid_stability import NEUTRAL, growth_rate
from systems.force.selection import position_selection, unit

Array = NDArray[np.float64]

_MOST_HELD = 5000  # steps in a period
_MOST_TRIALS = 1000
_MOST_PERIODS = 1_000_000  # of a run; its traces have a row for each


@dataclass(frozen=True, kw_only=True)
class ArmSettings(JointFrictionParams):
    """The arm's pose and friction; the rest of it is in its URDF."""

    elbow: Elbow = "negative"  # sign of the elbow joint
    contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, in the endpoint's frame

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "elbow", ("negative", "positive"))


@dataclass(frozen=True, kw_only=True)
class SurfaceSettings(ContactParams):
    """The surface's material, and how it differs from what the controller takes it to be."""

    tilt: float = 0.0  # rad, towards the direction of motion
    ripple: float = 0.0  # m, amplitude
    wavelength: float = 0.02  # m, of the ripple

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "ripple")
        require_positive(self, "wavelength")
        require_finite(self, "tilt")


@dataclass(frozen=True, kw_only=True)
class TaskSettings:
    """What the arm is to do: approach, touch, push and move along."""

    start: tuple[float, ...]  # m (rad), endpoint at the start
    direction: tuple[float, ...]  # of approach and push, in endpoint coordinates
    along: tuple[float, ...]  # of the motion in contact
    distance: float  # m, from the start to the surface
    speed: float  # m/s, of the approach
    acceleration: float = 10.0  # m/s^2, assumed
    force: float  # N, desired
    amplitude: float = 0.0  # m, of the sinusoid in contact; 0 holds the position
    frequency: float = 1.0  # rad/s
    nugget_mass: float = 0.185  # kg, what the surface is protected from (appendix C)
    kick_time: float | None = None  # s, of a blow that takes the tip off the surface
    kick_speed: float = 0.2  # m/s, that the blow gives it

    def __post_init__(self) -> None:
        require_positive(self, "distance", "force", "nugget_mass", "kick_speed")
        if self.kick_time is not None:
            require_positive(self, "kick_time")
        self.motion  # noqa: B018 - checks the rest

    @property
    def motion(self) -> GuardedMotionParams:
        """The desired trajectory."""
        return GuardedMotionParams(
            start=self.start,
            direction=self.direction,
            along=self.along,
            speed=self.speed,
            acceleration=self.acceleration,
            amplitude=self.amplitude,
            frequency=self.frequency,
        )


@dataclass(frozen=True, kw_only=True)
class ControllerSettings:
    """Law, gains and options of the hybrid controller."""

    law: Law
    stiffness: tuple[float, ...]  # Kp
    integral: tuple[float, ...]  # Ki
    damping: tuple[float, ...]  # Kd
    force_integral: float  # Kif, 1/s
    loss_mode: bool = True
    creep_speed: float = 0.05  # m/s, with which lost contact is sought
    bumpless: bool = True
    full_dynamics: bool = False  # True: control with the whole model of (2-1)
    held_integrators: tuple[int, ...] = ()  # joints whose integrator is off in contact
    allow_unstable: bool = False  # True: run a loop that is unstable out of contact
    period: float = 0.005  # s, section 1.1.2

    def __post_init__(self) -> None:
        require_positive(self, "period")


@dataclass(frozen=True, kw_only=True)
class SensorSettings:
    """The force sensor, and what counts as contact."""

    noise: float = 0.0  # N, half-width of a uniform noise
    cross_talk: float = 0.0
    decoupling: bool = False
    detect: float = 0.1  # N, more is contact
    release: float = 0.0  # N, not more is its loss

    def __post_init__(self) -> None:
        require_not_negative(self, "noise", "release")
        require_positive(self, "detect")
        if not self.release < self.detect:
            raise ParameterError("release", self.release, f"less than detect, {self.detect:g}")
        if not -0.5 < self.cross_talk < 1:
            raise ParameterError("cross_talk", self.cross_talk, "more than -0.5 and less than 1")


@dataclass(frozen=True, kw_only=True)
class HybridScenario:
    """An arm, its controller, what it touches and what it is to do."""

    ARM: ClassVar[Arm]
    UNIAXIAL: ClassVar[bool] = False  # True: a load cell along the last link measures the force

    arm: ArmSettings
    surface: SurfaceSettings
    task: TaskSettings
    controller: ControllerSettings
    sensor: SensorSettings = field(default_factory=SensorSettings)
    friction_compensation: float | None = None  # Hz, bandwidth; None: none
    duration: float = 15.0  # s
    measure_after: float = 6.0  # s, from then on deviations count
    trials: int = 1  # seeds over which the metrics are averaged
    step: float = 1e-4  # s, of friction and contact; the rest of the plant takes whole periods

    def __post_init__(self) -> None:
        require_positive(self, "duration", "step")
        require_not_negative(self, "measure_after")
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")
        if self.friction_compensation is not None:
            require_positive(self, "friction_compensation")
        period = self.controller.period
        held = round(period / self.step)
        if not (1 <= held <= _MOST_HELD and abs(held * self.step / period - 1) < 1e-9):
            raise ParameterError(
                "step",
                self.step,
                f"a whole part of the period, {period:g}, down to {period / _MOST_HELD:g}",
            )
        if not 10 <= self.duration / period <= _MOST_PERIODS:
            raise ParameterError(
                "duration", self.duration, f"10 to {_MOST_PERIODS} periods of {period:g} s"
            )
        for name, values, size in (
            ("task.start", self.task.start, self.ARM.num_coordinates),
            ("arm.coulomb", self.arm.coulomb, self.ARM.num_joints),
            ("controller.stiffness", self.controller.stiffness, self.ARM.num_joints),
        ):
            if len(values) != size:
                raise ParameterError(name, values, f"{size} numbers")

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
        """The endpoint where it should touch, shape (m,)."""
        return np.array(self.task.start) + self.task.distance * self.direction

    def joint_positions(self, endpoint: Array) -> Array:
        """Return q, shape (n,), at an endpoint, with the scenario's elbow."""
        return self.ARM.joint_positions(endpoint, self.arm.elbow)

    def dynamics(self) -> ArmDynamics:
        """Return the arm's equations of motion, with the scenario's contact point."""
        return ArmDynamics(self.ARM, contact_offset=self.arm.contact_offset)

    def make_surface(self) -> Surface:
        """Return what the tip touches."""
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

    @property
    def plant(self) -> ArmInContactParams:
        """The arm and its contact."""
        return ArmInContactParams(
            joint_friction=self.arm,
            contact=self.surface,
            contact_offset=self.arm.contact_offset,
            step=self.step,
            held=round(self.controller.period / self.step),
        )

    @property
    def detection(self) -> ContactDetectionParams:
        """Contact detection."""
        return ContactDetectionParams(
            direction=self.task.direction,
            detect=self.sensor.detect,
            release=self.sensor.release,
            period=self.controller.period,
        )

    @property
    def control(self) -> HybridControllerParams:
        """The hybrid controller; it knows gravity at the start, as a constant (section 2.1.2)."""
        given, dynamics = self.controller, self.dynamics()
        start = self.joint_positions(np.array(self.task.start))
        inertia = None
        if given.full_dynamics:
            q = self.joint_positions(self.touching)
            inertia = tuple(np.diag(dynamics.evaluate(q, np.zeros(len(q))).mass).tolist())
        return HybridControllerParams(
            law=given.law,
            stiffness=given.stiffness,
            integral=given.integral,
            damping=given.damping,
            force_integral=given.force_integral,
            feedforward_torque=tuple(dynamics.gravity_torque(start).tolist()),
            loss_mode=given.loss_mode,
            creep_speed=given.creep_speed,
            bumpless=given.bumpless,
            held_integrators=given.held_integrators,
            inertia=inertia,
            period=given.period,
        )

    def growth_rate(self) -> float:
        """Return the largest growth of the approach's loop and of the one out of contact, 1/s."""
        m = len(self.task.start)
        start = np.array(self.task.start)
        return max(
            self._growth(self.touching, position_selection(self.direction)),
            self._growth(self.touching, np.eye(m)),
            self._growth(start, np.eye(m)),
        )

    def _growth(self, endpoint: Array, selection: Array) -> float:
        q = self.joint_positions(endpoint)
        return growth_rate(
            self.dynamics().evaluate(q, np.zeros(len(q))).mass,
            self.ARM.jacobian(q),
            selection,
            self.control,
            np.array(self.arm.viscous),
        )


def _spatial(vector: tuple[float, ...]) -> Array:
    """Return the first three entries of an endpoint vector as a unit vector."""
    return unit(np.array([*vector, 0.0, 0.0, 0.0][:3]))


HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


def resolve(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return the scenario once everything that can be checked before a run has been.

    Raises:
        ParameterError: If blocks refuse their parameters, the arm can't reach the task, or the
            loop would be unstable out of contact and ``controller.allow_unstable`` is not set.
    """
    growth = scenario.growth_rate()
    scenario.make_surface()
    scenario.plant  # noqa: B018 - checks
    scenario.detection  # noqa: B018
    if growth > NEUTRAL and not scenario.controller.allow_unstable:
        raise ParameterError(
            "controller.law",
            scenario.controller.law,
            f"one whose position loop is stable out of contact, it grows at {growth:.3g} 1/s "
            "(projected, transpose or other gains; or controller.allow_unstable=true)",
        )
    if growth > NEUTRAL:
        warnings.warn(
            f"the position loop is unstable out of contact, it grows at {growth:.3g} 1/s",
            stacklevel=2,
        )
    return scenario
