"""What may be set where an arm finds an unknown wall and slides along it (section 6.3)."""

import math
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import ContactTask, HybridTrials
from chamfer.diagrams.surface.surface_scenario import (
    SurfaceSettings,
    require_calibration,
    require_whole,
)
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.composed import Extruded, Placed
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import (
    ParameterError,
    known,
    require_finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.contact.arm_in_contact import ContactParams
from chamfer.systems.estimation.surface_observer import SurfaceObserverParams
from chamfer.systems.force.selection import unit
from chamfer.systems.force.surface_motion import SurfaceMotionParams
from chamfer.systems.sensing.force_rate import ForceRateParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

Array = NDArray[np.float64]

_STEEPEST = math.radians(45)


@dataclass(frozen=True, kw_only=True)
class WallSettings(ContactParams, SurfaceSettings):
    """A wall through the point where the arm takes it to be, turned and bent as nobody told it.

    The shape's up is against the approach, its x along the motion; a shape of the plane is drawn
    out at right angles to both.
    """

    tilt: float = 0.0  # rad, by which the wall rises along the motion
    roll: float = 0.0  # rad, by which it rises sideways, in space

    def __post_init__(self) -> None:
        ContactParams.__post_init__(self)
        SurfaceSettings.__post_init__(self)
        require_finite(self, "tilt", "roll")
        for name in ("tilt", "roll"):
            if abs(getattr(self, name)) > _STEEPEST:
                raise ParameterError(name, getattr(self, name), "at most 45 degrees, in rad")

    def placed(self, point: Array, *, along: Array, up: Array) -> Surface:
        """Return the wall in the world.

        Args:
            point: m, shape (3,), on the wall.
            along: Unit vector, shape (3,), of the motion.
            up: Unit vector, shape (3,), at right angles to it, out of the wall as it is believed.
        """
        sideways = np.cross(up, along)
        tilted = math.cos(self.tilt) * along + math.sin(self.tilt) * up
        away = np.cross(tilted, sideways)
        rolled = math.cos(self.roll) * sideways + math.sin(self.roll) * away
        away = np.cross(tilted, rolled)
        shape = self.make()
        if shape.dimension == 2:
            shape, axes = Extruded(curve=shape), (tilted, away, -rolled)
        else:
            axes = (tilted, rolled, away)
        rows = tuple(tuple(row) for row in np.column_stack(axes).tolist())
        return Placed(surface=shape, point=tuple(point.tolist()), axes=rows)


@dataclass(frozen=True, kw_only=True)
class WallTask(ContactTask):
    """Approach, touch, push, and slide along at a constant speed."""

    distance: float  # m, from the start to the wall
    slide_speed: float  # m/s, V_d of (5-6), along the wall
    slide_acceleration: float = 0.1  # m/s^2, with which it is reached
    wait: float = 0.2  # s, of each contact, in which the observer is not given the force

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "wait")
        require_positive(self, "distance", "slide_speed", "slide_acceleration")

    @property
    def ways(self) -> tuple[float, ...]:
        """In which directions the tip slides along, 1 for ahead and -1 for back."""
        return (math.copysign(1.0, self.slide_speed),)

    @property
    def motion(self) -> SurfaceMotionParams:
        """The task in contact."""
        return SurfaceMotionParams(
            force=self.force, speed=self.slide_speed, acceleration=self.slide_acceleration
        )


@dataclass(frozen=True, kw_only=True)
class UnknownWallScenario(HybridTrials):
    """An arm that is told where a wall is, roughly, and estimates its normal."""

    surface: WallSettings
    gripper: GripperCompliance
    task: WallTask
    sensor: ForceSensorParams = ForceSensorParams()
    observer: SurfaceObserverParams
    force_rate: ForceRateParams = ForceRateParams()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole(self.observer.period, self.controller.period, "controller.period")
        if not abs(self.spatial_along @ self.spatial_up) < 1e-9:
            raise ParameterError("task.along", self.task.along, "at right angles to direction")
        planar = self.dimension == 2
        if planar and (self.surface.dimension == 3 or self.surface.roll):
            raise ParameterError("surface.shape", self.surface.shape, "one of the plane, no roll")

    @property
    def dimension(self) -> int:
        """2 for an arm in the plane, else 3."""
        return min(self.ARM.num_coordinates, 3)

    @property
    def distance(self) -> float:
        """Distance from the start to the wall, m."""
        return self.task.distance

    @property
    def spatial_along(self) -> Array:
        """Unit vector along the motion, shape (3,)."""
        return unit(np.array([*self.task.along, 0.0][:3]))

    @property
    def spatial_up(self) -> Array:
        """Unit vector out of the wall as it is believed to be, shape (3,)."""
        return unit(-np.array([*self.task.direction, 0.0][:3]))

    @property
    def axis(self) -> tuple[float, float, float]:
        """The axis about which the wall's normal is turned into the motion's direction (5-6)."""
        x, y, z = np.cross(self.spatial_along, self.spatial_up).tolist()
        return x, y, z

    @property
    def stiffness(self) -> tuple[tuple[float, ...], ...]:
        """The gripper's K where the tip should touch, in the world's axes, N/m, by rows."""
        R_WE = self.dynamics().orientation(self.joint_positions(self.touching))
        d = self.dimension
        rows = (R_WE @ np.array(self.gripper.matrix(3)) @ R_WE.T)[:d, :d]
        return tuple(map(tuple, ((rows + rows.T) / 2).tolist()))

    def make_surface(self) -> Surface:
        """Return the wall, through the point where the tip should touch."""
        q = self.joint_positions(self.touching)
        point = self.dynamics().evaluate(q, np.zeros(len(q))).p_WC
        return self.surface.placed(point, along=self.spatial_along, up=self.spatial_up)


UnknownWallScenarioT = TypeVar("UnknownWallScenarioT", bound=UnknownWallScenario)


def resolve_wall(scenario: UnknownWallScenarioT) -> UnknownWallScenarioT:
    """Return the scenario with what controller and observer are told filled in, and checked.

    The observer knows the gripper's stiffness, turned as it is where the tip should touch, and
    the noise of the force sensor and of the rate that is differenced from it.

    Raises:
        ParameterError: As :func:`chamfer.diagrams.contact.hybrid_loop_stability.resolve`.
    """
    scenario = resolve(scenario)
    given, task = scenario.observer, scenario.task
    require_calibration(given, free=task.distance / task.speed, pressed=0.0)
    noise = given.force_noise
    if noise is None:
        noise = _noise(scenario.sensor)
    derived: dict[str, Any] = {
        "stiffness": scenario.stiffness,
        "force_noise": noise,
        "force_rate_noise": noise * scenario.force_rate.noise_gain(scenario.controller.period),
    }
    if given.kind == "adaptive":
        derived["rate_lag"] = scenario.force_rate.time_constant
    missing = {name: value for name, value in derived.items() if getattr(given, name) is None}
    return replace(
        scenario, surface=scenario.surface.resolved(), observer=replace(given, **missing)
    )


def _noise(sensor: ForceSensorParams) -> float:
    """Return the rms length of a force's error by noise and converter, N."""
    undoing = sensor.undoing
    scale = np.array([1.0, 1.0, 1.0, *3 * [sensor.radius]])[: undoing.shape[1]]
    noise, step = known("noise", sensor.noise), known("resolution", sensor.resolution)
    return math.sqrt(noise**2 / 3 + step**2 / 12) * float(np.linalg.norm(undoing * scale))
