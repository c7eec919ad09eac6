"""An insertion with the controller in this process, and the robot in another one."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.cell.alignment_runs import row_before
from chamfer.analysis.insertion.cell_runs import (
    CellInsertion,
    cell_insertion,
    force_medians,
    is_over,
)
from chamfer.analysis.insertion.insertion import outcome_of
from chamfer.analysis.report.check_text import number
from chamfer.analysis.scenario.errors import ExperimentError
from chamfer.analysis.scenario.experiment import Outcome, Progress
from chamfer.analysis.scenario.scenario_io import unstructure
from chamfer.diagrams.insertion.insertion import (
    INSERTION,
    ResolvedInsertionScenario,
    controller_of,
)
from chamfer.systems.recording import Record, Records, active
from chamfer.systems.robot.command_guard import CommandGuard, CommandGuardParams, Intervention
from chamfer.systems.robot.command_limits import PoseLimits, VelocityLimits
from chamfer.systems.robot.link import LinkError, process
from chamfer.systems.robot.robot import run_controller
from chamfer.systems.robot.simulated_robot import SimulatedRobot
from chamfer.systems.strategies.insertion_controller import ControllerState, InsertionController

_ROBOT: Final = "chamfer.analysis.drive.simulated_insertion"  # the module of its process
_WAITS: Final = 0.8  # of a period, for which the robot waits for an answer
_PERIODS: Final = 4  # that the robot goes on without a command, and the controller without news
_SPEED: Final = 0.05  # m/s, of a tool along an axis; assumed, more if it is fed faster
_TURN: Final = 0.5  # rad/s, likewise about it; assumed
_MARGIN: Final = 0.05  # m, of the workspace around where the peg is to go; assumed


def _guard(scenario: ResolvedInsertionScenario, law: InsertionController) -> CommandGuard:
    """Return the limits of commands: poses around the hole, at twice the intended speed."""
    period, offset = scenario.cameras.frames.period, math.hypot(*scenario.start_offset)
    # The feed, and the cubic motion to the gap at its fastest.
    speed = max(_SPEED, 2 * scenario.insert.speed, 3 * offset / scenario.motion_time)
    # Within a period a tool may begin or end to move: compensations are steps.
    motion: dict[str, Any] = {
        "speed": (*(_TURN,) * 3, *(speed,) * 3),
        "acceleration": (*(_TURN / period,) * 3, *(speed / period,) * 3),
    }
    mouth = np.array(scenario.mouth)
    reach = scenario.gap + scenario.insert.feed + offset + _MARGIN
    room: dict[str, Any] = {"low": tuple(mouth - reach), "high": tuple(mouth + reach)}
    limits: dict[str, Any] = dict.fromkeys(law.outputs)
    limits["peg_velocity"] = VelocityLimits(**motion)
    for arm in scenario.arms:
        name = f"{arm}_pose"
        limits[name] = PoseLimits(**motion, **room, measured=name)
    timeout = _PERIODS * period
    return CommandGuard(CommandGuardParams(period=period, timeout=timeout, limits=limits))


def drive(
    scenario: ResolvedInsertionScenario, seed: int, progress: Progress, *, rate: float | None
) -> Outcome:
    """Insert the peg once, by a robot in another process.

    Inputs and outputs of the controllers are recorded as in a diagram, if a recorder is active.

    Args:
        scenario: Resolved.
        seed: Random seed of the robot.
        progress: Receives the progress.
        rate: Seconds that the robot simulates in one; None: it steps on request.

    Raises:
        ExperimentError: If the robot ends or does not answer, or the guard stops it.
    """
    law, records = controller_of(scenario), list[Record]()
    guard = _guard(scenario, law)
    order = {
        "scenario": unstructure(scenario),
        "seed": seed,
        "rate": rate,
        "waits": None if rate is None else _WAITS * law.period / rate,
        "timeout": guard.params.timeout,
    }

    def until(state: ControllerState, now: float) -> bool:
        task = state.task.snapshot
        progress(now / scenario.duration, f"{now:.0f} s of the task, {task.state}")
        return is_over(law.task.chart, task, now) or now >= scenario.duration - law.period

    progress(0.0, "the robot starts")
    try:
        with process(_ROBOT, order) as link:
            robot = SimulatedRobot(link, period=law.period)
            ways: dict[str, Any] = {"clock": robot.clock, "sleep": robot.sleep}
            began = time.monotonic()
            report = run_controller(robot, law, guard, until=until, log=records.append, **ways)
            seconds = time.monotonic() - began
            truth = robot.log()
    except LinkError as error:
        raise ExperimentError(f"the simulated robot {error}") from error
    except SystemExit as error:  # of a termination, which ends commands as Ctrl-C does
        raise KeyboardInterrupt from error
    if report.stopped is not None:
        raise ExperimentError(f"the robot was stopped: {_text(report.stopped)}")
    _record(law, records)
    done = cell_insertion(
        scenario, truth.pop("time"), truth, law.task.chart, report.state.task.log, seconds
    )
    outcome = outcome_of(scenario, done, seed)
    late = np.array(robot.answers)
    shares = {"median": 50, "p99": 99, "largest": 100}
    lateness = {name: float(np.percentile(late, share)) for name, share in shares.items()}
    missed = 0 if rate is None else int(np.sum(late > order["waits"]))
    seating, note = _seating(scenario, done), outcome.metrics["said_seated"].note
    peak, changes = outcome.metrics["force.contact"].value, len(report.interventions)
    said = (
        f"{note}: largest force {number(peak)} N, as the feed ends {number(seating)} N. The robot "
        f"ran at {robot.pace:.2f} of real time. Of {report.ticks} measurements half were answered "
        f"within {1e3 * lateness['median']:.1f} ms, 99 % within {1e3 * lateness['p99']:.1f} ms, "
        f"all within {1e3 * lateness['largest']:.1f} ms; {missed} too late for the robot. The "
        f"guard changed {changes} commands."
    )
    answered = "of real time, from a measurement until it is answered"
    driven = metrics_of(
        {
            "force.seating": (seating, "N", "of the contact as the feed ends"),
            "real_time_factor": (robot.pace, "", "of the robot"),
            **{f"lateness.{name}": (one, "s", answered) for name, one in lateness.items()},
            "ticks": (float(report.ticks), ""),
            "ticks.missed": (float(missed), "", "answered too late for the robot's period"),
            "interventions": (float(changes), "", "; ".join(map(_text, report.interventions))),
            "answer": (outcome.metrics["seated"].value, "", said),
        }
    )
    return replace(outcome, metrics={**outcome.metrics, **driven})


def _seating(scenario: ResolvedInsertionScenario, done: CellInsertion) -> float | None:
    """Return the force of the contact when the last feed ended, N."""
    if (ended := done.entered("check")) is None:
        return None
    row = row_before(done.traces["time"], ended)
    return math.hypot(*(one[row] for one in force_medians(done.traces, scenario.step)))


def _record(law: InsertionController, records: Sequence[Record]) -> None:
    """Pass inputs and outputs of each law to the active recorder, under its block's path."""
    if (recorder := active()) is None:
        return
    state, kept = law.start(), {name: Records(one) for name, one in law.laws.items()}
    for record in records:
        state, each = law.steps(state, law.observe(record.observation), record.time)
        for name, one in each.items():
            kept[name].append(one)
    recorder.runs |= {f"{INSERTION}::{name}": [each] for name, each in kept.items()}


def _text(one: Intervention) -> str:
    of = f" of {one.name}" if one.name else ""
    return f"{one.cause}{of}, {one.value:.4g}, allowed {one.limit:.4g}, at {one.time:.4g} s"
