"""Dimensions of the peg and the hole part, and the shapes made from them."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from chamfer.models.peg.part_surfaces import part_mesh, rings
from chamfer.models.peg.peg_and_hole import ColouredParts, HolePart, Peg, PegAndHole
from chamfer.models.validation import ParameterError

PEG, HOLE = PegAndHole().peg, PegAndHole().hole


def test_published_dimensions() -> None:
    assert PEG.radius == 0.009779
    assert HOLE.radius == 0.010035


def test_profile_of_the_peg_ends_with_a_chamfer_at_the_tip() -> None:
    peg = replace(PEG, radius=0.01, chamfer=0.002, length=0.05)
    np.testing.assert_allclose(peg.profile, [[-0.05, 0.01], [-0.002, 0.01], [0, 0.008]])


def test_profiles_of_the_hole_part_begin_at_the_mouth() -> None:
    hole = replace(HOLE, radius=0.01, chamfer=0.002, outer_radius=0.02, depth=0.05)
    assert hole.mouth_radius == pytest.approx(0.012)
    np.testing.assert_allclose(hole.outside, [[0, 0.02], [0.05, 0.02]])
    np.testing.assert_allclose(hole.bore, [[0, 0.012], [0.002, 0.01], [0.05, 0.01]])


@pytest.mark.parametrize("sides", [3, 16, 127])
def test_rings_have_the_area_of_the_circles(sides: int) -> None:
    profile = np.array([[0.1, 0.5], [-0.3, 2.0]])
    points = rings(profile, sides)
    assert points.shape == (2, sides, 3)
    for ring, (x, radius) in zip(points, profile, strict=True):
        np.testing.assert_array_equal(ring[:, 0], x)
        y, z = ring[:, 1], ring[:, 2]
        area = np.sum(y * np.roll(z, -1) - z * np.roll(y, -1)) / 2
        assert area == pytest.approx(math.pi * radius**2, rel=1e-12)
        np.testing.assert_allclose(ring[:, 1:].mean(axis=0), 0, atol=1e-12)


def triangles(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Return corners, shape (n, 3, 3), and their normals of a Wavefront OBJ file."""
    rows = [line.split() for line in text.splitlines()]
    points = np.array([row[1:] for row in rows if row[0] == "v"], dtype=float)
    normals = np.array([row[1:] for row in rows if row[0] == "vn"], dtype=float)
    faces = np.array(
        [[corner.split("//") for corner in row[1:]] for row in rows if row[0] == "f"], dtype=int
    )
    return points[faces[..., 0] - 1], normals[faces[..., 1] - 1]


def frustum(r0: float, r1: float, height: float) -> float:
    return math.pi * height * (r0**2 + r0 * r1 + r1**2) / 3


@pytest.mark.parametrize("part", ["peg", "hole"])
def test_mesh_is_closed_faces_outwards_and_has_the_volume(part: str) -> None:
    peg, hole = PEG, HOLE
    profile = {"peg": peg, "hole": hole}[part].closed_profile
    corners, normals = triangles(part_mesh(profile, 200))
    r, c = peg.radius, peg.chamfer
    R, C, Ro = hole.radius, hole.chamfer, hole.outer_radius
    volume = {
        "peg": math.pi * r**2 * (peg.length - c) + frustum(r, r - c, c),
        "hole": math.pi * (Ro**2 * hole.depth - R**2 * (hole.depth - C)) - frustum(R + C, R, C),
    }[part]
    one, two, three = corners[:, 0], corners[:, 1], corners[:, 2]
    across = np.cross(two - one, three - one)
    # Divergence theorem; the polygon's area is 1 - (2 pi / n)^2 / 6 of the circle's.
    assert np.sum(one * across) / 6 == pytest.approx(volume, rel=1e-3)
    np.testing.assert_allclose(across.sum(axis=0), 0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-6)
    large = np.linalg.norm(across, axis=1) > 1e-12
    assert (np.sum(across[:, np.newaxis] * normals, axis=2)[large] > 0).all()


