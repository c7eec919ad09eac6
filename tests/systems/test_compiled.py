"""The inverse that the compiled filters use, and compiling itself."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.systems.compiled import compiled, inverse


@settings(deadline=None)  # the first call compiles
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 6), exponent=st.integers(-100, 100))
def test_inverse_is_that_of_numpy(seed: int, size: int, exponent: int) -> None:
    root = np.random.default_rng(seed).standard_normal((size, size))
    matrix = 10.0**exponent * (root @ root.T + 0.1 * np.eye(size))
    before = matrix.copy()
    expected = np.linalg.inv(matrix)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(inverse(matrix), expected, rtol=0, atol=1e-10 * scale)
    np.testing.assert_array_equal(matrix, before)


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((2, 2)),
        np.zeros((3, 3)),
        np.ones((2, 2)),
        np.diag([1.0, 1.0, 0.0]),
        np.diag([1.0, -1.0]),
        np.full((2, 2), np.nan),
    ],
)
def test_no_inverse(matrix: np.ndarray) -> None:
    assert not np.all(np.isfinite(inverse(matrix)))


def test_compiles_what_has_no_file_to_be_kept_beside() -> None:
    # The cache on disk belongs to a source file; without one there is none.
    names: dict[str, object] = {}
    exec("def doubled(x):\n    return 2.0 * x", names)
    doubled = compiled(names["doubled"])  # type: ignore[type-var]
    assert doubled(1.5) == 3.0  # type: ignore[operator]
    assert doubled.signatures  # type: ignore[attr-defined]


KEPT = {
    "a called function": (
        "from chamfer.systems.compiled import compiled\n\n"
        "@compiled\ndef one(x):\n    return {} * x\n",
        "one(x)",
    ),
    "a constant": ("one = {}\n", "one * x"),
}


@pytest.mark.parametrize(("other", "use"), KEPT.values(), ids=KEPT)
def test_what_is_kept_is_not_taken_up_once_what_it_takes_from_another_file_has_changed(
    other: str, use: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "kept_calling.py").write_text(
        "from chamfer.systems.compiled import compiled\nfrom kept_called import one\n\n"
        f"@compiled\ndef two(x):\n    return {use}\n"
    )
    found = []
    for factor in (3.0, 5.0, 5.0):
        (tmp_path / "kept_called.py").write_text(other.format(factor))
        for name in ("kept_called", "kept_calling"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        two = importlib.import_module("kept_calling").two
        found.append((two(1.0), len(two.stats.cache_hits)))
    assert found == [(3.0, 0), (5.0, 0), (5.0, 1)]
