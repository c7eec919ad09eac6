"""Scenario of the Adept with its wrist that charges a crucible (thesis, section 1.1.2)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.charging.wrist_control import (
    CONTROLLER,
    FRICTION,
    GRIPPER,
    SENSING,
    BaseCompensationParams,
)
from chamfer.diagrams.contact.hybrid_loop_stability import (
    Stability,
    linear_loops,
    require_stable,
    stability_of,
)
from chamfer.diagrams.contact.hybrid_scenario import (
    ContactArmSettings,
    FreeArmSettings,
    HybridScenario,
    SlidingTask,
    fill,
    require_periods,
    require_steps,
    updates_of,
)
from chamfer.diagrams.contact.sensing import (
    ControllerSettings,
    Sensing,
    SensingValues,
    computer_of,
    encoders_of,
    force_noise,
    push_errors,
    sensor_of,
)
from chamfer.diagrams.surface.surface_scenario import derived_observer, require_whole
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.charging.packing import ItemPlace, Nugget, PlanItem, places
from chamfer.models.charging.station import Station, StationLayout
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.hertz import FUSED_SILICA, SILICON, hertz_stiffness
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import (
    ParameterError,
    require_between,
    require_finite,
    require_not_negative,
    require_one_of,
    require_positive,
    within,
)
from chamfer.systems.charging.charging_law import (
    DONE,
    MODE_OF,
    STOPPED,
    ChargingChart,
    make_charging_chart,
)
from chamfer.systems.charging.charging_params import (
    ChargingBeliefs,
    ChargingParams,
    ResolvedChargingParams,
)
from chamfer.systems.charging.crucible_world import GraspParams, LaidContact
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.arm_in_contact import (
    ArmInContactParams,
    ContactParams,
    ContactPoint,
    Load,
    Scene,
)
from chamfer.systems.estimation.model_error import ModelErrorParams
from chamfer.systems.estimation.normal_filter import (
    ResolvedSurfaceObserverParams,
    SurfaceObserverParams,
)
from chamfer.systems.sensing.encoders import EncoderParams, HomingParams
from chamfer.systems.sensing.force_rate import ForceRateParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

Array = NDArray[np.float64]
FaultKind = Literal[
    "none",
    "part_missing",
    "part_dropped",
    "wall_missing",
    "layer_missing",
    "contact_lost",
    "halt",
    "sensor_dead",
]

_FAR: Final = 10.0  # m, radius of a crucible whose wall is missing
_ABYSS: Final = 0.1  # m, by which a layer that is missing lies lower
_PAST: Final = 1.2  # of the way to the index marks, that homing goes
_BEFORE: Final = 0.01  # m, from where the approach is looked at
_SWING: Final = 0.01  # m, by which the nugget slides up and down where the loop is looked at
_DOWN: Final = (0.0, 0.0, -1.0)
_STILL: Final = (0.0, 0.0, 0.0, 0.0)  # the other coordinates
_UNSTEADY: Final = 0.03
# N, of a force that inertia and the gripper's damping make where chapter 4 has none; calibrated
_MOST_ITEMS: Final = 200
_RUNNING: Final = tuple(name for name in MODE_OF if name not in (DONE, STOPPED))
_LAYING: Final = ("wall", "crown", "bulk")  # modes that items of their kind alone come to
TIMED: Final = ("part_dropped", "sensor_dead", "contact_lost", "halt")  # begin in a state
# Of what may be missing, the items that would meet it.
_MEET: Final = {"wall_missing": ("wall",), "layer_missing": ("wall", "crown")}


@dataclass(frozen=True, kw_only=True)
class StationSettings:
    """The true cell, and the cycle's belief of it."""

    true: Station = Station()
    believed: StationLayout = StationLayout()


@dataclass(frozen=True, kw_only=True)
class TouchedSettings:
    """Contact of a nugget with a surface."""

    stiffness: float | None = None
    # N/m, of the contact; None: derived by Hertz, of appendix B's materials, at the desired force
    damping: float = 150.0  # N s/m, of the contact; assumed, like the Adept's
    friction: SurfaceFriction = SurfaceFriction(coefficient=0.3)  # of nuggets on it

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "damping")


@dataclass(frozen=True, kw_only=True)
class CrucibleWallSettings(TouchedSettings):
    """The crucible's wall of fused silica, and its lean."""

    lean: float = 0.0  # rad, of the crucible from the vertical, its top towards +x

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "lean")
        if abs(self.lean) > 0.2:
            raise ParameterError("lean", self.lean, "at most 0.2 rad")


