"""Times of Chamfer alone: a fresh process, loops against real time, surface observers."""

import gc
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, Final, NamedTuple

from pydrake.systems.framework import Diagram

from chamfer.analysis.benchmarks.__main__ import THREADS
from chamfer.analysis.contact.contact_runs import measure, run_contact
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.surface.normal_trials import (
    Contender,
    contender,
    cost,
    observer_of,
    slide,
)
from chamfer.analysis.surface.unknown_surface import run_surface
from chamfer.diagrams.cell.alignment import make_alignment_diagram
from chamfer.diagrams.cell.alignment import resolve as resolve_alignment
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.diagrams.charging.charging_loop import make_charging_diagram
from chamfer.diagrams.charging.charging_scenario import CRUCIBLE_CHARGING, resolve_charging
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    ADEPT_NUGGET_MOTION,
    ADEPT_ROLLER_HOLD,
    ADEPT_ROLLER_MOTION,
    PLANAR_SLIDE,
    PUMA_ROLLER_MOTION,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.diagrams.insertion.insertion import InsertionScenario, make_insertion_diagram
from chamfer.diagrams.insertion.insertion import resolve as resolve_insertion
from chamfer.diagrams.skills.connector_loop import make_connector_diagram
from chamfer.diagrams.skills.connector_scenario import BncConnectorScenario, DConnectorScenario
from chamfer.diagrams.skills.connector_scenario import resolve as resolve_connector
from chamfer.diagrams.surface.surface_estimation import EstimationScenario, resolve_estimation
from chamfer.diagrams.surface.surface_scenario import THESIS, ObserverSettings
from chamfer.diagrams.surface.surface_tracking import (
    TrackingScenario,
    make_tracking_diagram,
    resolve_tracking,
)
from chamfer.systems.cameras.vtk_camera import missing_graphics
from chamfer.systems.estimation.normal_filter import KINDS, ConstrainedFilter, ObserverKind

Rounds = dict[str, list[float]]  # a value per round, by name

IMPORTS: Final = "import pydrake, control, matplotlib"
ALL_IMPORTS: Final = "import pydrake.all, control, matplotlib"
COMMAND: Final = "chamfer run step-response"
NEWTON: Final = "thesis, by Newton's iteration"

SLIDES: Final = "20 slides of 10 s"
REAL_TIME: Final = {  # simulated over elapsed, at least
    "planar-slide": 60.0,
    SLIDES: 1e4 / 30,  # 1,000 of them in 30 s
    "puma-roller-motion": 25.0,
    "adept-roller-hold": 25.0,
    "adept-roller-motion": 25.0,
    "adept-nugget-hold": 25.0,
    "adept-nugget-motion": 25.0,
    "unknown-surface-control": 5.0,
    "unknown-surface-control, adaptive": 25.0,
    "alignment": 4.0,
    "alignment, VTK": 0.5,
    "insertion, contact at 2 ms": 3.0,
    "insertion, contact at 1 ms": 2.0,
    "d-connector": 12.0,
    "bnc-connector": 12.0,
    "crucible-charging, realistic": 6.0,
}
UPDATES: Final[Mapping[str, float]] = {"thesis": 40.0, "adaptive": 200.0}  # us, at most


def measure_cold_start(times: Rounds, failures: dict[str, str], *, rounds: int) -> None:
    """Time the command in a fresh process, s, against the imports that every result needs.

    The processes start in turns, with any number of threads; the first round only warms the file
    cache. One that fails is not started again, and its last line is kept.
    """
    python = sys.executable
    with tempfile.TemporaryDirectory() as folder:
        run = ["-m", "chamfer.analysis.cli", "run", "step-response", "--fresh", "--out", folder]
        commands = {
            IMPORTS: [python, "-c", IMPORTS],
            ALL_IMPORTS: [python, "-c", ALL_IMPORTS],
            COMMAND: [python, *run],
        }
        for number in range(rounds + 1):
            for name in [name for name in commands if name not in failures]:
                elapsed, failure = _start(commands[name])
                if failure:
                    failures[name] = failure
                elif number > 0:
                    times.setdefault(name, []).append(elapsed)


