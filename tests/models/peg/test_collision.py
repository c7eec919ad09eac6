"""Peg and hole as Drake's collision geometry."""

import math
import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.models.peg.bore_contact import (
    ContactMaterial,
    add_hole_contact,
    add_peg_contact,
    facets_needed,
    sagitta,
)
from chamfer.models.peg.part_overlap import TOUCHING, overlap, require_apart
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.validation import ParameterError

PARTS = PegAndHole()


@lru_cache
def colliding(parts: PegAndHole, facets: int) -> tuple[Diagram, MultibodyPlant]:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    peg = plant.AddRigidBody("peg", SpatialInertia.SolidSphereWithMass(1.0, 0.01))
    material = ContactMaterial(facets=facets)
    add_peg_contact(plant, peg, RigidTransform(), parts, material)
    add_hole_contact(plant, plant.world_body(), RigidTransform(), parts, material)
    plant.Finalize()
    return builder.Build(), plant


def deepest(X_MT: RigidTransform, parts: PegAndHole = PARTS, facets: int = 64) -> float:
    """Return the deepest penetration of a peg at a pose, m; 0 where nothing touches."""
    diagram, plant = colliding(parts, facets)
    context = diagram.CreateDefaultContext()
    own = plant.GetMyContextFromRoot(context)
    plant.SetFreeBodyPose(own, plant.GetBodyByName("peg"), X_MT)
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
    from chamfer.models.peg_theory.planar_limits import two_points

    tilt = 0.05
    found = two_points(PARTS, tilt)
    x_tip = float(found.depth) + PARTS.chamfer_height
    centred = at(x_tip, float(found.pose.x), 0.0, tilt)
    assert deepest(centred) < 1e-6
    deeper = at(x_tip + 2e-4, float(found.pose.x), 0.0, tilt)
    assert deepest(deeper) == pytest.approx(2e-4 * math.sin(tilt), rel=0.1)


def test_chamfers_guide() -> None:
    x, offset = 0.003, PARTS.clearance + 0.0005  # 3 of 4 mm down: 1 mm of the chamfers is left
    assert deepest(at(x, offset)) == 0.0
    off = PARTS.clearance + 0.0011
    assert deepest(at(x, off)) == pytest.approx(1e-4 * math.sin(math.pi / 4), rel=0.05)


def test_a_blind_bore_has_a_bottom() -> None:
    blind = PegAndHole(bore_depth=0.03)
    assert deepest(at(0.0299), blind) == 0.0
    assert deepest(at(0.0301), blind) == pytest.approx(1e-4, rel=1e-3)
    assert deepest(at(0.0301)) == 0.0


def test_facets_follow_from_the_clearance() -> None:
    assert sagitta(0.01, 64) == pytest.approx(12e-6, rel=0.01)
    assert facets_needed(PegAndHole()) == 64
    tight = PegAndHole(peg_radius=0.010005)
    facets = facets_needed(tight)
    assert facets % 4 == 0
    assert sagitta(tight.hole_radius, facets) <= 3e-6 < sagitta(tight.hole_radius, facets - 4)


def test_a_material_that_says_its_facets_keeps_them() -> None:
    tight = replace(PegAndHole(), hole_radius=PegAndHole().peg_radius + 3e-5)
    assert ContactMaterial(stiffness=1e6).over(tight) == ContactMaterial(
        stiffness=1e6, facets=facets_needed(tight)
    )
    assert ContactMaterial(facets=32).over(tight).facets == 32


@pytest.mark.parametrize("facets", [2, 66, 10_000])
def test_facets_are_some_and_face_both_planes(facets: int) -> None:
    message = re.escape(f"facets is {facets}, allowed: a multiple of 4 up to 4096, or null")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        ContactMaterial(facets=facets)


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


def test_facets_of_square_parts_are_not_to_be_chosen() -> None:
    with pytest.raises(ParameterError, match=r"contact.facets is 64, allowed: null of square"):
        ContactMaterial(facets=64).over(SQUARE)
    material = ContactMaterial().over(SQUARE)
    assert material.over(SQUARE) == material


BLIND = PegAndHole(bore_depth=0.03)


def pitched(x: float, y: float = 0.0, pitch: float = 0.0) -> RigidTransform:
    return RigidTransform(RollPitchYaw(0.0, pitch, 0.0), [x, y, 0.0])


