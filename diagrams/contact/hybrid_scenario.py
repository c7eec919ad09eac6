"""What may be set in a hybrid position/force loop, whatever the arm."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.contact.sampling import require_periods, require_steps, updates_of
from chamfer.diagrams.contact.sensing import Sensing, SensingValues
from chamfer.models.arms.arm import Arm, Elbow
from chamfer.models.arms.gripper import GripperParams
from chamfer.models.arms.joint_friction import JointFrictionParams
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
from chamfer.systems.contact.arm_in_contact import ArmInContactParams
from chamfer.systems.contact.scenes import ContactParams
from chamfer.systems.force.contact_detection import ContactDetectionParams
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.force.guarded_motion import ApproachParams, GuardedMotionParams
from chamfer.systems.force.hybrid_controller import HybridControllerParams
from chamfer.systems.force.selection import unit
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams, LoadCellParams

Array = NDArray[np.float64]

_MOST_TRIALS = 1000


@dataclass(frozen=True, kw_only=True)
class FreeArmSettings:
    """The arm's pose and friction; the rest of it is in its URDF."""

    joint_friction: JointFrictionParams
    elbow: Elbow = "negative"  # sign of the elbow joint

    def __post_init__(self) -> None:
        require_one_of(self, "elbow", ("negative", "positive"))


@dataclass(frozen=True, kw_only=True)
class ArmSettings(FreeArmSettings):
    """An arm that touches with one point of its own."""

    contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # m, of the point that touches, in the endpoint's frame


@dataclass(frozen=True, kw_only=True)
class UnevenPlane(ContactParams, Unevenness):
    """A surface's material, and how it differs from what the controller takes it to be."""

    def __post_init__(self) -> None:
        ContactParams.__post_init__(self)
        Unevenness.__post_init__(self)


@dataclass(frozen=True, kw_only=True)
class ContactTask(ApproachParams):
    """What the arm is to do: approach, touch and push."""

    force: float  # N, desired
    nugget_mass: float = 0.185  # kg, what the surface is protected from (appendix C)
    kick_time: float | None = None  # s, of a blow that takes the tip off the surface; None: none
    kick_speed: float = 0.2  # m/s, that the blow gives it

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "force", "nugget_mass", "kick_speed")
        if self.kick_time is not None:
            require_positive(self, "kick_time")

    @property
    def ways(self) -> tuple[float, ...]:
        """In which directions the tip slides along, 1 for ahead and -1 for back."""
        return ()


@dataclass(frozen=True, kw_only=True)
class Task(GuardedMotionParams, ContactTask):
    """The same, and move along."""

    @property
    def ways(self) -> tuple[float, ...]:
        """In which directions the tip slides along, 1 for ahead and -1 for back."""
        return (1.0, -1.0) if self.amplitude else ()


@dataclass(frozen=True, kw_only=True)
class TaskOnPlane(Task):
    """The same on a plane, which is where the task wants it."""

    distance: float  # m, from the start to the plane

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "distance")


@dataclass(frozen=True, kw_only=True)
class ControllerSettings(HybridControllerParams):
    """The hybrid controller, and whether it may run where it is unstable."""

    computation_delay: float | None = None
    # s, from the sensors to the torque, 0 to a period; None: derived from ``sensing``
    computation_jitter: float | None = None
    # s, half-width of what the delay is off; None: derived from ``sensing``
    allow_unstable: bool = False  # True: run a loop that is unstable


@dataclass(frozen=True, kw_only=True)
class HybridScenario(ABC):
    """An arm, its controller, what it touches and what it is to do."""

    ARM: ClassVar[Arm]
    SENSING: ClassVar[Mapping[Sensing, SensingValues]]

    arm: ArmSettings
    gripper: GripperParams | None = None  # between wrist and tip; None: rigid
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
        """Distance from the start to where the tip should touch, m."""

    @abstractmethod
    def make_surface(self) -> Surface:
        """Return what the tip touches."""

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
        updates = updates_of(self.step, self.controller.period)
        return ArmInContactParams(
            joint_friction=self.arm.joint_friction,
            contact=self.surface,
            contact_offset=self.arm.contact_offset,
            gripper=self.gripper,
            step=self.step,
            held=updates.held,
            window=updates.window,
        )


@dataclass(frozen=True, kw_only=True)
class OnPlane(HybridScenario):
    """A loop that touches a plane which is nearly what the controller takes it to be."""

    surface: UnevenPlane
    task: TaskOnPlane

    @property
    def distance(self) -> float:
        """Distance from the start to where the tip should touch, m."""
        return self.task.distance

    def make_surface(self) -> Surface:
        """Return the plane through the point where the tip should touch."""
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


def _spatial(vector: tuple[float, ...]) -> Array:
    """Return the first three entries of an endpoint vector as a unit vector."""
    return unit(np.array([*vector, 0.0, 0.0, 0.0][:3]))
