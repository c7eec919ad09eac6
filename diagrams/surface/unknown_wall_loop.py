"""An arm that finds an unknown wall: Fig. 2-4 and Fig. 5-7 in one loop (section 6.3)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import MatrixGain

from chamfer.diagrams.contact.contact_scenarios import AdeptLoop, PlanarLoop, PumaScenario
from chamfer.diagrams.contact.hybrid_loop import (
    add_friction_compensation,
    add_kick,
    add_manipulator,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import ContactTask, HybridTrials
from chamfer.diagrams.contact.sensing import Sensing, SensingValues, force_noise
from chamfer.diagrams.surface.surface_scenario import (
    SurfaceSettings,
    derived_observer,
    require_calibration,
    require_whole,
)
from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.composed import Extruded, Placed
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.contact.arm_in_contact import ContactParams
from chamfer.systems.estimation.normal_filter import (
    ResolvedSurfaceObserverParams,
    SurfaceObserverParams,
)
from chamfer.systems.estimation.surface_observer import SettledForce, SurfaceObserver
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.force.hybrid_controller import HybridController, require_hybrid_ports
from chamfer.systems.force.projection import unit
from chamfer.systems.force.surface_motion import GuardedMotion, SurfaceMotion, SurfaceMotionParams
from chamfer.systems.sensing.encoders import EndpointMotion
from chamfer.systems.sensing.force_rate import ForceRate, ForceRateParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

Array = NDArray[np.float64]

_STEEPEST: Final = math.radians(45)
# The observer needs three axes of force: the planar arm's sensor in place of the load cell.
_PUMA_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    sensing: replace(values, sensor=PlanarLoop.SENSING[sensing].sensor)
    for sensing, values in PumaScenario.SENSING.items()
}


@dataclass(frozen=True, kw_only=True)
class UnknownWallSettings(ContactParams, SurfaceSettings):
    """A wall through its believed point, with a tilt and a shape that are unknown to the arm.

    The shape's up is against the approach, its x along the motion. A plane shape is extruded at
    right angles to both.
    """

    tilt: float = 0.0  # rad, of the wall, which rises along the motion
    roll: float = 0.0  # rad, of the wall, which rises sideways, in space

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
            up: Unit vector, shape (3,), at right angles to it, out of the believed wall.
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
class UnknownWallTask(ContactTask):
    """Approach, touch, push, and slide along at a constant speed."""

    distance: float  # m, from the start to the wall
    slide_speed: float  # m/s, V_d of (5-6), along the wall
    slide_acceleration: float = 0.1  # m/s^2, up to that speed
    wait: float = 0.2  # s, at the start of each contact, without force to the observer

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "wait")
        require_positive(self, "distance", "slide_speed", "slide_acceleration")

    @property
    def ways(self) -> tuple[float, ...]:
        """Directions in which the tip slides, 1 for ahead and -1 for back."""
        return (math.copysign(1.0, self.slide_speed),)

    @property
    def motion(self) -> SurfaceMotionParams:
        """The task in contact."""
        return SurfaceMotionParams(
            force=self.force, speed=self.slide_speed, acceleration=self.slide_acceleration
        )


@dataclass(frozen=True, kw_only=True)
class UnknownWallScenario(HybridTrials):
    """An arm that knows a wall's approximate place, and estimates its normal."""

    surface: UnknownWallSettings
    gripper: GripperCompliance
    task: UnknownWallTask
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
        """Unit vector out of the believed wall, shape (3,)."""
        return unit(-np.array([*self.task.direction, 0.0][:3]))

    @property
    def axis(self) -> tuple[float, float, float]:
        """The axis about which the wall's normal is turned into the motion's direction (5-6)."""
        x, y, z = np.cross(self.spatial_along, self.spatial_up).tolist()
        return x, y, z

    @property
    def stiffness(self) -> tuple[tuple[float, ...], ...]:
        """The gripper's K at the desired contact, in the world's axes, N/m, by rows."""
        R_WE = self.dynamics().orientation(self.joint_positions(self.touching))
        d = self.dimension
        rows = (R_WE @ np.array(self.gripper.matrix(3)) @ R_WE.T)[:d, :d]
        return tuple(map(tuple, ((rows + rows.T) / 2).tolist()))

    def make_surface(self) -> Surface:
        """Return the wall, through the desired contact point."""
        q = self.joint_positions(self.touching)
        point = self.dynamics().evaluate(q, np.zeros(len(q))).p_WC
        return self.surface.placed(point, along=self.spatial_along, up=self.spatial_up)


@dataclass(frozen=True, kw_only=True)
class AdeptUnknownWallScenario(UnknownWallScenario):
    """The Adept One slides a nugget along a wall that it does not know."""

    ARM: ClassVar[Arm] = ADEPT_ONE
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = AdeptLoop.SENSING


@dataclass(frozen=True, kw_only=True)
class PumaUnknownWallScenario(UnknownWallScenario):
    """The same with the Puma 250, and with a wrist sensor in place of its load cell."""

    ARM: ClassVar[Arm] = PUMA_250
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _PUMA_SENSING


