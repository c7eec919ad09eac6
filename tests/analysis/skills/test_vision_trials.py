"""Trials of the vision primitives: what they draw, measure and compare with."""

import math
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.skills.vision_trials import (
    calibration,
    draw,
    run_trial,
    seen_error,
    shares,
    true_errors,
)
from chamfer.diagrams.skills.vision_servo import (
    NAMES,
    Belief,
    VisionServoScenario,
    VisionServoSetup,
)
from chamfer.systems.primitives.visual_servoing import ServoingParams


def drawn(name: Any, trial: int = 0) -> VisionServoScenario:
    return draw(
        VisionServoSetup(),
        name,
        focal_error=0.2,
        orientation_error=0.17,
        trial=trial,
        random=np.random.default_rng([3, trial]),
    )


def test_calibration_is_as_wrong_as_it_is_asked_to_be() -> None:
    axes = []
    for k in range(200):
        found = calibration(0.17, 1.2, np.random.default_rng(k))
        assert np.linalg.norm(found.turn) == pytest.approx(0.17)
        assert found.focal_factor == 1.2
        axes.append(found.turn)
    assert np.abs(np.mean(axes, axis=0)).max() < 0.02  # all directions


@pytest.mark.parametrize("name", NAMES)
def test_drawn_trials_go_through_the_signs(name: Any) -> None:
    trials = [drawn(name, k) for k in range(8)]
    signs = {(one.xz.focal_factor, one.yz.focal_factor, one.believed_lever) for one in trials}
    assert len(signs) == 8
    assert all(abs(abs(value - 1) - 0.2) < 1e-12 for sign in signs for value in sign)
    assert all(one.primitive == name for one in trials)
    assert len({one.start for one in trials}) == 8
    assert drawn(name, 3) == drawn(name, 3)


def test_true_errors() -> None:
    one = VisionServoScenario(primitive="translation", gap=0.01, target=(0, 0, 0, 0, 0, -0.02))
    away, turn = true_errors(one, np.array([0, 0, 0, 0.003, 0.004, -0.01]))
    assert away == pytest.approx(0.005)
    assert math.isnan(turn)

    one = VisionServoScenario(primitive="rotation", target=(0.1, 0, 0, 0, 0, 0))
    away, turn = true_errors(one, np.array([0.3, 0, 0, 0.01, 0, 0]))
    assert turn == pytest.approx(0.2)
    assert math.isnan(away)

    one = VisionServoScenario(primitive="fixed_point", angle=0.2, start=(0,) * 6)
    away, turn = true_errors(one, np.array([0, 0.05, 0, 0, 0, 0]))
    x, _, z = one.lever
    assert away == pytest.approx(2 * math.hypot(x, z) * math.sin(0.025))
    assert turn == pytest.approx(0.15)

    one = VisionServoScenario(primitive="grasp", target=(0, 0, 0.1, 0.01, 0, 0))
    away, turn = true_errors(one, np.array([0, 0, 0.3 + math.pi, 0.01, 0.002, 0]))
    assert away == pytest.approx(0.002)
    assert turn == pytest.approx(0.2)


def test_seen_errors() -> None:
    # 3 mm aside at 0.5 mm a pixel, where nothing is wrong and the goal is where the plug is.
    one = VisionServoScenario(primitive="translation", target=(0, 0, 0, 0, 0, -0.02))
    found = seen_error(one, np.array([0, 0, 0, 0.003, 0, -0.01]))
    assert found == pytest.approx(6, abs=0.4)
    one = VisionServoScenario(primitive="grasp", target=(0,) * 6)
    assert seen_error(one, np.array([0, 0, 0, 0, 0.002, 0])) == pytest.approx(4, abs=0.2)
    one = VisionServoScenario(primitive="fixed_point", start=(0, 0, 0, 0, 0, 0.04))
    found = seen_error(one, np.array([0, 0, 0, 0.002, 0, 0.04]))
    assert found == pytest.approx(4, abs=0.2)
    assert seen_error(VisionServoScenario(primitive="rotation"), np.zeros(6)) is None


@pytest.mark.parametrize("name", NAMES)
def test_with_right_cameras_every_share_is_the_gain(name: Any) -> None:
    one = VisionServoScenario(primitive=name, servoing=ServoingParams(gain=0.15))
    np.testing.assert_allclose(shares(one), 0.15)


def test_shares_of_a_wrong_focal_length_and_a_roll() -> None:
    wrong = Belief(focal_factor=0.5, turn=(0.0, 0.0, 0.3))
    found = shares(VisionServoScenario(primitive="fixed_point", xz=wrong))
    np.testing.assert_allclose(np.abs(found), 0.4)
    np.testing.assert_allclose(np.sort(np.angle(found)), [-0.3, 0.3], atol=1e-9)


def test_a_trial_and_its_repetition_in_the_same_diagram() -> None:
    one = drawn("grasp", 1)
    first = run_trial(one, seed=4, most=3.0)
    run_trial(drawn("grasp", 2), seed=5, most=0.3)
    again = run_trial(one, seed=4, most=3.0)
    assert first.event == "done"
    np.testing.assert_array_equal(first.displacement, again.displacement)
    assert first.time == first.times[-1] < 3.0
    assert len(first.times) == len(first.displacement) == len(first.errors)
    assert first.errors[0, 0] > 2e-3
    assert first.errors[-1, 0] < 4e-4
    assert first.seen is not None
    assert first.seen < 0.5
    assert first.slowest_root < 0.9
    np.testing.assert_array_equal(first.displacement[0], one.start)
    other = run_trial(one, seed=5, most=3.0)
    assert not np.array_equal(first.displacement[-1], other.displacement[-1])  # other noise


def test_a_trial_whose_time_is_up() -> None:
    found = run_trial(drawn("grasp", 1), seed=0, most=0.2)
    assert found.event is None
    assert found.seen is None
    assert found.time == pytest.approx(0.2, abs=0.02)


def test_a_primitive_that_refuses_its_cameras_is_a_trial_too() -> None:
    # The camera along Y is believed to look along X.
    turned = Belief(turn=(0.0, 0.0, 0.0))
    quarter = Belief(turn=(-math.pi / 2, 0.0, 0.0))
    one = VisionServoScenario(primitive="rotation", xz=quarter, yz=turned)
    found = run_trial(one, seed=0, most=1.0)
    assert (found.event, found.time, found.slowest_root) == (None, 0.0, math.inf)
