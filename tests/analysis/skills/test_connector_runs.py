from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.skills.connector_runs import (
    AXES,
    INSERTION,
    AnyConnectorScenario,
    Insertion,
    Step,
    failure,
    insertion_metrics,
    path_table,
    run_insertion,
    skill_charts,
    true_motion,
)
from diagrams.skills.connector_insertion import BncConnectorScenario, DConnectorScenario
from diagrams.skills.connector_loop import WristSensorParams
from models.wrist import tip_pose
from systems.skills.d_connector import DConnectorSkillParams

D = DConnectorScenario(sight=None)
MATED = D.connector.mated_depth
DONE = (
    Step(0.5, "approach", "level", "contact", "contact"),
    Step(1.5, "verify", "done", "hindered", "hindered"),
)
angles = st.floats(-0.4, 0.4)
ways = st.floats(-0.05, 0.05)


def inserted(path: tuple[Step, ...] = DONE, reason: str = "", depth: float = MATED) -> Insertion:
    time = np.array([0.0, 1.0, 2.0])
    traces = {"time": time, "depth": np.array([0.0, 0.001, depth]), "retries": time / 2}
    traces |= {f"wrench_{axis}": np.zeros(3) for axis in AXES}
    traces["wrench_z"] = np.array([0.0, -23.0, 4.0])
    traces["wrench_x"] = np.array([0.0, 99.0, 0.0])
    traces["wrench_ry"] = np.array([0.1, -0.2, 0.0])
    return Insertion(traces, path, reason, wall_seconds=0.5)


def test_metrics_of_a_run() -> None:
    found = insertion_metrics(inserted(), D)
    assert set(found) == set(INSERTION)
    share = found.pop("force.peak_share")  # type: ignore[attr-defined]
    assert share == pytest.approx(23.0 / D.connector.mating_force)
    assert found == {
        "success": 1.0,
        "duration": 2.0,
        "depth": MATED,
        "force.peak": 23.0,  # a pull counts, a force across does not
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
def test_why_a_run_is_no_success(done: Insertion, reason: str) -> None:
    assert failure(done, D) == reason
    assert insertion_metrics(done, D)["success"] == float(not reason)


def test_the_path_as_a_table() -> None:
    table = path_table(DONE)
    assert list(table) == ["entered", "time", "source", "target", "outcome", "label"]
    np.testing.assert_array_equal(table["entered"], [0.0, 0.5])
    np.testing.assert_array_equal(table["time"], [0.5, 1.5])
    assert table["outcome"].tolist() == ["contact", "hindered"]
    assert {len(values) for values in path_table(()).values()} == {0}


@given(displacement=st.tuples(angles, angles, angles, ways, ways, ways))
def test_true_motion_of_a_plug_that_is_held_straight(displacement: tuple[float, ...]) -> None:
    X = tip_pose(np.array(displacement))
    found = true_motion(np.array([displacement]), np.zeros(3))
    x, y, z = X.translation()
    assert found["depth"][0] == -z
    assert (found["lateral_x"][0], found["lateral_y"][0]) == (x, y)
    axis = X.rotation().matrix()[:, 2]
    assert np.cos(found["tilt"][0]) == pytest.approx(axis[2], abs=1e-12)


@given(grasp=st.tuples(angles, angles, angles))
def test_a_grasp_that_is_undone_leaves_no_tilt_and_no_turn(grasp: tuple[float, ...]) -> None:
    X_TP = tip_pose(np.array([*grasp, 0.0, 0.0, 0.0]))
    R = X_TP.rotation().inverse().matrix()
    undone = [-np.arctan2(R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), -np.arctan2(R[0, 1], R[0, 0])]
    found = true_motion(np.array([[*undone, 0.0, 0.0, 0.0]]), np.array(grasp))
    assert found["tilt"][0] == pytest.approx(0.0, abs=1e-7)
    assert found["turn"][0] == pytest.approx(0.0, abs=1e-9)


def test_a_turn_about_z_is_a_turn_and_no_tilt() -> None:
    found = true_motion(np.array([[0.0, 0.0, 0.3, 0.0, 0.0, 0.0]]), np.array([0.0, 0.0, 0.2]))
    assert found["turn"][0] == pytest.approx(0.5)
    assert found["tilt"][0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("scenario", "name"), [(D, "D"), (BncConnectorScenario(), "BNC")])
def test_the_chart_is_the_skills(scenario: AnyConnectorScenario, name: str) -> None:
    (chart,) = skill_charts(scenario)
    assert chart.name == f"{name} connector"
    assert chart.initial == ("approach" if scenario.sight is None else "reach")


def test_a_state_that_fails_reports_what_happened_in_it() -> None:
    skill = DConnectorSkillParams(approach_limit=0.002, retract=0.001)
    done = run_insertion(replace(D, skill=skill, height=0.01), 0)
    assert [(one.source, one.outcome, one.label) for one in done.path] == [
        ("approach", "lost", "otherwise"),
        ("retract", "over", "over"),
    ]
    assert failure(done, D) == done.reason == "approach: lost"
    traces = done.traces
    columns = {f"{name}_{axis}" for name in ("V_cmd", "V_ref", "wrench") for axis in AXES}
    columns |= {f"{name}_{axis}" for name in ("carriage", "plug") for axis in AXES}
    columns |= {"time", "holding", "retries", "state", "depth", "lateral_x", "lateral_y"}
    assert set(traces) == columns | {"tilt", "turn"}
    assert all(len(column) == len(traces["time"]) for column in traces.values())
    np.testing.assert_allclose(traces["plug_z"], -traces["depth"])
    assert done.wall_seconds > 0


def test_a_run_that_is_cut_off_says_where() -> None:
    done = run_insertion(replace(D, duration=0.2), 0)
    assert (done.path, done.reason) == ((), "")
    assert failure(done, D) == "approach: still running after 0.2 s"


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
    still = WristSensorParams(torque_noise=0.0, force_noise=0.0)
    scenario = replace(CONVERGENCE[name], sensor=still)
    coarse, fine = (
        insertion_metrics(run_insertion(replace(scenario, step=step), 0), scenario)
        for step in (0.001, 0.0005)
    )
    values: list[dict[str, Any]] = [dict(coarse), dict(fine)]
    assert [one["success"] for one in values] == [1.0, 1.0]
    assert values[1]["force.peak"] == pytest.approx(values[0]["force.peak"], rel=0.02)
    assert values[1]["depth"] == pytest.approx(values[0]["depth"], abs=2e-5)