@pytest.mark.parametrize(
    ("X_MT", "deep"),
    [
        (pitched(-0.001), 0.0),
        (pitched(0.02), 0.0),  # in the bore, in line
        (pitched(0.02, 0.000255), 0.0),
        (pitched(0.02, 0.001), 0.001 - PARTS.clearance),
        (pitched(0.001, 0.003), 0.0),  # in the mouth's chamfer
        (pitched(0.0, 0.02), 0.0),  # flat on the face, or beside it
        (pitched(0.001, 0.006), 0.001),  # in the front face
        (pitched(0.02, 0.0239), 0.0),  # beside the part
        (pitched(0.02, 0.0237), 0.014 + PARTS.peg_radius - 0.0237),
        (pitched(0.2), 0.0),  # out of the back
    ],
)
def test_parallel_parts(X_MT: RigidTransform, deep: float) -> None:
    assert overlap(PARTS, X_MT) == pytest.approx(deep, abs=5e-5)


@pytest.mark.parametrize("depth", [0.0299, 0.0301])
def test_a_blind_bore_ends(depth: float) -> None:
    assert overlap(BLIND, pitched(depth)) == pytest.approx(max(depth - 0.03, 0.0), abs=1e-9)
    assert overlap(PARTS, pitched(depth)) == 0.0


@given(tilt=st.floats(0.02, 0.3))
def test_the_rim_of_a_tilted_peg_is_ahead_of_its_tip(tilt: float) -> None:
    ahead = PARTS.leading(tilt)
    aside = 0.02  # before the face of a part that is wide
    wide = replace(PARTS, outer_radius=0.05)
    assert overlap(wide, pitched(-ahead - 1e-5, aside, tilt)) == 0.0
    assert overlap(wide, pitched(-ahead + 1e-4, aside, tilt)) == pytest.approx(1e-4, abs=1e-5)


@pytest.mark.slow
@settings(deadline=None, max_examples=150)
@given(
    blind=st.booleans(),
    x=st.floats(-0.02, 0.06),
    off=st.tuples(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03)),
    near=st.booleans(),
    turn=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_it_overlaps_where_a_simulation_says_so(
    blind: bool, x: float, off: tuple[float, float], near: bool, turn: tuple[float, float]
) -> None:
    parts = BLIND if blind else PARTS
    scale = 0.05 if near else 1.0
    X_MT = RigidTransform(
        RollPitchYaw(0.0, *(scale * np.array(turn))), [x, *(scale * np.array(off))]
    )
    true = deepest(X_MT, parts, facets=128)
    assume(not 0 < true < 1e-4)  # facets and points know it no better
    assert (overlap(parts, X_MT) > (1e-6 if true else 4e-5)) == (true > 0)


def test_what_is_said() -> None:
    require_apart(PARTS, pitched(-1e-9), "gap", 0.0)
    assert overlap(PARTS, pitched(0.5 * TOUCHING, 0.006)) > 0
    require_apart(PARTS, pitched(0.5 * TOUCHING, 0.006), "gap", 0.0)
    with pytest.raises(ParameterError) as caught:
        require_apart(PARTS, pitched(0.001, 0.006), "gap", -0.001)
    assert str(caught.value) == (
        "gap is -0.001, allowed: one with which peg and hole part are apart; they overlap by 1 mm"
    )


@pytest.mark.parametrize(
    ("p", "roll", "deep"),
    [
        ((0.02, 0.00025, -0.00025), 0.0, 0.0),
        ((0.02, 0.0, 0.001), 0.0, 0.001 - PARTS.clearance),
        ((0.02, 0.0, 0.0), 0.1, 0.000671),  # r (cos + sin) - R
        ((0.001, 0.011, 0.011), 0.0, 0.001),  # in the face, which reaches into the corners
        ((0.02, 0.0239, 0.0239), 0.0, 0.0),  # beside the part
    ],
)
def test_square_parts_overlap_at_their_faces(
    p: tuple[float, float, float], roll: float, deep: float
) -> None:
    square = PegAndHole(section="square")
    X_MT = RigidTransform(RollPitchYaw(roll, 0.0, 0.0), p)
    assert overlap(square, X_MT) == pytest.approx(deep, abs=1e-5)
