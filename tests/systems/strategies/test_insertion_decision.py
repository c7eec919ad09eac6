"""Errors over frames and how sure they are, and the region in which a peg neither wedges."""

import numpy as np
import pytest

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.wedging import assembles
from chamfer.systems.strategies.insertion_decision import (
    InsertionRegion,
    MeasuredErrors,
    measured_errors,
)

SUPPORT = Support(centre_distance=0.03)
PARTS = PegHoleGeometry()


def test_noise_is_an_uncertainty_of_two_standard_deviations() -> None:
    generator = np.random.default_rng(1)
    frames = generator.normal([2.0, 0.0, 0.01, 0.0], [0.1, 0.2, 3e-3, 4e-3], (4000, 4))
    found = measured_errors(frames.tolist(), 0.0005)
    assert found.lateral_uncertainty == pytest.approx(2 * 0.0005 * np.hypot(0.1, 0.2), rel=0.05)
    assert found.rotational_uncertainty == pytest.approx(2 * 5e-3, rel=0.05)
    assert found.lateral == pytest.approx(0.001, rel=0.02)


@pytest.mark.parametrize("side", [1, -1])
def test_the_region_takes_the_worst_signs(side: int) -> None:
    region = InsertionRegion(PARTS, SUPPORT)
    for lateral in np.linspace(0.0, 0.95, 7) * PARTS.chamfer_limit:
        tilts = np.linspace(0.0, 1.2, 25) * PARTS.rotation_limit
        fits = assembles(PARTS, SUPPORT, lateral, tilts) & assembles(
            PARTS, SUPPORT, lateral, -tilts
        )
        inside = [region.margin(float(lateral), tilt) > 0 for tilt in tilts.tolist()]
        far = np.abs(region.tilt_at(float(lateral)) - tilts) >= 1e-4
        np.testing.assert_array_equal(np.array(inside)[far], fits[far])


def test_margins() -> None:
    region = InsertionRegion(PARTS, SUPPORT)
    assert region.margin(PARTS.chamfer_limit, 0.0) == pytest.approx(0.0)
    assert region.margin(2 * PARTS.chamfer_limit, 0.0) < 0
    assert region.margin(0.0, region.tilt_at(0.0)) == pytest.approx(0.0)
    sure = MeasuredErrors(0.001, 0.01, 0.0, 0.0)
    unsure = sure._replace(lateral_uncertainty=0.0005, rotational_uncertainty=0.02)
    assert region.sure_margin(sure) == region.margin(0.001, 0.01)
    assert region.sure_margin(unsure) == region.margin(0.0015, 0.03)
