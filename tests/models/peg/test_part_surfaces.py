"""Surfaces of square parts; those of round ones are in test_peg_and_hole.py."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.models.peg.part_surfaces import around, part_mesh, radius_of, rings
from chamfer.models.peg.peg_and_hole import PegAndHole

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
