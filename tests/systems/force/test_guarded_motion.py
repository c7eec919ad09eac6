"""The desired trajectory against closed forms, and its smoothness by differences."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.validation import ParameterError
from chamfer.systems.force.surface_motion import GuardedMotion, GuardedMotionParams

# Section 2.2: from (1, 0) to the crucible, then a sinusoid across.
SLIDE = GuardedMotionParams(
    start=(1.0, 0.0),
    direction=(0.0, -1.0),
    along=(1.0, 0.0),
    speed=0.33,
    amplitude=0.02,
    frequency=1.0,
)
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


class Driven:
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

    def path(self, times: np.ndarray, contact: float = math.inf) -> np.ndarray:
        """Return the positions, shape (len(times), m), with contact known from then on."""
        return np.array([self.at(t, contact if t >= contact else -1.0) for t in times.tolist()])


# Approach


@given(
    speed=st.floats(0.01, 3.0),
    acceleration=st.floats(0.1, 50.0),
    after=st.floats(0.0, 10.0),
)
def test_approach_in_closed_form(speed: float, acceleration: float, after: float) -> None:
    params = GuardedMotionParams(
        start=(0.0, 0.0),
        direction=(1.0, 0.0),
        along=(0.0, 1.0),
        speed=speed,
        acceleration=acceleration,
    )
    ramp = speed / acceleration
    time = ramp + after
    expected = speed * (time - speed / (2 * acceleration))
    assert params.approached(time) == pytest.approx(expected, rel=1e-12)
    # Up to there it is a fall.
    fall = acceleration * (0.6 * ramp) ** 2 / 2
    assert params.approached(0.6 * ramp) == pytest.approx(fall, rel=1e-12)
    assert params.approached(0.0) == 0.0


def test_nominal_contact_of_chapter_2() -> None:
    # 1.5 m at 0.33 m/s: 4.545 s, and half of the ramp's 0.033 s more.
    assert SLIDE.approached(1.5 / 0.33 + 0.0165) == pytest.approx(1.5, abs=1e-12)


@pytest.mark.parametrize("params", [SLIDE, QUICK], ids=["slide", "quick"])
def test_approach_is_smooth(params: GuardedMotionParams) -> None:
    step, ramp = 1e-4, params.speed / params.acceleration
    times = np.arange(0.0, 3 * ramp, step)
    distance = np.array([params.approached(t) for t in times.tolist()])
    velocity = np.diff(distance) / step
    acceleration = np.diff(velocity) / step
    assert velocity[0] == pytest.approx(params.acceleration * step / 2)  # from rest
    assert np.all(np.diff(velocity) > -1e-9)
    assert velocity[-1] == pytest.approx(params.speed, rel=1e-9)
    assert acceleration.max() == pytest.approx(params.acceleration, rel=1e-3)


def test_approach_is_along_the_direction() -> None:
    driven = Driven(QUICK)
    for time in (0.0, 0.1, 0.25, 1.0):
        moved = driven.at(time) - np.array(QUICK.start)
        expected = np.array([0.0, 0.6, -0.8]) * QUICK.approached(time)
        np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-15)


# In contact


def test_approach_stops_where_contact_is() -> None:
    driven = Driven(QUICK)
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
    assert QUICK.swing(time) == pytest.approx(0.1 * math.sin(7.0 * time), abs=1e-15)
    driven = Driven(QUICK)
    # -x: the vector ``along`` gives the sign, its length of 2 nothing.
    moved = driven.at(0.3 + time, 0.3)[0] - QUICK.start[0]
    assert moved == pytest.approx(-0.1 * math.sin(7.0 * time), abs=1e-12)


def test_sinusoid_grows_monotonically_within_the_blend() -> None:
    times = np.linspace(0.01, QUICK.blend, 100)
    part = np.array([QUICK.swing(t) for t in times.tolist()]) / (0.1 * np.sin(7.0 * times))
    assert part[0] < 1e-3
    assert np.all(np.diff(part) > 0)
    assert part[-1] == pytest.approx(1.0, abs=1e-12)
    # Halfway it has half of the amplitude.
    assert QUICK.swing(0.2) == pytest.approx(0.05 * math.sin(1.4), abs=1e-15)


@pytest.mark.parametrize("params", [SLIDE, QUICK], ids=["slide", "quick"])
def test_velocity_along_the_surface_starts_from_zero(params: GuardedMotionParams) -> None:
    assert params.swing(0.0) == 0.0
    # Zero velocity and zero acceleration: like t^4, not like t.
    small = 1e-3 * params.blend
    steepest = 10 * params.amplitude * params.frequency * params.blend
    assert 0 < params.swing(small) < steepest * 1.001e-12


@pytest.mark.parametrize("params", [SLIDE, QUICK], ids=["slide", "quick"])
def test_acceleration_along_the_surface_is_finite(params: GuardedMotionParams) -> None:
    driven, step, contact = Driven(params), 1e-3, 0.5
    along = np.array(params.along) / np.linalg.norm(params.along)
    times = np.arange(0.3, contact + params.blend + 4 / params.frequency, step)
    s = driven.path(times, contact) @ along
    velocity = np.diff(s) / step
    acceleration = np.diff(velocity) / step
    # The bound of a product: A (g'' + 2 w g' + w^2) with g' <= 15/8 and g'' < 5.8 of the blend.
    w, blend = params.frequency, params.blend
    bound = params.amplitude * (5.8 / blend**2 + 2 * w * 1.875 / blend + w**2)
    assert np.abs(acceleration).max() < bound
    assert np.abs(np.diff(acceleration)).max() < 0.1 * bound  # no step in it either


def test_contact_before_full_speed() -> None:
    driven = Driven(QUICK)
    # At 0.1 s, of a ramp of 0.25 s: 8 * 0.1^2 / 2.
    expected = np.array(QUICK.start) + 0.04 * np.array([0.0, 0.6, -0.8])
    np.testing.assert_allclose(driven.at(0.1, 0.1), expected, rtol=0, atol=1e-15)
    assert driven.at(9.0, 0.1)[1] == pytest.approx(expected[1], abs=1e-14)


def test_contact_at_the_start() -> None:
    np.testing.assert_array_equal(Driven(QUICK).at(0.0, 0.0), QUICK.start)


def test_without_amplitude_the_position_is_held() -> None:
    hold = GuardedMotionParams(
        start=(1.0, 0.0), direction=(0.0, -1.0), along=(1.0, 0.0), speed=0.33
    )
    path = Driven(hold).path(np.linspace(2.0, 9.0, 50), contact=2.0)
    np.testing.assert_array_equal(path, np.tile(path[0], (50, 1)))
    np.testing.assert_allclose(path[0], [1.0, -0.33 * (2.0 - 0.0165)], rtol=0, atol=1e-15)


@given(length=st.floats(1e-6, 1e6))
def test_lengths_of_the_vectors_do_not_count(length: float) -> None:
    long = GuardedMotionParams(
        start=SLIDE.start,
        direction=(0.0, -length),
        along=(length, 0.0),
        speed=SLIDE.speed,
        amplitude=SLIDE.amplitude,
    )
    for time in (1.0, 3.0):
        np.testing.assert_allclose(
            Driven(long).at(time, 2.0), Driven(SLIDE).at(time, 2.0), rtol=0, atol=1e-15
        )


# The block


def test_ports() -> None:
    block = GuardedMotion(QUICK)
    assert block.GetInputPort("contact_time").size() == 1
    assert block.GetOutputPort("desired_position").size() == 3
    assert block.HasAnyDirectFeedthrough()


@pytest.mark.parametrize("field", ["speed", "acceleration", "frequency", "blend"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_rates_have_to_be_positive(field: str, value: float) -> None:
    given = {"speed": 1.0, field: value}
    message = rf"^{field} is {value}, allowed: a finite number > 0$"
    with pytest.raises(ParameterError, match=message):
        GuardedMotionParams(start=(0.0, 0.0), direction=(1.0, 0.0), along=(0.0, 1.0), **given)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"amplitude": -0.1}, "amplitude is -0.1, allowed: a finite number >= 0"),
        ({"amplitude": math.inf}, "amplitude is inf, allowed: a finite number >= 0"),
        ({"start": (0.0, math.nan)}, "start is (0.0, nan), allowed: finite numbers"),
        ({"direction": (1.0,)}, "direction is (1.0,), allowed: 2 numbers"),
        ({"along": (1.0, 0.0, 0.0)}, "along is (1.0, 0.0, 0.0), allowed: 2 numbers"),
        (
            {"direction": (0.0, 0.0)},
            "direction is [0.0, 0.0], allowed: a finite vector other than zero",
        ),
        (
            {"along": (0.0, math.inf)},
            "along is [0.0, inf], allowed: a finite vector other than zero",
        ),
    ],
)
def test_parameters(changes: dict[str, Any], message: str) -> None:
    fine = {"start": (0.0, 0.0), "direction": (1.0, 0.0), "along": (0.0, 1.0), "speed": 1.0}
    with pytest.raises(ParameterError) as caught:
        GuardedMotionParams(**{**fine, **changes})
    assert str(caught.value) == message
