"""Parts out of files: solids, their convex pieces, and a part whose pieces have closed forms."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RotationMatrix

from chamfer.models.connectors.mesh_connector import (
    MeshConnector,
    convex_hull,
    divide,
    read_solids,
    write_solids,
)
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import ParameterError

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


def test_an_l_is_divided(tmp_path: Path, ell: str) -> None:
    pytest.importorskip("coacd")
    (tmp_path / "ell.obj").write_text(ell)
    excess = divide(tmp_path / "ell.obj", tmp_path / "pieces.obj")
    pieces = read_solids(tmp_path / "pieces.obj")
    assert len(pieces) >= 2
    assert all(piece.convex for piece in pieces)
    assert sum(piece.volume for piece in pieces) == pytest.approx(3.0 * (1 + excess), rel=1e-6)
    assert excess == pytest.approx(0.0, abs=1e-3)
    inner = np.array([1.2, 1.2])  # beyond the L's inner corner
    for piece in pieces:
        assert not (piece.corners.max(axis=0)[:2] > inner).all()


PEG = RoundPeg(outer_radius=0.034)  # so that the mesh has a face to lie on beside the hole
SIDES = 16
MM = 1e3


def prism(radii, heights):
    """Corners of a prism whose sides are the radii away from the axis at each height, mm."""
    angles = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) / math.cos(math.pi / SIDES)
    return np.vstack(
        [MM * np.insert(r * ring, 2, z, axis=1) for r, z in zip(radii, heights, strict=True)]
    )


def wall(side):
    """Corners of what one side of the hole is cut from, with a chamfer, mm."""
    across = 2 * math.tan(math.pi / SIDES)
    bore, edge, outer = PEG.hole_radius, PEG.lead_in, PEG.outer_radius
    radii = (bore, bore, bore + edge, outer, outer)
    heights = (-PEG.depth, -edge, 0.0, 0.0, -PEG.depth)
    corners = [
        [r, sign * r * across / 2, z]
        for r, z in zip(radii, heights, strict=True)
        for sign in (-1, 1)
    ]
    turn = RotationMatrix.MakeZRotation(2 * math.pi * side / SIDES).matrix()
    return MM * np.array(corners) @ turn.T


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    """The round peg and its hole with 16 sides."""
    folder = tmp_path_factory.mktemp("meshes")
    r, edge = PEG.peg_radius, PEG.lead_in
    peg = convex_hull("peg", prism((r - edge, r, r), (0.0, edge, PEG.peg_length)))
    bottom = prism((PEG.outer_radius,) * 2, (-PEG.depth - 4e-3, -PEG.depth))
    walls = [convex_hull(f"wall {i}", wall(i)) for i in range(SIDES)]
    write_solids(folder / "peg.obj", [peg])
    write_solids(folder / "hole.obj", [*walls, convex_hull("bottom", bottom)])
    return MeshConnector(
        plug=str(folder / "peg.obj"),
        socket=str(folder / "hole.obj"),
        mated_depth=PEG.mated_depth,
        seating_force=PEG.mating_force,
        material=PEG.material,
    )


def test_play_is_that_of_the_round_parts(geometry_of, meshes):
    mesh, round_ = (geometry_of(one) for one in (meshes, PEG))
    for direction in ((1.0, 0.0), (0.0, -1.0), (math.sqrt(0.5), math.sqrt(0.5))):
        free = mesh.free(RotationMatrix(), 5e-3, direction)
        assert free == pytest.approx(PEG.clearance, abs=2e-6)
        assert free <= round_.free(RotationMatrix(), 5e-3, direction) + 2e-6


def test_it_goes_in_as_far_and_as_hard_as_the_round_parts(insert, meshes):
    found, expected = (
        insert(one, [0, 0, 0, 0, 0, 1e-3], -PEG.depth - 0.3e-3, 0.4) for one in (meshes, PEG)
    )
    before = found.depth < PEG.depth - 0.1e-3
    assert np.abs(found.wrench[:5, before]).max() < 1e-6
    assert found.push[before][-1] < 2.0  # N, of the wrist's mass as it starts
    assert found.depth[-1] == pytest.approx(expected.depth[-1], abs=5e-6)
    assert found.push[-1] == pytest.approx(expected.push[-1], rel=0.02)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("plug", "nowhere.obj", "(No such file or directory)"),
        ("socket", "ell.obj", "('ell' is not convex, divide it first)"),
        ("socket", "half.obj", "(line 1: 'v 1 2')"),
        ("unit", 1.0, "at most 1 m large"),
        ("seating_force", math.nan, "a finite number > 0"),
        ("mated_depth", 20.0, "more than lead_in, 0.0005, at most the plug's length, 0.0"),
        ("seating_force", None, "a number, or springs"),
        ("springs", {"peg": 4e3}, "null with springs"),
        ("springs", {"latch": 4e3}, "names of objects: peg, wall 0, "),
        ("springs", {"peg": 1e9}, "above 0, below 4e+06"),
    ],
)
def test_what_is_not_allowed_is_told_in_one_line(tmp_path, ell, meshes, name, value, told):
    (tmp_path / "ell.obj").write_text(ell)
    (tmp_path / "half.obj").write_text("v 1 2")
    if isinstance(value, str):
        value = str(tmp_path / value)
    fields = {"plug": meshes.plug, "socket": meshes.socket, "mated_depth": 0.02}
    with pytest.raises(ParameterError) as refused:
        MeshConnector(**{**fields, "seating_force": 20.0, name: value})
    assert name in refused.value.name or name == "springs"
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)
