"""Both connectors inserted in simulation, and with something in the way or missing."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pytest

from analysis.skills.connector_runs import insertion_metrics, run_insertion
from analysis.skills.skill_run import SkillResult
from diagrams.skills.connector_insertion import (
    AnyConnectorScenario,
    BncConnectorScenario,
    DConnectorScenario,
)
from diagrams.skills.connector_sight import SightSettings
from systems.skills.bnc_connector import BncConnectorSkillParams
from systems.skills.d_connector import DConnectorSkillParams

BOTH: Final = [DConnectorScenario, BncConnectorScenario]
SIGHT: Final = SightSettings()
BLIND: Final = replace(SIGHT, frames=replace(SIGHT.frames, miss=1.0))
MISSING: Final = replace(SIGHT, plug_present=False)


def path(found: SkillResult) -> list[tuple[str, str]]:
    return [(step.source, step.target) for step in found.path]


def assert_failed_and_retracted(found: SkillResult, reason: str) -> None:
    assert found.reason == reason
    state = reason.partition(":")[0]
    assert path(found)[-2:] == [(state, "retract"), ("retract", "failed")]
    begun, ended = (step.time for step in found.path[-2:])
    traces = found.traces
    height = np.interp([begun, ended], traces["time"], traces["carriage_z"])
    assert height[1] - height[0] == pytest.approx(0.03, abs=2e-3)
    assert traces["depth"][-1] <= 0.0
    assert not traces["V_cmd_z"][-1]


def assert_inserted(found: SkillResult, scenario: AnyConnectorScenario) -> None:
    metrics = insertion_metrics(found, scenario)
    assert metrics["success"] == 1.0
    assert found.reason == ""
    assert metrics["depth"] == pytest.approx(scenario.connector.mated_depth, abs=5e-4)
    assert 1.0 < metrics["force.peak_share"] < 1.5
    assert not found.traces["V_cmd_z"][-1]


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("sight", [MISSING, BLIND])
def test_a_part_that_is_missing_or_not_seen_is_lost_while_it_is_reached_for(
    kind: Any, sight: SightSettings
) -> None:
    found = run_insertion(kind(sight=sight), seed=0)
    assert_failed_and_retracted(found, "reach: lost")
    # It does not move without knowing where to.
    before = found.traces["time"] <= found.path[0].time
    start = np.add(SIGHT.plug, SIGHT.standby)
    for axis, value in zip("xyz", start, strict=True):
        np.testing.assert_allclose(found.traces[f"carriage_{axis}"][before], value, atol=1e-3)
    assert not found.traces["holding"].any()


@pytest.mark.parametrize("kind", BOTH)
def test_a_socket_that_is_not_there_is_not_met(kind: Any) -> None:
    params = kind().skill
    scenario = kind(sight=None, height=0.008, skill=replace(params, approach_limit=0.005))
    found = run_insertion(scenario, seed=0)
    assert_failed_and_retracted(found, "approach: lost")
    lowest = found.traces["carriage_z"].min()
    assert lowest == pytest.approx(0.008 - params.approach_speed * 0.5, abs=4e-4)


def test_a_shell_that_is_jammed_is_pushed_again() -> None:
    skill = DConnectorSkillParams(search_repeats=3, settle_cycles=0.5, retries=1)
    scenario = DConnectorScenario(
        sight=None,
        obstacle=0.002,
        height=0.001,
        initial_error=(0.01, 0.0, 0.005, 2e-4, 1e-4, 0.0),
        skill=skill,
        duration=6.5,
    )
    found = run_insertion(scenario, seed=0)
    taken = path(found)
    assert ("search", "settle") in taken
    first = taken.index(("push", "back off"))
    assert taken[first:] == [("push", "back off"), ("back off", "free")]
    traces = found.traces
    assert traces["depth"].max() == pytest.approx(0.002, abs=5e-5)  # the plate is what stops it
    pushed = found.path[first - 1].time, found.path[first].time
    force = traces["wrench_z"][(traces["time"] > pushed[0]) & (traces["time"] <= pushed[1])]
    assert skill.push_force < force.max() < 1.5 * scenario.connector.mating_force
    assert traces["retries"][-1] == 1.0


@pytest.mark.slow
def test_a_jammed_shell_fails_after_all_retries() -> None:
    found = run_insertion(DConnectorScenario(sight=None, obstacle=0.002), seed=0)
    assert_failed_and_retracted(found, "push: jammed")
    taken = path(found)
    assert taken.count(("push", "back off")) == 3
    assert taken.count(("push", "shift")) == 3
    assert not any(target == "verify" for _, target in taken)
    assert found.traces["depth"].max() == pytest.approx(0.002, abs=5e-5)
    assert (
        np.abs(found.traces["wrench_z"]).max() < 1.5 * DConnectorScenario().connector.mating_force
    )


def test_slots_that_are_not_found_fail_after_a_sweep() -> None:
    skill = BncConnectorSkillParams(sweep_frequency=0.4)
    scenario = BncConnectorScenario(sight=None, obstacle=0.0036, height=0.001, skill=skill)
    found = run_insertion(scenario, seed=0)
    assert_failed_and_retracted(found, "find slots: done")
    assert ("to the studs", "find slots") in path(found)
    assert 0.0033 < found.traces["depth"].max() < 0.0037
    sweep = found.path[-3].time, found.path[-2].time
    turn = found.traces["carriage_rz"]
    swept = turn[(found.traces["time"] > sweep[0]) & (found.traces["time"] < sweep[1])]
    assert np.ptp(swept) == pytest.approx(np.pi, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["carriage", "wam"])
@pytest.mark.parametrize("kind", BOTH)
def test_the_connector_is_inserted(kind: Any, robot: Any) -> None:
    scenario = kind(sight=None, robot=robot)
    found = run_insertion(scenario, seed=0)
    assert_inserted(found, scenario)


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOTH)
def test_the_connector_is_grasped_and_inserted_by_sight(kind: Any) -> None:
    scenario = kind()
    found = run_insertion(scenario, seed=0)
    assert_inserted(found, scenario)
    front = ["reach", "close in", "grasp", "lift", "transport", "approach"]
    assert path(found)[:5] == list(pairwise(front))
    assert found.traces["holding"][[0, -1]].tolist() == [0.0, 1.0]


def test_forces_of_the_skills_are_those_of_the_connectors() -> None:
    for scenario, speed, stopped in (
        (d := DConnectorScenario(), d.skill.push_speed, d.skill.push_force),
        (b := BncConnectorScenario(), b.skill.compress_speed, b.skill.compress_force),
    ):
        mating = scenario.connector.mating_force
        stall = scenario.accommodation.damping[5] * speed
        assert mating < stopped < stall < 1.5 * mating
    # The verifying turn is more than the studs' play, the pull less than its own stall.
    play = b.connector.slot / 2 - b.connector.stud_radius
    assert b.connector.stud_distance * math.sin(b.skill.verify_amplitude) > play
    assert b.skill.pull_force < b.accommodation.damping[5] * b.skill.pull_speed
    assert b.skill.turn_torque < b.accommodation.damping[2] * b.skill.turn_speed
    assert b.skill.turn_torque > 0.28  # N m, the most that a turn may take


def test_the_skill_verifies_by_more_than_the_play() -> None:
    scenario = DConnectorScenario()
    assert scenario.skill.verify_amplitude > scenario.connector.clearance.max()
    assert scenario.skill.push_depth < scenario.connector.mated_depth
