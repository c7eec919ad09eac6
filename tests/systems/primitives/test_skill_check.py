"""The skills that are refused, each in one line."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import pytest

from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import GuardedMove, Obstructed, Stick
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE, FAILED, RETRACT, Retry, Skill, SkillState
from chamfer.systems.primitives.skill_law import check_forces, check_timing, make_skill_chart
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.statechart.chart import ChartError

PERIOD: Final = 0.01  # s
SHAKE: Final = Dither(axis="x", frequency=2.0, cycles=4.0)


class Fake(Primitive):
    """May be done or lost."""

    events: Any = {"done": 0.0, "lost": 0.0}  # noqa: RUF012


def state(name: str, *run: Primitive, on: Mapping[Any, Any], **fields: Any) -> SkillState:
    return SkillState(name=name, run=run, on=on, **{"timeout": 10.0, **fields})


def skill(*states: SkillState, **fields: Any) -> Skill:
    return Skill(name="test", states=states, **{"retract": [MoveDx()], **fields})


GO: Final = state("go", Fake(), on={"done": DONE})


@pytest.mark.parametrize(
    ("states", "message"),
    [
        *[
            ([GO, state(name, Fake(), on={})], f"skill 'test': {name!r} is a state of every skill")
            for name in (DONE, RETRACT, FAILED)
        ],
        ([state("go", on={"done": DONE})], "skill 'test': 'go' runs no primitive"),
        *[
            (
                [state("go", Fake(), on={"done": DONE}, timeout=time)],
                f"skill 'test': 'go': the timeout is {time}, allowed: a finite number > 0",
            )
            for time in (0.0, math.inf, math.nan)
        ],
        *[
            (
                [state("go", Fake(), on={"done": DONE, "lost": answer})],
                "skill 'test': 'go': a failure needs no entry, but 'lost' has one",
            )
            for answer in (RETRACT, FAILED, Retry("go", 1, Retry(RETRACT)))
        ],
        (
            [state("go", Fake(), on={"done": "nowhere"})],
            "chart 'test': the transition go -> nowhere names 'nowhere', "
            "valid states: go, retract, done, failed",
        ),
        ([GO, GO], "chart 'test' has the state 'go' twice"),
        (
            [GO, state("alone", Fake(), on={"done": DONE})],
            "chart 'test': state 'alone' can't be reached",
        ),
        ([state("go", Fake(), on={})], "chart 'test': state 'done' can't be reached"),
        (
            [state("go", Fake(), on={"finished": DONE})],
            "skill 'test': 'go' has an entry for 'finished', valid outcomes: done, contact, "
            "lost, hindered, jammed, tilted, timed out",
        ),
        (
            [state("go", Fake(), on={"done": DONE}, grip="closed")],
            "skill 'test': 'go' has the grip 'closed', allowed: open, close, None",
        ),
    ],
)
def test_a_skill_that_can_t_be_run_is_refused(states: Sequence[SkillState], message: str) -> None:
    with pytest.raises(ChartError) as refused:
        make_skill_chart(skill(*states))
    assert str(refused.value) == message


@pytest.mark.parametrize(
    ("primitive", "answer", "possible"),
    [
        (GuardedMove(), "done", "contact, lost, timed out"),
        (Stick(threshold=math.inf), "lost", "timed out"),
        (Seat(), "lost", "done, jammed, timed out"),
        (SHAKE, "hindered", "done, timed out"),
        (MoveDx(), "contact", "done, timed out"),
    ],
)
def test_an_answer_to_what_can_t_be_is_refused(
    primitive: Primitive, answer: str, possible: str
) -> None:
    with pytest.raises(ChartError) as refused:
        make_skill_chart(skill(state("go", primitive, on={"timed out": DONE, answer: DONE})))
    assert str(refused.value) == (
        f"skill 'test': 'go' has an entry for {answer!r}, which none of its primitives can have, "
        f"possible outcomes: {possible}"
    )


@pytest.mark.parametrize(
    ("run", "timeout", "message"),
    [
        ([MoveDx(duration=3.0)], 3.0, "3 s, before which movedx is never done"),
        ([Dither(cycles=8.0)], 8.0, "8 s, before which ldither x is never done"),
        ([GuardedMove(limit=0.03)], 3.0, "3 s, before which gmove -z is never lost"),
        ([Seat(window=0.25)], 0.5, "0.5 s, before which seat -z is never done"),
    ],
)
def test_a_timeout_has_to_be_longer_than_what_is_run(
    run: Sequence[Primitive], timeout: float, message: str
) -> None:
    message = message.replace("movedx", run[0].label)
    outcome = "contact" if isinstance(run[0], GuardedMove) else "done"
    make_skill_chart(skill(state("go", *run, on={outcome: DONE}, timeout=1.01 * timeout + 1e-6)))
    with pytest.raises(ChartError) as refused:
        make_skill_chart(skill(state("go", *run, on={outcome: DONE}, timeout=timeout)))
    assert str(refused.value) == (
        f"skill 'test': 'go': the timeout is {timeout:g} s, allowed: more than {message}"
    )


def marked(*, first: bool, touch: bool, go_to: str = "touch") -> Skill:
    return skill(
        state("first", Fake(), on={"done": go_to, "lost": "touch"}, marks=first),
        state("touch", Fake(), on={"done": "push"}, marks=touch),
        state("push", Fake(), on={"done": DONE, "lost": "first"}, from_mark=True),
    )


def test_ways_count_from_a_mark_that_was_made() -> None:
    make_skill_chart(marked(first=False, touch=True))
    make_skill_chart(marked(first=True, touch=False, go_to="push"))
    refused = "skill 'test': 'push' counts from a mark, but can be reached without one"
    for touch in (False, True):  # past the mark, too
        with pytest.raises(ChartError) as error:
            make_skill_chart(marked(first=False, touch=touch, go_to="push"))
        assert str(error.value) == refused
    with pytest.raises(ChartError, match="'go' counts from a mark"):
        make_skill_chart(skill(state("go", Fake(), on={"done": DONE}, from_mark=True)))
    make_skill_chart(skill(state("go", Fake(), on={"done": DONE}, from_mark=True, marks=True)))


def test_a_dither_is_not_too_fast_for_the_ticks() -> None:
    def timed(frequency: float) -> None:
        dither = Dither(frequency=frequency)
        check_timing(skill(state("go", dither, on={"done": DONE})), PERIOD)

    timed(25.0)
    with pytest.raises(ChartError) as refused:
        timed(25.1)
    assert str(refused.value) == (
        "skill 'test': 'go': the frequency of ldither x is 25.1 Hz, "
        "allowed: at most 25 Hz, a quarter of the ticks"
    )


@pytest.mark.parametrize(("frequency", "samples"), [(0.6, 167), (0.6, 166), (0.675, 148)])
def test_windows_are_a_cycle_of_the_dither(frequency: float, samples: int) -> None:
    def timed(count: int, dithers: Sequence[Dither]) -> None:
        watch = Obstructed(axes=("x",), cycle=(count * PERIOD,))
        check_timing(skill(state("go", *dithers, watch, on={"hindered": DONE})), PERIOD)

    dither = Dither(axis="x", frequency=frequency)
    other = Dither(axis="y", frequency=3.3)  # is not watched
    cycle = 1 / (frequency * PERIOD)
    if abs(samples - cycle) <= 0.5:
        timed(samples, [other, dither])
    for count in (samples + 2, samples - 2, 2 * samples, samples // 2):
        with pytest.raises(ChartError) as refused:
            timed(count, [other, dither])
        assert str(refused.value) == (
            f"skill 'test': 'go': the windows of corr x are {count * PERIOD:.4g} s along "
            f"x, allowed: a cycle of ldither x, {cycle * PERIOD:.4g} s"
        )


@pytest.mark.parametrize(
    ("primitive", "damping", "told"),
    [
        (GuardedMove(speed=0.01, threshold=7.9), None, ""),
        (
            GuardedMove(speed=0.01, threshold=8.0),
            None,
            "gmove -z ends at 8 N, allowed: less than 8 N, the damping times its speed",
        ),
        # Stiff accommodation reaches whatever it is told to, another damping another force.
        (GuardedMove(speed=0.01, threshold=8.0), (0.0,) * 5 + (math.inf,), ""),
        (GuardedMove(speed=0.01, threshold=8.0), (0.0,) * 5 + (900.0,), ""),
        (
            GuardedMove(speed=0.5, threshold=61.0),
            None,
            "gmove -z pushes with 61 N, allowed: at most 60 N, which 25-pin D withstands",
        ),
        (
            GuardedMove(direction="+rz", speed=2.0, threshold=1.6),
            None,
            "gmove +rz pushes with 1.6 N m, allowed: at most 1.5 N m, which 25-pin D withstands",
        ),
        (Stick(speed=0.075), None, ""),  # 60 N
        (Stick(speed=0.076), (0.0,) * 5 + (math.inf,), ""),
        (
            Stick(speed=0.076),
            None,
            "stick -z pushes with 60.8 N, allowed: at most 60 N, which 25-pin D withstands",
        ),
    ],
)
def test_forces_are_within_reach_and_what_the_connector_stands(
    primitive: Any, damping: tuple[float, ...] | None, told: str
) -> None:
    connector = DConnector(largest_force=60.0, largest_torque=1.5)
    one = state("go", primitive, on={"timed out": DONE}, damping=damping)
    usual = (1.2, 1.2, 1.2, 800.0, 800.0, 800.0)
    if not told:
        check_forces(skill(one), usual, connector)
        return
    with pytest.raises(ChartError) as refused:
        check_forces(skill(one), usual, connector)
    assert str(refused.value) == f"skill 'test': 'go': {told}"


def test_states_and_retries_refuse_what_they_can_not_mean() -> None:
    with pytest.raises(ParameterError, match=r"^at_most is 0, allowed: a whole number >= 1$"):
        Retry("go", 0)
    for damping in ((1.0,) * 5, (1.0,) * 5 + (-1.0,), (math.nan,) * 6):
        with pytest.raises(ParameterError, match=r"^damping is .*, allowed: six numbers >= 0, in"):
            state("go", Fake(), on={}, damping=damping)


def test_obstruction_is_looked_for_where_there_is_a_dither() -> None:
    watch = Obstructed(axes=("x", "y"), cycle=(0.5, 0.5))
    turn = Dither(kind="rotary", axis="y")  # is no dither along y
    with pytest.raises(ChartError, match="corr x, y watches y, but runs no dither"):
        make_skill_chart(skill(state("go", SHAKE, turn, watch, on={"hindered": DONE})))
