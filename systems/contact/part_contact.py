"""What of a peg touches what of its hole, and with what force: Drake's contacts, read."""

import math
from collections.abc import Collection
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, LeafSystem, ValueProducer

from models.peg_and_hole import PegAndHole

Array = NDArray[np.float64]

FEATURES: Final = ("mouth", "tip", "chamfer", "face", "bottom")
SIDES: Final = FEATURES[:3]  # those that have one
WRENCH_SIZE: Final = 6
_MOUTH, _TIP, _CHAMFER, _FACE, _BOTTOM = range(len(FEATURES))
_FLUSH: Final = 2e-4  # m, of a face, within which what touches along the axis touches the face
_TOUCHING: Final = 0.01  # N, the least force of a feature that touches


class ContactState(IntEnum):
    """What a peg is doing."""

    NONE = 0
    CHAMFER = 1  # on a chamfer, its own or the mouth's
    ONE_POINT = 2  # on one side of the bore, also along it
    TWO_POINT = 3  # on opposite sides of it, one at the mouth and one at the tip
    SEATED = 4  # deep enough, or on the bottom
    FACE = 5  # on the face beside the mouth


class Points(NamedTuple):
    """Contacts at points, in the mouth's frame."""

    position: Array  # m, shape (n, 3)
    force: Array  # N, on the peg, shape (n, 3)
    normal: Array  # unit vectors out of the hole's material, shape (n, 3)
    speed: Array  # m/s, along the face and apart, shape (n, 2)

    @property
    def pressing(self) -> Array:
        """Normal forces, N, shape (n,)."""
        forces: Array = np.vecdot(self.force, self.normal)
        return forces

    @property
    def wrench(self) -> Array:
        """The wrench on the peg about the middle of the mouth, N m above N, shape (6,)."""
        x, f = self.position.T, self.force.T
        turning = [x[1] @ f[2] - x[2] @ f[1], x[2] @ f[0] - x[0] @ f[2], x[0] @ f[1] - x[1] @ f[0]]
        return np.array([*turning, *self.force.sum(axis=0)])

    @property
    def loss(self) -> float:
        """The power that the contacts take, W."""
        pressing = self.pressing
        rubbing = np.sqrt(np.maximum(np.vecdot(self.force, self.force) - pressing**2, 0.0))
        return float(rubbing @ self.speed[:, 0] - pressing @ self.speed[:, 1])


class Clusters(NamedTuple):
    """Contacts by feature."""

    forces: Array  # N, sum of the normal forces on each of FEATURES, shape (5,)
    sides: Array  # rad, direction from the axis towards each of SIDES, from y to z, shape (3,)

    def state(self) -> ContactState:
        """Return what touches, short of being seated."""
        touches = dict(zip(FEATURES, self.forces > _TOUCHING, strict=True))
        if touches["mouth"] and touches["tip"] and self.opposite:
            return ContactState.TWO_POINT
        if touches["mouth"] or touches["tip"]:
            return ContactState.ONE_POINT
        if touches["chamfer"]:
            return ContactState.CHAMFER
        return ContactState.FACE if touches["face"] else ContactState.NONE

    @property
    def opposite(self) -> bool:
        """Whether mouth and tip touch on opposite sides."""
        return math.cos(self.sides[0] - self.sides[1]) < 0


def cluster(points: Points, X_MT: RigidTransform, parts: PegAndHole) -> Clusters:
    """Return the contacts' forces by what touches, and on which side.

    The normal tells bore, chamfer and faces apart; of the bore's contacts, those closer to the
    peg's corner than to the bore's edge are at the tip. A wedge of the hole's geometry is no
    feature: a contact is one however many pairs of pieces share its force.

    Args:
        points: In the mouth's frame.
        X_MT: The peg's frame in the mouth's.
        parts: Peg and hole.
    """
    edge = parts.hole_chamfer.height
    angles = parts.chamfer_angle, parts.peg_chamfer_angle
    on_bore, on_face = math.cos(max(angles)) / 2, (1 + math.cos(min(angles))) / 2
    x, along = points.position[:, 0], np.abs(points.normal[:, 0])
    along_peg = (points.position - X_MT.translation()) @ X_MT.rotation().matrix()[:, 0]
    to_corner = np.abs(along_peg + parts.peg_chamfer.height)
    feature = np.where(np.abs(x - edge) <= to_corner, _MOUTH, _TIP)
    feature = np.where(along > on_bore, _CHAMFER, feature)
    # Along the axis: the front face, the bottom, or between them the tilted rim on an edge.
    end = np.where(x <= _FLUSH, _FACE, _CHAMFER)
    if parts.bore_depth is not None:
        end = np.where(x > parts.bore_depth - _FLUSH, _BOTTOM, end)
    feature = np.where(along > on_face, end, feature)
    pressing = points.pressing
    forces = np.bincount(feature, pressing, len(FEATURES)).astype(np.float64)
    y, z = (np.bincount(feature, -pressing * points.normal[:, k], len(FEATURES)) for k in (1, 2))
    return Clusters(forces, np.arctan2(z, y)[: len(SIDES)])


