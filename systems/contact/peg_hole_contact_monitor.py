"""The contacts between a peg and its hole, and their forces, read from Drake."""

import math
from collections.abc import Collection
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Demultiplexer

from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.compiled import compiled
from chamfer.systems.contact.near_walls import AfterSteps

Array = NDArray[np.float64]

FEATURES: Final = ("mouth", "tip", "chamfer", "face", "bottom")
SIDES: Final = FEATURES[:3]  # those that have one
WRENCH_SIZE: Final = 6
_OUTPUTS: Final = {
    "state": 1,
    "wrench": WRENCH_SIZE,
    "normal_forces": len(FEATURES),
    "sides": len(SIDES),
    "depth": 1,
    "loss": 1,
}
_SIZE: Final = sum(_OUTPUTS.values())
_OF_CONTACT: Final = 12  # numbers that are read of one
_MOUTH, _TIP, _CHAMFER, _FACE, _BOTTOM = range(len(FEATURES))
_FLUSH: Final = 2e-4  # m, of a face, within which what touches along the axis touches the face
_TOUCHING: Final = 0.01  # N, the least force of a feature that touches


class ContactState(IntEnum):
    """State of a peg in its hole."""

    NONE = 0
    CHAMFER = 1  # on a chamfer, its own or the mouth's
    ONE_POINT = 2  # on one side of the bore, also along it
    TWO_POINT = 3  # on opposite sides of it, one at the mouth and one at the tip
    SEATED = 4  # deep enough, or on the bottom
    FACE = 5  # on the face beside the mouth


class Shape(NamedTuple):
    """Dimensions of the parts that classify contacts."""

    edge: float  # m, of the bore below the mouth
    corner: float  # m, of the peg's side above the tip
    on_bore: float  # the largest share of a normal along the axis that is one of the bore
    on_face: float  # the least share of one that is along the axis
    bore_depth: float  # m
    hole_radius: float  # m
    seated_depth: float  # m, of the tip of a peg in the bore, which is seated from there on


def shape_of(parts: PegAndHole, seated_depth: float = math.inf) -> Shape:
    """Return the dimensions that classify these parts' contacts."""
    angles = parts.chamfer_angle, parts.peg_chamfer_angle
    return Shape(
        parts.hole_chamfer.height,
        parts.peg_chamfer.height,
        math.cos(max(angles)) / 2,
        (1 + math.cos(min(angles))) / 2,
        math.inf if parts.bore_depth is None else parts.bore_depth,
        parts.hole_radius,
        seated_depth,
    )


@compiled
def told(contacts: Array, X_WM: Array, X_WT: Array, shape: Shape) -> Array:
    """Return all outputs of :class:`PegHoleContactMonitor`, one after the other.

    A row of ``contacts``, shape (n, 12), is a point, m, the force there, N, the unit normal, the
    speeds along the face and apart, m/s, and 1, or else -1, if the normal is out of the hole's
    material and the force on the hole. Frames have shape (3, 4).

    The normal tells bore, chamfer and faces apart; of the bore's contacts, those closer to the
    peg's corner than to the bore's edge are at the tip. A wedge of the hole's geometry is no
    feature: a contact is one however many pairs of pieces share its force.
    """
    found, pressing, across = np.zeros(_SIZE), np.zeros(len(FEATURES)), np.zeros((len(SIDES), 2))
    tip, p, f, n = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for j in range(3):
        for k in range(3):
            tip[j] += X_WM[k, j] * (X_WT[k, 3] - X_WM[k, 3])
    wrench, loss = found[1 : 1 + WRENCH_SIZE], 0.0
    for row in contacts:
        p[:], f[:], n[:] = 0.0, 0.0, 0.0
        along_peg, normal, size = 0.0, 0.0, 0.0
        for k in range(3):
            for j in range(3):
                p[j] += X_WM[k, j] * (row[k] - X_WM[k, 3])
                f[j] -= row[11] * X_WM[k, j] * row[3 + k]
                n[j] += row[11] * X_WM[k, j] * row[6 + k]
            along_peg += X_WT[k, 0] * (row[k] - X_WT[k, 3])
            normal -= row[3 + k] * row[6 + k]
            size += row[3 + k] ** 2
        x, along = p[0], abs(n[0])
        if along > shape.on_face:
            # The front face, the bottom, or between them the tilted rim on an edge.
            if x > shape.bore_depth - _FLUSH:
                feature = _BOTTOM
            elif x <= _FLUSH:
                feature = _FACE
            else:
                feature = _CHAMFER
        elif along > shape.on_bore:
            feature = _CHAMFER
        else:
            at_edge = abs(x - shape.edge) <= abs(along_peg + shape.corner)
            feature = _MOUTH if at_edge else _TIP
        pressing[feature] += normal
        if feature < len(SIDES):
            across[feature, 0] -= normal * n[1]
            across[feature, 1] -= normal * n[2]
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            wrench[k] += p[a] * f[b] - p[b] * f[a]
            wrench[3 + k] += f[k]
        loss += math.sqrt(max(size - normal * normal, 0.0)) * row[9] - normal * row[10]
    state, touching = ContactState.NONE, pressing > _TOUCHING
    if touching[_MOUTH] or touching[_TIP]:
        state = ContactState.ONE_POINT
        opposite = across[_MOUTH, 0] * across[_TIP, 0] + across[_MOUTH, 1] * across[_TIP, 1] < 0
        if touching[_MOUTH] and touching[_TIP] and opposite:
            state = ContactState.TWO_POINT
    elif touching[_CHAMFER]:
        state = ContactState.CHAMFER
    elif touching[_FACE]:
        state = ContactState.FACE
    deep = tip[0] >= shape.seated_depth and math.hypot(tip[1], tip[2]) < shape.hole_radius
    if deep or touching[_BOTTOM]:
        state = ContactState.SEATED
    found[0] = state.value
    sides = 1 + WRENCH_SIZE + len(FEATURES)
    found[1 + WRENCH_SIZE : sides] = pressing
    for k in range(len(SIDES)):
        found[sides + k] = math.atan2(across[k, 1], across[k, 0])
    found[-2], found[-1] = tip[0], loss
    return found


