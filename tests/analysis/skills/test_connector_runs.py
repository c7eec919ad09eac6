from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.skills.connector_runs import (
    INSERTION,
    failure,
    insertion_metrics,
    run_insertion,
    skill_charts,
)
from chamfer.analysis.skills.skill_run import AXES, SkillResult, Step
from chamfer.diagrams.skills.connector_insertion import (
    AnyConnectorScenario,
    BncConnectorScenario,
    DConnectorScenario,
)
from chamfer.systems.sensing.force_sensor import WrenchSensorParams
from chamfer.systems.strategies.d_strategy import DConnectorSkillParams

D = DConnectorScenario(sight=None)
MATED = D.connector.mated_depth
DONE = (
    Step(0.5, "approach", "level", "contact", "contact"),
    Step(1.5, "verify", "done", "hindered", "hindered"),
)


def inserted(
    path: tuple[Step, ...] = DONE, reason: str = "", depth: float = MATED, turn: float = 0.0
) -> SkillResult:
    time = np.array([0.0, 1.0, 2.0])
    traces = {"time": time, "depth": np.array([0.0, 0.001, depth]), "retries": time / 2}
    traces["turn"] = np.full(3, turn)
    state = path[-1].target if path else "approach"
    ended = {"done": "done", "failed": "failed"}.get(state, "running")
    return SkillResult(
        outcome=ended,  # type: ignore[arg-type]
        state=state,
        reason=reason,
        path=path,
        traces=traces,
        peaks=np.array([0.1, 0.2, 0.0, 99.0, 0.0, 23.0]),
        wall_seconds=0.5,
    )


def test_metrics_of_a_run() -> None:
    found = insertion_metrics(inserted(), D)
    assert set(found) == set(INSERTION)
    share = found.pop("force.peak_share")  # type: ignore[attr-defined]
    assert share == pytest.approx(23.0 / D.connector.mating_force)
    assert found == {
        "success": 1.0,
        "duration": 2.0,
        "depth": MATED,
        "force.peak": 23.0,  # a force across does not count
        "torque.peak": 0.2,
        "retries": 1.0,
        "real_time_factor": 4.0,
    }


@pytest.mark.parametrize(
    ("done", "reason"),
    [
        (inserted(), ""),
        (inserted(depth=MATED + 0.0004), ""),
        (inserted(depth=0.0025), "said to be done 2.50 mm deep, mated is 5.60 mm"),
        (inserted(depth=MATED + 0.0006), "said to be done 6.20 mm deep, mated is 5.60 mm"),
        (
            inserted((Step(1.0, "retract", "failed", "over", "over"),), "push: jammed"),
            "push: jammed",
        ),
        # A plug that is in by chance is no success of a skill that failed.
        (inserted(DONE[:1]), "level: still running after 2 s"),
        (inserted(()), "approach: still running after 2 s"),
    ],
)
def test_why_a_run_is_no_success(done: SkillResult, reason: str) -> None:
    assert failure(done, D) == reason
    assert insertion_metrics(done, D)["success"] == float(not reason)


@pytest.mark.parametrize(("scenario", "name"), [(D, "D"), (BncConnectorScenario(), "BNC")])
def test_the_chart_is_the_skills(scenario: AnyConnectorScenario, name: str) -> None:
    (chart,) = skill_charts(scenario)
    assert chart.name == f"{name} connector"
    assert chart.initial == ("tare" if scenario.sight is None else "reach")


def test_a_bayonet_that_is_not_locked_is_no_success() -> None:
    bnc = BncConnectorScenario()
    deep = bnc.connector.mated_depth
    assert failure(inserted(depth=deep, turn=-1.6), bnc) == ""
    said = failure(inserted(depth=deep, turn=-0.6), bnc)
    assert said.endswith("deep, mated is 7.26 mm, it is turned 56 degrees from there")


def test_a_state_that_fails_reports_what_happened_in_it() -> None:
    skill = DConnectorSkillParams(approach_limit=0.002, retract=0.001)
    done = run_insertion(replace(D, skill=skill, height=0.01), 0)
    assert [(one.source, one.outcome, one.label) for one in done.path] == [
        ("tare", "done", "done"),
        ("beside", "done", "done"),
        ("touch", "lost", "otherwise"),
        ("retract", "over", "over"),
    ]
    assert failure(done, D) == done.reason == "touch: lost"
    traces = done.traces
    columns = {f"{name}_{axis}" for name in ("V_cmd", "V_ref", "wrench") for axis in AXES}
    columns |= {f"{name}_{axis}" for name in ("carriage", "plug", "true_wrench") for axis in AXES}
    columns |= {"time", "holding", "retries", "state", "depth", "lateral_x", "lateral_y"}
    assert set(traces) == columns | {"tilt", "turn"}
    assert all(len(column) == len(traces["time"]) for column in traces.values())
    np.testing.assert_allclose(traces["plug_z"], -traces["depth"])
    assert done.wall_seconds > 0


def test_a_run_that_is_cut_off_says_where() -> None:
    done = run_insertion(replace(D, duration=0.2), 0)
    assert (done.path, done.reason) == ((), "")
    assert failure(done, D) == "tare: still running after 0.2 s"


# Contact-rich searches may be chaotic: these begin near the socket's middle, where the search has
# nothing to find, or, with the BNC connector, only the slots.
CONVERGENCE: dict[str, AnyConnectorScenario] = {
    "d": DConnectorScenario(
        sight=None, height=0.001, initial_error=(0.01, 0.0, 0.005, 1e-4, 5e-5, 0.0)
    ),
    "bnc": BncConnectorScenario(
        sight=None, height=0.001, initial_error=(0.0, 0.0, -0.12, 0.0, 0.0, 0.0)
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CONVERGENCE)
def test_a_finer_step_changes_neither_depth_nor_peak_force(name: str) -> None:
    still = WrenchSensorParams()
    scenario = replace(CONVERGENCE[name], sensor=still)
    coarse, fine = (
        insertion_metrics(run_insertion(replace(scenario, step=step), 0), scenario)
        for step in (0.001, 0.0005)
    )
    values: list[dict[str, Any]] = [dict(coarse), dict(fine)]
    assert [one["success"] for one in values] == [1.0, 1.0]
    assert values[1]["force.peak"] == pytest.approx(values[0]["force.peak"], rel=0.02)
    assert values[1]["depth"] == pytest.approx(values[0]["depth"], abs=2e-5)