class PartContact(LeafSystem):
    """Says what of a peg touches its hole, and with what force.

    .. pydrake_system::

        name: PartContact
        input_ports:
        - contact_results
        - body_poses
        output_ports:
        - state
        - wrench
        - normal_forces
        - sides
        - depth
        - loss

    The inputs are the plant's ports of these names. ``state``, shape (1,), is a
    :class:`ContactState`. ``wrench``, shape (6,), N m above N, is that of the hole on the peg
    about the middle of the mouth in the mouth's frame: x into the hole. ``normal_forces``, N,
    shape (5,), by :data:`FEATURES`; ``sides``, rad, shape (3,), by :data:`SIDES`, 0 where nothing
    touches. ``depth``, m, is that of the tip's middle below the mouth. ``loss``, W, is the power
    that the contacts take, elastic part included.

    Args:
        parts: Peg and hole.
        peg: The body that holds the peg, and the peg's frame on it.
        hole: Likewise of the part with the hole.
        peg_shapes: The peg's collision geometry.
        hole_shapes: The hole's.
        seated_depth: m, of the tip; from there on the peg is seated.
    """

    def __init__(
        self,
        parts: PegAndHole,
        *,
        peg: tuple[RigidBody, RigidTransform],
        hole: tuple[RigidBody, RigidTransform],
        peg_shapes: Collection[GeometryId],
        hole_shapes: Collection[GeometryId],
        seated_depth: float,
    ) -> None:
        super().__init__()
        self._parts = parts
        self._peg, self._hole = (int(body.index()) for body, _ in (peg, hole))
        self._X_BT, self._X_BM = peg[1], hole[1]
        self._peg_shapes, self._hole_shapes = frozenset(peg_shapes), frozenset(hole_shapes)
        self._seated_depth = seated_depth
        results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self._results, self._poses = results, poses
        entry = self.DeclareCacheEntry(
            "contacts",
            ValueProducer(allocate=lambda: AbstractValue.Make(None), calc=self._calc),
            {results.ticket(), poses.ticket()},
        )
        for k, (name, size) in enumerate(
            (
                ("state", 1),
                ("wrench", WRENCH_SIZE),
                ("normal_forces", len(FEATURES)),
                ("sides", len(SIDES)),
                ("depth", 1),
                ("loss", 1),
            )
        ):

            def calc(context: Context, output: BasicVector, k: int = k) -> None:
                output.SetFromVector(entry.Eval(context)[k])

            self.DeclareVectorOutputPort(name, size, calc, {entry.ticket()})

    def _calc(self, context: Context, value: Any) -> None:
        poses = self._poses.Eval(context)
        X_WM = poses[self._hole] @ self._X_BM
        X_MW = X_WM.inverse()
        X_MT = X_MW @ poses[self._peg] @ self._X_BT
        points = self._points(self._results.Eval(context), X_MW)
        found = cluster(points, X_MT, self._parts)
        depth = float(X_MT.translation()[0])
        state = found.state()
        if depth >= self._seated_depth or found.forces[-1] > _TOUCHING:
            state = ContactState.SEATED
        value.set_value(
            ([state], points.wrench, found.forces, found.sides, [depth], [points.loss])
        )

    def _points(self, results: ContactResults, X_MW: RigidTransform) -> Points:
        rows = []
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            pair = info.point_pair()
            # The pair's normal points from B into A, the force acts on B.
            if pair.id_A in self._hole_shapes and pair.id_B in self._peg_shapes:
                sign = -1.0
            elif pair.id_A in self._peg_shapes and pair.id_B in self._hole_shapes:
                sign = 1.0
            else:
                continue
            force, normal = -sign * info.contact_force(), sign * pair.nhat_BA_W
            speed = info.slip_speed(), info.separation_speed()
            rows.append((*info.contact_point(), *force, *normal, *speed))
        table = np.array(rows).reshape(len(rows), 11)
        R_WM = X_MW.rotation().matrix().T
        return Points(
            table[:, :3] @ R_WM + X_MW.translation(),
            table[:, 3:6] @ R_WM,
            table[:, 6:9] @ R_WM,
            table[:, 9:],
        )
