"""Selection matrices against the algebra of (2-5), and the block that switches between them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from chamfer.models.validation import ParameterError
from chamfer.systems.force.selection import Selection, position_selection, require_projection, unit

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


@given(normal=directions(), seed=st.integers(0, 2**32 - 1))
def test_parts_of_a_vector(normal: np.ndarray, seed: int) -> None:
    v = np.random.default_rng(seed).normal(size=len(normal))
    P = position_selection(normal)
    F = np.eye(len(normal)) - P
    np.testing.assert_allclose(P @ v + F @ v, v, rtol=0, atol=EXACT)  # (2-5)
    # The force part is along the normal, the position part at right angles to it.
    n = normal / math.sqrt(sum(c * c for c in normal.tolist()))
    np.testing.assert_allclose(F @ v, sum(n * v) * n, rtol=0, atol=EXACT)
    np.testing.assert_allclose(normal @ (P @ v), 0, atol=EXACT)
    np.testing.assert_allclose(P @ normal, np.zeros_like(normal), rtol=0, atol=EXACT)


@given(normal=directions(), exponent=st.integers(-90, 90), sign=st.sampled_from([-1, 1]))
def test_only_the_line_of_the_normal_counts(normal: np.ndarray, exponent: int, sign: int) -> None:
    scaled = sign * math.ldexp(1.0, exponent) * normal
    found = position_selection(scaled)
    np.testing.assert_allclose(found, position_selection(normal), rtol=0, atol=EXACT)
    require_projection(found)


def test_oblique_normal() -> None:
    # A right-angled triangle of sides 3, 4, 5.
    np.testing.assert_allclose(
        position_selection(np.array([3.0, 4.0])),
        [[0.64, -0.48], [-0.48, 0.36]],
        rtol=0,
        atol=EXACT,
    )


def test_unit_has_length_one_and_keeps_the_direction() -> None:
    np.testing.assert_allclose(unit(np.array([-3e5, 4e5])), [-0.6, 0.8], rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    ("normal", "printed"),
    [
        ((0.0, 0.0), r"\[0.0, 0.0\]"),
        ((0.0, 0.0, 0.0), r"\[0.0, 0.0, 0.0\]"),
        ((math.nan, 1.0), r"\[nan, 1.0\]"),
        ((1.0, -math.inf), r"\[1.0, -inf\]"),
    ],
)
def test_normal_has_to_have_a_direction(normal: tuple[float, ...], printed: str) -> None:
    allowed = "allowed: a finite vector other than zero"
    with pytest.raises(ParameterError, match=f"^normal is {printed}, {allowed}$"):
        position_selection(np.array(normal))
    with pytest.raises(ParameterError, match=f"^normal is {printed}, {allowed}$"):
        Selection(np.array(normal))
    with pytest.raises(ParameterError, match=f"^along is {printed}, {allowed}$"):
        unit(np.array(normal), "along")


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


@pytest.mark.parametrize("size", [1, 2, 4])
def test_all_and_nothing_are_projections(size: int) -> None:
    require_projection(np.eye(size))
    require_projection(np.zeros((size, size)))


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


def test_block_follows_the_mode_at_once() -> None:
    block = Selection(np.array([0.0, 1.0]))
    assert block.HasAnyDirectFeedthrough()
    assert block.GetInputPort("mode").size() == 1
    assert block.GetOutputPort("selection").size() == 4
