"""The campaign's figure: shares where they are, and the force of each drawn slide."""

from collections.abc import Sequence

import numpy as np
import pytest
from matplotlib.axes import Axes

from chamfer.analysis.campaign.trial_metrics import rate
from chamfer.analysis.charging.charging_campaign import plot_campaign
from chamfer.analysis.scenario.experiment import Metric, Outcome

REMEDIES = ("none", "compensation")
LIMITS = ("scan.position_error", "wall.slide_force", "wall.losses")
NAMES = ("cycle.finished", "cycle.all_limits", *LIMITS)
FRICTION = (8.0, 12.0, 16.0)  # N


def outcome(most: Sequence[float], losses: Sequence[float]) -> Outcome:
    """Return three drawn cycles without and three with the remedy."""
    metrics: dict[str, Metric] = {}
    for remedy, good in zip(REMEDIES, (1, 3), strict=True):
        for name in NAMES:
            metrics |= rate(f"{remedy}.{name}", good, 3, "")
    traces = {
        "remedy": np.repeat([0.0, 1.0], 3),
        "quill_friction": np.tile(FRICTION, 2),
        "wall.slide_force": np.array(most),
        "wall.slide_force_min": np.array(most) - 1.0,
        "wall.losses": np.array(losses),
    }
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=1.0)


def points(axes: Axes, marker: str) -> list[np.ndarray]:
    """Return what is drawn with a marker, one array (k, 2) a line."""
    found = [np.asarray(one.get_xydata()) for one in axes.lines if one.get_marker() == marker]
    return [one for one in found if len(one)]


def test_shares_are_drawn_with_their_intervals() -> None:
    figure = plot_campaign(REMEDIES, LIMITS, 3, outcome([1.5] * 6, [0.0] * 6))
    axes = figure.axes[0]
    without, with_it = points(axes, "o")
    np.testing.assert_allclose(without[:, 0], 100 / 3)
    np.testing.assert_allclose(with_it[:, 0], 100.0)
    assert [label.get_text() for label in axes.get_yticklabels()] == list(NAMES)
    # Clopper and Pearson of 1 of 3, from tables of the beta distribution
    ends = axes.collections[0].get_segments()[0][:, 0]
    assert ends == pytest.approx([0.840, 90.57], abs=0.01)


def test_a_slide_is_a_bar_at_its_friction_and_a_loss_is_marked() -> None:
    most = [1.4, 1.5, 2.3, 1.2, 1.3, 1.4]
    axes = plot_campaign(REMEDIES, LIMITS, 3, outcome(most, [0, 0, 2, 0, 0, 0])).axes[1]
    bars = np.array([one.get_segments() for one in axes.collections])  # remedy, cycle, end, x y
    np.testing.assert_allclose(bars[..., 1, 1].ravel(), most)
    np.testing.assert_allclose(bars[..., 0, 1].ravel(), np.array(most) - 1.0)
    # Beside each other, at the friction that was drawn.
    np.testing.assert_allclose(bars[:, :, 0, 0].mean(axis=0), FRICTION)
    assert np.all(bars[0, :, 0, 0] < bars[1, :, 0, 0])
    (lost,) = points(axes, "x")
    np.testing.assert_allclose(lost[0, 0], bars[0, 2, 0, 0])
    assert any(list(line.get_ydata()) == [2.0, 2.0] for line in axes.lines)


def test_what_did_not_slide_has_no_bar() -> None:
    most = [1.4, np.nan, 1.5, 1.2, 1.3, np.nan]
    axes = plot_campaign(REMEDIES, LIMITS, 3, outcome(most, [0.0] * 6)).axes[1]
    assert [len(one.get_segments()) for one in axes.collections] == [2, 2]
    without = plot_campaign(REMEDIES, LIMITS[:1], 3, outcome([np.nan] * 6, [np.nan] * 6))
    assert len(without.axes) == 1
