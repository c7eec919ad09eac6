"""The force of a slow insertion in line, from the geometry of plug and socket alone.

The plug goes straight down, step by step, upright and unturned. It gives way sideways until the
forces across are in balance, as it does in the gripper. Every pair of pieces that
overlaps is a spring with Coulomb friction against the motion; there are no masses and no damping.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.connectors.connector import Array, Connector

_ITERATIONS: Final = 40
_BALANCED: Final = 1e-3  # N, that is left across
_STEP: Final = 1e-4  # m, across, at most
_STIFFNESS: Final = ("material", "point_contact_stiffness")  # as Drake names them
_FRICTION: Final = ("material", "coulomb_friction")


class _Touch(NamedTuple):
    """The contact parameters of two pieces."""

    stiffness: float  # N/m, of both in series
    friction: float  # Coulomb's
    side: float  # 1: the plug's piece is the first, -1: the second


class InLine:
    """A plug, upright and unturned, at any place in its socket."""

    def __init__(self, connector: Connector) -> None:
        builder = DiagramBuilder()
        self._plant, self._scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
        self._body = self._plant.AddRigidBody("plug")
        connector.add_socket(self._plant, RigidTransform())
        connector.add_plug(self._plant, self._body, RigidTransform())
        self._plant.Finalize()
        self._diagram = builder.Build()
        self._root = self._diagram.CreateDefaultContext()
        self._context = self._plant.GetMyMutableContextFromRoot(self._root)
        self._touches: dict[tuple[GeometryId, GeometryId], _Touch] = {}

    def balanced(self, depth: float, across: Array) -> tuple[float, Array]:
        """Return the force against the insertion, N, and the plug's place across, m, shape (2,).

        The search begins at a place across.
        """
        for _ in range(_ITERATIONS):
            force, slope = self._force(depth, across)
            if np.abs(force[:2]).max() < _BALANCED:
                break
            # Where nothing is met on the way, nothing is stiff.
            step = np.linalg.pinv(slope, rcond=1e-9) @ force[:2]
            across = across + step * min(1.0, _STEP / max(float(np.linalg.norm(step)), 1e-12))
        return float(force[2]), across

    def _force(self, depth: float, across: Array) -> tuple[Array, Array]:
        """Return the force on the plug, N, shape (3,), and its stiffness across, (2, 2)."""
        place = RigidTransform(np.array([*across, -depth]))
        self._plant.SetFreeBodyPose(self._context, self._body, place)
        query = self._plant.get_geometry_query_input_port().Eval(self._context)
        force, slope = np.zeros(3), np.zeros((2, 2))
        for pair in query.ComputePointPairPenetration():
            touch = self._touch(query.inspector(), pair.id_A, pair.id_B)
            n = touch.side * pair.nhat_BA_W
            slides = np.array([0.0, 0.0, 1.0]) - n[2] * n  # against the motion along the surface
            size = float(np.linalg.norm(slides))
            way = n + touch.friction * slides / size if size > 1e-6 else n
            force += touch.stiffness * pair.depth * way
            slope += touch.stiffness * np.outer(way[:2], n[:2])
        return force, slope

    def _touch(self, inspector: Any, first: GeometryId, second: GeometryId) -> _Touch:
        if (first, second) not in self._touches:
            properties = [inspector.GetProximityProperties(one) for one in (first, second)]
            k, other = (one.GetProperty(*_STIFFNESS) for one in properties)
            mu, its = (one.GetProperty(*_FRICTION).dynamic_friction() for one in properties)
            frame = inspector.GetFrameId(first)
            mine = self._plant.GetBodyFromFrameId(frame).index() == self._body.index()
            self._touches[first, second] = _Touch(
                k * other / (k + other),
                2 * mu * its / (mu + its) if mu + its else 0.0,
                1.0 if mine else -1.0,
            )
        return self._touches[first, second]


def insertion_force(connector: Connector, depth: Array) -> Array:
    """Return the force against a slow insertion in line, N, at increasing depths, m."""
    plug, across, forces = InLine(connector), np.zeros(2), []
    for one in depth.tolist():
        force, across = plug.balanced(one, across)
        forces.append(force)
    return np.array(forces)
