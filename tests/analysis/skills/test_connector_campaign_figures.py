"""Figures of campaigns, drawn from made-up trials."""

import math

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.analysis.skills.connector_campaign import plot_searches, plot_success

MIDDLE = (0.0, 0.0, 0.6, 0.0, 0.0, 0.0)


def outcome(success: list[float], reasons: list[str]) -> Outcome:
    n = len(success)
    ramp = np.linspace(-1.0, 1.0, n)
    traces = {
        "initial_x": 0.002 * ramp,
        "initial_y": -0.001 * ramp,
        "initial_rx": np.deg2rad(3 * ramp),
        "initial_ry": np.deg2rad(ramp),
        "initial_rz": 0.6 + np.deg2rad(2 * ramp),
        "success": np.array(success),
        "obstacle": np.full(n, np.nan),
        "retries": np.arange(n, dtype=float),
        "force.peak_share": np.where(np.array(success) > 0, 1.2 + 0.2 * ramp, np.nan),
        "duration": np.where(np.array(success) > 0, 20.0 + 9 * ramp, np.nan),
        "reason": np.array(reasons),
    }
    values = {"success_rate": 75.0, "success_rate.low": 19.4, "success_rate.high": 99.4}
    metrics = {name: Metric(value=value, unit="%") for name, value in values.items()}
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=1.0)


@pytest.fixture(scope="module")
def figure() -> Figure:
    of = outcome([1.0, 1.0, 1.0, 0.0], ["", "", "", "push: jammed"])
    return plot_success(of, middle=MIDDLE)


def places(figure: Figure, panel: int) -> list[np.ndarray]:
    axes = figure.axes[panel]
    found = [np.asarray(one.get_offsets()) for one in axes.collections]
    assert all(isinstance(one, PathCollection) for one in axes.collections)
    return [one for one in found if len(one)]


def test_dots_and_crosses_stand_at_the_errors_in_milli_and_degrees(figure: Figure) -> None:
    good, failed = places(figure, 0)
    np.testing.assert_allclose(good, [[-2.0, 1.0], [-2 / 3, 1 / 3], [2 / 3, -1 / 3]])
    np.testing.assert_allclose(failed, [[2.0, -1.0]])
    good, failed = places(figure, 1)
    np.testing.assert_allclose(good, [[-3.0, -1.0], [-1.0, -1 / 3], [1.0, 1 / 3]])
    np.testing.assert_allclose(failed, [[3.0, 1.0]])
    # About z from the middle of the errors.
    shade = np.asarray(figure.axes[1].collections[0].get_array())
    np.testing.assert_allclose(shade, [-2.0, -2 / 3, 2 / 3], atol=1e-9)


def test_searches_are_compared_trial_by_trial() -> None:
    rows = {
        "search": np.repeat(["dithers", "spiral", "tilt"], 4),
        "trial": np.array([0.0, 1.0, 2.0, 3.0] * 3),
        "success": np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0]),
        "duration": np.array([10.0, 20.0, 90.0, 60.0, 12.0, 11.0, 13.0, 60.0, *[14.0] * 4]),
        "obstacle": np.array([math.nan, math.nan, math.nan, 0.004] * 3),
    }
    share, pairs = plot_searches(rows).axes
    dithers, spiral, tilt = share.get_lines()
    assert dithers.get_ydata()[-1] == pytest.approx(200 / 3)
    assert spiral.get_ydata()[-1] == pytest.approx(100.0)
    assert tilt.get_ydata()[-1] == pytest.approx(200 / 3)
    along, leaning = pairs.collections
    np.testing.assert_allclose(along.get_offsets(), [[10.0, 12.0], [20.0, 11.0]])
    np.testing.assert_allclose(leaning.get_offsets(), [[20.0, 14.0]])
