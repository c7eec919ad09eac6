"""What isn't convex is divided into pieces that are."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from chamfer.models.connectors.convex_pieces import divide
from chamfer.models.connectors.obj_file import convex_hull, read_solids, write_solids
from chamfer.models.validation import ParameterError


def test_convex_solids_stay_as_they_are(tmp_path: Path) -> None:
    corners = np.array(list(product((0.0, 1.0), repeat=3)))
    write_solids(tmp_path / "cube.obj", [convex_hull("cube", corners)])
    assert divide(tmp_path / "cube.obj", tmp_path / "pieces.obj") == 0.0
    assert (tmp_path / "pieces.obj").read_text() == (tmp_path / "cube.obj").read_text()


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


@pytest.mark.parametrize("concavity", [0.0, 0.009, 1.1, float("nan")])
def test_a_concavity_that_is_not_allowed(tmp_path: Path, concavity: float) -> None:
    with pytest.raises(ParameterError, match=r"^concavity is .*, allowed: 0\.01 to 1$"):
        divide(tmp_path / "ell.obj", tmp_path / "pieces.obj", concavity=concavity)
