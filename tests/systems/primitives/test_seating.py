"""The force ramp, against what gives way at a force, under damping control on a soft wrist."""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
import pytest

from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.systems.primitives.primitive import STILL, Observation
from chamfer.systems.primitives.seating import Press, Seat
from chamfer.systems.strategies.bnc_strategy import BncConnectorSkillParams

PERIOD: Final = 0.01  # s
DAMPING: Final = 800.0  # N s/m
WRIST: Final = 2e4  # N/m, as it is believed to be
_FINE: Final = 20  # steps of the carriage in a tick
Resistance = Callable[[float], float]  # N, of a depth, m


class Pushed(NamedTuple):
    event: str | None
    depth: float  # m, of the tip
    peak: float  # N
    time: float  # s


def pushed(
    seat: Seat,
    resists: Resistance,
    *,
    end: float = math.inf,
    start: float = 0.0,
    wrist: float = WRIST,
    noise: float = 0.0,
    seed: int = 0,
) -> Pushed:
    """Push a tip that moves where the wrist's spring pushes more than resists, up to an end."""
    random = np.random.default_rng(seed)
    tip = carriage = start
    force = peak = speed = 0.0
    memory: object = None
    for i in range(3000):
        felt = force + noise * random.normal()
        sensed = Observation(
            carriage=(0.0, 0.0, 0.0, 0.0, 0.0, -(carriage - felt / WRIST)),
            motion=STILL,
            wrench=(0.0, 0.0, 0.0, 0.0, 0.0, felt),
        )
        memory = seat.begin(sensed._replace(carriage=STILL)) if i == 0 else memory
        stepped = seat.step(sensed, memory, i * PERIOD)
        memory = stepped.memory
        if stepped.event is not None:
            return Pushed(stepped.event, tip, peak, i * PERIOD)
        speed = -stepped.velocity[5] - felt / DAMPING
        for _ in range(_FINE):
            carriage += speed * PERIOD / _FINE
            # Without mass the tip slides on to where the spring is as strong as what resists.
            while tip < end and wrist * (carriage - tip) > resists(tip):
                tip = min(tip + 2e-6, end)
            force = wrist * (carriage - tip)
        peak = max(peak, force)
    return Pushed(None, tip, peak, math.inf)


def contacts(most: float) -> Resistance:
    """Contacts that spread between 2.5 and 3 mm, and rub on behind with 55 % of that."""

    def resists(depth: float) -> float:
        rising = most * (depth - 0.0025) / 0.0003
        return min(max(rising, 0.5), most) if depth < 0.003 else 0.55 * most

    return resists


def seat(**changes: Any) -> Seat:
    return Seat(**{"limit": 115.0, "distance": 0.0033, **changes})


@pytest.mark.parametrize("most", [22.0, 45.0, 90.0])
@pytest.mark.parametrize("wrist", [0.7 * WRIST, WRIST, 1.3 * WRIST])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_it_is_seated_with_little_more_force_than_it_takes(
    most: float, wrist: float, noise: float
) -> None:
    found = pushed(seat(), contacts(most), end=0.0056, start=0.0025, wrist=wrist, noise=noise)
    assert found.event == "done"
    assert found.depth == pytest.approx(0.0056, abs=1e-6)
    assert 0.99 * most < found.peak < 1.15 * most
    assert found.time < 6.0


@pytest.mark.parametrize("wrist", [0.7 * WRIST, WRIST, 1.3 * WRIST])
def test_what_does_not_give_way_is_jammed_at_the_limit(wrist: float) -> None:
    found = pushed(seat(limit=60.0), contacts(90.0), start=0.0025, wrist=wrist)
    assert found.event == "jammed"
    assert 0.97 * 60.0 <= found.peak < 1.07 * 60.0


@pytest.mark.parametrize("wrist", [0.7 * WRIST, WRIST, 1.3 * WRIST])
@pytest.mark.parametrize("seed", range(3))
def test_a_stop_gets_the_force_that_needs_no_proof_and_no_more(wrist: float, seed: int) -> None:
    one = seat(free=30.0)
    found = pushed(one, lambda depth: 0.5, end=0.002, wrist=wrist, noise=0.5, seed=seed)
    assert found.event == "jammed"
    assert 0.9 * 30.0 < found.peak < 1.07 * 30.0