@dataclass(frozen=True, kw_only=True)
class LayerSettings(TouchedSettings):
    """The layer of nuggets that a nugget is laid on."""

    damping: float = 50.0  # N s/m, of the contact; assumed
    tilt: float = 0.0  # rad, of the bed, which rises towards +x
    mass: float = 0.085  # kg, of the nugget that is pushed
    slip_friction: float = 0.5  # of that nugget on the bed, in which it is nestled; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "tilt")
        require_positive(self, "mass")
        require_not_negative(self, "slip_friction")
        if abs(self.tilt) > 0.5:
            raise ParameterError("tilt", self.tilt, "at most 0.5 rad")


@dataclass(frozen=True, kw_only=True)
class BelievedMasses:
    """Believed masses over the true ones."""

    links: float | tuple[float, ...] = 1.0  # of the arm's links, one for all or one for each
    items: float = 1.0  # of nuggets and filler

    def __post_init__(self) -> None:
        require_between(self, 0.5, 2.0, "items")
        if not all(0.5 <= one <= 2.0 for one in np.atleast_1d(self.links)):
            raise ParameterError("links", self.links, "numbers of 0.5 to 2")


@dataclass(frozen=True, kw_only=True)
class FaultParams:
    """A fault, which occurs once."""

    kind: FaultKind = "none"
    # part_missing: the feeder has none; part_dropped: the gripper loses it; wall_missing,
    # layer_missing: it does not exist; contact_lost: a blow lifts the nugget off; halt: the
    # operator's key; sensor_dead: the force sensor reads a constant from then on
    state: str = "slew.over"  # state of the chart in which it occurs; read for kinds with a time
    item: int = 0  # index in the plan
    delay: float = 0.2  # s, after the state is entered
    duration: float | None = None  # s, of halt and blow; None: derived, 1 s and 0.1 s
    force: float = 3.0
    # N, of the blow, away from the wall: contact is lost, and found again with less than 2 N;
    # after 20 N for 1 s the nugget comes back so hard that the cycle stops

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(FaultKind))
        require_one_of(self, "state", _RUNNING)
        require_not_negative(self, "delay")
        require_positive(self, "force")
        if self.duration is not None:
            require_positive(self, "duration")
        if self.item < 0:
            raise ParameterError("item", self.item, "a whole number >= 0")

    def require_met(self, kind: str) -> None:
        """Refuse a fault that its item, wall, crown or bulk, never meets.

        Raises:
            ParameterError: If the item meets nothing that is missing, or is never in the state.
        """
        met = _MEET.get(self.kind, _LAYING)
        if kind not in met:
            raise ParameterError("item", self.item, f"an item that meets it: {' or '.join(met)}")
        mode = self.state.partition(".")[0]
        if self.kind in TIMED and mode in _LAYING and mode != kind:
            raise ParameterError("state", self.state, f"a state that a {kind} item reaches")

    @property
    def lasting(self) -> float:
        """Its duration, s; infinite for a missing part or a dead sensor."""
        if self.kind in ("halt", "contact_lost"):
            usual = 1.0 if self.kind == "halt" else 0.1
            return usual if self.duration is None else self.duration
        return math.inf


