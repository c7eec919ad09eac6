"""What pieces become in a plant, which of them touch, and what no connector can be."""

from collections import Counter
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box, Role, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.arms.wrist import WristParams
from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.connectors.connector import ContactMaterial, ConvexPiece, add_pieces
from chamfer.models.connectors.d_connector import DConnector, DSection
from chamfer.models.connectors.rj45_connector import Rj45Connector
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import ParameterError

X_BP = RigidTransform(RollPitchYaw(0.3, -0.4, 2.5), [0.1, -0.2, 0.3])
PIECES = [
    ConvexPiece("ball", Sphere(0.1), RigidTransform([0.0, 0.0, 0.5])),
    ConvexPiece(
        "block", Box(0.1, 0.2, 0.3), RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), np.zeros(3))
    ),
]
MATERIAL = ContactMaterial(stiffness=1.5e5, dissipation=7.0, friction=0.35)
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


@pytest.mark.parametrize("kind", [DConnector, BncConnector, Rj45Connector, RoundPeg])
@pytest.mark.parametrize("socket_first", [False, True])
def test_only_partners_touch_and_what_is_no_part_is_touched_by_all(
    kind: Any, socket_first: bool
) -> None:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    hand = plant.AddRigidBody("hand", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    connector, here = kind(), RigidTransform()
    if socket_first:
        connector.add_socket(plant, here)
    connector.add_plug(plant, hand, here)
    if not socket_first:
        connector.add_socket(plant, here)
    obstacle = ConvexPiece("obstacle", Sphere(0.1), here)
    add_pieces(plant, plant.world_body(), here, [obstacle], MATERIAL, None)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    found = Counter(
        frozenset(inspector.GetName(g).rpartition("::")[2].partition(":")[0] for g in pair)
        for pair in inspector.GetCollisionCandidates()
    )
    plug, socket = (
        {part.name: len(part.pieces) for part in parts}
        for parts in (connector.plug_parts(), connector.socket_parts())
    )
    expected = {frozenset((a, b)): plug[a] * socket[b] for a, b in kind.PARTNERS}
    assert found == expected | {frozenset((a, "obstacle")): count for a, count in plug.items()}


SMOOTH = ContactMaterial(friction=1e-6)
STIFF = WristParams(stiffness=(2e4, 2e4, 2e4, 2e9, 2e9, 2e9))  # it goes where it is sent
# Depths, m, between which springs give way, and where the plug is along y for their closed form.
SPRINGS: dict[Any, Any] = {
    DConnector: (1.5e-3, 5.5e-3, lambda one: 0.0, DConnector.pin_force),
    BncConnector: (4.5e-3, 8.3e-3, lambda one: 0.0, BncConnector.spring_push),
    Rj45Connector: (3.0e-3, 9.4e-3, lambda one: -one.clearance[1], Rj45Connector.insertion_force),
}


def forces_at(follow: Any, kind: Any, speed: float, per_step: float, **fields: Any) -> Any:
    """Depth, m, push and the closed form of a plug that goes in, N, by a way in a step, m."""
    connector = kind(material=SMOOTH, **fields)
    first, last, beside, law = SPRINGS[kind]
    ends = [[0.0] * 4 + [beside(connector), -depth] for depth in (first, last)]
    way = [(0.0, ends[0]), ((last - first) / speed, ends[1])]
    run = follow(connector, way, wrist=STIFF, step=per_step / speed)
    # It was at rest first, and is sent no further in the end.
    rows = (run.depth > first + 5e-4) & (run.depth < last - 2e-5)
    return run.depth[rows], run.push[rows], law(connector, run.depth[rows])


@pytest.mark.parametrize("speed", [0.002, 0.02, 0.06, 0.12])
@pytest.mark.parametrize("kind", SPRINGS)
def test_springs_take_what_their_closed_form_says_at_any_speed(
    follow: Any, kind: Any, speed: float
) -> None:
    errors = []
    for per_step in (4e-6, 2e-6):
        depth, push, law = forces_at(follow, kind, speed, per_step)
        errors.append(np.abs(push - law).max() / np.abs(law).max())
        given_back, expected = (np.trapezoid(np.clip(f, None, 0), depth) for f in (push, law))
        assert given_back == pytest.approx(expected, rel=0.05, abs=1e-5)
    assert errors[1] < 0.05
    assert errors[1] < max(0.6 * errors[0], 1e-3)


def test_springs_that_dissipate_give_less_back(follow: Any) -> None:
    back = []
    for dissipation in (0.0, 20.0):
        depth, push, _ = forces_at(
            follow, Rj45Connector, 0.06, 4e-6, spring_dissipation=dissipation
        )
        back.append(-np.trapezoid(np.clip(push, None, 0), depth))
    assert back[0] > 3e-3  # J, of the latch behind its edge
    assert back[1] < 0.5 * back[0]


SECTION = {"width": 0.038, "height": 0.008, "corner_radius": 0.0026, "side_angle": 0.17}


@pytest.mark.parametrize(
    ("kind", "changes", "name"),
    [
        (BncConnector, {"stud_diameter": (2.0e-3, 1.9e-3)}, "stud_diameter"),
        (BncConnector, {"stud_diameter": (1.9e-3, 2.4e-3)}, "slot_width"),
        (BncConnector, {"barrel_diameter": (9.6e-3, 9.8e-3)}, "bore_diameter"),
        (BncConnector, {"tips_diameter": (9.65e-3, 11e-3)}, "tips_diameter"),
        (BncConnector, {"detent": 2.8e-3}, "detent"),
        (BncConnector, {"detent": 2.7e-3}, "spring_travel"),  # the sleeve would leave the spring
        (BncConnector, {"spring_travel": 1.1e-3}, "spring_travel"),
        (DConnector, {"plug_width": (0.039, 0.038)}, "plug_width"),
        (DConnector, {"travel": 6.2e-3}, "travel"),
        (DConnector, {"tine_deflection": 1.1e-3}, "tine_deflection"),
        (DConnector, {"pin_depth": 0.5e-3}, "pin_depth"),
        (DConnector, {"plug_height": (7.9e-3, 8.0e-3), "tolerance": "worst"}, "plug_width"),
        (DSection, {**SECTION, "width": 5e-3}, "width"),
        (DSection, {**SECTION, "height": 5e-3}, "corner_radius"),
        (Rj45Connector, {"plug_height": (6.5e-3, 6.7e-3)}, "plug_height"),
        (Rj45Connector, {"jack_width": (0.05, 0.05)}, "jack_width"),
        (Rj45Connector, {"lead_in": 2e-3}, "lead_in"),
        (Rj45Connector, {"latch_place": 9e-3}, "latch_place"),
        (Rj45Connector, {"contact_depth": 9e-3}, "contact_depth"),
        (RoundPeg, {"peg_radius": 0.010}, "peg_radius"),
        (RoundPeg, {"hole_radius": 0.04}, "hole_radius"),
        (RoundPeg, {"lead_in": 0.006}, "lead_in"),
        (RoundPeg, {"outer_radius": 0.0105}, "outer_radius"),
    ],
)
def test_refuses_in_one_line(kind: Any, changes: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError) as refused:
        kind(**changes)
    assert refused.value.name == name
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("kind", [DConnector, BncConnector, Rj45Connector, RoundPeg])
def test_outlines_meet_at_the_faces_and_are_tall_enough_to_be_found(kind: Any) -> None:
    plug, socket = kind().plug_outline, kind().socket_outline
    assert plug[:, 2].min() == socket[:, 2].max() == 0.0
    for corners in (plug, socket):
        width, depth, height = np.ptp(corners, axis=0)
        np.testing.assert_allclose(corners.mean(axis=0)[:2], 0.0, atol=1e-12)
        assert height >= 0.5 * max(width, depth)
