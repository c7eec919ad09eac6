"""The guard: what it lets through, what it holds back, when it stops, and that it always does."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.models.validation import ParameterError
from chamfer.systems.robot.command_guard import CommandGuard, CommandGuardParams, Reading
from chamfer.systems.robot.command_limits import (
    EffortLimits,
    Limits,
    PoseLimits,
    PositionLimits,
    VelocityLimits,
)

Array = NDArray[np.float64]

DRAWN: Final = int(os.environ.get("CHAMFER_FUZZ", "100"))
PERIOD, TIMEOUT = 0.01, 0.03  # s
SPEED, ACCELERATION = (1.0,) * 3 + (0.25,) * 3, (4.0,) * 3 + (1.0,) * 3
LOW, HIGH = (-0.1, -0.1, 0.0), (0.1, 0.1, 0.2)
HERE = np.array([1.0, 0, 0, 0, 0, 0, 0.1])
VELOCITY = VelocityLimits(
    speed=SPEED, acceleration=ACCELERATION, low=LOW, high=HIGH, measured="pose"
)
POSE = PoseLimits(speed=SPEED, acceleration=ACCELERATION, low=LOW, high=HIGH, measured="pose")
JOINTS = PositionLimits(
    speed=(1.0, 2.0), acceleration=(5.0, 8.0), low=(-1, -2), high=(1, 2), measured="q"
)
TORQUES = EffortLimits(most=(10.0, 5.0), rate=(200.0, 50.0), rest=(0.0, 1.0))
KINDS = {
    "velocity": (VELOCITY, np.zeros(6)),
    "pose": (POSE, HERE),
    "joints": (JOINTS, np.zeros(2)),
    "torques": (TORQUES, np.array([0.0, 1.0])),
}


def guard_of(limits: Limits) -> CommandGuard:
    return CommandGuard(
        CommandGuardParams(
            period=PERIOD,
            timeout=TIMEOUT,
            limits={"command": limits},
            torque=2.0,
            force=20.0,
            unchecked=("error",),
        )
    )


class Run:
    """Steps a guard, with readings that are as they should be unless told otherwise."""

    def __init__(self, limits: Limits) -> None:
        self.guard = guard_of(limits)
        self.state = self.guard.start()
        self.tick = 0
        self.causes: list[str] = []

    def step(self, asked: Sequence[float] | Array | None, **told: Any) -> Array:
        time = told.pop("time", self.tick * PERIOD)
        abort, measured = told.pop("abort", False), told.pop("measured", time)
        values = {"pose": HERE, "q": np.zeros(2), "wrench": np.zeros(6)} | told
        command = None if asked is None else {"command": np.array(asked, dtype=float)}
        reading = Reading(measured, values)
        self.state, sent, found = self.guard.step(self.state, reading, command, time, abort=abort)
        self.causes += [one.cause for one in found]
        self.tick += 1
        return sent["command"]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_allowed_goes_through_to_the_bit(kind: str) -> None:
    limits, asked = KINDS[kind]
    run, rng = Run(limits), np.random.default_rng(1)
    for _ in range(50):
        asked = asked + rng.uniform(-1e-6, 1e-6, limits.size)
        if limits is POSE:  # a quaternion and its negative are the same
            asked[:4] *= -1 / np.linalg.norm(asked[:4])
        assert run.step(asked).tobytes() == asked.tobytes()
    assert run.causes == []


def test_a_place_that_jumps_is_reached_without_overrunning_it() -> None:
    run, target = Run(POSE), np.array([-math.cos(0.4), 0, -math.sin(0.4), 0, 0.05, -0.05, 0.1])
    targets = [target + np.eye(7)[5] * 1e-4 * tick for tick in range(120)]  # and moves on
    sent = np.array([run.step(one) for one in targets])
    assert sent[-1].tobytes() == targets[-1].tobytes()
    assert sent[:, 4].max() <= 0.05
    assert np.abs(sent[:, 2]).max() <= math.sin(0.4) + 1e-12  # the short way round


@pytest.mark.parametrize(("step", "fresh"), [(PERIOD, 1), (0.5 * TIMEOUT, 2)])
def test_the_tool_slides_along_a_border_and_comes_back_from_outside(
    step: float, fresh: int
) -> None:
    run, place, seen = Run(VELOCITY), HERE.copy(), HERE
    for k in range(150):
        if k % fresh == 0:
            seen = place.copy()
        time, measured = k * step, (k - k % fresh) * step
        velocity = run.step([0, 0, 0, 0.2, 0.01, 0], pose=seen, time=time, measured=measured)
        place[4:] += velocity[3:] * step
        assert place[4] <= 0.1
    assert place[4] > 0.099
    assert velocity[4] == 0.01
    assert set(run.causes) == {"workspace", "acceleration"}
    run = Run(VELOCITY)
    outside = HERE + np.eye(7)[4] * 0.5
    assert run.step([0, 0, 0, 0.01, 0, 0], pose=outside)[3] == 0
    assert run.step([0, 0, 0, -0.01, 0, 0], pose=outside)[3] == -0.01


@pytest.mark.parametrize(
    ("cause", "told"),
    [
        ("abort", {"abort": True}),
        ("time", {"time": 0.04}),
        ("time", {"time": math.nan}),
        ("time", {"time": 0.01}),
        ("late", {"time": 0.08}),
        ("input", {"pose": HERE * [1, 1, 1, 1, 1, math.nan, 1]}),
        ("input", {"pose": None}),
        ("input", {"wrench": np.zeros(3)}),
        ("input", {"anything": np.array([0.0, math.inf])}),
        ("force", {"wrench": np.array([0, 0, 0, 15.0, 15, 0])}),
        ("torque", {"wrench": np.array([0, 1.5, 1.5, 0, 0, 0])}),
        ("command", {"asked": None}),
        ("command", {"asked": [0, 0, 0, 0.05, math.nan, 0]}),
        ("command", {"asked": [0.0] * 7}),
        ("command", {"asked": [0, 0, 0, 0, 0, 1e300]}),
    ],
)
def test_it_stops(cause: str, told: dict[str, Any]) -> None:
    run, asked = Run(VELOCITY), [0, 0, 0, 0.0, 0.05, 0]
    for _ in range(5):
        run.step(asked, error=np.full(6, math.nan))
    before, begin = len(run.causes), told.get("time", math.nan)
    begin = begin if math.isfinite(begin) else 0.05
    sent = [run.step(**{"asked": asked} | told)]
    sent += [run.step(asked, time=begin + i * PERIOD) for i in range(1, 6)]
    assert run.causes[before:] == [cause]
    steps = -np.diff([0.05, *(one[4] for one in sent)])
    assert steps.min() >= 0
    assert steps.max() <= (0.04 if cause == "late" else 0.01) + 1e-12
    assert not sent[-1].any()
    assert run.guard.at_rest(run.state)
    assert not run.step(asked, time=3.0).any()  # until it is reset
    run.state = run.guard.reset(run.state)
    assert run.step(asked, time=4.0)[4] == pytest.approx(0.01)


def test_a_pose_turns_the_shorter_way_about_the_world_s_axes() -> None:
    draws = np.random.default_rng(0).normal(size=(20, 2, 7))
    for place, target in draws:
        place[:4], target[:4] = (one[:4] / np.linalg.norm(one[:4]) for one in (place, target))
        start, end = (Rotation.from_quat(one[[1, 2, 3, 0]]) for one in (place, target))
        way = POSE._way(place, target)
        assert way[:3] == pytest.approx((end * start.inv()).as_rotvec(), abs=1e-9)
        reached = POSE._moved(place, way)
        assert abs(reached[:4] @ target[:4]) == pytest.approx(1.0, abs=1e-12)
        assert reached[4:] == pytest.approx(target[4:], abs=1e-12)


def test_a_pose_that_is_none_stops() -> None:
    for told in ({"asked": 2 * HERE}, {"asked": HERE, "pose": np.zeros(7)}):
        run = Run(POSE)
        run.step(HERE)
        assert run.step(**told).tolist() == HERE.tolist()  # type: ignore[arg-type]
        assert run.causes == [("command", "input")["pose" in told]]


def test_nothing_new_is_borne_for_the_timeout_and_no_longer() -> None:
    run = Run(VELOCITY)
    for _ in range(4):
        assert run.step([0, 0, 0, 0, 0.01, 0], measured=7.0)[4] == 0.01
    run.step(np.zeros(6), measured=7.0)
    run.step(np.zeros(6), measured=8.0)
    run.state = run.guard.reset(run.state)  # where it is then has to be measured anew
    run.step(np.zeros(6), measured=8.0)
    assert run.causes == ["stale", "stale"]


def test_what_has_no_limits_is_held_in_a_stop() -> None:
    params = replace(guard_of(TORQUES).params, limits={"command": TORQUES, "grip": None})
    guard = CommandGuard(replace(params, torque=math.inf, force=math.inf))
    asked, state = {"command": np.array([0.0, 1.0]), "grip": np.array([7.0])}, guard.start()
    for tick in range(2):
        state, sent, _ = guard.step(state, Reading(tick, {}), asked, 0.01 * tick, abort=tick > 0)
    assert sent["grip"].tolist() == [7.0]


def test_where_the_tool_may_not_have_gone_by_a_fast_clock_is_not_counted_on() -> None:
    run, place = Run(VELOCITY), HERE + np.eye(7)[4] * -0.1  # at the border
    told = {"pose": place, "measured": 1.0}
    sent = [run.step([0, 0, 0, v, 0, 0], **told)[3] for v in (5e-3, 5e-3, -1e-3)]
    assert sent == [5e-3, 5e-3, 0]


def test_an_effort_stops_at_rest_in_the_time_that_is_said() -> None:
    limits = replace(TORQUES, rest=(0.0, -1.0))
    assert guard_of(limits).stopping_time == pytest.approx(6 / 50 + TIMEOUT)
    run = Run(replace(TORQUES, rest=()))
    sent = np.array([run.step([4.0, 0.6], abort=tick > 2) for tick in range(5)])
    assert sent == pytest.approx(np.array([[2, 0.5], [4, 0.6], [4, 0.6], [2, 0.1], [0, 0]]))
    assert run.guard.at_rest(run.state)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: replace(VELOCITY, measured=""), "measured"),
        (lambda: replace(VELOCITY, high=(0.1, 0.1, 0.0)), "high"),
        (lambda: replace(POSE, low=(), high=(), measured=""), "measured"),
        (lambda: replace(POSE, speed=(1.0,) * 7, acceleration=(1.0,) * 7), "speed"),
        (lambda: replace(JOINTS, acceleration=(1.0, 0.0)), "acceleration"),
        (lambda: replace(TORQUES, rest=(0.0, 6.0)), "rest"),
        (lambda: replace(guard_of(POSE).params, timeout=0.001), "timeout"),
        (lambda: replace(guard_of(POSE).params, limits={"command": None}), "limits"),
    ],
)
def test_limits_that_mean_nothing_are_refused(make: Callable[[], object], name: str) -> None:
    with pytest.raises(ParameterError) as refused:
        make()
    assert refused.value.name == name


class Faulty:
    """A robot whose sensor and clock fail; it does as it is told, until its watchdog stops it."""

    def __init__(self, kind: str, faults: dict[str, float], rng: np.random.Generator) -> None:
        self.limits, self.home = KINDS[kind]
        self.faults, self.rng = faults, rng
        self.first, self.step = rng.choice([0, 10, 40]), rng.choice([1e-4, 0.003, 0.1, 3.0])
        self.place = np.array([1.0, 0, 0, 0, *rng.uniform(LOW, HIGH)])
        self.joints = rng.uniform(JOINTS.low, JOINTS.high)
        self.true = self.clock = 0.0  # s
        self.sent: Array | None = None
        self.reading = Reading(math.nan, {})
        self.wrong: set[str] = set()

    def tick(self) -> float:
        """Pass until the next tick, and return the time that the clock says it took."""
        rng = self.rng
        self.first -= 1  # ticks until something goes wrong
        wrong = {name for name, part in self.faults.items() if rng.random() < part}
        self.wrong = wrong = set() if self.first >= 0 else wrong
        passed = shown = PERIOD * rng.uniform(0.6, 1.4)
        if wrong & {"late", "missed"}:
            passed = shown = TIMEOUT * rng.uniform(*((1, 3) if "missed" in wrong else (0.4, 1)))
        elif wrong & {"still", "back"}:
            passed, shown = PERIOD, -float("back" in wrong) * rng.exponential()
        elif "ahead" in wrong:
            shown = rng.choice([2.9 * PERIOD, 10.0])
        self.true, self.clock = self.true + passed, self.clock + shown
        if self.limits is VELOCITY and self.sent is not None:
            self.place = self.place.copy()
            self.place[4:] += self.sent[3:] * min(passed, TIMEOUT)
        return float(shown)

    def read(self) -> Reading:
        rng, wrong = self.rng, self.wrong
        if "old" in wrong:
            return self.reading
        values: dict[str, Any] = {"pose": self.place, "q": self.joints, "wrench": np.zeros(6)}
        if "hit" in wrong:
            values["wrench"] = rng.normal(0, 10, 6)
        name = rng.choice(list(values))
        if "nan" in wrong:
            values[name] = values[name] * np.where(rng.random(len(values[name])) < 0.5, 1, np.nan)
        if "none" in wrong:
            values[name] = None
        stamp = rng.choice([math.nan, -1.0]) if "stamp" in wrong else self.true
        self.reading = Reading(stamp, values)
        return self.reading

    def asked(self, last: Array) -> Array:
        rng = self.rng
        asked = last + rng.normal(0, self.step, self.limits.size)
        if rng.random() < 0.1:
            asked = self.home + rng.normal(0, 30 * self.step, self.limits.size)
        if self.limits is POSE:
            asked[:4] /= np.linalg.norm(asked[:4])
        return asked


def bounds(limits: Limits) -> tuple[Array, Array]:
    """Return the largest size of what moves, and how fast that may change."""
    if isinstance(limits, EffortLimits):
        return np.array(limits.most), np.array(limits.rate)
    return np.array(limits.speed), np.array(limits.acceleration)


def way(limits: Limits, start: Array, end: Array) -> Array:
    """Return the way of a step, of each axis."""
    if limits is not POSE:
        return end - start
    turns = [Rotation.from_quat(one[:4], scalar_first=True) for one in (start, end)]
    return np.array([*(turns[1] * turns[0].inv()).as_rotvec(), *(end - start)[4:]])


FAULTS = (
    *("late", "missed", "still", "back", "ahead", "old", "stamp"),
    *("nan", "none", "hit", "bad"),
)


@settings(max_examples=DRAWN, derandomize="CHAMFER_FUZZ" not in os.environ)
@given(
    st.sampled_from(list(KINDS)),
    st.dictionaries(st.sampled_from(FAULTS), st.sampled_from([0.02, 0.2, 1.0]), max_size=3),
    st.integers(0, 2**32 - 1),
)
def test_no_limit_is_ever_violated(kind: str, faults: dict[str, float], seed: int) -> None:
    limits, asked = KINDS[kind]
    robot = Faulty(kind, faults, np.random.default_rng(seed))
    guard = guard_of(limits)
    most, change = bounds(limits)
    rest = asked if limits is TORQUES else np.zeros(len(most))
    state, stopped, motion = guard.start(), math.inf, rest
    for _ in range(80):
        shown = robot.tick()
        asked = robot.asked(asked)
        given = asked[1:] if "bad" in robot.wrong and robot.true < 0.1 else asked
        given = asked * math.nan if "bad" in robot.wrong and robot.true >= 0.1 else given
        last, first = robot.sent, math.isnan(state.time)
        state, sent, found = guard.step(state, robot.read(), {"command": given}, robot.clock)
        if state.stop is not None:
            stopped = min(stopped, robot.true)
        if "command" not in sent:  # it is not known where the robot is
            assert state.stop is not None
            continue
        robot.sent = answer = sent["command"]
        before = motion
        motion = answer
        if limits in (POSE, JOINTS):
            shown = max(shown, PERIOD)
            start = (robot.place if limits is POSE else robot.joints) if last is None else last
            motion = way(limits, start, answer) / PERIOD
        if first or shown <= 0:
            shown = PERIOD
        assert np.isfinite(answer).all()
        assert np.all(np.abs(motion) <= most + 1e-9)
        assert np.all(np.abs(motion - before) <= change * shown + 1e-9)
        if limits in (VELOCITY, POSE):
            place = robot.place if limits is VELOCITY else answer
            assert np.all(
                (place[4:] >= np.array(LOW) - 1e-9) & (place[4:] <= np.array(HIGH) + 1e-9)
            )
        if limits is JOINTS:
            assert np.all((answer >= JOINTS.low) & (answer <= JOINTS.high))
        if state.stop is None and not found:
            assert answer.tobytes() == given.tobytes()
        if robot.true > stopped + guard.stopping_time:
            assert guard.at_rest(state)
            assert np.array_equal(motion, rest)
