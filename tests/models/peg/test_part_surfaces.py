"""Surfaces of peg and hole part, and whether they overlap."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.peg.part_surfaces import (
    TOUCHING,
    around,
    overlap,
    radius_of,
    require_apart,
    require_tilted_apart,
    rings,
)
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.validation import ParameterError

SQUARE = PegAndHole(section="square")


def test_rings_of_squares_have_their_faces_in_y_and_z() -> None:
    (ring,) = rings(np.array([[0.1, 2.0]]), 96, "square")
    assert ring.tolist() == [[0.1, 2, 2], [0.1, -2, 2], [0.1, -2, -2], [0.1, 2, -2]]


@pytest.mark.parametrize("section", ["round", "square"])
def test_points_around_have_radius_one(section: str) -> None:
    points = np.insert(around(96, section), 0, 5.0, axis=1)  # type: ignore[arg-type]
    np.testing.assert_allclose(radius_of(points, section), 1.0)  # type: ignore[arg-type]
    assert np.abs(points[:, 1:]).max() == pytest.approx(1.0)


PARTS = PegAndHole()
BLIND = PegAndHole(bore_depth=0.03)


def at(x: float, y: float = 0.0, pitch: float = 0.0) -> RigidTransform:
    return RigidTransform(RollPitchYaw(0.0, pitch, 0.0), [x, y, 0.0])


@pytest.mark.parametrize(
    ("X_MT", "deep"),
    [
        (at(-0.001), 0.0),
        (at(0.02), 0.0),  # in the bore, in line
        (at(0.02, 0.000255), 0.0),
        (at(0.02, 0.001), 0.001 - PARTS.clearance),
        (at(0.001, 0.003), 0.0),  # in the mouth's chamfer
        (at(0.0, 0.02), 0.0),  # flat on the face, or beside it
        (at(0.001, 0.006), 0.001),  # in the front face
        (at(0.02, 0.0239), 0.0),  # beside the part
        (at(0.02, 0.0237), 0.014 + PARTS.peg_radius - 0.0237),
        (at(0.2), 0.0),  # out of the back
    ],
)
def test_parallel_parts(X_MT: RigidTransform, deep: float) -> None:
    assert overlap(PARTS, X_MT) == pytest.approx(deep, abs=5e-5)


@pytest.mark.parametrize("depth", [0.0299, 0.0301])
def test_a_blind_bore_ends(depth: float) -> None:
    assert overlap(BLIND, at(depth)) == pytest.approx(max(depth - 0.03, 0.0), abs=1e-9)
    assert overlap(PARTS, at(depth)) == 0.0


@given(tilt=st.floats(0.02, 0.3))
def test_the_rim_of_a_tilted_peg_is_ahead_of_its_tip(tilt: float) -> None:
    ahead = PARTS.leading(tilt)
    aside = 0.02  # before the face of a part that is wide
    wide = replace(PARTS, outer_radius=0.05)
    assert overlap(wide, at(-ahead - 1e-5, aside, tilt)) == 0.0
    assert overlap(wide, at(-ahead + 1e-4, aside, tilt)) == pytest.approx(1e-4, abs=1e-5)


def test_parts_in_each_other_are_refused() -> None:
    require_apart(PARTS, at(0.5 * TOUCHING, 0.006), "gap", 0.0)
    with pytest.raises(ParameterError) as caught:
        require_apart(PARTS, at(0.001, 0.006), "gap", -0.001)
    assert str(caught.value) == (
        "gap is -0.001, allowed: one with which peg and hole part are apart; they overlap by 1 mm"
    )
    ahead = PARTS.leading(0.1)
    for tilt in (-0.1, 0.1):
        require_tilted_apart(PARTS, tilt, ahead + 1e-9)
        with pytest.raises(ParameterError, match=r"^gap is .*, allowed: > .* m, so that peg and"):
            require_tilted_apart(PARTS, tilt, ahead)
    with pytest.raises(
        ParameterError, match=r"^tilt is 0\.7853.*, allowed: between -pi/4 and pi/4"
    ):
        require_tilted_apart(PARTS, np.pi / 4, 1.0)


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
    X_MT = RigidTransform(RollPitchYaw(roll, 0.0, 0.0), p)
    assert overlap(SQUARE, X_MT) == pytest.approx(deep, abs=1e-5)
