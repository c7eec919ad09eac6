"""Selection matrices against the algebra of (2-5), and the block that switches between them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from chamfer.models.validation import ParameterError
from chamfer.systems.force.selection import Selection, position_selection, require_projection

EXACT = 1e-14


@st.composite
def directions(draw: st.DrawFn) -> np.ndarray:
    """Draw a vector of 2 to 4 numbers that is not tiny."""
    size = draw(st.integers(2, 4))
    components = st.floats(-1, 1)
    return draw(arrays(float, size, elements=components).filter(lambda v: np.abs(v).max() > 1e-3))


@given(normal=directions())
def test_domains_share_out_the_space(normal: np.ndarray) -> None:
    P = position_selection(normal)
    F = np.eye(len(normal)) - P
    np.testing.assert_allclose(P @ P, P, rtol=0, atol=EXACT)
    np.testing.assert_allclose(F @ F, F, rtol=0, atol=EXACT)
    np.testing.assert_allclose(P @ F, np.zeros_like(P), rtol=0, atol=EXACT)
    np.testing.assert_array_equal(P, P.T)
    assert np.trace(F) == pytest.approx(1, abs=EXACT)


@pytest.mark.parametrize(
    ("matrix", "allowed"),
    [
        # A projection, but an oblique one.
        ([[1.0, 1.0], [0.0, 0.0]], "a symmetric projection, P P = P = P^T"),
        # Symmetric, but a scaling, a reflection, a permutation.
        ([[0.5, 0.0], [0.0, 1.0]], "a symmetric projection, P P = P = P^T"),
        ([[-1.0, 0.0], [0.0, 1.0]], "a symmetric projection, P P = P = P^T"),
        ([[0.0, 1.0], [1.0, 0.0]], "a symmetric projection, P P = P = P^T"),
        ([[1.0, 0.0], [0.0, 1e-6]], "a symmetric projection, P P = P = P^T"),
        ([[math.nan, 0.0], [0.0, 1.0]], "finite numbers"),
        ([[1.0, 0.0], [0.0, math.inf]], "finite numbers"),
    ],
)
def test_what_is_no_projection_is_refused(matrix: list[list[float]], allowed: str) -> None:
    with pytest.raises(ParameterError) as caught:
        require_projection(np.array(matrix))
    assert str(caught.value) == f"selection is {matrix}, allowed: {allowed}"
    with pytest.raises(ParameterError, match=r"^P is "):
        require_projection(np.array(matrix), "P")


@pytest.mark.parametrize("normal", [(0.0, -2.0), (1.0, 2.0, -2.0), (0.0, 0.0, 1.0, 0.0)])
def test_block_gives_the_normal_away_at_contact(normal: tuple[float, ...]) -> None:
    block = Selection(np.array(normal))
    context = block.CreateDefaultContext()
    size = len(normal)

    def selection(mode: float) -> np.ndarray:
        block.GetInputPort("mode").FixValue(context, [mode])
        found: np.ndarray = block.GetOutputPort("selection").Eval(context).reshape(size, size)
        return found

    n = np.array(normal) / np.linalg.norm(normal)
    np.testing.assert_array_equal(selection(0), np.eye(size))
    for mode in (1, 2):  # in contact, and while it is lost
        np.testing.assert_allclose(
            selection(mode), np.eye(size) - np.outer(n, n), rtol=0, atol=EXACT
        )
    np.testing.assert_array_equal(selection(0), np.eye(size))