@pytest.mark.parametrize("wrist", [0.7 * WRIST, WRIST, 1.3 * WRIST])
def test_a_stop_behind_contacts_gets_little_more_than_they_took(wrist: float) -> None:
    found = pushed(
        seat(free=20.0, distance=0.0045), contacts(28.0), end=0.0032, wrist=wrist, noise=0.5
    )
    assert found.event == "jammed"
    assert found.peak < 1.5 * 28.0


@pytest.mark.parametrize("wrist", [0.7 * WRIST, WRIST, 1.3 * WRIST])
@pytest.mark.parametrize("seed", range(3))
def test_a_steep_lead_in_is_told_from_a_stop(wrist: float, seed: int) -> None:
    one = seat(free=30.0, steep=(0.002, 0.004), through=45.0)
    found = pushed(one, contacts(90.0), end=0.0056, wrist=wrist, noise=0.5, seed=seed)
    assert (found.event, found.depth) == ("done", pytest.approx(0.0056, abs=1e-6))
    assert found.peak < 1.3 * 90.0
    stop = pushed(one, contacts(30.0), end=0.0026, wrist=wrist, noise=0.5, seed=seed)
    assert stop.event == "jammed"
    assert stop.peak < 1.05 * one.share * 45.0  # where it crept a little into the lead-in


def pushed_spring(rate: float, wrist: float, seed: int, *, harder: float) -> tuple[Pushed, float]:
    """Push a spring of a rate, N/m, that ends at 5.5 mm; with what it pushes with there, N."""

    def spring(depth: float) -> float:
        return 0.5 + rate * max(0.0, depth - 0.0025)

    one = seat(free=9.0, distance=0.0045, rise=1.2, harder=harder)
    return pushed(one, spring, end=0.0055, wrist=wrist, noise=0.3, seed=seed), spring(0.0055)


@pytest.mark.parametrize("wrist", [0.7 * WRIST, WRIST, 1.3 * WRIST])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("rate", [2.2e3, 6e3, 1.2e4])
def test_a_spring_is_pushed_to_its_end_though_it_gives_way_slowly(
    rate: float, wrist: float, seed: int
) -> None:
    found, most = pushed_spring(rate, wrist, seed, harder=1.1)
    assert (found.event, found.depth) == ("done", 0.0055)
    assert found.peak < max(1.5 * most, 9.5)


@pytest.mark.parametrize(
    ("turn", "tilt", "event"),
    [
        ((0.0, 0.031), (0.09, 0.03), "tilted"),
        ((0.031, -0.029), (0.09, 0.03), "jammed"),
        ((-0.091, 0.0), (0.09, 0.03), "tilted"),
        ((0.5, 0.5), None, "jammed"),
    ],
)
def test_what_has_jammed_is_tilted_if_it_has_turned_since_its_begin(
    turn: tuple[float, float], tilt: Any, event: str
) -> None:
    """The wrench is the same: where accommodation turns readily it says nothing."""
    push, there = seat(tilt=tilt, limit=30.0), (0.2, -0.1)
    felt = Observation((*there, 0, 0, 0, 0), STILL, (0, 0, 0, 0, 0, 31.0))
    memory: Any = push.begin(felt)
    turned = felt._replace(carriage=tuple(map(sum, zip(there, turn, strict=True))) + (0.0,) * 4)
    for i in range(1000):
        stepped = push.step(turned, memory, i * PERIOD)
        memory = stepped.memory
        if stepped.event is not None:
            break
    assert stepped.event == event
    assert ("tilted" in push.events) == (tilt is not None)


