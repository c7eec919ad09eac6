"""Solids in Wavefront files."""

from pathlib import Path

import numpy as np
import pytest

from chamfer.models.connectors.obj_file import convex_hull, read_solids, write_solids

CUBE = """
# a cube, its faces in every way that a file may have
mtllib nothing.mtl
o cube
v 0 0 0
v 1 0 0 # a corner
v 1 1 0
v 0 1 0 1.0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
vn 0 0 1
f 1 4 3 2
f 5//1 6//1 7//1 8//1
f 1/1 2/2 6/3 5/4
f -7 -6 -2 -3
f 3 4 8 7
f 4 1 5 8
"""


def solids(tmp_path: Path, text: str):
    path = tmp_path / "part.obj"
    path.write_text(text)
    return read_solids(path)


def test_a_cube_is_convex(tmp_path: Path) -> None:
    (cube,) = solids(tmp_path, CUBE)
    assert (cube.name, cube.convex) == ("cube", True)
    assert (cube.volume, cube.hull) == pytest.approx((1.0, 1.0))
    assert cube.corners.shape == (8, 3)
    assert cube.triangles.shape == (12, 3)


def test_faces_all_inside_out_are_turned(tmp_path: Path) -> None:
    turned = "\n".join(
        " ".join(["f", *reversed(line.split()[1:])]) if line.startswith("f") else line
        for line in CUBE.splitlines()
    )
    (cube,) = solids(tmp_path, turned)
    assert cube.volume == pytest.approx(1.0)


def test_an_l_is_not_convex_and_has_the_files_name(tmp_path: Path, ell: str) -> None:
    (found,) = solids(tmp_path, ell)
    assert (found.name, found.convex) == ("part", False)
    assert (found.volume, found.hull) == pytest.approx((3.0, 3.5))


def test_solids_are_written_and_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    written = [convex_hull(name, rng.normal(size=(30, 3))) for name in ("one piece", "another")]
    assert all(len(solid.corners) < 30 and solid.convex for solid in written)
    write_solids(tmp_path / "pieces.obj", written)
    found = read_solids(tmp_path / "pieces.obj")
    assert [solid.name for solid in found] == ["one piece", "another"]
    for solid, original in zip(found, written, strict=True):
        assert solid.volume == pytest.approx(original.volume, rel=1e-7)
        assert solid.convex


def test_a_face_that_its_first_corner_does_not_see_is_refused(tmp_path: Path, ell: str) -> None:
    assert "f 4 3 2 1" in ell
    one_face = ell.replace("f 4 3 2 1\n", "").replace("f 6 5 4 1", "f %s")
    (whole,) = solids(tmp_path, one_face % "1 6 5 4 3 2")
    assert whole.volume == pytest.approx(3.0)
    with pytest.raises(ValueError, match=r"^a face of 'part' is not convex, divide it into tri"):
        solids(tmp_path, one_face % "6 5 4 3 2 1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no faces"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        ("v 0 0\n", "line 1: 'v 0 0'"),
        ("v 0 0 nan\n", "line 1: 'v 0 0 nan'"),
        ("v 0 0 0\nv 1 0 0\nf 1 2 3\n", "line 3: 'f 1 2 3'"),
        ("v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3: 'f 1 2'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "the surface of 'part' is open"),
        (CUBE.replace("f 4 1 5 8", ""), "the surface of 'cube' is open"),
        (CUBE.replace(" 1\nv", " 0\nv").replace("v 0 1 1", "v 0 1 0"), "'cube' has no volume"),
    ],
)
def test_what_is_no_solid_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        solids(tmp_path, text)
    assert str(refused.value) == message
