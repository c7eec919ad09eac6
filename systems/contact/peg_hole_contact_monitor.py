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

from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.compiled import compiled

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
    def wrench_and_loss(self) -> Array:
        """N m above N, on the peg about the middle of the mouth; W that they take, shape (7,)."""
        return _wrench_and_loss(*self)


class Clusters(NamedTuple):
    """Contacts by feature."""

    forces: Array  # N, sum of the normal forces on each of FEATURES, shape (5,)
    sides: Array  # rad, direction from the axis towards each of SIDES, from y to z, shape (3,)

    def state(self) -> ContactState:
        """Return what touches, short of being seated."""
        mouth, tip, chamfer, face, _ = (force > _TOUCHING for force in self.forces.tolist())
        if mouth and tip and self.opposite:
            return ContactState.TWO_POINT
        if mouth or tip:
            return ContactState.ONE_POINT
        if chamfer:
            return ContactState.CHAMFER
        return ContactState.FACE if face else ContactState.NONE

    @property
    def opposite(self) -> bool:
        """Whether mouth and tip touch on opposite sides."""
        return math.cos(self.sides[0] - self.sides[1]) < 0


def cluster(points: Points, X_MT: RigidTransform, parts: PegAndHole) -> Clusters:
    """Return the contacts' forces by what touches, and on which side.

    The normal tells bore, chamfer and faces apart; of the bore's contacts, those closer to the
    peg's corner than to the bore's edge are at the tip. A wedge of the hole's geometry is no
    feature: a contact is one however many pairs of pieces share its force. ``X_MT`` is the peg's
    frame in the mouth's.
    """
    angles = parts.chamfer_angle, parts.peg_chamfer_angle
    found = _by_feature(
        points.position,
        points.force,
        points.normal,
        X_MT.GetAsMatrix34(),
        np.array([parts.hole_chamfer.height, parts.peg_chamfer.height]),
        math.cos(max(angles)) / 2,
        (1 + math.cos(min(angles))) / 2,
        math.inf if parts.bore_depth is None else parts.bore_depth,
    )
    return Clusters(found[: len(FEATURES)], found[len(FEATURES) :])


@compiled
def _by_feature(
    position: Array,
    force: Array,
    normal: Array,
    X_MT: Array,
    heights: Array,
    on_bore: float,
    on_face: float,
    bore_depth: float,
) -> Array:
    """Return forces and sides of :class:`Clusters`, shape (8,).

    Contacts are as :class:`Points` has them, ``X_MT`` has shape (3, 4), ``heights`` are those of
    the chamfers of hole and peg, m. ``on_bore`` is the largest share of a normal along the axis
    that is one of the bore, ``on_face`` the least of one that is along the axis.
    """
    pressing, across = np.zeros(len(FEATURES)), np.zeros((len(FEATURES), 2))
    edge, corner = heights
    for i in range(len(position)):
        x, along = position[i, 0], abs(normal[i, 0])
        if along > on_face:
            # The front face, the bottom, or between them the tilted rim on an edge.
            if x > bore_depth - _FLUSH:
                feature = _BOTTOM
            elif x <= _FLUSH:
                feature = _FACE
            else:
                feature = _CHAMFER
        elif along > on_bore:
            feature = _CHAMFER
        else:
            along_peg = 0.0
            for k in range(3):
                along_peg += (position[i, k] - X_MT[k, 3]) * X_MT[k, 0]
            feature = _MOUTH if abs(x - edge) <= abs(along_peg + corner) else _TIP
        pushed = 0.0
        for k in range(3):
            pushed += force[i, k] * normal[i, k]
        pressing[feature] += pushed
        for k in range(2):
            across[feature, k] -= pushed * normal[i, k + 1]
    found = np.empty(len(FEATURES) + len(SIDES))
    found[: len(FEATURES)] = pressing
    for k in range(len(SIDES)):
        found[len(FEATURES) + k] = math.atan2(across[k, 1], across[k, 0])
    return found


@compiled
def _wrench_and_loss(position: Array, force: Array, normal: Array, speed: Array) -> Array:
    """Return N m, N and W, shape (7,), of contacts, see :class:`Points`."""
    found = np.zeros(7)
    for i in range(len(position)):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        f, g, h = force[i, 0], force[i, 1], force[i, 2]
        found[0] += y * h - z * g
        found[1] += z * f - x * h
        found[2] += x * g - y * f
        pressing = 0.0
        for k in range(3):
            found[3 + k] += force[i, k]
            pressing += force[i, k] * normal[i, k]
        rubbing = math.sqrt(max(f * f + g * g + h * h - pressing * pressing, 0.0))
        found[6] += rubbing * speed[i, 0] - pressing * speed[i, 1]
    return found


_NO_WRENCH: Final = [0.0] * WRENCH_SIZE
_NOTHING: Final = Clusters(np.zeros(len(FEATURES)), np.zeros(len(SIDES)))


class PegHoleContactMonitor(LeafSystem):
    """Says what of a peg touches its hole, and with what force.

    .. pydrake_system::

        name: PegHoleContactMonitor
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

    ``peg`` is the body that holds the peg and the peg's frame on it, ``hole`` likewise; shapes are
    collision geometry. From ``seated_depth``, m, of the tip on a peg in the bore is seated.
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
        X_MW = (poses[self._hole] @ self._X_BM).inverse()
        X_MT = X_MW @ poses[self._peg] @ self._X_BT
        depth, *across = X_MT.translation().tolist()
        state, wrench, loss, found = ContactState.NONE, _NO_WRENCH, 0.0, _NOTHING
        points = self._points(self._results.Eval(context), X_MW)
        if points is not None:
            found = cluster(points, X_MT, self._parts)
            state = found.state()
            *wrench, loss = points.wrench_and_loss.tolist()
        deep = depth >= self._seated_depth and math.hypot(*across) < self._parts.hole_radius
        if deep or found.forces[_BOTTOM] > _TOUCHING:
            state = ContactState.SEATED
        value.set_value(([state], wrench, found.forces, found.sides, [depth], [loss]))

    def _points(self, results: ContactResults, X_MW: RigidTransform) -> Points | None:
        """Return the contacts of peg and hole, None if there is none."""
        count = results.num_point_pair_contacts()
        if not count:
            return None
        table = np.empty((count, 11))
        n = 0
        for i in range(count):
            info = results.point_pair_contact_info(i)
            pair = info.point_pair()
            # The pair's normal points from B into A, the force acts on B.
            if pair.id_A in self._hole_shapes and pair.id_B in self._peg_shapes:
                sign = -1.0
            elif pair.id_A in self._peg_shapes and pair.id_B in self._hole_shapes:
                sign = 1.0
            else:
                continue
            row = table[n]
            row[:3] = info.contact_point()
            row[3:6] = -sign * info.contact_force()
            row[6:9] = sign * pair.nhat_BA_W
            row[9], row[10] = info.slip_speed(), info.separation_speed()
            n += 1
        if not n:
            return None
        R_WM = X_MW.rotation().matrix().T
        table = table[:n]
        return Points(
            table[:, :3] @ R_WM + X_MW.translation(),
            table[:, 3:6] @ R_WM,
            table[:, 6:9] @ R_WM,
            np.ascontiguousarray(table[:, 9:]),
        )