@dataclass(frozen=True, kw_only=True)
class CrucibleChargingScenario:
    """Nuggets that go from a feeder over a scanner into a crucible, one after the other."""

    ARM: ClassVar[Arm] = ADEPT_WRIST
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = SENSING

    plan: tuple[PlanItem, ...] = (
        PlanItem(kind="wall", mass=0.085, azimuth=0.3),
        PlanItem(kind="wall", mass=0.185, azimuth=1.0),
        PlanItem(kind="crown", mass=0.140, azimuth=0.3),
        PlanItem(kind="bulk", mass=0.4),
    )  # nuggets and loads of the bulk filler, in the order of laying
    laid: tuple[PlanItem, ...] = ()  # nuggets that lie in the crucible already
    station: StationSettings = StationSettings()
    believed_masses: BelievedMasses = BelievedMasses()
    arm: FreeArmSettings = FreeArmSettings(joint_friction=FRICTION)
    gripper: GripperCompliance | None = GRIPPER  # of the fingers; None: rigid
    wall: CrucibleWallSettings = CrucibleWallSettings()
    layer: LayerSettings = LayerSettings()
    feeder: ContactParams = ContactParams(
        stiffness=1500.0, damping=60.0, friction=SurfaceFriction(coefficient=0.3)
    )  # a nugget on the feeder's foam; assumed: a hard tray meets 15 cm/s with more than 20 N
    touch_radius: float = 0.02  # m, of a nugget where it touches; assumed, like one of 85 g
    filler_mass: float = 0.5  # kg, of the empty bulk filler, which hangs like a nugget
    grasp: GraspParams = GraspParams()
    charging: ChargingParams = ChargingParams()
    controller: ControllerSettings = CONTROLLER
    sensing: Sensing = "ideal"
    # only errors that are set; realistic: open fields get realistic values
    sensor: ForceSensorParams = field(default_factory=ForceSensorParams)
    encoders: EncoderParams = field(default_factory=EncoderParams)
    homing: HomingParams = HomingParams(
        zero_error=(0.005, 0.005, 0.004, 0.02, 0.01, 0.01, 0.01),
        mark_distance=(0.05, 0.05, -0.02, 0.1, 0.05, 0.05, 0.05),
    )  # errors of the encoders before they pass their index marks; assumed
    friction_compensation: BaseCompensationParams | None = None  # by a base sensor; None: none
    observer: SurfaceObserverParams | None = SurfaceObserverParams(
        smallest_radius=0.025, initial_deviation=0.2, model_error=ModelErrorParams(bias=0.05)
    )  # of the normal of nuggets below, its bias the error after a tare; None: they are assumed
    # to be level
    force_rate: ForceRateParams = ForceRateParams()  # for the observer
    fault: FaultParams = FaultParams()
    step: float = 1e-4  # s, of the arm's dynamics, friction and contact
    duration: float | None = None  # s, at most; None: derived, a minute for each item

    def __post_init__(self) -> None:
        require_positive(self, "step", "filler_mass", "touch_radius")
        require_one_of(self, "sensing", ("ideal", "realistic"))
        if not 1 <= len(self.plan) <= _MOST_ITEMS:
            raise ParameterError("plan", len(self.plan), f"1 to {_MOST_ITEMS} items")
        for index, one in enumerate(self.laid):
            if one.kind == "bulk":
                raise ParameterError(f"laid[{index}].kind", one.kind, "wall or crown")
        period = self.controller.period
        require_steps(self.step, period)
        for name, own in (("charging", self.charging.period), ("grasp", self.grasp.period)):
            if own != period:
                raise ParameterError(f"{name}.period", own, f"controller.period, {period:g}")
        if self.observer is not None:
            require_whole(self.observer.period, period, "controller.period")
        if self.duration is not None:
            require_periods(self.duration, period)
        if self.fault.item >= len(self.plan):
            raise ParameterError("fault.item", self.fault.item, f"0 to {len(self.plan) - 1}")
        with within("fault"):
            self.fault.require_met(self.plan[self.fault.item].kind)
        friction, n = self.arm.joint_friction, self.ARM.num_joints
        if len(friction.coulomb) != n:
            raise ParameterError("arm.joint_friction.coulomb", friction.coulomb, f"{n} numbers")
        if self.gripper is not None:
            with within("gripper"):
                self.gripper.matrix(3)
                self.gripper.damping_matrix(3)
        with within("controller"):
            replace(self.controller, full_dynamics=True, law="inverse").for_joints(n)
        if len(np.atleast_1d(self.believed_masses.links)) not in (1, n):
            links = self.believed_masses.links
            raise ParameterError("believed_masses.links", links, f"{n} numbers, or one for all")
        with within("homing"):
            self.homing.for_joints(n)

    def dynamics(self) -> ArmDynamics:
        """Return the arm's equations of motion."""
        return ArmDynamics(self.ARM)

    def believed_dynamics(self) -> ArmDynamics:
        """Return the believed ones of the controller; its drives' rotors are known."""
        model = self.dynamics()
        off = np.broadcast_to(self.believed_masses.links, self.ARM.num_joints)
        mass, inertia = model.chain.mass * off, model.chain.inertia * off[:, None, None]
        model.chain = model.chain._replace(mass=mass, inertia=inertia)
        return model

    def places(self, *, believed: bool) -> tuple[ItemPlace, ...]:
        """Return the place of each item of the plan, for the true or the believed cell.

        Raises:
            ParameterError: As :func:`chamfer.models.charging.packing.places`.
        """
        station = self.station.believed if believed else self.station.true
        return places(self.plan, station, believed=believed, laid=self.laid)

    @property
    def nuggets(self) -> tuple[Nugget, ...]:
        """The true load of the gripper with each item; a bulk item with its filler."""
        return tuple(
            replace(item.true_nugget, mass=item.mass + self.filler_mass)
            if item.kind == "bulk"
            else item.true_nugget
            for item in self.plan
        )

    @property
    def start(self) -> Array:
        """Where the endpoint truly is at the start, m and rad, shape (7,): over the feeder."""
        x, y, z = self.station.believed.feeder
        over = self.charging.lift_height + self.plan[0].believed_nugget.height
        return np.array([x, y, z + over, 0.0, 0.0, 0.0, self.charging.lean])

    @property
    def wall_contact(self) -> ContactParams:
        """Contact of a nugget with the wall."""
        wall, force = self.wall, self.charging.wall_force
        derived = hertz_stiffness(SILICON, FUSED_SILICA, radius=self.touch_radius, force=force)
        return ContactParams(
            stiffness=wall.stiffness or derived, damping=wall.damping, friction=wall.friction
        )

    @property
    def layer_contact(self) -> LaidContact:
        """Contact of a nugget with those below, all equally round."""
        layer, radius = self.layer, self.touch_radius / 2
        force = self.charging.layer_force
        derived = hertz_stiffness(SILICON, SILICON, radius=radius, force=force)
        return LaidContact(
            stiffness=layer.stiffness or derived,
            damping=layer.damping,
            friction=layer.friction,
            mass=layer.mass,
            slip_friction=layer.slip_friction,
        )

    @property
    def plant(self) -> ArmInContactParams:
        """The arm, without contacts."""
        held, window = updates_of(self.step, self.controller.period)
        return ArmInContactParams(
            joint_friction=self.arm.joint_friction,
            gripper=self.gripper,
            step=self.step,
            held=held,
            window=window,
        )


