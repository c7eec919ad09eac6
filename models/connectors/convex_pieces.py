"""Divides solids into convex pieces by CoACD (Wei, Liu, Ling and Su, 2022), which is optional."""

from pathlib import Path
from typing import Final

import numpy as np

from chamfer.models.connectors.obj_file import Solid, convex_hull, read_solids, write_solids
from chamfer.models.validation import ParameterError

_FINEST: Final = 0.01  # that CoACD takes


def divide(source: Path, target: Path, *, concavity: float = _FINEST) -> float:
    """Write the convex pieces of a file's solids to another, and return what they have too much.

    The pieces cover the solids and fill what is narrower than the concavity: look at them, and
    make what has to fit exactly, such as the walls of a narrow hole, of convex objects yourself.
    It takes seconds; the same file gives the same pieces.

    Args:
        source: A Wavefront file.
        target: Another one, with a convex object for each piece.
        concavity: That a piece may have at most, as a share of the solid's size, 0.01 to 1.

    Returns:
        The volume that the pieces have more than the solids, as a share of the solids'.

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


def _divided(solid: Solid, concavity: float) -> list[Solid]:
    if solid.convex:
        return [solid]
    import coacd

    coacd.set_log_level("error")
    mesh = coacd.Mesh(solid.corners, solid.triangles)
    found = [np.asarray(corners) for corners, _ in coacd.run_coacd(mesh, threshold=concavity)]
    return [convex_hull(f"{solid.name} {i}", corners) for i, corners in enumerate(found)]
