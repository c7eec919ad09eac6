"""Restricts the search for contacts to those walls of a hole that its peg is near.

Drake tries every wall against the peg: it bounds what is turned by spheres, and all of them
overlap. Here a plane between the two separates most of them. Walls that are passed over cannot
touch, so that contacts and forces are the same to the last digit.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, SceneGraph
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, EventStatus

from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]
AfterSteps = Callable[[Context], Callable[[Context], EventStatus]]  # of a root's context

_NEAR: Final = 1e-6  # m, from where on a wall has to be looked at
_AHEAD: Final = 0.02  # of the clearance: so near ones are looked at too, the next steps need them
_TOO_MANY: Final = 1  # walls that are not near any more, before they are passed over again


@compiled
def wall_gaps(X_MT: Array, bore: float, radius: float, length: float, walls: int) -> Array:
    """Return how far a round peg is from each wall of a bore, at least, m, shape (walls,).

    The first wall faces +y in the mouth's frame, the others follow towards z; all are below the
    mouth and beyond a plane at the bore's radius. ``X_MT``, shape (3, 4), is the peg's frame.
    """
    gaps = np.full(walls, np.inf)
    axis, tip = X_MT[:, 0], X_MT[:, 3]
    below = tip[0] + radius * math.sqrt(max(1.0 - axis[0] ** 2, 0.0))
    if below < 0.0:
        return gaps
    back = min(length, below / axis[0]) if axis[0] > 0.0 else length  # what is farther is above
    for k in range(walls):
        y, z = math.cos(2.0 * math.pi * k / walls), math.sin(2.0 * math.pi * k / walls)
        slope = y * axis[1] + z * axis[2]
        middle = y * tip[1] + z * tip[2] + max(0.0, -slope * back)
        gaps[k] = bore - middle - radius * math.sqrt(max(1.0 - slope**2, 0.0))
    return gaps


@compiled
def _changes(gaps: Array, looked_at: NDArray[np.bool_], ahead: float) -> bool:
    far = 0
    for gap, looked in zip(gaps, looked_at):  # noqa: B905, which Numba does not know
        if gap < _NEAR and not looked:
            return True
        far += looked and gap >= ahead
    return far > _TOO_MANY


class NearWalls:
    """Selects, step by step, the walls of a round hole at which a plant searches contacts.

    The bodies' frames are those of peg and mouth; the walls are in the order of
    :func:`wall_gaps`.
    """

    def __init__(
        self,
        parts: PegAndHole,
        scene_graph: SceneGraph,
        bodies: tuple[RigidBody, RigidBody],
        peg_shapes: Sequence[GeometryId],
        walls: Sequence[GeometryId],
    ) -> None:
        self._scene_graph, self._peg, self._walls = scene_graph, GeometrySet(peg_shapes), walls
        self._plant, frames = bodies[0].GetParentPlant(), [one.body_frame() for one in bodies]
        self._peg_frame, self._hole_frame = frames
        peg = parts.peg
        self._sizes = parts.hole.radius, peg.radius, peg.length, len(walls)
        self._ahead = _NEAR + _AHEAD * parts.clearance

    def after_steps(self, root: Context) -> Callable[[Context], EventStatus]:
        """Return the function to call after each step of a simulation with this context."""
        plant = self._plant.GetMyContextFromRoot(root)
        geometry = self._scene_graph.GetMyMutableContextFromRoot(root)
        frames = self._hole_frame, self._peg_frame
        looked_at = np.ones(len(self._walls), dtype=bool)

        def look(_root: Context) -> EventStatus:
            X_MT = self._plant.CalcRelativeTransform(plant, *frames).GetAsMatrix34()
            gaps = wall_gaps(X_MT, *self._sizes)
            if _changes(gaps, looked_at, self._ahead):
                wanted, changed = gaps < self._ahead, CollisionFilterDeclaration()
                changed.AllowBetween(self._peg, self._at(wanted & ~looked_at))
                changed.ExcludeBetween(self._peg, self._at(looked_at & ~wanted))
                self._scene_graph.collision_filter_manager(geometry).Apply(changed)
                looked_at[:] = wanted
            return EventStatus.DidNothing()

        return look

    def _at(self, places: NDArray[np.bool_]) -> GeometrySet:
        return GeometrySet([self._walls[i] for i in np.flatnonzero(places).tolist()])
