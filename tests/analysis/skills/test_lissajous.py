"""What two dithers cover."""

import math
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.analysis.skills.lissajous import LissajousScenario, covering_radius, run

SHORT = LissajousScenario(repeats=(2, 6))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run(SHORT, 0, quiet)


def test_the_pattern_closes_and_is_centred(outcome: Outcome, value: Any) -> None:
    assert value(outcome, "repeats_after") == pytest.approx(0.0, abs=1e-12)
    assert value(outcome, "sine_start.offset") == 0.002
    for n in (2, 6):
        assert value(outcome, f"centre_offset.n{n}") < 0.005 * 0.002
        assert value(outcome, f"duration.n{n}") == pytest.approx(n)


def test_the_covering_radius_is_that_of_the_curve(outcome: Outcome, value: Any) -> None:
    for n in (2, 6):
        time = np.linspace(0.0, n, 4000 * n)
        curve = 0.002 * np.column_stack(
            [np.sin(2 * np.pi * time), np.sin(2 * np.pi * (n + 1) / n * time)]
        )
        expected = covering_radius(curve, 0.002)
        assert value(outcome, f"covering_radius.n{n}") == pytest.approx(expected, abs=1e-5)
        assert value(outcome, f"covering_ratio.n{n}") == pytest.approx(
            n * expected / 0.002, abs=0.03
        )
    # The reference gives about 1.05 A / N.
    assert value(outcome, "covering_ratio.n6") == pytest.approx(1.05, abs=0.12)


@pytest.mark.parametrize(("cells", "amplitude"), [(2, 1.0), (5, 0.003), (20, 0.002)])
def test_a_dense_grid_leaves_half_a_cells_diagonal(cells: int, amplitude: float) -> None:
    side = np.linspace(-amplitude, amplitude, cells + 1)
    x, y = np.meshgrid(side, side)
    found = covering_radius(np.column_stack([x.ravel(), y.ravel()]), amplitude)
    assert found == pytest.approx(math.sqrt(2) * amplitude / cells)
