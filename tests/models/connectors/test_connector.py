"""What pieces become in a plant."""

from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box, Role, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    DiscreteContactApproximation,
)
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.connectors.connector import Material, Piece, add_pieces
from chamfer.models.validation import ParameterError

X_BP = RigidTransform(RollPitchYaw(0.3, -0.4, 2.5), [0.1, -0.2, 0.3])
PIECES = [
    Piece("ball", Sphere(0.1), RigidTransform([0.0, 0.0, 0.5])),
    Piece("block", Box(0.1, 0.2, 0.3), RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), np.zeros(3))),
]
MATERIAL = Material(stiffness=1.5e5, dissipation=7.0, friction=0.35)
RED = np.array([1.0, 0.0, 0.0, 0.5])


@pytest.mark.parametrize("rgba", [RED, None])
def test_pieces_have_their_shape_place_and_material(rgba: Any) -> None:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    body = plant.AddRigidBody("part", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    add_pieces(plant, body, X_BP, PIECES, MATERIAL, rgba)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    found = plant.GetCollisionGeometriesForBody(body)
    assert len(found) == len(PIECES)
    for geometry, piece in zip(found, PIECES, strict=True):
        assert inspector.GetName(geometry).endswith(piece.name)
        assert repr(inspector.GetShape(geometry)) == repr(piece.shape)
        assert inspector.GetPoseInFrame(geometry).IsNearlyEqualTo(X_BP @ piece.X_BP, 1e-12)
        get = inspector.GetProximityProperties(geometry).GetProperty
        assert get("material", "point_contact_stiffness") == 1.5e5
        assert get("material", "hunt_crossley_dissipation") == 7.0
        friction = get("material", "coulomb_friction")
        assert (friction.static_friction(), friction.dynamic_friction()) == (0.35, 0.35)
    seen = plant.GetVisualGeometriesForBody(body)
    assert len(seen) == (0 if rgba is None else len(PIECES))
    for geometry in seen:
        colour = inspector.GetProperties(geometry, Role.kIllustration).GetProperty(
            "phong", "diffuse"
        )
        np.testing.assert_allclose([colour.r(), colour.g(), colour.b(), colour.a()], RED)


@pytest.mark.parametrize("force", [5.0, 40.0])
def test_two_pieces_that_touch_are_springs_in_series(force: float) -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kTamsi)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -force])  # of 1 kg
    ball = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(1.0, 0.01))
    plant.AddJoint(PrismaticJoint("z", plant.world_frame(), ball.body_frame(), [0, 0, 1]))
    soft, hard = Material(stiffness=2e4), Material(stiffness=6e4)
    at = RigidTransform([0.0, 0.0, 0.01])
    add_pieces(plant, ball, at, [Piece("ball", Sphere(0.01), RigidTransform())], soft, None)
    floor = Piece("floor", Box(1.0, 1.0, 1.0), RigidTransform([0.0, 0.0, -0.5]))
    add_pieces(plant, plant.world_body(), RigidTransform(), [floor], hard, None)
    plant.Finalize()
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    (height,) = plant.GetPositions(context)
    assert -height == pytest.approx(force / 1.5e4, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "value"), [("stiffness", 0.0), ("dissipation", -1.0), ("friction", -0.1)]
)
def test_materials_that_cannot_be(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is {value}, allowed: a finite number >"):
        Material(**{name: value})