def test_the_speed_does_not_grow_without_bound_where_no_force_is_felt() -> None:
    stuck, memory = Observation(carriage=STILL, motion=STILL, wrench=STILL), None
    one = seat(fastest=0.05)
    memory = one.begin(stuck)
    for i in range(1000):
        stepped = one.step(stuck, memory, i * PERIOD)
        memory = stepped.memory  # type: ignore[assignment]
    assert stepped.velocity == (0, 0, 0, 0, 0, -0.05)


def test_windows_begin_at_multiples_of_their_length_whichever_ticks_are_missing() -> None:
    seat = Seat(limit=60.0, window=0.08)
    still = Observation(STILL, STILL, wrench=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    memory: object = seat.begin(still)
    raised, before = [], seat.speed
    for tick in (0, 3, 9, 12, 16, 20, 25, 31, 32, 60, 64):
        stepped = seat.step(still, memory, tick * PERIOD)
        memory, speed = stepped.memory, -stepped.velocity[5]
        if speed > before:
            raised.append(tick)
        before = speed
    assert raised == [16, 25, 32, 60, 64]


def test_what_moves_is_pushed_on_alike_whichever_ticks_are_missing() -> None:
    """What moves half as fast as it is commanded: the rest of the command is the force."""

    def commanded(ticks: tuple[int, ...]) -> float:
        push = Seat(limit=60.0, window=0.08, speed=0.001)
        memory: object = push.begin(Observation(STILL, STILL, STILL))
        memory = memory._replace(speed=0.02)  # type: ignore[attr-defined]
        for tick in ticks:
            force, place = (0.0,) * 5 + (8.0,), (0.0,) * 5 + (-0.01 * PERIOD * tick,)
            stepped = push.step(Observation(place, STILL, force), memory, tick * PERIOD)
            memory = stepped.memory
        return -stepped.velocity[5]

    assert commanded(tuple(range(17))) == pytest.approx(1.35 * 0.01, rel=0.1)
    assert commanded((0, 4, 8, 12, 16)) == pytest.approx(1.35 * 0.01, rel=0.3)
    assert commanded((0, 8, 24)) == pytest.approx(1.35 * 0.01, rel=0.3)


def test_a_press_goes_on_with_what_was_commanded_last() -> None:
    press = Press(direction="-rz")
    before = Observation(
        carriage=STILL, motion=STILL, wrench=STILL, perturbed=(1, 2, -0.3, 4, 5, 6)
    )
    stepped = press.step(before._replace(perturbed=STILL), press.begin(before), 1.0)
    assert (stepped.velocity, stepped.event) == ((0, 0, -0.3, 0, 0, 0), None)


@pytest.mark.parametrize("most", [5.0, 13.0, 30.0])
@pytest.mark.parametrize("wrist", [0.58, 1.0, 1.4])
def test_a_spring_is_told_from_its_stop_by_a_wrist_much_softer_or_stiffer(
    most: float, wrist: float
) -> None:
    params = BncConnectorSkillParams()
    push = params.seat(
        BncConnector().mating_force,
        rise=params.rise,
        harder=params.harder,
        stiffness=params.stop_stiffness,
        sure=params.surely,
        distance=0.002,
    )
    for seed in range(3):
        found = pushed(
            push,
            lambda depth: most * depth / 0.003,
            end=0.003,
            wrist=wrist * WRIST,
            noise=0.2,
            seed=seed,
        )
        assert (found.event, found.depth) == ("done", 0.003)
        assert found.peak < 1.5 * most


def test_what_seems_to_move_on_and_on_is_pushed_with_the_limit_at_most() -> None:
    # A wrist so soft that a stop seems to give way as a spring does.
    found = pushed(seat(limit=30.0), lambda depth: 0.0, end=0.001, wrist=0.3 * WRIST)
    assert found.event == "jammed"
    assert found.peak < 1.25 * 30.0


def test_a_press_goes_on_with_its_share() -> None:
    sensed = Observation(carriage=STILL, motion=STILL, wrench=STILL, perturbed=(*[0.0] * 5, -0.02))
    press = Press(share=0.85)
    stepped = press.step(sensed, press.begin(sensed), 0.0)
    assert stepped.velocity == pytest.approx((0, 0, 0, 0, 0, -0.017))
