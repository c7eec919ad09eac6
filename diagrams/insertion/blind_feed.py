"""The peg's arm pushes its peg towards the hole without cameras and compensation.

The arms start at rest where they are commanded to be, the peg's with errors in one of the two
planes of insertion: a command alone would leave a part of them to the joints' friction. The peg
is fed along the nominal axis of the hole, waits, and then the push is taken away.
"""

from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar, get_args

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    PEG_ARM,
    CellArmSettings,
    HoleSettings,
    WorkCellScenario,
    resolve_arms,
    support_at,
)
from chamfer.diagrams.insertion.cell_contact import add_cell_in_contact, export_contact
from chamfer.models.peg.bore_contact import ContactMaterial, require_resolved_clearance
from chamfer.models.peg.part_surfaces import require_tilted_apart
from chamfer.models.peg.peg_and_hole import SEATED, ColouredParts
from chamfer.models.peg.support import OpenSupport, Support
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_one_of,
    require_positive,
    require_same,
)
from chamfer.systems.contact.contact_approximation import Convex
from chamfer.systems.pose import pose_vector

Plane = Literal["xy", "xz"]


@dataclass(frozen=True, kw_only=True)
class FedCellScenario(WorkCellScenario):
    """The cell, its parts, and the feed; the controllers know the arms' loads."""

    peg: CellArmSettings = replace(PEG_ARM, payload_error=0.0)
    hole: HoleSettings = replace(HOLE_ARM, payload_error=0.0)
    gap: float = 0.006  # m, from tip to mouth at the start; assumed
    feed: float = 0.12
    # m; the part beyond the depth becomes push, by the arms' stiffness; assumed
    speed: float = 0.02  # m/s, of the feed; assumed
    depth: float = 0.04  # m, of the tip below the mouth, at which the peg is in; assumed
    rest: float = 0.2  # s, between the feed and its end; assumed
    withdrawal_speed: float = 0.1  # m/s, with which the push is removed; assumed
    contact: ContactMaterial = field(default_factory=ContactMaterial)
    support: OpenSupport = field(default_factory=OpenSupport)
    # of the theory; open fields: derived from the arms, at the depth in question
    approximation: Convex = "lagged"  # of contact, by Drake
    step: float = 0.001  # s, of the plant

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "gap", "feed", "speed", "depth", "withdrawal_speed")
        require_not_negative(self, "rest")
        require_one_of(self, "approximation", get_args(Convex))
        colours = ("peg_colour", "hole_colour")
        require_same(self.parts, ColouredParts, "parts", *colours, why="nobody looks")
        if not self.feed > self.gap + self.depth:
            allowed = f"more than gap + depth, {self.gap + self.depth:g} m"
            raise ParameterError("feed", self.feed, allowed)
        require_resolved_clearance(self.parts, self.speed, self.step)

    def support_at(self, depth: float, plane: Plane) -> Support:
        """Return the believed support of the peg at a depth of its tip, m."""
        return self.support.over(support_at(self, depth, plane))

    @property
    def fed(self) -> float:
        """Time at which the feed ends, s."""
        return self.feed / self.speed

    @property
    def released(self) -> float:
        """Time at which the push begins to fall, s."""
        return self.fed + self.rest

    @property
    def duration(self) -> float:
        """Time at which the peg's command is back at the start, s."""
        return self.released + self.feed / self.withdrawal_speed

    @property
    def deepest(self) -> float:
        """Largest depth of the tip, m: the commanded one, or the bottom."""
        bottom = self.parts.bore_depth
        return self.depth if bottom is None else min(self.depth, bottom)


@dataclass(frozen=True, kw_only=True)
class BlindFeedScenario(FedCellScenario):
    """The fed cell, with the peg's errors as it is fed."""

    plane: Plane = "xy"  # of the errors, in the frame of the hole, x along its axis
    lateral: float = 0.002  # m, of the tip: how far it is off the axis, to +y or +z; assumed
    tilt: float = 0.03  # rad; of lateral's sign it adds to it, the peg's end is further off

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "plane", get_args(Plane))
        require_finite(self, "lateral", "tilt")
        require_tilted_apart(self.parts, self.tilt, self.gap)

    def start(self) -> RigidTransform:
        """Return X_WT of the peg with its errors."""
        turned = (0.0, 0.0, -self.tilt) if self.plane == "xy" else (0.0, self.tilt, 0.0)
        off = (self.lateral, 0.0) if self.plane == "xy" else (0.0, self.lateral)
        X_MT = RigidTransform(RollPitchYaw(turned), np.array([-self.gap, *off]))
        return self.nominal_pose("hole") @ X_MT


CellT = TypeVar("CellT", bound=FedCellScenario)


def resolve_fed_cell(scenario: CellT) -> CellT:
    """Fill in the meeting point of the parts and the number of facets for the clearance."""
    scenario = resolve_arms(scenario)
    contact = scenario.contact.over(scenario.parts)
    return replace(scenario, meeting_point=scenario.mouth, contact=contact)


def make_blind_feed_diagram(scenario: BlindFeedScenario) -> Diagram:
    """Return the cell in contact for a resolved scenario; the peg's arm is fed without cameras.

    Outputs: ``<arm>.true_pose``, and the outputs of the contact's monitor as ``contact.<name>``.
    """
    builder = DiagramBuilder()
    X_WT = scenario.start()
    cell, contact = add_cell_in_contact(
        builder,
        scenario,
        scenario.parts,
        seated_depth=SEATED * scenario.depth,
        material=scenario.contact,
        approximation=scenario.approximation,
        start={"peg": X_WT},
    )
    if "hole" in cell.arms:
        hole = ConstantVectorSource(pose_vector(scenario.nominal_pose("hole")))
        hole = builder.AddNamedSystem("hole desired pose", hole)
        builder.Connect(hole.get_output_port(), cell.arms["hole"].desired_pose)
    for name, path, port in (
        ("peg desired pose", _pose(scenario, X_WT), cell.arms["peg"].desired_pose),
        ("peg desired velocity", _velocity(scenario), cell.arms["peg"].desired_velocity),
    ):
        source = builder.AddNamedSystem(name, TrajectorySource(path))
        builder.Connect(source.get_output_port(), port)
    for arm, pose in cell.true_poses.items():
        builder.ExportOutput(pose, f"{arm}.true_pose")
    export_contact(builder, contact)
    diagram = builder.Build()
    diagram.set_name("Feed without sight")
    return diagram


def _pose(scenario: BlindFeedScenario, X_WT: RigidTransform) -> PiecewisePolynomial:
    """Return the desired pose over time."""
    start = pose_vector(X_WT)
    fed = start.copy()
    fed[4:] += scenario.feed * scenario.hole_axes.matrix()[:, 0]
    times = [0.0, scenario.fed, scenario.released, scenario.duration]
    poses = [start, fed, fed, start]
    if not scenario.rest:
        del times[2], poses[2]
    return PiecewisePolynomial.FirstOrderHold(times, np.array(poses).T)


def _velocity(scenario: BlindFeedScenario) -> PiecewisePolynomial:
    """Return the desired velocity likewise; as the push is taken away it is that of rest."""
    forward = np.concatenate([np.zeros(3), scenario.speed * scenario.hole_axes.matrix()[:, 0]])
    rest = np.zeros(6)
    times = [0.0, scenario.fed, scenario.duration]
    return PiecewisePolynomial.ZeroOrderHold(times, np.array([forward, rest, rest]).T)
