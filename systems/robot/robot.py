"""Run a law on a robot at a fixed rate, with a guard around the commands."""

import gc
import signal
import time as clocks
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError
from chamfer.systems.law import Law
from chamfer.systems.recording import Record
from chamfer.systems.robot.command_guard import CommandGuard, Intervention, Reading

Array = NDArray[np.float64]

_ROUNDING: Final = 1e-9  # s


class Robot(Protocol):
    """A robot, as its adapter presents it."""

    period: float  # s, between two commands

    def read(self) -> Reading:
        """Return the last measurements, without waiting."""

    def write(self, command: Mapping[str, Array]) -> None:
        """Send a command, vectors by name."""

    def stop(self) -> None:
        """Stop the robot; may be called at any time, and more than once."""


@dataclass(frozen=True, kw_only=True)
class RunReport:
    """The result of a run on a robot."""

    ticks: int
    missed: int  # ticks that were left out, because their time was over
    lateness: Mapping[str, float]  # s, by which ticks began late: median, 99 % and largest
    interventions: tuple[Intervention, ...]
    stopped: Intervention | None  # reason of the guard's stop; None: no stop
    state: Any  # last one of the law


def run_controller(
    robot: Robot,
    law: Law[Any, Any, Any],
    guard: CommandGuard,
    *,
    until: Callable[[Any, float], bool],
    abort: Callable[[], bool] = lambda: False,
    log: Callable[[Record], None] = lambda record: None,
    clock: Callable[[], float] = clocks.monotonic,
    sleep: Callable[[float], None] = clocks.sleep,
) -> RunReport:
    """Run a law on a robot until it has ended, or the guard has stopped the robot.

    The ticks are multiples of the period from the start, so that rounding does not add up; a tick
    whose time is over when it would begin is left out. However the run ends, the robot is stopped
    first: at the end, at Ctrl-C or a termination, and at any error, which is then raised. Once the
    guard stops, the law is aborted and not called again.

    Args:
        robot: The robot.
        law: Its inputs are the robot's readings, its outputs the robot's commands.
        guard: Decides which commands are sent.
        until: Whether it has ended, of the law's state and the time, s.
        abort: Whether somebody wants it to stop.
        log: Gets each step of the law: its inputs and its outputs.
        clock: Time, s, that only goes forward.
        sleep: Waits, s.

    Raises:
        ParameterError: If the periods differ, or a command is limited that the law does not give.
    """
    period = law.period
    for name, other in (("robot.period", robot.period), ("guard.period", guard.params.period)):
        if abs(other - period) > 1e-9 * period:
            raise ParameterError(name, other, f"that of the law, {period:g} s")
    for name, limits in guard.params.limits.items():
        signal_ = law.outputs.get(name)
        if signal_ is None or (limits is not None and limits.size != signal_.size):
            sizes = {one: given.size for one, given in law.outputs.items()}
            raise ParameterError(f"limits of {name}", limits, f"those of {sizes}")
    state, guarded, observation = law.start(), guard.start(), None
    late, interventions, tick, missed = list[float](), list[Intervention](), 0, 0
    with ExitStack() as afterwards, _stopped_at_the_end(robot):
        gc.collect()
        gc.freeze()  # to look through all that there is would pause ticks by 0.3 s
        afterwards.callback(gc.unfreeze)
        start = clock()
        while True:
            if (wait := start + tick * period - clock()) > _ROUNDING:
                sleep(wait)
            time = clock() - start
            late.append(time - tick * period)
            reading, aborted = robot.read(), abort()
            command = None
            if not (guarded.stop or guard.trouble(guarded, reading, time, abort=aborted)):
                observation = law.observe(reading.values)
                state, answer = law.step(state, observation, time)
                command = answer._asdict()
                log(Record(time, reading.values, command))
            before = guarded.stop
            guarded, sent, found = guard.step(guarded, reading, command, time, abort=aborted)
            if len(sent) == len(guard.params.limits):  # else it is not known yet where it is
                robot.write(sent)
            interventions += found
            if guarded.stop and not before and observation is not None:
                state = law.abort(state, observation, time)
            if guard.at_rest(guarded) or (not guarded.stop and until(state, time)):
                break
            # A robot's clock may leave out periods, whose ticks are then over too.
            begun, over = (int((one + _ROUNDING) // period) for one in (time, clock() - start))
            following = max(tick + 1, begun + 1, over)
            tick, missed = following, missed + following - tick - 1
    median, p99, largest = np.percentile(late, [50, 99, 100]).tolist()
    return RunReport(
        ticks=len(late),
        missed=missed,
        lateness={"median": median, "99 %": p99, "largest": largest},
        interventions=tuple(interventions),
        stopped=guarded.stop,
        state=state,
    )


@contextmanager
def _stopped_at_the_end(robot: Robot) -> Iterator[None]:
    """Stop the robot as the first thing when the block ends, however it does.

    A second Ctrl-C does not come between.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        for one in handled:
            signal.signal(one, signal.SIG_IGN)
        raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)

    handled = dict[int, Any]()
    try:
        with suppress(ValueError):  # not the main thread, to which signals go
            for one in (signal.SIGINT, signal.SIGTERM):
                handled[one] = signal.signal(one, interrupt)
        yield
        robot.stop()
    except BaseException as error:
        try:
            robot.stop()
        except Exception as trouble:
            error.add_note(f"the robot could not be stopped: {trouble!r}")
        raise
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)
