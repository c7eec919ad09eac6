"""Links whose pieces touch some links only."""

import pytest
from pydrake.geometry import Box, Capsule, Cylinder, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from models.connectors.connector import Material, Piece
from models.connectors.filtered_links import filtered_links

X_BP = RigidTransform(RollPitchYaw(0.3, -0.4, 2.5), [0.1, -0.2, 1e-5])
LINKS = {
    "a": [Piece("ball", Sphere(0.1), X_BP), Piece("pin", Cylinder(0.2, 0.3), X_BP)],
    "b": [Piece("block", Box(0.1, 0.2, 0.3), X_BP)],
    "c": [Piece("other", Sphere(0.4), RigidTransform())],
}
HARD, SOFT = Material(1e6, 20.0, 0.3), Material(1e3, 0.0, 0.2)


def test_what_is_parsed_is_what_was_given() -> None:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    materials = {"a": HARD, "b": HARD, "c": SOFT}
    text = filtered_links("parts", LINKS, {"a": ["b"]}, materials)
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    seen = {}
    for link, pieces in LINKS.items():
        geometries = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link))
        assert len(geometries) == len(pieces)
        for geometry, piece in zip(geometries, pieces, strict=True):
            seen[geometry] = piece.name
            assert repr(inspector.GetShape(geometry)) == repr(piece.shape)
            pose = inspector.GetPoseInFrame(geometry)
            assert pose.IsNearlyEqualTo(piece.X_BP, 1e-12)
            properties = inspector.GetProximityProperties(geometry)
            get = properties.GetProperty
            assert get("material", "point_contact_stiffness") == materials[link].stiffness
            assert get("material", "hunt_crossley_dissipation") == materials[link].dissipation
            friction = get("material", "coulomb_friction")
            assert friction.static_friction() == materials[link].friction
            assert friction.dynamic_friction() == materials[link].friction
    pairs = {frozenset(seen[g] for g in pair) for pair in inspector.GetCollisionCandidates()}
    assert pairs == {frozenset({"other", name}) for name in ("ball", "pin", "block")}
    assert not any(plant.GetVisualGeometriesForBody(plant.GetBodyByName(x)) for x in LINKS)


def test_refuses_shapes_without_a_closed_form() -> None:
    with pytest.raises(TypeError, match=r"Capsule.*allowed: a sphere, a box or a cylinder"):
        filtered_links("x", {"a": [Piece("p", Capsule(1, 1), X_BP)]}, {}, {"a": HARD})
