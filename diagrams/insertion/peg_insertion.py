"""One peg on a spring support, fed into a hole that is fixed: Whitney's case, with inertia.

World frame: that of the mouth, x into the hole. The feed carries the support at a constant
speed, pushing with a force up to its cap. On it the centre of compliance moves along y and z and
turns about both, on springs; gravity does not act. The tilt and the lateral error are in the
plane X-Y: positive where the tip, and where the centre beyond the tip, is further to +y, so that
equal signs add.

A run advances by the feed, waits, and then takes the push away and withdraws.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Final, TypeVar, get_args

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import AffineSystem, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.cell.work_cell import add_part_meshes
from chamfer.diagrams.insertion.cell_contact import TouchingParts, export_contact
from chamfer.models.peg.bore_contact import ContactMaterial, require_resolved_clearance
from chamfer.models.peg.part_surfaces import require_tilted_apart
from chamfer.models.peg.peg_and_hole import SEATED, ColouredParts, PegAndHole
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.wedging import require_stiff
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.contact.contact_approximation import Convex

JOINTS: Final = ("feed", "y", "z", "rz", "ry")  # in the plant's order
PLANT: Final = "plant"  # the name that CENIC looks for
_CARRIER: Final = 1e-3  # kg, of each of the support's bodies, for which CENIC wants a mass
_SIZE: Final = 0.005  # m, of such a body


@dataclass(frozen=True, kw_only=True)
class FeedSupport(Support):
    """The support with the additional values that a simulation needs."""

    axial_stiffness: float = 2e4  # N/m, of feed and support along the axis; assumed
    damping_ratio: float = 0.1  # of the peg on each spring; assumed, small: quasi-static

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "axial_stiffness", "damping_ratio")


@dataclass(frozen=True, kw_only=True)
class FeedScenario:
    """A peg, its hole, the support, and the feed.

    The feed goes on, beyond the depth, until it pushes with its cap; the run ends where the
    depth is reached.
    """

    parts: PegAndHole = field(default_factory=PegAndHole)
    support: FeedSupport = field(default_factory=FeedSupport)
    speed: float = 0.02  # m/s, of the feed; assumed
    force_cap: float = 40.0  # N, largest push of the feed; assumed
    depth: float = 0.03  # m, commanded, of the tip below the mouth; assumed
    gap: float = 0.003  # m, from tip to mouth at the start; assumed
    rest: float = 0.1  # s, between the feed and the withdrawal; assumed
    mass: float = 0.25  # kg, of the peg and the bodies that move with it; assumed
    contact: ContactMaterial = field(default_factory=ContactMaterial)
    stiction: float = 1e-4  # m/s, speed below which a contact sticks, creeping; by Drake
    approximation: Convex = "lagged"  # of contact, by Drake
    step: float = 0.001  # s, of the plant

    def __post_init__(self) -> None:
        require_positive(self, "speed", "force_cap", "depth", "gap", "mass", "stiction", "step")
        require_not_negative(self, "rest")
        require_one_of(self, "approximation", get_args(Convex))
        require_stiff(self.parts, self.support)
        if not self.depth <= self.parts.peg_length:
            allowed = f"at most the peg's length, {self.parts.peg_length} m"
            raise ParameterError("depth", self.depth, allowed)
        require_resolved_clearance(self.parts, self.speed, self.step)

    @property
    def way(self) -> float:
        """Travel of the feed, m."""
        return self.gap + self.depth + self.force_cap / self.support.axial_stiffness

    @property
    def fed(self) -> float:
        """Time at which the feed ends, s."""
        return self.way / self.speed

    @property
    def released(self) -> float:
        """Time at which the push begins to fall, s."""
        return self.fed + self.rest

    @property
    def duration(self) -> float:
        """Time at which the peg is back at the start, s."""
        return self.released + self.fed


@dataclass(frozen=True, kw_only=True)
class PegInsertionScenario(FeedScenario):
    """The feed, with the peg's errors at the start."""

    lateral: float = 0.0025  # m, of the tip: the mean of the ten runs (section 5)
    tilt: float = 0.022  # rad, the mean of the ten runs; the same sign is assumed, the worst case

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "lateral", "tilt")
        require_tilted_apart(self.parts, self.tilt, self.gap)


PEG_INSERTION: Final = PegInsertionScenario()


ScenarioT = TypeVar("ScenarioT", bound=FeedScenario)


def resolve_peg_insertion(scenario: ScenarioT) -> ScenarioT:
    """Fill in the number of facets for the clearance."""
    return replace(scenario, contact=scenario.contact.over(scenario.parts))


