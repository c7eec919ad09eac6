import importlib
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.benchmarks.agreement import agree, exact
from chamfer.analysis.benchmarks.case import Case, make_case
from chamfer.analysis.benchmarks.engine import SOURCES, Engine, LoopName, Source
from chamfer.analysis.benchmarks.exact import exact_pid
from chamfer.diagrams.servo.servo_scenario import StepScenario

# Long enough for the whole transient of the PID, and for both increments of the FSM.
_DURATION: dict[LoopName, float] = {"pid": 0.1, "fsm": 2.5}


@pytest.fixture(scope="module")
def cases() -> dict[LoopName, Case]:
    return {loop: make_case(duration) for loop, duration in _DURATION.items()}


@pytest.mark.parametrize("loop", ["pid", "fsm"])
@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.module)
def test_engine_agrees_with_the_exact_solution(
    cases: dict[LoopName, Case], source: Source, loop: LoopName
) -> None:
    pytest.importorskip(source.requires)
    case = cases[loop]
    module = importlib.import_module(f"chamfer.analysis.benchmarks.{source.module}")
    solution = exact(case, loop)
    for engine in module.engines(case, loop):
        agreement = agree(engine, case, loop, solution)
        assert agreement.ok, agreement


def test_exact_fsm_takes_both_increments_and_comes_to_rest(cases: dict[LoopName, Case]) -> None:
    output = exact(cases["fsm"], "fsm")
    fsm = cases["fsm"].scenario.fsm
    assert output[0] == 0.0
    assert abs(output[-1] - 1.0) < fsm.dead_zone
    assert output.max() < 1.005


def test_exact_pid_ends_where_the_final_value_theorem_says() -> None:
    case = make_case()
    _, i, _, _ = case.gains
    stiffness = case.mass_damping_stiffness[2]
    assert exact_pid(case)[-1] == pytest.approx(i / (i + stiffness), abs=1e-9)


@pytest.mark.parametrize(
    ("error", "increments"),
    [
        (0.0, 0.0),
        (0.0074, 0.0),  # shown as 0.005, inside the dead zone
        (0.0076, 0.2),  # shown as 0.010, on its edge
        (-0.0076, -0.2),
        (0.9, 1.0),
        (-0.9, -1.0),
    ],
)
def test_law(cases: dict[LoopName, Case], error: float, increments: float) -> None:
    case = cases["fsm"]
    increment = case.scenario.fsm.increment
    assert increment is not None
    assert case.compensate(0.0, error) == pytest.approx(increments * increment)


def test_law_stops_at_the_limit(cases: dict[LoopName, Case]) -> None:
    limit = cases["fsm"].scenario.fsm.limit
    assert limit is not None
    assert cases["fsm"].compensate(limit, 0.9) == limit
    assert cases["fsm"].compensate(-limit, -0.9) == -limit


def test_open_scenario_is_refused() -> None:
    with pytest.raises(ValueError, match="open values"):
        Case(scenario=StepScenario()).compensate(0.0, 1.0)


def _engine(case: Case, change: float) -> Engine:
    return Engine(
        name="an engine",
        build=lambda: None,
        run=lambda _: exact(case, "fsm") + change,
        accuracy=1e-6,
        note="",
    )


@pytest.mark.parametrize(("change", "ok"), [(0.0, True), (1e-7, True), (1e-5, False)])
def test_a_difference_beyond_the_promise_shows(
    cases: dict[LoopName, Case], change: float, ok: bool
) -> None:
    case = cases["fsm"]
    agreement = agree(_engine(case, change), case, "fsm", exact(case, "fsm"))
    assert agreement.ok is ok
    assert agreement.difference == pytest.approx(change, abs=1e-12)


def test_a_result_that_is_not_a_number_does_not_agree(cases: dict[LoopName, Case]) -> None:
    case = cases["fsm"]
    agreement = agree(_engine(case, np.nan), case, "fsm", exact(case, "fsm"))
    assert not agreement.ok
    assert agreement.failure == "gave a result that is not finite"


def test_an_engine_that_fails_or_is_too_short_is_named(cases: dict[LoopName, Case]) -> None:
    case, solution = cases["fsm"], exact(cases["fsm"], "fsm")

    def fail(_: object) -> np.ndarray:
        raise RuntimeError("no\nsuch block")

    failed = agree(replace(_engine(case, 0.0), run=fail), case, "fsm", solution)
    assert failed.failure == "RuntimeError: no such block"
    assert not failed.ok
    short = agree(replace(_engine(case, 0.0), run=lambda _: solution[1:]), case, "fsm", solution)
    assert short.failure == "gave 200 samples instead of 201"
