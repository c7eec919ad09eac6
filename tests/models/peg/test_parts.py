"""Dimensions of the peg and the hole part, and the shapes made from them."""

import dataclasses
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from chamfer.models.peg.part_presets import PRESETS
from chamfer.models.peg.part_surfaces import around, part_mesh, radius_of, rings
from chamfer.models.peg.peg_and_hole import ColouredParts, HolePart, Peg, PegAndHole
from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.validation import ParameterError

PEG, HOLE = PegAndHole().peg, PegAndHole().hole


def test_profile_of_the_peg_ends_with_a_chamfer_at_the_tip() -> None:
    peg = replace(PEG, radius=0.01, chamfer=0.002, length=0.05)
    np.testing.assert_allclose(peg.profile, [[-0.05, 0.01], [-0.002, 0.01], [0, 0.008]])


def test_profiles_of_the_hole_part_begin_at_the_mouth() -> None:
    hole = replace(HOLE, radius=0.01, chamfer=0.002, outer_radius=0.02, depth=0.05)
    assert hole.mouth_radius == pytest.approx(0.012)
    np.testing.assert_allclose(hole.outside, [[0, 0.02], [0.05, 0.02]])
    np.testing.assert_allclose(hole.bore, [[0, 0.012], [0.002, 0.01], [0.05, 0.01]])


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


SQUARE = PegAndHole(section="square")


def test_rings_of_squares_have_their_faces_in_y_and_z() -> None:
    (ring,) = rings(np.array([[0.1, 2.0]]), 96, "square")
    assert ring.tolist() == [[0.1, 2, 2], [0.1, -2, 2], [0.1, -2, -2], [0.1, 2, -2]]


@pytest.mark.parametrize("section", ["round", "square"])
def test_points_around_have_radius_one(section: str) -> None:
    points = np.insert(around(96, section), 0, 5.0, axis=1)  # type: ignore[arg-type]
    np.testing.assert_allclose(radius_of(points, section), 1.0)  # type: ignore[arg-type]
    assert np.abs(points[:, 1:]).max() == pytest.approx(1.0)


def test_the_mesh_of_a_square_peg_is_closed_and_flat() -> None:
    peg = replace(SQUARE.peg, radius=0.01, chamfer=0.0, length=0.05)
    rows = [line.split() for line in part_mesh(peg.closed_profile, 96, "square").splitlines()]
    points = np.array([row[1:] for row in rows if row[0] == "v"], dtype=float)
    normals = np.array([row[1:] for row in rows if row[0] == "vn"], dtype=float)
    volume = 0.0
    for row in rows:
        if row[0] == "f":
            corners = [tuple(map(int, one.split("//"))) for one in row[1:]]
            a, b, c = (points[point - 1] for point, _ in corners)
            volume += float(a @ np.cross(b, c)) / 6
            face = np.cross(b - a, c - a)
            if np.linalg.norm(face) > 1e-12:  # none at the axis
                for _, normal in corners:
                    np.testing.assert_allclose(normals[normal - 1], face / np.linalg.norm(face))
    assert volume == pytest.approx(0.02**2 * 0.05)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_parts_that_fit(name: str) -> None:
    parts = ColouredParts(**PRESETS[name])  # type: ignore[arg-type]
    assert 0 < parts.clearance_ratio < 0.05
    assert parts.bore_length < parts.peg_length


def test_the_papers_parts_are_the_default() -> None:
    assert PegAndHole(**PRESETS["paper"]) == PegAndHole()  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "diameter", "bore"),
    [
        ("nist-12.675mm", 12.675e-3, 12.70e-3),
        ("factory-8mm", 7.986e-3, 8.1e-3),
        ("nist-16mm", 16e-3, 16.1e-3),
    ],
)
def test_published_diameters(name: str, diameter: float, bore: float) -> None:
    parts = PegAndHole(**PRESETS[name])  # type: ignore[arg-type]
    assert 2 * parts.peg_radius == pytest.approx(diameter)
    assert 2 * parts.hole_radius == pytest.approx(bore)


def test_scaled_parts_have_the_same_shape() -> None:
    parts = ColouredParts(bore_depth=0.03).scaled(0.0020070, 0.01)
    assert parts.hole_radius == 0.0020070
    assert parts.clearance_ratio == pytest.approx(0.01)
    assert parts.friction == ColouredParts.friction
    for name, length in (("peg_length", 0.012), ("bore_depth", 0.006), ("chamfer_width", 8e-4)):
        assert getattr(parts, name) == pytest.approx(length)


PAPER = PegHoleGeometry()
# Every number differs from the paper's, so that no two can be mixed up unseen.
OTHER = PegHoleGeometry(
    hole_radius=0.012, peg_radius=0.0117, friction=0.3, chamfer_width=0.003, chamfer_angle=0.9
)


def test_published_numbers() -> None:
    assert PAPER.clearance_ratio == pytest.approx(0.0255107, abs=5e-8)
    assert PAPER.rotation_limit == pytest.approx(0.05817, abs=5e-6)
    assert PAPER.lateral_limit == pytest.approx(0.019814, abs=5e-7)
    # Section 4 writes the limit as (c 2R) / (mu 2r), which is not c / mu.
    c, R, r, mu = PAPER.clearance_ratio, 0.010035, 0.009779, 0.45
    assert PAPER.rotation_limit == pytest.approx(c * 2 * R / (mu * 2 * r), rel=1e-12)
    assert PAPER.rotation_limit != pytest.approx(c / mu, rel=0.02)


def test_lengths_of_the_parts() -> None:
    assert OTHER.clearance == pytest.approx(3e-4)
    assert OTHER.friction_radius == pytest.approx(0.3 * 0.0117)
    assert OTHER.wedging_depth == pytest.approx(2 * 0.3 * 0.0117)
    assert OTHER.chamfer_limit == pytest.approx(0.0033)
    assert OTHER.lateral_limit == pytest.approx(0.0237)
    # A peg that leans by that much just spans the mouth.
    assert 2 * 0.0117 / math.cos(OTHER.mouth_tilt_limit) == pytest.approx(2 * 0.012)
    # Two points touch at theta_w where lambda is one.
    assert OTHER.wedging_depth * OTHER.rotation_limit == pytest.approx(2 * OTHER.clearance)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        *(
            (name, value, "a finite number > 0")
            for value in (0.0, -1.0, math.nan, math.inf)
            for name in ("hole_radius", "peg_radius", "friction")
        ),
        *(
            ("chamfer_width", value, "a finite number >= 0")
            for value in (-1e-9, math.nan, math.inf)
        ),
        ("peg_radius", 0.010035, "less than the hole's radius, 0.010035"),
        ("peg_radius", 0.02, "less than the hole's radius, 0.010035"),
        ("chamfer_angle", 0.0, "between 0 and pi/2"),
        ("chamfer_angle", math.pi / 2, "between 0 and pi/2"),
        ("chamfer_angle", math.nan, "between 0 and pi/2"),
        ("chamfer_width", 0.02, "with less than the peg's radius, 0.009779, on the peg"),
    ],
)
def test_errors_of_peg_hole_geometry(name: str, value: float, allowed: str) -> None:
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        dataclasses.replace(PAPER, **{name: value})
