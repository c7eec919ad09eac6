"""Each force primitive alone, driven by made-up senses."""

import math
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from chamfer.systems.primitives.correlation import correlation
from chamfer.systems.primitives.force_primitives import (
    AXIS_NAMES,
    DIRECTIONS,
    Direction,
    GuardedMove,
    Hold,
    Level,
    Obstructed,
    Stick,
    velocity,
)
from chamfer.systems.primitives.primitive import STILL, Observation, Primitive, Stepped, Vector

PERIOD: Final = 0.01  # s


def six(**values: float) -> Vector:
    """Six elements by the names of their axes."""
    return tuple(values.get(name, 0.0) for name in AXIS_NAMES)


def sensed(
    *,
    carriage: Vector = STILL,
    wrench: Vector = STILL,
    motion: Vector = STILL,
    perturbed: Vector = STILL,
    spread: Vector | None = None,
) -> Observation:
    return Observation(
        carriage=carriage, motion=motion, wrench=wrench, perturbed=perturbed, spread=spread
    )


def shown(
    primitive: Primitive, *senses: Observation, begin: Observation | None = None
) -> list[Stepped]:
    """What a primitive does at ticks from 0 on."""
    memory = primitive.begin(begin or senses[0])
    found = []
    for i, one in enumerate(senses):
        found.append(primitive.step(one, memory, i * PERIOD))
        memory = found[-1].memory
    return found


@given(direction=st.sampled_from(DIRECTIONS), force=st.floats(-10, 10), across=st.floats(-99, 99))
def test_a_guarded_move_ends_at_its_threshold_against_the_motion(
    direction: Direction, force: float, across: float
) -> None:
    move = GuardedMove(direction=direction, speed=0.02, threshold=4.0)
    other: Direction = "+x" if direction[1:] != "x" else "+y"
    wrench = np.array(velocity(direction, -force)) + velocity(other, across)
    (found,) = shown(move, sensed(wrench=tuple(wrench.tolist())))
    assert found.event == ("contact" if force >= 4.0 else None)
    assert found.velocity == (STILL if force >= 4.0 else velocity(direction, 0.02))


def test_noise_is_no_contact() -> None:
    move = GuardedMove(direction="-z", threshold=4.0, sure=5.0)

    def event(force: float, spread: float) -> str | None:
        felt = sensed(wrench=six(z=force), spread=six(z=spread, x=99.0))
        return shown(move, felt)[0].event

    assert (event(4.1, 0.5), event(4.9, 1.0), event(5.1, 1.0)) == ("contact", None, "contact")


def test_a_guarded_move_counts_its_way_from_where_it_began() -> None:
    move = GuardedMove(direction="-z", limit=0.03)
    here, before, at = (sensed(carriage=six(z=z)) for z in (0.5, 0.4701, 0.4699))
    events = [one.event for one in shown(move, here, before, at)]
    assert events == [None, None, "lost"]
    found = shown(move, sensed(carriage=six(z=0.4, x=1.0), wrench=six(z=4.0)), begin=here)
    assert found[0].event == "contact"  # of both, what it was looking for


@given(
    direction=st.sampled_from(DIRECTIONS),
    start=st.sampled_from([0.0, 0.25, -2.0]),
    steps=st.integers(-64, 64),
)
def test_contact_is_lost_beyond_the_threshold_only(
    direction: Direction, start: float, steps: int
) -> None:
    stick = Stick(direction=direction, speed=0.01, threshold=2**-10)
    here = sensed(carriage=velocity(direction, start))
    there = sensed(carriage=velocity(direction, start + steps * 2**-15))
    (found,) = shown(stick, there, begin=here)
    assert found.event == ("lost" if steps > 32 else None)
    assert found.velocity == (STILL if steps > 32 else velocity(direction, 0.01))


def dithered(
    hindered: Obstructed, command: NDArray[np.float64], motion: NDArray[np.float64]
) -> int | None:
    """Samples after which a watched x axis counts as hindered; two more are not its own."""
    senses = [sensed(perturbed=six(x=7.0), motion=six(x=-7.0))] * 2
    senses += [
        sensed(perturbed=six(x=float(f)), motion=six(x=float(g)))
        for f, g in zip(command, motion, strict=True)
    ]
    events = [one.event for one in shown(hindered, *senses)]
    assert set(events) <= {None, "hindered"}
    return events.index("hindered") - 1 if "hindered" in events else None


N: Final = 100
WAVE: Final = np.cos(2 * math.pi * np.arange(8 * N) / N)
ONE = Obstructed(axes=("x",), cycle=(N * PERIOD,))


def test_a_lagging_dither_is_hindered_after_its_windows() -> None:
    def lagging(degrees: float, windows: int) -> int | None:
        motion = np.cos(2 * math.pi * np.arange(8 * N) / N - math.radians(degrees))
        return dithered(
            Obstructed(axes=("x",), cycle=(N * PERIOD,), windows=windows), WAVE, motion
        )

    # C = (pi^2 / 8) cos(lag) is 0.8 at 49.6 degrees.
    assert lagging(48.5, 2) is None
    assert lagging(51.0, 1) == N
    assert lagging(51.0, 2) == 2 * N
    assert lagging(51.0, 5) == 5 * N