@dataclass(frozen=True, kw_only=True)
class PlanarUnknownWallScenario(UnknownWallScenario):
    """The same with the two-link arm in the plane."""

    ARM: ClassVar[Arm] = PLANAR_TWO_LINK
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = PlanarLoop.SENSING


_WALL: Final = UnknownWallSettings(
    stiffness=3e4,
    damping=150.0,
    friction=SurfaceFriction(coefficient=0.3),
    shape="circle",
    radius=0.75,
    inside=True,
    tilt=0.15,
)
# Rubber between wrist and nugget; assumed.
_GRIPPER: Final = GripperCompliance(stiffness=1e3, damping=20.0)
ADEPT_WALL: Final = AdeptUnknownWallScenario(
    arm=AdeptLoop.arm,
    surface=_WALL,
    gripper=_GRIPPER,
    task=UnknownWallTask(
        start=(0.45, -0.2, 0.3, 0.0),
        direction=(1.0, 0.0, 0.0, 0.0),
        along=(0.0, 1.0, 0.0, 0.0),
        distance=0.05,
        speed=0.05,
        force=5.0,  # section 5.3.4
        slide_speed=0.03,  # nugget scanning, section 1.1.2
        kick_time=9.0,
    ),
    controller=replace(AdeptLoop.controller, force_integral=3.0, force_damping=150.0),
    sensor=ForceSensorParams(decoupling=True),
    observer=SurfaceObserverParams(initial_deviation=0.2),
    measure_after=3.0,  # s
    trials=4,
)
PUMA_WALL: Final = PumaUnknownWallScenario(
    arm=PumaScenario.arm,
    surface=_WALL,
    gripper=_GRIPPER,
    task=UnknownWallTask(
        start=(0.31, -0.011, 0.45),
        direction=(1.0, 0.0, 0.0),
        along=(0.0, 0.0, 1.0),
        distance=0.03,  # section 3.1.3
        speed=0.03,
        force=5.0,  # section 3.1.3
        slide_speed=0.03,
        kick_time=6.0,
        kick_speed=0.4,
    ),
    controller=replace(PumaScenario.controller, force_integral=3.0, force_damping=150.0),
    sensor=ForceSensorParams(noise=0.5),
    observer=SurfaceObserverParams(initial_deviation=0.2),
    # Section 6.3; without it stiction lets the force rise to 8 N where contact is made.
    friction_compensation=FrictionCompensationParams(bandwidth=20.0),
    duration=10.0,  # s
    measure_after=3.0,  # s
    trials=4,
)
PLANAR_WALL: Final = PlanarUnknownWallScenario(
    arm=PlanarLoop.arm,
    surface=_WALL,
    gripper=_GRIPPER,
    task=UnknownWallTask(
        start=(1.0, -1.4),
        direction=(0.0, -1.0),
        along=(1.0, 0.0),
        distance=0.1,
        speed=0.05,
        force=5.0,  # section 5.3.4
        slide_speed=0.03,
        kick_time=9.0,
        kick_speed=0.4,
    ),
    controller=replace(
        PlanarLoop.controller, law="transpose", force_integral=8.0, force_damping=100.0
    ),
    sensor=ForceSensorParams(noise=0.5),
    observer=SurfaceObserverParams(initial_deviation=0.2),
    measure_after=3.0,  # s
    trials=4,
)


@dataclass(frozen=True, kw_only=True)
class ResolvedUnknownWallScenario(UnknownWallScenario):
    """The same, with nothing left open."""

    observer: ResolvedSurfaceObserverParams


@dataclass(frozen=True, kw_only=True)
class _ResolvedAdept(ResolvedUnknownWallScenario, AdeptUnknownWallScenario):
    pass


@dataclass(frozen=True, kw_only=True)
class _ResolvedPuma(ResolvedUnknownWallScenario, PumaUnknownWallScenario):
    pass


@dataclass(frozen=True, kw_only=True)
class _ResolvedPlanar(ResolvedUnknownWallScenario, PlanarUnknownWallScenario):
    pass


_RESOLVED: Final = {one.ARM.name: one for one in (_ResolvedAdept, _ResolvedPuma, _ResolvedPlanar)}


def resolve_wall(scenario: UnknownWallScenario) -> ResolvedUnknownWallScenario:
    """Return the scenario with controller's and observer's open fields filled in, and checked.

    The observer knows the gripper's stiffness in its orientation at the desired contact, and
    the noise of the force sensor and of the rate that is differenced from it.

    Raises:
        ParameterError: As :func:`chamfer.diagrams.contact.hybrid_loop_stability.resolve`.
    """
    scenario = resolve(scenario)
    given, task = scenario.observer, scenario.task
    require_calibration(given, free=task.distance / task.speed, pressed=0.0)
    noise = force_noise(scenario.sensor) if given.force_noise is None else given.force_noise
    derived = derived_observer(
        given,
        stiffness=scenario.stiffness,
        force_noise=noise,
        force_rate_noise=noise * scenario.force_rate.noise_gain(scenario.controller.period),
        rate_lag=scenario.force_rate.time_constant,
    )
    observer = ResolvedSurfaceObserverParams(**vars(given) | derived)
    known = {"surface": scenario.surface.resolved(), "observer": observer}
    return _RESOLVED[scenario.ARM.name](**vars(scenario) | known)


