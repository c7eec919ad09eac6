"""Your own part: plug and socket as convex pieces from mesh files.

Each object of a Wavefront file (``o`` or ``g``, vertices ``v``, faces ``f``) is one convex piece.
:func:`divide` divides other solids first, with CoACD (Wei, Liu, Ling and Su, 2022),
which is optional. The plug's file is in frame P, the socket's in frame S, as
:mod:`chamfer.models.connectors.connector` has them: z against the direction of insertion, both
origins where the parts in line just touch.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Convex, Shape, Sphere
from pydrake.math import RigidTransform
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from chamfer.models.connectors.connector import Array, ConnectorPart, ConvexPiece, SprungConnector
from chamfer.models.connectors.quasi_static import insertion_force
from chamfer.models.validation import ParameterError, require_not_negative, require_positive

Triangles = NDArray[np.intp]

_PLUG_COLOUR: Final = np.array([0.8, 0.16, 0.16, 1.0])
_SOCKET_COLOUR: Final = np.array([0.16, 0.28, 0.8, 0.5])
_LARGEST: Final = 1.0  # m, of a part: beyond it the unit is wrong
# Of the convex hull's volume, that a convex solid may lack: what rounding in the file does.
_ROUNDING: Final = 1e-3
_FINEST: Final = 0.01  # concavity that CoACD takes
_DEPTHS: Final = 200  # at which the force of an insertion in line is computed


@dataclass(frozen=True, eq=False)
class MeshSolid:
    """An object of a file."""

    name: str
    corners: Array  # in the file's unit, shape (n, 3)
    triangles: Triangles  # places of their corners, anticlockwise from outside, shape (m, 3)

    @cached_property
    def volume(self) -> float:
        """Volume inside the triangles, in the file's unit; positive if they face outwards."""
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


def convex_hull(name: str, corners: Array) -> MeshSolid:
    """Return the solid with the fewest corners around points, shape (n, 3)."""
    hull = ConvexHull(corners)
    used, places = np.unique(hull.simplices, return_inverse=True)
    triangles = places.reshape(hull.simplices.shape)
    points = corners[used]
    outward = hull.equations[:, :3]
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    inside_out = np.einsum("ij,ij->i", np.cross(b - a, c - a), outward) < 0
    triangles[inside_out] = triangles[inside_out, ::-1]
    return MeshSolid(name, points, triangles)


def read_solids(path: Path) -> tuple[MeshSolid, ...]:
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


def write_solids(path: Path, solids: Sequence[MeshSolid]) -> None:
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


def _solid(name: str, corners: Array, faces: Sequence[tuple[int, ...]]) -> MeshSolid:
    triangles = np.array(list(_triangles(name, corners, faces)))
    used, places = np.unique(triangles, return_inverse=True)
    points, same = np.unique(corners[used], axis=0, return_inverse=True)
    solid = MeshSolid(name, points, np.asarray(same).reshape(-1)[places.reshape(triangles.shape)])
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
        solid = MeshSolid(name, solid.corners, solid.triangles[:, ::-1])
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


