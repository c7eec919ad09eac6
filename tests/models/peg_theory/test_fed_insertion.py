"""What theory says of blind feeds: the classes, the force and where two points touch."""

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support, in_series
from chamfer.models.peg_theory.fed_insertion import FeedVerdict, limits, predict_feed
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.wedging import rotation_bounds, two_point_onset

Array = NDArray[np.float64]
PARTS = PegHoleGeometry()
ARM = Support(lateral_stiffness=400.0, angular_stiffness=5.0, centre_distance=0.0)
DEPTH = 0.04


def support_at(depth: float) -> Support:
    return in_series(ARM, ARM, depth)


def plenty(depth: Array) -> Array:
    return np.full_like(depth, 100.0)


STARTS = (
    (0.0, 0.0, FeedVerdict.SAFE),
    (0.002, 0.03, FeedVerdict.SAFE),
    (-0.002, -0.03, FeedVerdict.SAFE),
    (0.0042, 0.0, FeedVerdict.SAFE),  # the chamfers reach 4.256 mm
    (0.0043, 0.0, FeedVerdict.STOPPED),
    (-0.0043, 0.0, FeedVerdict.STOPPED),
    (0.0043, 0.12, FeedVerdict.MAY),  # a tilted tip is narrower; and it may wedge
    (0.00433, 0.12, FeedVerdict.STOPPED),  # by 0.056 mm
    (0.0, 0.07, FeedVerdict.MAY),  # beyond the limit to wedging
    (0.002, -0.05, FeedVerdict.MAY),  # inside it, but the rim may sit on the edge
    (0.002, 0.05, FeedVerdict.SAFE),
)


def test_what_theory_says() -> None:
    lateral, tilt, expected = zip(*STARTS, strict=True)
    found = predict_feed(PARTS, support_at, plenty, lateral, tilt, depth=DEPTH)
    assert found.verdict.tolist() == list(expected)
    assert limits(PARTS, support_at, lateral, tilt).verdict.tolist() == list(expected)


@pytest.mark.slow
def test_the_limit_to_wedging_is_that_of_the_support_at_the_wedging_depth() -> None:
    support = support_at(PARTS.wedging_depth + PARTS.chamfer_height)
    _, upper = rotation_bounds(PARTS, support, 0.001)
    tilt = float(upper) + np.array([-1e-4, 1e-4])
    found = predict_feed(PARTS, support_at, plenty, 0.001, tilt, depth=DEPTH)
    assert found.verdict.tolist() == [FeedVerdict.SAFE, FeedVerdict.MAY]
    assert found.may_wedge.tolist() == [False, True]


@pytest.mark.slow
def test_the_force_is_the_largest_of_the_statics_on_the_way() -> None:
    tips = np.linspace(0.001, DEPTH, 40)
    forces = [
        float(
            equilibrium(
                PARTS, support_at(tip), 0.001, 0.05, tip - PARTS.chamfer_height
            ).insertion_force
        )
        for tip in tips.tolist()
    ]
    found = predict_feed(PARTS, support_at, plenty, 0.001, 0.05, depth=DEPTH)
    assert found.axial == pytest.approx(max(forces))

    def weak(depth: Array) -> Array:
        return np.full_like(depth, 0.99 * max(forces))

    assert predict_feed(PARTS, support_at, weak, 0.001, 0.05, depth=DEPTH).verdict == (
        FeedVerdict.STOPPED
    )


@pytest.mark.slow
def test_two_points_touch_where_the_support_of_that_depth_says_so() -> None:
    lateral, tilt = np.array([0.0, 0.002, 0.0]), np.array([0.05, 0.03, 0.0])
    found = predict_feed(PARTS, support_at, plenty, lateral, tilt, depth=DEPTH)
    for k in range(2):
        support = support_at(float(found.onset[k]) + PARTS.chamfer_height)
        again = two_point_onset(PARTS, support, lateral[k], tilt[k])
        assert found.onset[k] == pytest.approx(float(again), abs=3e-5)
    assert np.isnan(found.onset[2])
