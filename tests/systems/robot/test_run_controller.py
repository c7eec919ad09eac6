"""A law on a robot: on time, through the guard, and stopped first whatever ends it."""

import os
import signal
import threading
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError
from chamfer.systems.law import Signal
from chamfer.systems.recording import Record
from chamfer.systems.robot.command_guard import CommandGuard, CommandGuardParams, Reading
from chamfer.systems.robot.command_limits import PositionLimits, VelocityLimits
from chamfer.systems.robot.robot import RunReport, run_controller
from chamfer.systems.statechart.chart import Chart, State, Transition
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput

Array = NDArray[np.float64]
PERIOD = 0.01  # s


class Seen(NamedTuple):
    place: tuple[float, ...]


def make_law() -> ChartLaw[Seen, tuple[float]]:
    """Return what goes to 0, as a chart that nothing but an abort ends."""
    states = [
        State[Seen, tuple[float]](name="go", during=lambda tick: (-2 * tick.inputs.place[0],)),
        State[Seen, tuple[float]](name="halted", entry=lambda tick: (0.0,), outcome="failed"),
    ]
    never = Transition[Seen, tuple[float]](
        source="go", target="halted", guard=lambda tick: False, label="never"
    )
    return ChartLaw(
        Chart("law", states=states, transitions=[never], memory=(0.0,)),
        observation=Seen,
        inputs={"place": Signal(1, "m")},
        outputs={"velocity": MachineOutput(unit="m/s", read=lambda memory: memory)},
        period=PERIOD,
    )


class Axis:
    """A robot of one axis, with a clock that only goes on when somebody waits or works."""

    period = PERIOD

    def __init__(self, **delays: float) -> None:
        self.now, self.place, self.velocity = 100.0, 0.2, 0.0
        self.calls: list[str] = []
        self.delays = {int(name[1:]): delay for name, delay in delays.items()}  # by tick
        self.ticks: list[float] = []

    def clock(self) -> float:
        return self.now

    def sleep(self, time: float) -> None:
        self.now += time
        self.place += self.velocity * time

    def read(self) -> Reading:
        self.sleep(self.delays.get(len(self.ticks), 0.0))
        self.ticks.append(self.now - 100)
        self.calls.append("read")
        return Reading(self.now, {"place": np.array([self.place])})

    def write(self, command: Mapping[str, Array]) -> None:
        self.calls.append("write")
        (self.velocity,) = command["velocity"]

    def stop(self) -> None:
        self.calls.append("stop")
        self.velocity = 0.0


def guard(**changes: Any) -> CommandGuard:
    limits = {"velocity": VelocityLimits(speed=(0.1,), acceleration=(1.0,))}
    return CommandGuard(
        CommandGuardParams(**{"period": PERIOD, "timeout": 0.03, "limits": limits} | changes)
    )


def run(robot: Axis, law: Any = None, **options: Any) -> RunReport:
    defaults = {"guard": guard(), "until": lambda state, time: time > 0.495}
    clocks = {"clock": robot.clock, "sleep": robot.sleep}
    return run_controller(robot, law or make_law(), **defaults | clocks | options)


def test_ticks_are_multiples_of_the_period_and_late_ones_are_counted() -> None:
    robot, records = Axis(t7=0.004, t9=0.025), list[Record]()
    report = run(robot, log=records.append)
    assert robot.ticks[6:12] == pytest.approx([0.06, 0.074, 0.08, 0.115, 0.115, 0.12])
    assert robot.ticks[12:] == pytest.approx([k * PERIOD for k in range(13, 51)])
    assert (report.ticks, report.missed) == (50, 1)
    assert report.lateness["largest"] == pytest.approx(0.005)  # of the eleventh
    assert [one.time for one in records[10:]] == pytest.approx(robot.ticks[10:])
    assert records[1].command["velocity"] == tuple(-2 * records[1].observation["place"])
    assert {one.cause for one in report.interventions} == {"velocity", "acceleration"}
    assert robot.place < 0.2 - 0.1 * 0.4
    assert robot.calls[-1] == "stop"


def test_a_period_that_the_robots_own_clock_leaves_out_is_a_missed_tick() -> None:
    class Pacing(Axis):
        def sleep(self, time: float) -> None:
            lost = abs(self.now - 100.2) < PERIOD / 2
            super().sleep(PERIOD * (2 if lost else 1))

        def read(self) -> Reading:
            self.ticks.append(self.now - 100)
            return Reading(self.now, {"place": np.array([self.place])})

    robot = Pacing()
    report = run(robot)
    assert report.stopped is None
    assert robot.ticks[20:23] == pytest.approx([0.20, 0.22, 0.23])
    assert (report.ticks, report.missed) == (50, 1)


def test_a_stop_of_the_guard_ends_the_run_at_rest() -> None:
    robot = Axis()
    report = run(robot, abort=lambda: robot.now > 100.3)
    assert report.stopped is not None
    assert report.stopped.cause == "abort"
    assert report.state.snapshot.state == "halted"
    assert [(one.source, one.label) for one in report.state.log] == [("go", "abort")]
    assert robot.velocity == 0
    assert robot.calls[-2:] == ["write", "stop"]
    robot, places = Axis(), PositionLimits(speed=(0.1,), acceleration=(1.0,), measured="place")
    run(robot, guard=guard(limits={"velocity": places}), abort=lambda: True)
    assert robot.calls == ["read", "stop"]  # it was never known from where it starts


@pytest.mark.parametrize("broken", ["read", "write", "step", "stop"])
def test_an_error_stops_the_robot_first_and_goes_on(
    broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, law = Axis(), make_law()

    def fail(*args: object) -> None:
        robot.calls.append(broken)
        raise OSError("broken")

    monkeypatch.setattr(law if broken == "step" else robot, broken, fail)
    with pytest.raises(OSError, match="broken") as failed:
        run(robot, law)
    assert robot.calls[robot.calls.index(broken) + 1 :] == ["stop"]
    assert bool(getattr(failed.value, "__notes__", [])) == (broken == "stop")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_stops_the_robot_and_a_second_one_does_not_come_between(
    number: signal.Signals,
) -> None:
    class Stubborn(Axis):
        def stop(self) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
            super().stop()

    robot, before = Stubborn(), signal.getsignal(signal.SIGINT)
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        run(robot, until=lambda state, time: bool(time > 0.2 and os.kill(os.getpid(), number)))
    assert robot.calls[-1] == "stop"
    assert signal.getsignal(signal.SIGINT) is before


def test_it_runs_beside_the_main_thread_where_signals_do_not_go() -> None:
    reports = list[RunReport]()
    thread = threading.Thread(target=lambda: reports.append(run(Axis())))
    thread.start()
    thread.join()
    assert reports[0].ticks == 51


def test_what_does_not_fit_is_refused_before_the_robot_is_touched() -> None:
    robot, towards = Axis(), VelocityLimits(speed=(0.1,) * 2, acceleration=(1.0,) * 2)
    with pytest.raises(ParameterError, match="limits of velocity"):
        run_controller(robot, make_law(), guard(limits={"velocity": towards}), until=bool)
    with pytest.raises(ParameterError, match=r"guard\.period is 0\.02"):
        run_controller(robot, make_law(), guard(period=0.02), until=bool)
    assert robot.calls == []