@dataclass(frozen=True, kw_only=True)
class MeshConnector(SprungConnector):
    """A plug and a socket from two files.

    With the tightest fit all pieces but the springs have grown to all sides, each face by half of
    ``tolerance_width`` across the insertion, so that the depths stay the same.
    """

    plug: str  # path of the .obj file of the plug
    socket: str  # path of the .obj file of the socket
    unit: float = 0.001  # m, of the files' lengths
    mated_depth: float  # m, of a plug that is fully in
    springs: Mapping[str, float] = field(default_factory=dict)
    # N/m, stiffness of the compliant objects, such as latches and contacts, by name; latch is each
    # of "latch 0", "latch 1", the names of divided ones. Each is a ball in its middle, as wide as
    # its smallest side, whose centre stays outside of the piece that it touches
    seating_force: float | None = None
    # N, with which a part without springs counts as pressed home; None: it has springs
    tolerance_width: float = 0.0
    # m, largest error of the width of a plug and of that of a socket's opening
    lead_in: float = 0.0005
    # m, depth up to which a plug beside its place still slides off sideways
    mass: float = 0.02  # kg, of the plug; assumed
    digest: str | None = None
    # of both files; a run keeps it, so that trials of other files are not taken for its own

    PARTNERS: ClassVar[Sequence[tuple[str, str]]] = (("plug", "socket"),)
    MAY_BE_ZERO: ClassVar[Sequence[str]] = ("tolerance_width", *SprungConnector.MAY_BE_ZERO)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "tolerance_width")
        require_positive(self, "seating_force")
        for name in ("plug", "socket"):
            path = getattr(self, name)
            try:
                solids = _solids(path)
            except (OSError, ValueError) as error:
                told = error.strerror if isinstance(error, OSError) else error
                allowed = f"a Wavefront file of convex objects ({told})"
                raise ParameterError(name, path, allowed) from error
            size = self.unit * float(np.ptp(_corners(solids), axis=0).max())
            if not size <= _LARGEST:
                allowed = f"lengths for which {path} is at most {_LARGEST:g} m large, not {size:g}"
                raise ParameterError("unit", self.unit, allowed)
        length = self.unit * float(np.ptp(_corners(_solids(self.plug))[:, 2]))
        if not self.lead_in < self.mated_depth <= length:
            allowed = (
                f"more than lead_in, {self.lead_in:g}, at most the plug's length, {length:g} m"
            )
            raise ParameterError("mated_depth", self.mated_depth, allowed)
        objects = [*_solids(self.plug), *_solids(self.socket)]
        names = [name for one in objects for name in _names(one)]
        for name, stiffness in self.springs.items():
            if name not in names:
                allowed = f"names of objects: {', '.join(dict.fromkeys(names))}"
                raise ParameterError("springs", name, allowed)
            if not 0 < stiffness < self.material.stiffness:
                allowed = f"above 0, below {self.material.stiffness:g}, material.stiffness"
                raise ParameterError(f"springs.{name}", stiffness, allowed)
        if self.digest not in (None, digest := self.files_digest):
            allowed = f"null, or the digest of the present files, {digest}"
            raise ParameterError("digest", self.digest, allowed)
        if (self.seating_force is None) == (not self.springs):
            allowed = "null with springs" if self.springs else "a number, or springs"
            raise ParameterError("seating_force", self.seating_force, allowed)

    @property
    def name(self) -> str:
        """Name of the plug's file."""
        return Path(self.plug).stem

    @property
    def files_digest(self) -> str:
        """Digest of the contents of both files."""
        texts = [Path(path).read_bytes() for path in (self.plug, self.socket)]
        return hashlib.sha256(b"".join(texts)).hexdigest()[:16]

    @property
    def plug_outline(self) -> Array:
        """Corners of the plug, m, in P, shape (n, 3); cameras see their convex hull."""
        return self.unit * _corners(_solids(self.plug))

    @property
    def socket_outline(self) -> Array:
        """Likewise of the socket, in S."""
        return self.unit * _corners(_solids(self.socket))

    @cached_property
    def mating_force(self) -> float:
        """Largest force of the insertion of a plug in line, N.

        It is computed from the springs and friction, or is the force that presses the plug home.

        Raises:
            ParameterError: If the springs need none, or plug and socket overlap in line.
        """
        if self.seating_force is not None:
            return self.seating_force
        depth = np.linspace(0.0, self.mated_depth, _DEPTHS, endpoint=False)
        force = float(insertion_force(self, depth).max())
        if not 0 < force <= self.largest_force:
            allowed = (
                f"springs that a plug in line meets, with at most {self.largest_force:g} N: "
                f"they and all that overlaps take {force:.3g} N"
            )
            raise ParameterError("springs", dict(self.springs), allowed)
        return force

    def with_mating_force(self, force: float) -> "MeshConnector":
        """Return the same parts with stiffer springs, or pressed home with another force, N."""
        if self.seating_force is not None:
            return replace(self, seating_force=force)
        share = force / self.mating_force
        return replace(self, springs={name: share * k for name, k in self.springs.items()})

    def plug_parts(self) -> list[ConnectorPart]:
        """Return the plug's pieces, in P."""
        return self._parts("plug", self.plug, _PLUG_COLOUR)

    def socket_parts(self) -> list[ConnectorPart]:
        """Return the socket's pieces, in S."""
        return self._parts("socket", self.socket, _SOCKET_COLOUR)

    def _parts(self, name: str, path: str, colour: Array) -> list[ConnectorPart]:
        """Return the convex hull of each object, its origin in its middle; springs are balls."""
        parts = []
        grown = self.tolerance_width / 2 if self.tolerance == "worst" else 0.0
        for i, solid in enumerate(_solids(path)):
            corners, material = self.unit * solid.corners, self.material
            found = [self.springs[one] for one in _names(solid) if one in self.springs]
            if grown and not found:
                corners = _grown(corners, grown)
            low, high = corners.min(axis=0), corners.max(axis=0)
            middle, size = (low + high) / 2, high - low
            shape: Shape = Convex((corners - middle).T, solid.name)
            if found:
                shape = Sphere(size.min() / 2)
                # With what is hard it is a spring in series.
                material = self.spring(1 / (1 / found[0] - 1 / material.stiffness))
            elif self.springs and len(corners) == 8 and _is_box(corners):
                shape = Box(*size)  # deep in it a ball is exact, deep in a mesh it isn't
            piece = ConvexPiece(f"{i} {solid.name}", shape, RigidTransform(middle))
            parts.append(ConnectorPart(name, [piece], material, colour))
        return parts