@dataclass(frozen=True, kw_only=True)
class ResolvedCrucibleChargingScenario(CrucibleChargingScenario):
    """The same, with nothing left open."""

    charging: ResolvedChargingParams
    observer: ResolvedSurfaceObserverParams | None
    duration: float


CRUCIBLE_CHARGING: Final = CrucibleChargingScenario()


def make_scenes(scenario: ResolvedCrucibleChargingScenario) -> tuple[Scene, ...]:
    """Return two scenes for each item: the gripper empty, then with the item in it.

    Empty, the fingers meet the item in the feeder, or the feeder's ground. An item in the gripper
    meets the wall with its side, and the surface below with its bottom or flank; the feeder no
    longer holds it. The crucible contains the items laid before, at their planned places, with
    their true sizes.

    Raises:
        ParameterError: If an item does not fit into the crucible.
    """
    station, fault = scenario.station.true, scenario.fault
    goals = scenario.places(believed=False)
    standing = station.wall(lean=scenario.wall.lean)
    scenes = []
    for index, (nugget, goal) in enumerate(zip(scenario.nuggets, goals, strict=True)):
        hit = index == fault.item
        top = 0.0 if hit and fault.kind == "part_missing" else nugget.height
        grip = ContactPoint((0.0, 0.0, 0.0), station.tray(top), scenario.feeder)
        scenes.append(Scene((grip,)))
        far = hit and fault.kind == "wall_missing"
        wall = replace(station, crucible_radius=_FAR).wall() if far else standing
        if hit and fault.kind == "layer_missing":
            layer = station.layer(goal.position, goal.layer - _ABYSS)
        else:
            layer = _below(scenario, nugget, goal)
        points = (
            ContactPoint(nugget.wall_point, wall, scenario.wall_contact),
            ContactPoint(nugget.layer_point, layer, scenario.layer_contact),
        )
        load = Load(nugget.mass, nugget.centre, nugget.inertia)
        scenes.append(Scene(points, load))
    return tuple(scenes)


def _below(scenario: CrucibleChargingScenario, nugget: Nugget, goal: ItemPlace) -> Surface:
    """Return the surface that a nugget's lowest point meets at its place."""
    station, tilt = scenario.station.true, scenario.layer.tilt
    return goal.below(nugget, station.layer(goal.position, station.bed_height, tilt=tilt))


