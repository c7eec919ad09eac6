"""Peg and hole as Drake's collision geometry."""

import math

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.peg.bore_contact import (
    ContactMaterial,
    add_hole_contact,
    add_peg_contact,
    facets_needed,
    sagitta,
)
from chamfer.models.peg.peg_and_hole import PegAndHole, Section
from chamfer.models.peg_theory.wedging import two_points
from chamfer.models.validation import ParameterError

PARTS = PegAndHole()


def deepest(X_MT: RigidTransform, parts: PegAndHole = PARTS, facets: int = 64) -> float:
    """Return the deepest penetration of a peg at a pose, m; 0 where nothing touches."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    peg = plant.AddRigidBody("peg", SpatialInertia.SolidSphereWithMass(1.0, 0.01))
    material = ContactMaterial(facets=facets)
    add_peg_contact(plant, peg, RigidTransform(), parts, material)
    add_hole_contact(plant, plant.world_body(), RigidTransform(), parts, material)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = plant.GetMyContextFromRoot(context)
    plant.SetFreeBodyPose(own, peg, X_MT)
    query = plant.get_geometry_query_input_port().Eval(own)
    return max((one.depth for one in query.ComputePointPairPenetration()), default=0.0)


def at(x: float, y: float = 0.0, z: float = 0.0, tilt: float = 0.0) -> RigidTransform:
    return RigidTransform(RotationMatrix.MakeZRotation(-tilt), np.array([x, y, z]))


def test_a_peg_in_line_has_room_all_around() -> None:
    assert deepest(at(0.02)) == 0.0
    for angle in np.linspace(0.0, 2 * math.pi, 7):
        room = 0.85 * PARTS.clearance  # less the sagitta
        assert deepest(at(0.02, room * math.cos(angle), room * math.sin(angle))) == 0.0


@pytest.mark.parametrize("side", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_in_the_planes_of_insertion_the_parts_are_the_round_ones(
    side: tuple[float, float],
) -> None:
    beyond = 5e-6
    y, z = (one * (PARTS.clearance + beyond) for one in side)
    assert deepest(at(0.02, y, z)) == pytest.approx(beyond, abs=2e-7)


def test_two_points_touch_where_the_statics_say() -> None:
    tilt = 0.05
    found = two_points(PARTS, tilt)
    x_tip = float(found.depth) + PARTS.chamfer_height
    centred = at(x_tip, float(found.pose.x), 0.0, tilt)
    assert deepest(centred) < 1e-6
    deeper = at(x_tip + 2e-4, float(found.pose.x), 0.0, tilt)
    assert deepest(deeper) == pytest.approx(2e-4 * math.sin(tilt), rel=0.1)


@pytest.mark.parametrize("section", ["round", "square"])
def test_a_blind_bore_has_a_bottom(section: Section) -> None:
    blind = PegAndHole(section=section, bore_depth=0.03)
    facets = facets_needed(blind)
    assert deepest(at(0.0299), blind, facets) == 0.0
    assert deepest(at(0.0301), blind, facets) == pytest.approx(1e-4, rel=1e-3)
    assert deepest(at(0.0301)) == 0.0


def test_facets_follow_from_the_clearance() -> None:
    assert sagitta(0.01, 64) == pytest.approx(12e-6, rel=0.01)
    assert facets_needed(PegAndHole()) == 64
    tight = PegAndHole(peg_radius=0.010005)
    facets = facets_needed(tight)
    assert facets % 4 == 0
    assert ContactMaterial(stiffness=1e6).over(tight) == ContactMaterial(
        stiffness=1e6, facets=facets
    )
    assert ContactMaterial(facets=32).over(tight).facets == 32
    assert sagitta(tight.hole_radius, facets) <= 3e-6 < sagitta(tight.hole_radius, facets - 4)


def test_facets_that_are_left_open_are_refused() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    with pytest.raises(ParameterError, match=r"^facets is None, allowed: a number"):
        add_hole_contact(plant, plant.world_body(), RigidTransform(), PARTS, ContactMaterial())


SQUARE = PegAndHole(section="square")


def in_square(y: float, z: float, roll: float = 0.0) -> float:
    X_MT = RigidTransform(RotationMatrix.MakeXRotation(roll), [0.02, y, z])
    return deepest(X_MT, SQUARE, facets=facets_needed(SQUARE))


def test_a_square_peg_has_its_clearance_along_both_faces_at_once() -> None:
    room = 0.999 * SQUARE.clearance
    for y, z in ((room, 0.0), (0.0, -room), (-room, room), (room, room)):
        assert in_square(y, z) == 0.0
    beyond = 5e-6
    for y, z in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (1.0, -1.0)):
        reach = SQUARE.clearance + beyond
        assert in_square(reach * y, reach * z) == pytest.approx(beyond, rel=1e-3)


def test_a_square_peg_turns_until_its_corners_touch() -> None:
    # r (cos + sin) = R
    limit = math.asin(SQUARE.hole_radius / SQUARE.peg_radius / math.sqrt(2)) - math.pi / 4
    for sign in (1.0, -1.0):
        assert in_square(0.0, 0.0, sign * 0.99 * limit) == 0.0
        assert in_square(0.0, 0.0, sign * 1.05 * limit) > 0.0


def test_facets_of_square_parts_are_not_to_be_chosen() -> None:
    with pytest.raises(ParameterError, match=r"contact.facets is 64, allowed: null of square"):
        ContactMaterial(facets=64).over(SQUARE)
    material = ContactMaterial().over(SQUARE)
    assert material.over(SQUARE) == material
