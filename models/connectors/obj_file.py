"""Solids in Wavefront files: one of each object, by its corners and triangles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

Array = NDArray[np.float64]
Triangles = NDArray[np.intp]

# Of the convex hull's volume, that a convex solid may lack: what rounding in the file does.
_ROUNDING: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Solid:
    """An object of a file."""

    name: str
    corners: Array  # in the file's unit, shape (n, 3)
    triangles: Triangles  # places of their corners, anticlockwise from outside, shape (m, 3)

    @cached_property
    def volume(self) -> float:
        """What the triangles enclose, in the file's unit; positive if they face outwards."""
        a, b, c = np.moveaxis(self.corners[self.triangles], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    @cached_property
    def hull(self) -> float:
        """The volume of the convex hull."""
        return float(ConvexHull(self.corners).volume)

    @property
    def convex(self) -> bool:
        """Whether it is its own convex hull."""
        return self.volume >= (1 - _ROUNDING) * self.hull


def convex_hull(name: str, corners: Array) -> Solid:
    """Return the solid with the fewest corners around points, shape (n, 3)."""
    hull = ConvexHull(corners)
    used, places = np.unique(hull.simplices, return_inverse=True)
    triangles = places.reshape(hull.simplices.shape)
    points = corners[used]
    outward = hull.equations[:, :3]
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    inside_out = np.einsum("ij,ij->i", np.cross(b - a, c - a), outward) < 0
    triangles[inside_out] = triangles[inside_out, ::-1]
    return Solid(name, points, triangles)


def read_solids(path: Path) -> tuple[Solid, ...]:
    """Return the solids of a file, each a closed surface.

    Raises:
        OSError: If the file can't be read.
        ValueError: If a line is wrong, there is no solid, or one is flat or open.
    """
    corners: list[list[float]] = []
    faces: dict[str, list[tuple[int, ...]]] = {}
    name = path.stem
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        kind, *words = line.partition("#")[0].split() or [""]
        try:
            if kind == "v":
                corners.append([float(word) for word in words[:3]])
                if len(corners[-1]) != 3 or not np.isfinite(corners[-1]).all():
                    raise ValueError
            elif kind in ("o", "g"):
                name = " ".join(words) or f"object {len(faces)}"
            elif kind == "f":
                faces.setdefault(name, []).append(_face(words, len(corners)))
        except ValueError:
            raise ValueError(f"line {number}: {line.strip()!r}") from None
    if not faces:
        raise ValueError("no faces")
    return tuple(_solid(name, np.array(corners), group) for name, group in faces.items())


def write_solids(path: Path, solids: Sequence[Solid]) -> None:
    """Write solids to a file, an object each."""
    lines = []
    first = 1
    for solid in solids:
        lines.append(f"o {solid.name}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in solid.corners.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (solid.triangles + first).tolist()]
        first += len(solid.corners)
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _face(words: Sequence[str], known: int) -> tuple[int, ...]:
    """Return the places of a face's corners; a file counts from 1, or back from -1."""
    places = [int(word.partition("/")[0]) for word in words]
    places = [place - 1 if place > 0 else known + place for place in places]
    if len(places) < 3 or not all(0 <= place < known for place in places):
        raise ValueError
    return tuple(places)


def _solid(name: str, corners: Array, faces: Sequence[tuple[int, ...]]) -> Solid:
    triangles = np.array(list(_triangles(name, corners, faces)))
    used, places = np.unique(triangles, return_inverse=True)
    points, same = np.unique(corners[used], axis=0, return_inverse=True)
    solid = Solid(name, points, np.asarray(same).reshape(-1)[places.reshape(triangles.shape)])
    edges = np.vstack([solid.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    if not np.array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0)):
        raise ValueError(f"the surface of {name!r} is open")
    try:
        flat = not abs(solid.volume) > 1e-9 * solid.hull
    except QhullError:
        flat = True
    if flat:
        raise ValueError(f"{name!r} has no volume")
    if solid.volume < 0:  # all of it inside out
        solid = Solid(name, solid.corners, solid.triangles[:, ::-1])
    return solid


def _triangles(
    name: str, corners: Array, faces: Sequence[tuple[int, ...]]
) -> Iterator[tuple[int, int, int]]:
    """Yield the triangles from each face's first corner, which has to see all others."""
    for first, *others in faces:
        sides = corners[others] - corners[first]
        normals = np.cross(sides[:-1], sides[1:])
        if (normals @ normals.sum(axis=0) < 0).any():
            raise ValueError(f"a face of {name!r} is not convex, divide it into triangles")
        for second, third in pairwise(others):
            yield first, second, third