def beliefs_of(scenario: ResolvedCrucibleChargingScenario) -> ChargingBeliefs:
    """Return the cycle's beliefs of the cell."""
    arm, station = scenario.ARM, scenario.station.believed
    error, distance = scenario.homing.for_joints(arm.num_joints)
    shown = arm.joint_positions(scenario.start, scenario.arm.elbow) + error
    nuggets = tuple(
        replace(item.believed_nugget, mass=held.mass * scenario.believed_masses.items)
        for item, held in zip(scenario.plan, scenario.nuggets, strict=True)
    )
    return ChargingBeliefs(
        station=station,
        plan=scenario.plan,
        nuggets=nuggets,
        places=scenario.places(believed=True),
        start=tuple(arm.endpoint(shown).tolist()),
        home=tuple(arm.endpoint(shown + _PAST * distance).tolist()),
    )


def chart_of(scenario: ResolvedCrucibleChargingScenario) -> ChargingChart:
    """Return the cycle's chart."""
    return make_charging_chart(scenario.charging, beliefs_of(scenario))


@dataclass(frozen=True, kw_only=True)
class NuggetLoop(HybridScenario):
    """The Adept with its wrist that presses a nugget on a surface."""

    ARM: ClassVar[Arm] = ADEPT_WRIST
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = SENSING

    touched: Surface
    task: SlidingTask

    @property
    def distance(self) -> float:
        """Distance from the start to where the nugget should touch, m."""
        return _BEFORE

    def make_surface(self) -> Surface:
        """Return the surface that the nugget touches."""
        return self.touched


def contact_loops(scenario: ResolvedCrucibleChargingScenario) -> tuple[NuggetLoop, ...]:
    """Return the loops in which the plan's nuggets are pressed on a surface.

    A wall nugget slides along the wall at its place; a crown nugget is pressed on what lies below
    and follows it, with all position integrators held. Both as the world is.
    """
    station, charging = scenario.station.true, scenario.charging
    control = scenario.controller
    resting = replace(control, held_integrators=tuple(range(scenario.ARM.num_joints)))
    wall = station.wall(lean=scenario.wall.lean)
    goals = scenario.places(believed=False)
    loops = []
    for item, nugget, goal in zip(scenario.plan, scenario.nuggets, goals, strict=True):
        if item.kind == "bulk":
            continue
        outwards = (math.cos(goal.azimuth), math.sin(goal.azimuth), 0.0)
        if item.kind == "wall":
            meets = ContactPoint(nugget.wall_point, wall, scenario.wall_contact)
            force, ahead, along = charging.wall_force, outwards, _DOWN
        else:
            below = _below(scenario, nugget, goal)
            meets = ContactPoint(nugget.layer_point, below, scenario.layer_contact)
            force, ahead, along = charging.layer_force, _DOWN, outwards
        height = goal.layer + nugget.height
        start = np.array([*goal.position, height, goal.azimuth, 0.0, 0.0, charging.lean])
        start[:3] -= _BEFORE * np.array(ahead)
        loop = NuggetLoop(
            arm=ContactArmSettings(
                joint_friction=scenario.arm.joint_friction,
                elbow=scenario.arm.elbow,
                contact_offset=meets.offset,
            ),
            gripper=scenario.gripper,
            touched=meets.surface,
            surface=meets.contact,
            task=SlidingTask(
                start=tuple(start.tolist()),
                direction=(*ahead, *_STILL),
                along=(*along, *_STILL),
                speed=charging.seek_speed,
                force=force,
                amplitude=_SWING if item.kind == "wall" else charging.follow,
            ),
            controller=control if item.kind == "wall" else resting,
            sensing=scenario.sensing,
            sensor=scenario.sensor,
            encoders=scenario.encoders,
            friction_compensation=scenario.friction_compensation,
            step=scenario.step,
        )
        loops.append(fill(loop))
    return tuple(loops)


def charging_stability(scenario: ResolvedCrucibleChargingScenario) -> Stability | None:
    """Return growth and margins, the worst of all nuggets; None if none is pressed.

    Raises:
        ParameterError: If a place is out of reach.
    """
    linear = [one for loop in contact_loops(scenario) for one in linear_loops(loop)]
    return stability_of(tuple(linear)) if linear else None


