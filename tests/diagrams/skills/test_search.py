import math

import numpy as np
import pytest

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.skills.search import make_search_diagram
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx, lissajous

WAY = (0.1, -0.2, 0.3, 0.01, -0.02, 0.03)


def test_the_carriage_covers_the_way_and_stops() -> None:
    diagram = make_search_diagram([MoveDx(displacement=WAY, duration=0.5)], step=0.01)
    found = simulate(diagram, duration=0.705, step=0.01)
    displacement = found.outputs["displacement"]
    assert displacement.shape == (71, 6)
    np.testing.assert_allclose(displacement[25], np.array(WAY) / 2, atol=1e-9)
    np.testing.assert_allclose(displacement[50:], np.tile(WAY, (21, 1)), atol=1e-9)
    np.testing.assert_allclose(found.outputs["velocity"][10], np.array(WAY) / 0.5)
    assert not found.outputs["velocity"][-1].any()


@pytest.mark.parametrize("repeats", [1, 3])
def test_a_pattern_ends_where_it_began_and_is_centred(repeats: int) -> None:
    slow, fast = lissajous(
        first=Dither(axis="x", amplitude=0.002, frequency=2.0), axis="y", repeats=repeats
    )
    step = 1 / (400 * fast.frequency)
    found = simulate(
        make_search_diagram([slow, fast], step=step), duration=slow.duration + step / 2, step=step
    )
    displacement = found.outputs["displacement"]
    assert found.time[-1] == pytest.approx(repeats / 2.0)
    np.testing.assert_allclose(displacement[-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(displacement[:, [0, 1, 2, 5]], 0.0, atol=0)
    k = np.arange(len(found.time))
    for dither in (slow, fast):
        # The sum of held cosines in closed form: a sine about a centre that is A half off.
        half = math.pi * dither.frequency * step
        expected = (
            0.002 * half * (np.sin(2 * half * k) / math.tan(half) + 1 - np.cos(2 * half * k))
        )
        np.testing.assert_allclose(displacement[:, dither.index], expected, atol=1e-12)
        assert np.mean(displacement[:-1, dither.index]) == pytest.approx(0.002 * half)


def test_primitives_of_different_kinds_add_up() -> None:
    primitives = [
        MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, -0.05), duration=1.0),
        Dither(kind="rotary", axis="z", amplitude=0.1, frequency=5.0, cycles=5.0),
    ]
    found = simulate(make_search_diagram(primitives, step=0.01), duration=1.005, step=0.01)
    displacement = found.outputs["displacement"]
    assert displacement[-1, 5] == pytest.approx(-0.05)
    assert displacement[-1, 2] == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(displacement[:, 2]) == pytest.approx(0.2, rel=0.05)