def _start(command: Sequence[str]) -> tuple[float, str]:
    start = perf_counter()
    process = subprocess.run(
        command,
        env={name: value for name, value in os.environ.items() if name not in THREADS},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    elapsed = perf_counter() - start
    if process.returncode == 0:
        return elapsed, ""
    return elapsed, (process.stderr.strip().splitlines() or [f"status {process.returncode}"])[-1]


class TimedLoop(NamedTuple):
    """A loop to be timed."""

    make: Callable[[], Diagram]
    duration: float  # s
    period: float  # s, between two rows of the log
    missing: Callable[[], str | None] = lambda: None  # why it can't run on this machine
    run: Callable[[float], object] | None = None  # for a time, s, what runs do without the diagram


def loops() -> Mapping[str, TimedLoop]:
    """Return the timed loops, by experiment."""

    def hybrid(scenario: HybridScenario) -> TimedLoop:
        resolved = resolve(scenario)
        make = partial(make_hybrid_diagram, resolved)
        timed = TimedLoop(make, resolved.duration, resolved.controller.period)
        return timed._replace(run=lambda time: run_contact(replace(resolved, duration=time), 0))

    def tracking(kind: ObserverKind) -> TimedLoop:
        resolved = resolve_tracking(TrackingScenario(observer=ObserverSettings(kind=kind)))
        make = partial(make_tracking_diagram, resolved)
        timed = TimedLoop(make, resolved.duration, resolved.observer.period)
        return timed._replace(run=lambda time: run_surface(replace(resolved, duration=time), 0))

    def alignment(**settings: Any) -> TimedLoop:
        scenario = AlignmentScenario(cameras=CameraSettings(**settings))
        make = partial(make_alignment_diagram, resolve_alignment(scenario))
        return TimedLoop(make, scenario.duration, scenario.cameras.frames.period)

    def insertion(step: float) -> TimedLoop:
        scenario = resolve_insertion(InsertionScenario(step=step))
        return TimedLoop(partial(make_insertion_diagram, scenario), 6.7, step)

    def connector(scenario: DConnectorScenario | BncConnectorScenario, time: float) -> TimedLoop:
        make = partial(make_connector_diagram, resolve_connector(scenario))
        return TimedLoop(make, time, scenario.accommodation.period)

    long = resolve(replace(PLANAR_SLIDE, duration=10.0))

    def slides(time: float) -> None:
        for seed in range(max(1, round(time / long.duration))):  # one to warm up
            measure(long, run_contact(long, seed))

    charging = resolve_charging(replace(CRUCIBLE_CHARGING, sensing="realistic"))
    timed = {
        "planar-slide": hybrid(PLANAR_SLIDE),
        "puma-roller-motion": hybrid(PUMA_ROLLER_MOTION),
        "adept-roller-hold": hybrid(ADEPT_ROLLER_HOLD),
        "adept-roller-motion": hybrid(ADEPT_ROLLER_MOTION),
        "adept-nugget-hold": hybrid(ADEPT_NUGGET_HOLD),
        "adept-nugget-motion": hybrid(ADEPT_NUGGET_MOTION),
        "unknown-surface-control": tracking("thesis"),
        "unknown-surface-control, adaptive": tracking("adaptive"),
        "alignment": alignment(renderer="software"),
        "alignment, VTK": alignment(renderer="vtk")._replace(missing=missing_graphics),
        "insertion, contact at 2 ms": insertion(0.002),
        "insertion, contact at 1 ms": insertion(0.001),
        "d-connector": connector(DConnectorScenario(), 20.0),
        "bnc-connector": connector(BncConnectorScenario(), 25.0),
        "d-connector, WAM": connector(DConnectorScenario(robot="wam"), 20.0),
        "crucible-charging, realistic": TimedLoop(
            partial(make_charging_diagram, charging), 30.0, charging.controller.period
        ),
    }
    # The same in Drake, as a user extends it.
    wired = {f"{name}, diagram": one._replace(run=None) for name, one in timed.items() if one.run}
    batch = timed["planar-slide"]._replace(run=slides, duration=20 * long.duration)
    return {**timed, **wired, SLIDES: batch}


def measure_real_time(
    factors: Rounds, *, rounds: int, timed: Mapping[str, TimedLoop] | None = None
) -> None:
    """Run each loop once a round on one core, and keep simulated over elapsed seconds.

    A first short run compiles the functions; loops with missing dependencies are left out.
    """
    timed = loops() if timed is None else timed
    timed = {name: loop for name, loop in timed.items() if loop.missing() is None}
    for loop in timed.values():
        _run(loop, 10 * loop.period)
    for _ in range(rounds):
        for name, loop in timed.items():
            elapsed = _run(loop, loop.duration)
            factors.setdefault(name, []).append(loop.duration / elapsed)


def _simulate(diagram: Diagram, period: float, duration: float) -> None:
    simulate(diagram, duration=duration, step=period)


def _run(loop: TimedLoop, duration: float) -> float:
    run = loop.run or partial(_simulate, loop.make(), loop.period)
    gc.collect()
    start = perf_counter()
    run(duration)
    return perf_counter() - start


def measure_updates(seconds: dict[str, float], *, updates: int = 5000) -> None:
    """Find the least time of an update, s, of every surface observer on Fig. 5-3's slide."""
    scenario = resolve_estimation(EstimationScenario(duration=15.0))
    on = slide(scenario)
    contenders: dict[str, Contender] = {
        kind: contender(scenario, ObserverSettings(kind=kind), on) for kind in KINDS
    }
    newton = ConstrainedFilter(observer_of(scenario, THESIS), solver="newton")
    contenders[NEWTON] = Contender(filter=newton, predicted=None)
    for name, one in contenders.items():
        seconds[name] = cost(one, on, up=scenario.up, updates=updates)