def make_unknown_wall_diagram(
    scenario: ResolvedUnknownWallScenario, *, controller: LeafSystem | None = None
) -> Diagram:
    """Build the loop.

    Outputs:

    * the arm's ``encoders``, ``contact_force``, ``contact`` and ``tip``;
    * the controller's ``torque``, ``position_error`` and ``force_error``;
    * the ``mode`` of contact;
    * the observer's ``normal``, ``covariance``, ``deviation`` and ``status``;
    * its inputs ``measured_force``, ``measured_force_rate`` (before the wait) and
      ``nominal_motion``.

    Controller and observer know the arm only by its encoders and its force sensor. Before contact
    the arm follows the guarded approach. In contact the observer's normal sets selection, desired
    force and motion. The arm searches lost contact along the last normal.

    Args:
        scenario: Parameters of the blocks.
        controller: Your own, in place of the
            :class:`chamfer.systems.force.hybrid_controller.HybridController`; with its ports, as
            :func:`chamfer.systems.force.hybrid_controller.require_hybrid_ports` lists them.

    Raises:
        ParameterError: If the controller has other ports.
    """
    arm, task, control = scenario.ARM, scenario.task, scenario.controller
    d, m = scenario.dimension, scenario.ARM.num_coordinates
    builder = DiagramBuilder()
    manipulator = add_manipulator(builder, scenario)
    add = builder.AddNamedSystem
    endpoint = add("endpoint motion", EndpointMotion(arm, dimension=d))
    spatial = add("force in space", MatrixGain(np.eye(d, m)))
    rate = add("force rate", ForceRate(scenario.force_rate, dimension=d, period=control.period))
    settled = add("settled force", SettledForce(task.wait, dimension=d, period=control.period))
    up = scenario.spatial_up[:d]
    observer = add("surface estimator", SurfaceObserver(scenario.observer, up))
    detecting = ContactDetection(scenario.detection, scenario.direction, period=control.period)
    detection = add("contact detection", detecting)
    approach = add("approach", GuardedMotion(task))
    sliding = SurfaceMotion(
        task.motion, start=task.start, axis=scenario.axis, dimension=d, period=control.period
    )
    motion = add("task", sliding)
    if controller is None:
        dynamics = scenario.dynamics() if control.full_dynamics else None
        controller = HybridController(arm, control, dynamics=dynamics)
    require_hybrid_ports(controller, arm)
    add("hybrid control", controller)
    connect = builder.Connect
    measured = manipulator.measured_force
    mode = detection.GetOutputPort("state")
    connect(manipulator.encoders, endpoint.get_input_port())
    connect(measured, spatial.get_input_port())
    connect(spatial.get_output_port(), rate.get_input_port())
    for name, source in (("force", spatial), ("force_rate", rate)):
        given = settled.GetOutputPort(f"settled_{name}")
        connect(source.get_output_port(), settled.GetInputPort(f"measured_{name}"))
        connect(given, observer.GetInputPort(f"measured_{name}"))
    connect(mode, settled.GetInputPort("mode"))
    connect(endpoint.GetOutputPort("nominal_motion"), observer.GetInputPort("nominal_motion"))
    connect(measured, detection.GetInputPort("measured_force"))
    connect(detection.GetOutputPort("contact_time"), approach.GetInputPort("contact_time"))
    connect(endpoint.GetOutputPort("endpoint_motion"), motion.GetInputPort("endpoint_motion"))
    connect(observer.GetOutputPort("normal"), motion.GetInputPort("normal"))
    connect(mode, motion.GetInputPort("mode"))
    connect(approach.get_output_port(), motion.GetInputPort("approach"))
    connect(manipulator.encoders, controller.GetInputPort("encoders"))
    connect(measured, controller.GetInputPort("measured_force"))
    connect(mode, controller.GetInputPort("mode"))
    for name in ("selection", "desired_force", "desired_position"):
        connect(motion.GetOutputPort(name), controller.GetInputPort(name))
    torque = add_friction_compensation(builder, scenario, manipulator, controller)
    connect(torque, manipulator.torque)
    add_kick(builder, scenario, manipulator.arm)
    for block, names in (
        (manipulator.arm, ("encoders", "contact_force", "contact", "tip")),
        (controller, ("torque", "position_error", "force_error")),
        (observer, ("normal", "covariance", "deviation", "status")),
        (endpoint, ("nominal_motion",)),
    ):
        for name in names:
            builder.ExportOutput(block.GetOutputPort(name), name)
    builder.ExportOutput(mode, "mode")
    builder.ExportOutput(spatial.get_output_port(), "measured_force")
    builder.ExportOutput(rate.get_output_port(), "measured_force_rate")
    diagram = builder.Build()
    diagram.set_name(f"Control along an unknown wall, {arm.name}")
    return diagram
