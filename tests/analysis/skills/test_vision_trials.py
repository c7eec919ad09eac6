"""Vision primitives: what trials draw and measure, the experiment, and its figure."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.scenario.experiment import quiet
from chamfer.analysis.skills.vision_trials import (
    VisionPrimitivesScenario,
    VisionTrial,
    draw,
    map_metrics,
    run,
    run_trial,
    seen_error,
    shares,
    trial_metrics,
    true_errors,
)
from chamfer.diagrams.skills.vision_servo import (
    NAMES,
    CameraBelief,
    VisionServoScenario,
    VisionServoSetup,
)
from chamfer.systems.primitives.visual_servoing import ServoingParams


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


def test_a_trial() -> None:
    wrong = {"focal_error": 0.2, "orientation_error": 0.17}
    one = draw(VisionServoSetup(), "grasp", **wrong, trial=1, random=np.random.default_rng([3, 1]))
    first = run_trial(one, seed=4, most=3.0)
    assert first.event == "done"
    assert first.time == first.times[-1] < 3.0
    assert len(first.times) == len(first.errors)
    assert first.errors[0, 0] > 2e-3
    assert first.errors[-1, 0] < 4e-4
    assert first.seen is not None
    assert first.seen < 0.5
    assert first.slowest_root < 0.9
    other = run_trial(one, seed=5, most=3.0)
    assert not np.array_equal(first.errors[-1], other.errors[-1])  # other noise


def test_a_primitive_that_refuses_its_cameras_is_a_trial_too() -> None:
    # The camera along Y is believed to look along X.
    turned = CameraBelief(turn=(0.0, 0.0, 0.0))
    quarter = CameraBelief(turn=(-math.pi / 2, 0.0, 0.0))
    one = VisionServoScenario(primitive="rotation", xz=quarter, yz=turned)
    found = run_trial(one, seed=0, most=1.0)
    assert (found.event, found.time, found.slowest_root) == (None, 0.0, math.inf)


SHORT = VisionPrimitivesScenario(
    trials=1, map_focal=(0.15, 1.0), map_angle=(0.0,), map_trials=1, duration=2.5
)


def test_every_primitive_settles_and_the_map_has_both() -> None:
    outcome = run(SHORT, 0, quiet)
    for name in NAMES:
        assert outcome.metrics[f"{name}.converged"].value == 100
        assert outcome.metrics[f"{name}.theory.largest_root"].value < 1  # type: ignore[operator]
    assert outcome.metrics["fixed_point.excursion.max"].value < 5e-4  # type: ignore[operator]
    cells = outcome.tables["map"]
    np.testing.assert_array_equal(cells["focal_factor"], [0.15, 1.0])
    np.testing.assert_array_equal(cells["converged"], [0, 1])
    assert outcome.metrics["map.agreement"].value == 100
    assert outcome.metrics["margin.focal_factor"].value == 1.0


def trial(event: Any = "done", **changes: Any) -> VisionTrial:
    plain = VisionTrial(
        event=event,
        time=1.0,
        times=np.array([0.0, 1.0]),
        errors=np.array([[0.01, math.nan], [0.001, math.nan]]),
        seen=0.1 if event == "done" else None,
        slowest_root=0.8,
    )
    return replace(plain, **changes)


def test_metrics_of_trials() -> None:
    worse = trial(time=2.0, seen=0.3, slowest_root=0.9)
    metrics = trial_metrics([trial(), worse, trial(), trial("lost", time=9.0), trial(None)])
    values = {name: metric.value for name, metric in metrics.items()}
    assert values["converged"] == 60
    # Clopper and Pearson, 3 of 5.
    assert values["converged.low"] == pytest.approx(14.66, abs=0.01)
    assert values["converged.high"] == pytest.approx(94.73, abs=0.01)
    assert values["settling_time.mean"] == pytest.approx(4 / 3)
    assert values["settling_time.max"] == 2.0
    assert values["error_px.max"] == 0.3
    assert values["error_m.mean"] == 0.001
    assert values["theory.largest_root"] == 0.9
    assert "error_rad.max" not in values


def test_margins_of_a_map() -> None:
    grid = np.meshgrid([0.2, 0.5, 1.0, 2.0], [0.0, 0.5, 1.0, 1.5], indexing="ij")
    focal, angle = (axis.ravel() for axis in grid)
    good = (focal >= 0.5) & (angle <= 1.0)
    cells = {
        "focal_factor": focal,
        "angle": angle,
        "converged": good.astype(float),
        "theory_root": np.where(good | ((focal == 1.0) & (angle == 1.5)), 0.9, 1.1),
    }
    metrics = {name: metric.value for name, metric in map_metrics(cells).items()}
    assert metrics == {
        "map.agreement": 100 * 15 / 16,
        "margin.focal_factor": 0.5,
        "margin.orientation": 1.0,
        "theory.margin.focal_factor": 0.5,
        "theory.margin.orientation": 1.5,
    }
    # A gap ends the range; without the start there is none.
    cells["converged"] = np.where((focal == 1.0) & (angle == 0.5), 0.0, cells["converged"])
    assert map_metrics(cells)["margin.orientation"].value == 0.0
    cells["converged"] = np.zeros_like(focal)
    assert map_metrics(cells)["margin.focal_factor"].value is None