@pytest.mark.parametrize(
    ("part", "changes", "allowed"),
    [
        (PEG, {"radius": 0.0}, "a finite number > 0"),
        (PEG, {"length": math.nan}, "a finite number > 0"),
        (PEG, {"chamfer": -1e-3}, "a finite number >= 0"),
        (PEG, {"chamfer": 0.01}, "less than the radius, 0.009779 m"),
        (replace(PEG, radius=0.1), {"chamfer": 0.07}, "less than the length, 0.06 m"),
        (HOLE, {"radius": math.inf}, "a finite number > 0"),
        (HOLE, {"depth": 0.0}, "a finite number > 0"),
        (replace(HOLE, outer_radius=0.5), {"chamfer": 0.1}, "less than the depth, 0.04 m"),
        (
            replace(HOLE, radius=0.01),
            {"outer_radius": 0.011},
            "more than radius + chamfer, 0.012 m",
        ),
    ],
)
def test_errors(part: Peg | HolePart, changes: dict[str, float], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        replace(part, **changes)


def test_a_chamfer_of_another_angle_has_another_height() -> None:
    peg = replace(PEG, radius=0.01, chamfer=0.002, chamfer_angle=math.pi / 3, length=0.05)
    height = 0.002 * math.sqrt(3)
    np.testing.assert_allclose(peg.profile, [[-0.05, 0.01], [-height, 0.01], [0, 0.008]])
    hole = replace(HOLE, chamfer=0.001, chamfer_angle=math.pi / 6)
    np.testing.assert_allclose(hole.bore[1], [0.001 / math.sqrt(3), hole.radius])


def test_parts_without_chamfers_have_no_edge_twice() -> None:
    sharp = PegAndHole(chamfer_width=0.0)
    assert sharp.peg.profile.shape == sharp.hole.bore.shape == (2, 2)
    corners, _ = triangles(part_mesh(sharp.peg.closed_profile, 100))
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(across.sum(axis=0), 0, atol=1e-15)


def test_a_blind_bore_ends_in_the_material() -> None:
    hole = replace(HOLE, bore_depth=0.03)
    R, C, Ro = hole.radius, hole.chamfer, hole.outer_radius
    corners, _ = triangles(part_mesh(hole.closed_profile, 200))
    one, two, three = corners[:, 0], corners[:, 1], corners[:, 2]
    volume = np.sum(one * np.cross(two - one, three - one)) / 6
    expected = math.pi * (Ro**2 * 0.04 - R**2 * (0.03 - C)) - frustum(R + C, R, C)
    assert volume == pytest.approx(expected, rel=1e-3)


def test_chamfers_are_shared_between_peg_and_hole() -> None:
    parts = PegAndHole(chamfer_width=0.003, peg_chamfer_share=0.25, peg_chamfer_angle=1.0)
    assert (parts.peg.chamfer, parts.hole.chamfer) == pytest.approx((0.00075, 0.00225))
    assert (parts.peg.chamfer_angle, parts.hole.chamfer_angle) == (1.0, math.pi / 4)
    assert parts.chamfer_height == pytest.approx(0.00075 * math.tan(1.0) + 0.00225)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("peg_chamfer_share", 1.1, "0 to 1"),
        ("peg_chamfer_angle", 0.0, "between 0 and pi/2"),
        ("peg_length", 0.001, None),
        ("hole_length", -0.04, "a finite number > 0"),
        ("outer_radius", 0.011, "more than radius + chamfer, 0.012035 m"),
        ("bore_depth", 0.05, "between the chamfer's height, 0.002 m, and the depth, 0.04 m"),
        ("peg_colour", (0, 0, 256), "three numbers from 0 to 255"),
    ],
)
def test_parts_are_refused_by_their_own_names(name: str, value: object, allowed: str) -> None:
    with pytest.raises(ParameterError) as caught:
        ColouredParts(**{name: value})
    if allowed is None:  # the chamfer does not fit on it
        assert caught.value.name == "chamfer_width"
    else:
        assert str(caught.value) == f"{name} is {value!r}, allowed: {allowed}"
