"""Peg and hole, their presets and their support."""

import math
import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.models.peg.part_surfaces import part_mesh
from chamfer.models.peg.peg_and_hole import (
    PRESETS,
    Chamfer,
    ColouredParts,
    PegAndHole,
    PegHoleGeometry,
)
from chamfer.models.peg.support import OpenSupport, Support, in_series
from chamfer.models.validation import ParameterError

PEG, HOLE = PegAndHole().peg, PegAndHole().hole


@pytest.mark.parametrize(("angle", "height"), [(math.pi / 4, 0.002), (math.pi / 3, 0.0034641)])
def test_profiles(angle: float, height: float) -> None:
    peg = PEG._replace(radius=0.01, chamfer=Chamfer(0.002, angle), length=0.05)
    hole = HOLE._replace(radius=0.01, chamfer=Chamfer(0.002, angle), outer_radius=0.02, depth=0.05)
    profiles = peg.profile, hole.outside, hole.bore
    expected = (
        [[-0.05, 0.01], [-height, 0.01], [0, 0.008]],
        [[0, 0.02], [0.05, 0.02]],
        [[0, 0.012], [height, 0.01], [0.05, 0.01]],
    )
    for got, wanted in zip(profiles, expected, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-7)


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


@pytest.mark.parametrize("part", ["peg", "hole", "blind", "square"])
def test_mesh_is_closed_faces_outwards_and_has_the_volume(part: str) -> None:
    blind = HOLE._replace(bore_depth=0.03)
    profile = {"hole": HOLE, "blind": blind}.get(part, PEG).closed_profile
    section: Any = "square" if part == "square" else "round"
    corners, normals = triangles(part_mesh(profile, 200, section))
    r, c, R, C, Ro = PEG.radius, PEG.chamfer.width, HOLE.radius, HOLE.chamfer.width, 0.014
    bore = 0.03 if part == "blind" else HOLE.depth
    volume = math.pi * (Ro**2 * HOLE.depth - R**2 * (bore - C)) - frustum(R + C, R, C)
    if part in ("peg", "square"):
        volume = math.pi * r**2 * (PEG.length - c) + frustum(r, r - c, c)
        volume *= 4 / math.pi if part == "square" else 1
    one, two, three = corners[:, 0], corners[:, 1], corners[:, 2]
    across = np.cross(two - one, three - one)
    # Divergence theorem; the polygon's area is 1 - (2 pi / n)^2 / 6 of the circle's.
    assert np.sum(one * across) / 6 == pytest.approx(volume, rel=1e-3)
    np.testing.assert_allclose(across.sum(axis=0), 0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-6)
    large = np.linalg.norm(across, axis=1) > 1e-12
    assert (np.sum(across[:, np.newaxis] * normals, axis=2)[large] > 0).all()


def test_chamfers_are_shared_between_peg_and_hole() -> None:
    parts = PegAndHole(chamfer_width=0.003, peg_chamfer_share=0.25, peg_chamfer_angle=1.0)
    assert parts.peg.chamfer == pytest.approx((0.00075, 1.0))
    assert parts.hole.chamfer == pytest.approx((0.00225, math.pi / 4))
    assert parts.chamfer_height == pytest.approx(0.00075 * math.tan(1.0) + 0.00225)


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
    assert OTHER.peg_chamfer == OTHER.hole_chamfer == pytest.approx((0.0015, 0.9))
    # A peg that leans by that much just spans the mouth.
    assert 2 * 0.0117 / math.cos(OTHER.mouth_tilt_limit) == pytest.approx(2 * 0.012)
    # Two points touch at theta_w where lambda is one.
    assert OTHER.wedging_depth * OTHER.rotation_limit == pytest.approx(2 * OTHER.clearance)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("chamfer_width", 0.019558, "with less than the peg's radius, 0.009779, on the peg"),
        *(
            ("bore_depth", depth, "between the chamfer's height, 0.002 m, and the depth, 0.04 m")
            for depth in (0.0019, 0.04)
        ),
        ("peg_colour", (0, 0, 256), "three numbers from 0 to 255"),
    ],
)
def test_refused_parts(name: str, value: object, allowed: str) -> None:
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        ColouredParts(**{name: value})


@pytest.mark.parametrize(("part", "name"), [("peg", "peg_length"), ("hole", "hole_length")])
def test_a_chamfer_fits_on_its_part(part: str, name: str) -> None:
    allowed = f"with less than the {part}'s length, 0.0019 m, along the {part}"
    message = re.escape(f"chamfer_width is 0.004, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        PegAndHole(**{name: 0.0019})
    PegAndHole(**{name: 0.0021})


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_parts_that_fit(name: str) -> None:
    parts = ColouredParts(**PRESETS[name], peg_colour=(0, 0, 255))  # type: ignore[arg-type]
    assert 0 < parts.clearance_ratio < 0.05
    assert parts.bore_length < parts.peg_length


ARM = Support(centre_distance=0.0)


def compliance(support: Support, height: float) -> NDArray[np.float64]:
    """Return lateral and angular motion of the tip for a unit of force and of moment there."""
    arm = np.array([height, 1.0])
    turned = np.outer(arm, arm) / support.angular_stiffness
    return np.diag([1 / support.lateral_stiffness, 0.0]) + turned


def test_compliances_at_the_tip_add() -> None:
    peg = Support(lateral_stiffness=300.0, angular_stiffness=4.0, centre_distance=0.03)
    hole = Support(lateral_stiffness=700.0, angular_stiffness=9.0, centre_distance=0.05)
    depth = 0.02
    both = in_series(peg, hole, depth)
    expected = compliance(peg, 0.03) + compliance(hole, depth - 0.05)
    np.testing.assert_allclose(compliance(both, both.centre_distance), expected, rtol=1e-12)


def test_no_slope_at_a_remote_centre_and_the_largest_in_between() -> None:
    support = Support()
    assert ARM.tilt_per_error == 0.0
    assert Support(centre_distance=1e6).tilt_per_error == pytest.approx(0.0, abs=2e-6)
    at = support.worst_centre_distance
    assert at == pytest.approx(math.sqrt(5 / 400))
    largest = Support(centre_distance=at).tilt_per_error
    assert largest == pytest.approx(1 / (2 * math.sqrt(5 / 400)))
    for distance in np.linspace(0.0, 1.0, 101).tolist():
        assert Support(centre_distance=distance).tilt_per_error <= largest * (1 + 1e-12)


def test_what_is_left_open_is_derived() -> None:
    assert OpenSupport().over(ARM) == ARM
    said = OpenSupport(angular_stiffness=7.0).over(ARM)
    assert said == Support(angular_stiffness=7.0, centre_distance=0.0)
    at_tip = OpenSupport(centre_distance=0.0).over(Support())
    assert at_tip.centre_distance == 0.0