class _Reader(LeafSystem):
    """Reads Drake's contacts into one vector, :func:`told`."""

    def __init__(
        self,
        shape: Shape,
        peg: RigidBody,
        hole: RigidBody,
        peg_shapes: Collection[GeometryId],
    ) -> None:
        super().__init__()
        self._shape, self._peg_shapes = shape, frozenset(peg_shapes)
        self._peg, self._hole = int(peg.index()), int(hole.index())
        results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self._results, self._poses = results, poses
        tickets = {results.ticket(), poses.ticket()}
        self.DeclareVectorOutputPort("told", _SIZE, self._calc, tickets)

    def _calc(self, context: Context, output: BasicVector) -> None:
        poses, results = self._poses.Eval(context), self._results.Eval(context)
        read: list[float] = []
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            pair = info.point_pair()
            # The pair's normal points from B into A, the force acts on B.
            of_peg = 1.0 if pair.id_A in self._peg_shapes else -1.0
            read += info.contact_point().tolist()
            read += info.contact_force().tolist()
            read += pair.nhat_BA_W.tolist()
            read += info.slip_speed(), info.separation_speed(), of_peg
        contacts = np.array(read).reshape(-1, _OF_CONTACT)
        frames = poses[self._hole].GetAsMatrix34(), poses[self._peg].GetAsMatrix34()
        output.SetFromVector(told(contacts, *frames, self._shape))


class PegHoleContactMonitor(Diagram):
    """Classifies the contacts between a peg and its hole, and measures their forces.

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

    The inputs are the plant's ports of these names.

    * ``state``, shape (1,), is a :class:`ContactState`.
    * ``wrench``, shape (6,), N m above N, is of the hole on the peg about the middle of the mouth
      in the mouth's frame: x into the hole.
    * ``normal_forces``, N, shape (5,), follow :data:`FEATURES`.
    * ``sides``, rad, shape (3,), follow :data:`SIDES`: the directions from the axis towards them,
      from y to z, 0 without contact.
    * ``depth``, m, is that of the tip's middle below the mouth.
    * ``loss``, W, is the power that the contacts absorb, elastic part included.

    The frames of the bodies ``peg`` and ``hole`` are those of peg and mouth. ``peg_shapes`` is the
    peg's collision geometry, which touches only the hole's. A peg in the bore is seated from the
    tip's ``seated_depth``, m, on. A simulation calls ``after_steps``, see
    :class:`chamfer.systems.contact.near_walls.NearWalls`.
    """

    def __init__(
        self,
        parts: PegAndHole,
        *,
        peg: RigidBody,
        hole: RigidBody,
        peg_shapes: Collection[GeometryId],
        seated_depth: float,
        after_steps: AfterSteps | None = None,
    ) -> None:
        super().__init__()
        self.after_steps = after_steps
        builder = DiagramBuilder()
        reader = _Reader(shape_of(parts, seated_depth), peg, hole, peg_shapes)
        builder.AddNamedSystem("reading", reader)
        # One block in Python, asked once in a step.
        parted = builder.AddNamedSystem("parted", Demultiplexer(list(_OUTPUTS.values())))
        builder.Connect(reader.get_output_port(), parted.get_input_port())
        for i in range(reader.num_input_ports()):
            builder.ExportInput(reader.get_input_port(i), reader.get_input_port(i).get_name())
        for k, name in enumerate(_OUTPUTS):
            builder.ExportOutput(parted.get_output_port(k), name)
        builder.BuildInto(self)
