"""Desired motions of an arm that touches, by hand, by steps, and with the hybrid controller."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
from chamfer.systems.force.surface_motion import (
    GuardedMotion,
    GuardedMotionParams,
    SurfaceMotion,
    SurfaceMotionParams,
    approached,
    swung,
)

PERIOD = 0.25  # binary, so that the ticks' times are exact
OUTPUTS = ("selection", "desired_force", "desired_position")

spatial = arrays(float, 3, elements=st.floats(-2, 2))
seeds = st.integers(0, 10_000)


class Driven:
    """The block, ticked with one pair of inputs after the other."""

    def __init__(self, start: tuple[float, ...] = (0.0, 0.0), **changes: Any) -> None:
        axis = {"axis": changes.pop("axis")} if "axis" in changes else {}
        params = SurfaceMotionParams(**changes)
        self.block = SurfaceMotion(params, start=start, period=PERIOD, **axis)
        self.simulator = Simulator(self.block)
        self.context: Any = self.simulator.get_mutable_context()
        self.ticks = 0

    def feed(self, position: Any, normal: Any) -> None:
        motion = [*position, *np.full(len(position), 77.0)]
        self.block.GetInputPort("endpoint_motion").FixValue(self.context, motion)
        self.block.GetInputPort("normal").FixValue(self.context, normal)

    def guard(self, mode: int, approach: Any) -> None:
        self.block.GetInputPort("mode").FixValue(self.context, float(mode))
        self.block.GetInputPort("approach").FixValue(self.context, approach)

    def read(self, name: str) -> np.ndarray:
        found: np.ndarray = self.block.GetOutputPort(name).Eval(self.context).copy()
        return found

    def tick(self, position: Any, normal: Any) -> np.ndarray:
        """Return the desired position of this instant and let the block store it."""
        self.feed(position, normal)
        if self.ticks > 0:  # advancing to 0 would tick already
            self.simulator.AdvanceTo(self.ticks * PERIOD)
        found = self.read("desired_position")
        self.simulator.AdvancePendingEvents()
        self.ticks += 1
        return found


def scaled(vector: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vector)
    assume(length > 0.1)
    unit: np.ndarray = vector / length
    return unit


def test_on_a_slope() -> None:
    driven = Driven(start=(1.0, 2.0), force=10.0, speed=2.0)
    driven.feed((1.0, 2.0), (0.6, 0.8))
    expected = [0.64, -0.48, -0.48, 0.36]
    np.testing.assert_allclose(driven.read("selection"), expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(driven.read("desired_force"), [-6, -8], rtol=0, atol=1e-15)
    found = driven.read("desired_position")
    np.testing.assert_allclose(found, [1 + 0.5 * 0.8, 2 - 0.5 * 0.6], rtol=0, atol=1e-15)


def test_in_space() -> None:
    # z x x is y; the axis' length and its part along the normal do not count.
    for axis in ((1.0, 0.0, 0.0), (1e9, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.3, 0.0, -9.0)):
        driven = Driven(start=(1.0, 2.0, 3.0), axis=axis)
        driven.feed((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))
        np.testing.assert_array_equal(driven.read("selection"), [1, 0, 0, 0, 1, 0, 0, 0, 0])
        np.testing.assert_array_equal(driven.read("desired_force"), [0, 0, -5])
        found = driven.read("desired_position")
        np.testing.assert_allclose(found, [1, 2.125, 3], rtol=0, atol=1e-15)


def reference(
    held: np.ndarray, x: np.ndarray, n: np.ndarray, speed: float, axis: np.ndarray
) -> np.ndarray:
    """Return the next desired position, in steps: move, take the error, drop its normal part."""
    across = np.cross(n, axis)
    along = across / np.linalg.norm(across)
    error = held + speed * PERIOD * along - x
    found: np.ndarray = x + error - n * (n @ error)
    return found


@given(seed=seeds, axis=spatial)
def test_any_course_in_space(seed: int, axis: np.ndarray) -> None:
    scaled(axis)
    rng = np.random.default_rng(seed)
    driven = Driven(start=(0.5, -0.25, 2.0), axis=tuple(axis.tolist()))
    held = np.array([0.5, -0.25, 2.0])
    for _ in range(6):
        x, n = rng.normal(size=3), scaled(rng.normal(size=3))
        assume(np.linalg.norm(np.cross(n, axis)) > 1e-3)
        found = driven.tick(x, n)
        held = reference(held, x, n, 0.5, axis)
        np.testing.assert_allclose(found, held, rtol=0, atol=1e-12)


def test_between_the_ticks_it_looks_ahead() -> None:
    driven = Driven()
    now = driven.tick((0.0, 0.0), (0.0, 1.0))
    np.testing.assert_array_equal(now, [0.125, 0.0])
    for time in (0.1, 0.2, 0.25):  # at 0.25 s before the tick
        driven.simulator.AdvanceTo(time)
        np.testing.assert_array_equal(driven.read("desired_position"), [0.25, 0.0])


@pytest.mark.parametrize("name", OUTPUTS)
@pytest.mark.parametrize("normal", [(0.0, 0.0), (0.0, 1.00001), (0.6, 0.79998), (1.0, 1.0)])
def test_normal_has_to_be_of_unit_length(normal: tuple[float, float], name: str) -> None:
    driven = Driven()
    driven.feed((0.0, 0.0), normal)
    with pytest.raises(ParameterError) as caught:
        driven.read(name)
    allowed = "a vector of length 1 within 1e-06"
    assert str(caught.value) == f"normal is {list(normal)}, allowed: {allowed}"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_normal_along_the_axis_gives_no_direction(sign: float) -> None:
    driven = Driven(start=(0.0, 0.0, 0.0), axis=(0.0, 3.0, 4.0))
    normal = [0.0, sign * 0.6, sign * 0.8]
    with pytest.raises(ParameterError) as caught:
        driven.tick((0.0, 0.0, 0.0), normal)
    allowed = "a direction other than that of the axis (0.0, 3.0, 4.0)"
    assert str(caught.value) == f"normal is {normal}, allowed: {allowed}"


def test_the_approach_is_followed_in_every_direction() -> None:
    guarded = Driven(start=(0.0, 1.0))
    guarded.guard(APPROACH, (0.0, 0.75))
    np.testing.assert_array_equal(guarded.tick((0.1, 0.9), (0.0, 1.0)), [0.0, 0.75])
    np.testing.assert_array_equal(guarded.read("selection"), [1, 0, 0, 1])
    # At the contact the motion along the surface goes on from there.
    guarded.guard(CONTACT, (9.0, 9.0))
    np.testing.assert_array_equal(guarded.tick((0.1, 0.7), (0.0, 1.0)), [0.125, 0.7])
    np.testing.assert_array_equal(guarded.read("selection"), [1, 0, 0, 0])
    np.testing.assert_array_equal(guarded.read("desired_force"), [0, -5])


def test_it_waits_for_lost_contact_and_begins_again_with_its_ramp() -> None:
    guarded = Driven(acceleration=1.0)  # 0.25 m/s a period, up to 0.5
    travelled = []
    for mode in (CONTACT, CONTACT, CONTACT, LOST, CONTACT, CONTACT):
        guarded.guard(mode, (9.0, 9.0))
        travelled.append(guarded.tick((0.0, 0.0), (0.0, 1.0))[0])
    np.testing.assert_allclose(np.diff([0, *travelled]), PERIOD * np.array([1, 2, 2, 0, 1, 2]) / 4)
    np.testing.assert_array_equal(guarded.read("selection"), [1, 0, 0, 0])
    # The ramp has the sign of the speed.
    guarded = Driven(acceleration=1.0, speed=-0.5)
    travelled = [guarded.tick((0.0, 0.0), (0.0, 1.0))[0] for _ in range(3)]
    np.testing.assert_allclose(np.diff([0, *travelled]), -PERIOD * np.array([1, 2, 2]) / 4)


def test_coordinates_beyond_the_normal_are_held() -> None:
    block = SurfaceMotion(
        SurfaceMotionParams(),
        start=(0.0, 0.0, 0.0, 0.7),
        axis=(0.0, -1.0, 0.0),
        dimension=3,
        period=PERIOD,
    )
    context = block.CreateDefaultContext()
    block.GetInputPort("endpoint_motion").FixValue(context, [0.1, 0.2, 0.3, 0.4, *(77.0,) * 4])
    block.GetInputPort("normal").FixValue(context, [0.0, 0.0, 1.0])
    desired, selection, force = (
        block.GetOutputPort(name).Eval(context)
        for name in ("desired_position", "selection", "desired_force")
    )
    np.testing.assert_allclose(desired, [0.125, 0.0, 0.3, 0.7], atol=1e-15)
    np.testing.assert_array_equal(selection.reshape(4, 4), np.diag([1.0, 1.0, 0.0, 1.0]))
    np.testing.assert_array_equal(force, [0, 0, -5, 0])


# Everything fast and oblique: vectors of lengths 5 and 2.
QUICK = GuardedMotionParams(
    start=(0.5, -0.25, 2.0),
    direction=(0.0, 3.0, -4.0),
    along=(-2.0, 0.0, 0.0),
    speed=2.0,
    acceleration=8.0,
    amplitude=0.1,
    frequency=7.0,
    blend=0.4,
)


class Approaching:
    """The block at any time, before contact or after."""

    def __init__(self, params: GuardedMotionParams) -> None:
        self.block = GuardedMotion(params)
        self.context = self.block.CreateDefaultContext()
        self.at(0.0)

    def at(self, time: float, contact: float = -1.0) -> np.ndarray:
        self.context.SetTime(time)
        self.block.GetInputPort("contact_time").FixValue(self.context, [contact])
        found: np.ndarray = self.block.GetOutputPort("desired_position").Eval(self.context)
        return found


@given(speed=st.floats(0.01, 3.0), acceleration=st.floats(0.1, 50.0), after=st.floats(0.0, 10.0))
def test_approach_in_closed_form(speed: float, acceleration: float, after: float) -> None:
    ramp = speed / acceleration
    time = ramp + after
    expected = speed * (time - speed / (2 * acceleration))
    assert approached(time, speed, acceleration) == pytest.approx(expected, rel=1e-12)
    # Up to there it is a fall.
    fall = acceleration * (0.6 * ramp) ** 2 / 2
    assert approached(0.6 * ramp, speed, acceleration) == pytest.approx(fall, rel=1e-12)
    assert approached(0.0, speed, acceleration) == 0.0


def test_approach_stops_where_contact_is() -> None:
    driven = Approaching(QUICK)
    towards = np.array([0.0, 0.6, -0.8])
    depth = 2.0 * (0.7 - 0.125)  # speed * (t - speed / (2 acceleration)) at 0.7 s
    for time in (0.7, 0.8, 1.5, 40.0):
        moved = driven.at(time, 0.7) - np.array(QUICK.start)
        assert towards @ moved == pytest.approx(depth, abs=1e-14)
        assert abs(np.cross(towards, [1.0, 0.0, 0.0]) @ moved) < 1e-15
    np.testing.assert_allclose(driven.at(0.7, 0.7), driven.at(0.7), rtol=0, atol=1e-15)


@given(after=st.floats(0.0, 100.0))
def test_sinusoid_after_the_blend(after: float) -> None:
    time = QUICK.blend + after
    assert swung(time, 0.1, 7.0, 0.4) == pytest.approx(0.1 * math.sin(7.0 * time), abs=1e-15)
    driven = Approaching(QUICK)
    # -x: the vector ``along`` gives the sign, its length of 2 nothing.
    moved = driven.at(0.3 + time, 0.3)[0] - QUICK.start[0]
    assert moved == pytest.approx(-0.1 * math.sin(7.0 * time), abs=1e-12)


def test_sinusoid_grows_monotonically_within_the_blend() -> None:
    times = np.linspace(0.01, QUICK.blend, 100)
    part = np.array([swung(t, 0.1, 7.0, 0.4) for t in times.tolist()]) / (
        0.1 * np.sin(7.0 * times)
    )
    assert part[0] < 1e-3
    assert np.all(np.diff(part) > 0)
    assert part[-1] == pytest.approx(1.0, abs=1e-12)
    # Halfway it has half of the amplitude.
    assert swung(0.2, 0.1, 7.0, 0.4) == pytest.approx(0.05 * math.sin(1.4), abs=1e-15)
