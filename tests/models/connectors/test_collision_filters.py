"""Two plugs and two sockets of one sphere each, all in one place."""

from itertools import permutations

import numpy as np
import pytest
from pydrake.geometry import SceneGraph, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.connectors.collision_filters import let_touch, of_part
from chamfer.models.connectors.connector import Material, Piece, add_pieces

PAIRS = (("key", "lock"), ("rim", "wall"), ("foot", "wall"))
METAL = Material(stiffness=1e6, dissipation=20.0, friction=0.3)
BALLS = [Piece("0", Sphere(0.1), RigidTransform()), Piece("1", Sphere(0.2), RigidTransform())]


def empty_plant() -> tuple[MultibodyPlant, SceneGraph]:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    plant.AddRigidBody("hand", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    return plant, scene_graph


def add(plant: MultibodyPlant, part: str) -> None:
    socket = part in ("lock", "wall", "obstacle")
    body = plant.world_body() if socket else plant.GetBodyByName("hand")
    add_pieces(plant, body, RigidTransform(), of_part(part, BALLS), METAL, None)


def candidates(plant: MultibodyPlant, scene_graph: SceneGraph) -> set[frozenset[str]]:
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    return {
        frozenset(inspector.GetName(g).split("::")[-1] for g in pair)
        for pair in inspector.GetCollisionCandidates()
    }


@pytest.mark.parametrize("order", list(permutations([("key", "rim", "foot"), ("lock", "wall")])))
def test_only_the_pieces_of_a_pair_touch_in_any_order(order: tuple[tuple[str, ...], ...]) -> None:
    plant, scene_graph = empty_plant()
    for parts in order:
        for part in parts:
            add(plant, part)
        let_touch(plant, PAIRS)
    expected = {
        frozenset({f"{plug}:{i}", f"{socket}:{j}"})
        for plug, socket in PAIRS
        for i in range(2)
        for j in range(2)
    }
    assert candidates(plant, scene_graph) == expected


def test_what_is_no_part_is_touched_by_all() -> None:
    plant, scene_graph = empty_plant()
    for part in ("key", "rim", "foot", "obstacle"):
        add(plant, part)
    let_touch(plant, PAIRS)
    found = candidates(plant, scene_graph)
    assert len(found) == 12
    assert all(any(name.startswith("obstacle") for name in pair) for pair in found)


def test_a_part_is_put_in_front_of_the_names_and_nothing_else_changes() -> None:
    named = of_part("rim", BALLS)
    assert [piece.name for piece in named] == ["rim:0", "rim:1"]
    assert [piece.shape for piece in named] == [piece.shape for piece in BALLS]
    np.testing.assert_array_equal(named[0].X_BP.GetAsMatrix4(), np.eye(4))