def _with_gains(
    scenario: CrucibleChargingScenario, control: ControllerSettings
) -> ControllerSettings:
    """Return a controller without the full model, with one gain for each joint, as in the thesis.

    Where a nominal inertia is given, gains are multiplied by the diagonal of the believed mass
    matrix over it, where the first item is laid; with the transpose by that in coordinates.
    """
    if control.full_dynamics or control.inertia is None:
        return control
    place, nugget = scenario.places(believed=True)[0], scenario.plan[0].believed_nugget
    over = place.layer + nugget.height
    laid = np.array([*place.position, over, place.azimuth, 0.0, 0.0, scenario.charging.lean])
    q = scenario.ARM.joint_positions(laid, scenario.arm.elbow)
    mass = scenario.believed_dynamics().evaluate(q, np.zeros(len(q))).mass
    if control.law == "transpose":
        J = scenario.ARM.jacobian(q)
        mass = np.linalg.inv(J @ np.linalg.solve(mass, J.T))
    scale = np.diag(mass) / control.inertia
    return replace(
        control,
        inertia=None,
        stiffness=tuple((scale * control.stiffness).tolist()),
        integral=tuple((scale * control.integral).tolist()),
        damping=tuple((scale * control.damping).tolist()),
    )


def _resolved_observer(
    scenario: CrucibleChargingScenario, sensor: ForceSensorParams
) -> ResolvedSurfaceObserverParams | None:
    """Return the observer with its settings for gripper and sensor; it receives mean forces."""
    given, gripper, charging = scenario.observer, scenario.gripper, scenario.charging
    if given is None:
        return None
    if gripper is None:
        raise ParameterError("observer", given.kind, "null, where the gripper is rigid")
    noise = given.force_noise
    if noise is None:
        mean = force_noise(sensor) / math.sqrt(charging.detection.readings)
        noise = math.hypot(mean, _UNSTEADY)
    derived = derived_observer(
        given,
        stiffness=tuple(map(tuple, gripper.matrix(3))),
        force_noise=noise,
        force_rate_noise=noise * scenario.force_rate.noise_gain(charging.period),
        rate_lag=scenario.force_rate.time_constant,
    )
    return ResolvedSurfaceObserverParams(**vars(given) | derived)


_TIME_EACH = 60.0  # s, that an item may take


def resolve_charging(scenario: CrucibleChargingScenario) -> ResolvedCrucibleChargingScenario:
    """Return the scenario with its open fields filled in, and checked.

    Sensors and computer are what ``sensing`` says. The controller knows gravity at the start, as
    a constant, and the arm's whole model or its diagonal, with the masses that are believed.

    Raises:
        ParameterError: If blocks refuse their parameters, an item does not fit into the crucible,
            the arm can't reach a place, or a nugget's contact would be unstable and
            ``controller.allow_unstable`` is not set.
    """
    values = scenario.SENSING[scenario.sensing]
    q = scenario.ARM.joint_positions(scenario.start, scenario.arm.elbow)
    control = _with_gains(scenario, computer_of(scenario.controller, values))
    if control.feedforward_torque is None:
        gravity = scenario.believed_dynamics().gravity_torque(q)
        control = replace(control, feedforward_torque=tuple(gravity.tolist()))
    with within("sensor"):
        sensor = sensor_of(scenario.sensor, values)
    with within("encoders"):
        encoders = encoders_of(scenario.encoders, values)
        encoders.quanta(len(q))
    compensation = scenario.friction_compensation
    if compensation is not None:
        with within("friction_compensation"):
            compensation.compensated(len(q))
            compensation = compensation.filled(scenario.sensing)
    charging = scenario.charging
    with within("charging.detection"):
        R_WE = scenario.dynamics().orientation(q)
        detection = charging.detection.resolved(*push_errors(sensor, np.eye(7)[0], R_WE))
    for believed in (True, False):
        scenario.places(believed=believed)  # refuses what does not fit
    known = {
        "controller": control,
        "sensor": sensor,
        "encoders": encoders,
        "friction_compensation": compensation,
        "charging": ResolvedChargingParams(**vars(charging) | {"detection": detection}),
        "wall": replace(scenario.wall, stiffness=scenario.wall_contact.stiffness),
        "layer": replace(scenario.layer, stiffness=scenario.layer_contact.stiffness),
        "observer": _resolved_observer(scenario, sensor),
        "duration": scenario.duration or _TIME_EACH * len(scenario.plan),
    }
    found = ResolvedCrucibleChargingScenario(**vars(scenario) | known)
    for loop in contact_loops(found):
        require_stable(loop)
    return found