def _grown(corners: Array, by: float) -> Array:
    """Return the corners of a convex piece whose faces have moved outwards, across z alone, m."""
    hull = ConvexHull(corners)
    faces = hull.equations.copy()
    faces[:, 3] -= by * np.hypot(faces[:, 0], faces[:, 1])
    within = HalfspaceIntersection(faces, corners.mean(axis=0)).intersections
    found: Array = np.unique(within.round(10), axis=0)
    return found


def _solids(path: str) -> tuple[MeshSolid, ...]:
    return _convex(path, Path(path).stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _convex(path: str, changed: int) -> tuple[MeshSolid, ...]:
    """Return the solids of a file, read again when it has changed."""
    solids = read_solids(Path(path))
    for solid in solids:
        if not solid.convex:
            raise ValueError(f"{solid.name!r} is not convex, divide it first")
    return solids


def _is_box(corners: Array) -> bool:
    """Return whether a convex piece is a box along the axes."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool(np.isclose(np.where(corners > (low + high) / 2, high, low), corners).all())


def _names(solid: MeshSolid) -> list[str]:
    """Return the names of an object: its name, and that without the number behind it."""
    stem, _, number = solid.name.rpartition(" ")
    return [solid.name, stem] if number.isdigit() else [solid.name]


def _corners(solids: tuple[MeshSolid, ...]) -> Array:
    return np.vstack([solid.corners for solid in solids])


def divide(source: Path, target: Path, *, concavity: float = _FINEST) -> float:
    """Write the convex pieces of a file's solids to another, and return their excess volume.

    The pieces cover the solids and fill gaps that are narrower than the concavity. Inspect them,
    and make exact fits, such as the walls of a narrow hole, from convex objects yourself. It takes
    seconds; the same file gives the same pieces. The excess volume of the pieces is a share of the
    solids' volume. The concavity is the largest one of a piece, as a share of the solid's size,
    0.01 to 1.

    Raises:
        ParameterError: If the concavity is not allowed.
        ModuleNotFoundError: If CoACD is not installed.
        OSError: If a file can't be read or written.
        ValueError: If the source holds no solids.
    """
    if not _FINEST <= concavity <= 1:
        raise ParameterError("concavity", concavity, f"{_FINEST} to 1")
    solids = read_solids(source)
    pieces = [piece for solid in solids for piece in _divided(solid, concavity)]
    write_solids(target, pieces)
    whole = sum(solid.volume for solid in solids)
    return sum(piece.volume for piece in pieces) / whole - 1


def _divided(solid: MeshSolid, concavity: float) -> list[MeshSolid]:
    if solid.convex:
        return [solid]
    import coacd

    coacd.set_log_level("error")
    mesh = coacd.Mesh(solid.corners, solid.triangles)
    found = [np.asarray(corners) for corners, _ in coacd.run_coacd(mesh, threshold=concavity)]
    return [convex_hull(f"{solid.name} {i}", corners) for i, corners in enumerate(found)]