def test_a_stop_on_one_side_is_seen_by_the_amplitude_alone() -> None:
    one_sided = np.maximum(WAVE, 0.0)
    blind = Obstructed(axes=("x",), cycle=(N * PERIOD,), amplitude_threshold=0.0)
    assert dithered(blind, WAVE, one_sided) is None  # its C is that of a free dither
    seeing = Obstructed(axes=("x",), cycle=(N * PERIOD,), amplitude_threshold=0.51)
    assert dithered(seeing, WAVE, one_sided) == 2 * N
    strict = Obstructed(axes=("x",), cycle=(N * PERIOD,), amplitude_threshold=0.51, threshold=0.0)
    assert dithered(strict, WAVE, one_sided) == 2 * N


@pytest.mark.parametrize("seed", range(4))
def test_bias_and_noise_hinder_nothing_and_hide_nothing(seed: int) -> None:
    noise = 0.6 * np.random.default_rng(seed).normal(size=8 * N) + 1.1
    assert correlation(WAVE[:N], (WAVE + noise)[:N]).value < ONE.threshold  # as eq. (1) says
    assert dithered(ONE, WAVE, WAVE + noise) is None
    assert dithered(ONE, WAVE, 0.15 * WAVE + noise) == 2 * N


@pytest.mark.parametrize("seed", range(4))
def test_windows_count_time_where_ticks_are_missing_early_or_late(seed: int) -> None:
    random = np.random.default_rng(seed)
    times = PERIOD * (np.arange(8 * N) + random.uniform(-0.5, 0.5, 8 * N))
    times = np.append(0.0, times[(times > 0) & (random.random(8 * N) > 0.2)])

    def hindered(ratio: float) -> float | None:
        """Seconds until it is, with a bias many times the dither."""
        memory = ONE.begin(sensed())
        for time in times.tolist():
            wave = math.cos(2 * math.pi * time)
            felt = sensed(perturbed=six(x=wave), motion=six(x=ratio * wave + 20.0))
            stepped = ONE.step(felt, memory, time)
            memory = stepped.memory
            if stepped.event is not None:
                return time
        return None

    assert hindered(0.45) is None
    assert hindered(0.35) == pytest.approx(2.0, abs=5 * PERIOD)


def test_a_window_begins_anew_after_a_pause() -> None:
    memory = ONE.begin(sensed())
    held = sensed(perturbed=six(x=1.0), motion=six(x=-1.0))  # against it, if it were a dither
    for time in (0.0, 0.01, 0.52, 3.0, 6.0, 6.49):
        stepped = ONE.step(held, memory, time)
        memory = stepped.memory
        assert stepped.event is None, time


@given(
    place=st.tuples(*[st.floats(-1, 1)] * 6),
    start=st.tuples(*[st.floats(-1, 1)] * 6),
    axes=st.sets(st.sampled_from(AXIS_NAMES), min_size=1).map(tuple),
)
def test_a_hold_goes_back_to_where_it_began(place: Vector, start: Vector, axes: Any) -> None:
    hold = Hold(axes=axes, gain=3.0)
    (found,) = shown(hold, sensed(carriage=place), begin=sensed(carriage=start))
    expected = [
        3.0 * (a - b) if name in axes else 0.0
        for name, a, b in zip(AXIS_NAMES, start, place, strict=True)
    ]
    np.testing.assert_allclose(found.velocity, expected, atol=1e-12)
    assert found.event is None


def levelled(*places: tuple[Vector, Vector]) -> list[str | None]:
    """Events of levelling at turns and torques, begun at rx = 0.5."""
    level = Level(torque=0.02, time=0.02, limit=0.05)
    senses = [sensed(carriage=turn, wrench=torque) for turn, torque in places]
    found = shown(level, *senses, begin=sensed(carriage=six(rx=0.5)))
    assert all(one.velocity == STILL for one in found)
    return [one.event for one in found]


def test_levelling_is_done_when_no_torque_is_left_on_average() -> None:
    here = six(rx=0.5)
    calm, busy = (here, six(rx=0.012, ry=-0.015, rz=9.0, z=9.0)), (here, six(rx=-0.013, ry=0.016))
    # A window is three ticks, then two: the first tick has no time behind it.
    assert levelled(calm, calm, calm) == [None, None, "done"]
    assert levelled(busy, busy, busy, calm, busy) == [None] * 4 + ["done"]  # they cancel
    assert levelled(busy, busy, busy, busy, busy, calm, calm) == [None] * 6 + ["done"]


def test_levelling_about_an_axis_counts_what_noise_leaves_as_none() -> None:
    def event(torque: float, spread: float) -> str | None:
        felt = sensed(wrench=six(rx=5.0, ry=torque), spread=six(ry=spread))
        level = Level(axes=("ry",), torque=0.01, sure=3.0, time=0.08)
        return shown(level, *[felt] * 9)[-1].event

    assert (event(0.009, 0.0), event(0.02, 0.0)) == ("done", None)
    assert (event(0.0299, 0.03), event(0.0301, 0.03)) == ("done", None)  # of nine samples


@pytest.mark.parametrize("axis", ["rx", "ry"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_levelling_is_lost_when_it_turns_too_far(axis: str, sign: int) -> None:
    def at(angle: float) -> tuple[Vector, Vector]:
        turn = six(**{"rx": 0.5, axis: (0.5 if axis == "rx" else 0.0) + sign * angle, "rz": 9.0})
        return turn, six(rx=1.0)

    assert levelled(at(0.049), at(0.051)) == [None, "lost"]
