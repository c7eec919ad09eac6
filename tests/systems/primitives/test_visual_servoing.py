"""The law, the bounds of its gain, and how frames are counted."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.primitive import STILL, Observation
from chamfer.systems.primitives.visual_servoing import (
    Servoing,
    StaticCameras,
    Watch,
    seen_part,
    slowest_root,
)
from chamfer.systems.vision.detections import Detection, Status, pack_detections

seeds = st.integers(0, 2**32 - 1)
SENSED = Observation(STILL, STILL, STILL)


@settings(deadline=None, max_examples=15)
@given(seed=seeds, gain=st.floats(0.1, 0.9))
def test_the_law_makes_the_cost_least(seed: int, gain: float) -> None:
    generator = np.random.default_rng(seed)
    J, deviation = generator.normal(size=(4, 3)), generator.normal(size=4)

    def cost(u: Any) -> float:
        left = deviation + 0.5 * J @ u
        return float(left @ left + (1 / gain - 1) * np.sum((0.5 * J @ u) ** 2))

    u = Servoing(gain=gain, period=0.5).solve(J, deviation)
    assert cost(u) <= minimize(cost, np.zeros(3)).fun + 1e-9


@pytest.mark.parametrize(("delay", "most"), [(0, 2.0), (1, 1.0), (2, 2 * math.sin(math.pi / 10))])
def test_bound_of_the_gain(delay: int, most: float) -> None:
    assert slowest_root(most, delay=delay) == pytest.approx(1.0)
    assert slowest_root(0.99 * most, delay=delay) < 1
    assert slowest_root(1.01 * most, delay=delay) > 1


def events(servoing: Servoing, seen: list[Any], *, moves: float = 0.0) -> list[Any]:
    """The event of every tick of 10 ms; each element: features, None for nothing, and small."""
    watch, found = Watch(), []
    for k, one in enumerate(seen):
        sensed = SENSED._replace(carriage=(0.0, 0.0, 0.0, 0.0, 0.0, k * moves))
        if one is None:
            watch, event = servoing.missing(watch, k * 0.01)
        else:
            watch, event = servoing.found(watch, sensed, (one[0],), one[1], k * 0.01)
        found.append(event)
    return found


def test_done_after_m_frames_and_not_before() -> None:
    servoing = Servoing(period=0.03, settled_frames=3)
    found = events(servoing, [(1.0, False)] * 2 + [(1.0, True)] * 12)
    assert found.index("done") == 2 + 9  # 9 ticks are 3 frames
    # It begins anew where the error is large or nothing is found in between.
    for between in ((1.0, False), None):
        seen = [(1.0, True)] * 8 + [between] + [(1.0, True)] * 11
        assert events(servoing, seen).index("done") == 9 + 9


def test_lost_after_n_frames_in_a_row() -> None:
    servoing = Servoing(period=0.03, lost_frames=4)
    assert events(servoing, [None] * 20).index("lost") == 12
    found = events(servoing, ([None] * 11 + [(1.0, False)]) * 3)
    assert found == [None] * 36


def test_an_image_that_stays_the_same_while_the_carriage_moves_is_lost() -> None:
    servoing = Servoing(period=0.03, lost_frames=4)
    frozen = [(1.0, False)] * 20
    assert events(servoing, frozen, moves=0.0005).index("lost") == 12
    assert events(servoing, frozen) == [None] * 20  # it stands: the image may be the same
    alive = [(float(k), False) for k in range(20)]
    assert events(servoing, alive, moves=0.0005) == [None] * 20


def test_reducible_is_what_a_velocity_takes_away_in_time() -> None:
    servoing = Servoing(gain=0.1)
    J = np.array([[1000.0, 0.0], [0.0, 1000.0], [0.0, 1000.0]])
    # The last two rows disagree: half of that cannot be reduced.
    u = servoing.solve(J, np.array([3.0, 2.0, 0.0]))
    np.testing.assert_allclose(servoing.reducible(J, u), [3.0, 1.0, 1.0])


def test_what_a_camera_sees_of_a_part() -> None:
    first = Detection(status=Status.VALID, tip=(1.0, 2.0), angle=0.1, point=(3.0, 4.0))
    second = Detection(status=Status.OCCLUDED, angle=0.2, point=(5.0, 6.0))
    vector = tuple(pack_detections(first, second, Detection(status=Status.NO_COLOUR)).tolist())
    sensed = SENSED._replace(yz_detections=vector)
    assert seen_part(sensed, "yz", 0) == first
    found = seen_part(sensed, "yz", 1)
    assert found is not None
    assert (found.status, found.point) == (Status.OCCLUDED, (5.0, 6.0))
    assert seen_part(sensed, "yz", 2) is None
    assert seen_part(sensed, "xz", 0) is None
    with pytest.raises(ParameterError, match=r"^part is 3, allowed: 0 to 2, "):
        seen_part(sensed, "yz", 3)


def test_a_camera_that_is_needed_has_to_be_there() -> None:
    with pytest.raises(ParameterError, match=r"^cameras\.xz is None, allowed: a camera"):
        StaticCameras().views(["xz"])