def make_peg_insertion_diagram(
    scenario: PegInsertionScenario, *, continuous: bool = False
) -> Diagram:
    """Return the peg on its support, the hole, and the feed.

    Args:
        scenario: Resolved.
        continuous: Leave the steps to an integrator such as CENIC. The scenario's step and
            approximation of contact are then not used.

    Outputs: ``joints``, positions above velocities of :data:`JOINTS`, shape (10,). ``drives``, N
    and N m, of feed and springs on the peg, shape (5,). Also those of
    :class:`PegHoleContactMonitor`.
    """
    builder = DiagramBuilder()
    step = 0.0 if continuous else scenario.step
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, step)
    plant.set_name(PLANT)
    scene_graph.set_name("geometry")
    plant.set_stiction_tolerance(scenario.stiction)
    peg, body = _add_sprung_peg(plant, scenario)
    touching = TouchingParts(scenario.parts, scenario.contact, scenario.approximation)
    touching.add(plant, body, plant.world_body())
    plant.Finalize()
    plant.SetDefaultPositions(_at_rest(scenario))

    feed = builder.AddNamedSystem("feed", TrajectorySource(_feed(scenario), 1))
    desired = builder.AddNamedSystem("support at rest", _desired(scenario))
    contact = touching.monitor(builder, plant, SEATED * scenario.depth)
    connect = builder.Connect
    connect(feed.get_output_port(), desired.get_input_port())
    connect(desired.get_output_port(), plant.get_desired_state_input_port(peg))
    builder.ExportOutput(plant.get_state_output_port(peg), "joints")
    builder.ExportOutput(plant.get_net_actuation_output_port(peg), "drives")
    export_contact(builder, contact, "")
    diagram = builder.Build()
    diagram.set_name("Peg on a spring support")
    return diagram


def _add_sprung_peg(
    plant: MultibodyPlant, scenario: FeedScenario
) -> tuple[ModelInstanceIndex, RigidBody]:
    """Add the peg on its springs; return its joints' instance and the body, in its frame.

    The solver takes springs as they are at a step's end: no step is too long for a light peg.
    """
    instance = plant.AddModelInstance("peg")
    support, parts = scenario.support, scenario.parts
    L_g, mass = support.centre_distance, scenario.mass
    back = parts.peg_length / 2
    shape = UnitInertia.SolidCylinder(parts.peg_radius, parts.peg_length, np.array([1.0, 0, 0]))
    if parts.section == "square":
        shape = UnitInertia.SolidBox(parts.peg_length, 2 * parts.peg_radius, 2 * parts.peg_radius)
    middle = np.array([-back, 0.0, 0.0])
    inertia = SpatialInertia(mass, middle, shape.ShiftFromCenterOfMass(-middle))
    plant.set_gravity_enabled(instance, False)
    about_middle = shape.get_moments()[1]
    turning = mass * ((L_g - back) ** 2 + about_middle)
    along, across = (support.axial_stiffness, mass), (support.lateral_stiffness, mass)
    about = support.angular_stiffness, turning
    springs = along, across, across, about, about
    axes = np.eye(3)[[0, 1, 2, 2, 1]]
    parent = plant.world_body()
    for name, (stiffness, moved), axis in zip(JOINTS, springs, axes, strict=True):
        last = name == JOINTS[-1]
        body = plant.AddRigidBody(
            "peg" if last else f"support {name}",
            instance,
            inertia if last else SpatialInertia.SolidSphereWithMass(_CARRIER, _SIZE),
        )
        kind = RevoluteJoint if name.startswith("r") else PrismaticJoint
        child = body.body_frame()
        if last:
            X_TC = RigidTransform([-L_g, 0.0, 0.0])
            child = plant.AddFrame(FixedOffsetFrame("compliance centre", child, X_TC))
        joint = plant.AddJoint(kind(name, parent.body_frame(), child, axis))
        limit = scenario.force_cap if name == "feed" else math.inf
        damping = 2 * support.damping_ratio * math.sqrt(stiffness * moved)
        actuator = plant.AddJointActuator(name, joint, limit)
        actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
        parent = body
    return instance, parent


def _at_rest(scenario: PegInsertionScenario) -> np.ndarray:
    """Return the joints' positions at the start, where no spring is strained."""
    L_g, tilt = scenario.support.centre_distance, scenario.tilt
    x, y = -scenario.gap - L_g * math.cos(tilt), scenario.lateral + L_g * math.sin(tilt)
    return np.array([x, y, 0.0, -tilt, 0.0])


def _feed(scenario: PegInsertionScenario) -> PiecewisePolynomial:
    """Return the way of the feed from the start, m."""
    times = [0.0, scenario.fed, scenario.released, scenario.duration]
    ways = [0.0, scenario.way, scenario.way, 0.0]
    if not scenario.rest:
        del times[2], ways[2]
    return PiecewisePolynomial.FirstOrderHold(times, np.array([ways]))


def _desired(scenario: PegInsertionScenario) -> AffineSystem:
    """Return the map from the feed's way and speed to the state that the springs pull towards."""
    n = len(JOINTS)
    D = np.zeros((2 * n, 2))
    D[0, 0] = D[n, 1] = 1.0
    rest = np.concatenate([_at_rest(scenario), np.zeros(n)])
    empty = np.zeros((0, 0))
    return AffineSystem(empty, np.zeros((0, 2)), np.zeros(0), np.zeros((2 * n, 0)), D, rest)


def make_peg_insertion_view(
    scenario: PegInsertionScenario, meshcat: Meshcat
) -> tuple[Diagram, MultibodyPlant]:
    """Return a diagram that shows peg and hole in Meshcat when it publishes, and its plant."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, scenario.step)
    _, body = _add_sprung_peg(plant, scenario)
    coloured = ColouredParts(**vars(scenario.parts))
    add_part_meshes(coloured, plant, {"peg": body, "hole": plant.world_body()})
    plant.Finalize()
    params = MeshcatVisualizerParams(prefix="insertion")
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    return builder.Build(), plant
