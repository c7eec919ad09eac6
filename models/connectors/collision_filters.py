"""Which parts of a plug touch which of its socket; all others pass through each other."""

from collections.abc import Sequence
from itertools import product

from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from chamfer.models.connectors.connector import Piece


def of_part(part: str, pieces: Sequence[Piece]) -> list[Piece]:
    """Return the pieces with the name of their part in front, by which a filter finds them."""
    return [piece._replace(name=f"{part}:{piece.name}") for piece in pieces]


def let_touch(plant: MultibodyPlant, pairs: Sequence[tuple[str, str]]) -> None:
    """Keep every part of a plug apart from every part of its socket but those of the pairs.

    To be called after the plug and after the socket was added, in any order: a call filters what
    is there. What belongs to no part is left alone.

    Args:
        plant: Not yet finalized, and registered with a scene graph.
        pairs: A part of the plug and a part of the socket that touch, each.
    """
    scene_graph = Parser(plant).scene_graph()  # the only way from a plant to its geometry
    inspector = scene_graph.model_inspector()
    parts: dict[str, list[GeometryId]] = {}
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        # A geometry's name has that of its model in front.
        part = inspector.GetName(geometry).rpartition("::")[2].partition(":")[0]
        parts.setdefault(part, []).append(geometry)
    plugs, sockets = zip(*pairs, strict=True)
    for pair in product(plugs, sockets):
        if pair not in pairs:
            first, second = (GeometrySet(parts.get(part, [])) for part in pair)
            strangers = CollisionFilterDeclaration().ExcludeBetween(first, second)
            scene_graph.collision_filter_manager().Apply(strangers)
