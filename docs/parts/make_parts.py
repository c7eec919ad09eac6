"""Writes the mesh files of the parts beside it, out of boxes and prisms, in mm."""

from itertools import product
from pathlib import Path

import numpy as np

from chamfer.models.connectors.mesh_connector import MeshSolid, convex_hull, write_solids

HERE = Path(__file__).parent
SIDES = (-1, 1)
FAR = 25.0  # mm, of a socket's face from its middle


def box(name, *ends):
    """A box from, to along x, y and z."""
    return convex_hull(name, np.array(list(product(*ends)), float))


def ball(name, middle, radius):
    """The box around a spring's ball."""
    return box(name, *[(m - radius, m + radius) for m in middle])


def wall(name, inner, across, axis, low, lead_in=0.5):
    """A wall of the opening, outwards from ``inner`` along an axis, its mouth at 45 degrees."""
    side = np.sign(inner)
    section = [(inner, low), (inner, -lead_in), (inner + side * lead_in, 0)]
    section += [(side * FAR, 0), (side * FAR, low)]
    points = [(u, w, z) if axis == "x" else (w, u, z) for u, z in section for w in across]
    return convex_hull(name, np.array(points, float))


def usb_a():
    """A shell with its insulator in the upper half, and a tongue that has room in the lower."""
    plug = [
        box("upper", (-6, 6), (0.2, 2.25), (0, 14)),
        box("lower", (-6, 6), (-2.25, -1.95), (0, 14)),
        box("left", (-6, -5.7), (-2.25, 2.25), (0, 14)),
        box("right", (5.7, 6), (-2.25, 2.25), (0, 14)),
    ]
    tongue = [
        (x * (5.4 - lead_in), y * (0.825 - lead_in) - 0.925, z)
        for lead_in, z in ((0.4, -1), (0, -1.6), (0, -9))
        for x, y in product(SIDES, SIDES)
    ]
    socket = [
        wall("west", -6.25, (-FAR, FAR), "x", -9),
        wall("east", 6.25, (-FAR, FAR), "x", -9),
        wall("north", 2.55, (-7, 7), "y", -9),
        wall("south", -2.55, (-7, 7), "y", -9),
        box("floor", (-FAR, FAR), (-FAR, FAR), (-13, -9)),
        convex_hull("tongue", np.array(tongue)),
    ]
    for k, x in enumerate((-3, 3)):
        socket += [
            ball(f"grip {2 * k}", (x, 3, -3.5), 1),
            ball(f"grip {2 * k + 1}", (x, -3, -3.5), 1),
            ball(f"contact {k}", (x, -0.35, -4.5), 0.8),
        ]
    return plug, socket


def header():
    """A plug for 2x5 pins with a key, ten contacts as four balls, and a shroud with two pins."""
    plug = [
        box("north", (-8.6, 8.6), (1.5, 3), (0, 9)),
        box("south", (-8.6, 8.6), (-3, -1.5), (0, 9)),
        box("back", (-8.6, 8.6), (-3, 3), (9, 12)),
        box("key", (-2, 2), (-4, -3), (1, 9)),
    ]
    socket = [
        wall("west", -8.85, (-FAR, FAR), "x", -6.5),
        wall("east", 8.85, (-FAR, FAR), "x", -6.5),
        wall("north", 3.25, (-9.5, 9.5), "y", -6.5),
        wall("south left", -3.25, (-9.5, -2.3), "y", -6.5),
        wall("south right", -3.25, (2.3, 9.5), "y", -6.5),
        box("floor", (-FAR, FAR), (-FAR, FAR), (-10.5, -6.5)),
    ]
    for k, x in enumerate((-5, 5)):
        plug += [
            ball(f"tine {2 * k}", (x, 1.2, 3), 0.8),
            ball(f"tine {2 * k + 1}", (x, -1.2, 3), 0.8),
        ]
        socket.append(box(f"pin {k}", (x - 0.6, x + 0.6), (-0.6, 0.6), (-6.5, -1.5)))
    return plug, socket


def key_peg():
    """A peg of 20 x 12 mm with radii of 2 mm at three corners and 5 mm at one, and its hole."""
    peg = outline(20, 12, (5, 2, 2, 2))
    plug = [convex_hull("peg", np.vstack([at(offset(peg, -0.5), 0), at(peg, 0.5), at(peg, 24)]))]
    socket = [box("floor", (-27, 27), (-27, 27), (-16, -12))]
    hole, edge, far = offset(peg, 0.2), offset(peg, 0.7), offset(peg, 26)
    rings = ((hole, -12), (hole, -0.5), (edge, 0), (far, 0), (far, -12))
    for i in range(len(peg)):
        side = [i, (i + 1) % len(peg)]
        corners = np.vstack([at(ring[side], z) for ring, z in rings])
        socket.append(convex_hull(f"wall {i}", corners))
    return plug, socket


def outline(width, height, radii, chords=2):
    """A rectangle with its corners rounded by chords, from the upper right on, shape (n, 2)."""
    points = []
    for k, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        middle = np.array([x * (width / 2 - radii[k]), y * (height / 2 - radii[k])])
        angle = np.pi / 2 * (k + np.arange(chords + 1) / chords)
        points.append(middle + radii[k] * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.vstack(points)


def offset(points, by):
    """The outline whose sides are further out."""
    sides = np.roll(points, -1, axis=0) - points
    normals = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    places = (normals * points).sum(axis=1) + by
    pairs = [[i - 1, i] for i in range(len(points))]
    return np.array([np.linalg.solve(normals[pair], places[pair]) for pair in pairs])


def at(points, z):
    """Points of an outline at a height."""
    return np.insert(points, 2, z, axis=1)


if __name__ == "__main__":
    for name, make in (("usb-a", usb_a), ("header", header), ("key-peg", key_peg)):
        ends: tuple[list[MeshSolid], list[MeshSolid]] = make()
        for end, solids in zip(("plug", "socket"), ends, strict=True):
            write_solids(HERE / f"{name}-{end}.obj", solids)
