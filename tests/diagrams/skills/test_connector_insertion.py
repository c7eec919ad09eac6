"""Both connectors inserted in simulation, and with something in the way or missing."""

from dataclasses import replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pytest

from chamfer.analysis.skills.connector_runs import insertion_metrics, run_insertion
from chamfer.analysis.skills.skill_run import SkillResult
from chamfer.diagrams.skills.connector_insertion import (
    AnyConnectorScenario,
    BncConnectorScenario,
    DConnectorScenario,
    PegScenario,
    Rj45ConnectorScenario,
)
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.models.connectors.d_connector import DConnector
from chamfer.systems.primitives.position_primitives import Held
from chamfer.systems.sensing.force_sensor import WrenchSensorParams
from chamfer.systems.strategies.bnc_strategy import BncConnectorSkillParams

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
    # Asked is 1.5; the WAM misses it, whose force lags behind the command that grows.
    most = 1.5 if scenario.robot == "carriage" else 1.6
    assert 0.95 < metrics["force.peak_share"] < most
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
    assert_failed_and_retracted(found, "touch: lost")
    lowest = found.traces["carriage_z"].min()
    assert lowest == pytest.approx(0.008 - params.approach_speed * 0.5, abs=4e-4)


@pytest.mark.slow
def test_what_is_in_the_way_before_the_contacts_is_not_pushed_at() -> None:
    scenario = DConnectorScenario(
        sight=None,
        obstacle=0.0015,
        height=0.001,
        initial_error=(0.01, 0.0, 0.005, 2e-4, 1e-4, 0.0),
        duration=30.0,
    )
    found = run_insertion(scenario, seed=0)
    taken = path(found)
    first = taken.index(("feel", "out"))
    assert taken[first:][:2] == [("feel", "out"), ("out", "tare again")]
    traces = found.traces
    assert traces["depth"].max() == pytest.approx(0.0015, abs=2e-4)  # the plate is what stops it
    stalled = 800 * scenario.skill.search_press
    assert np.abs(traces["true_wrench_z"]).max() < 1.2 * stalled
    assert traces["retries"][-1] >= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("depth", [0.0032, 0.0051])
def test_a_plug_that_is_stopped_short_is_not_taken_for_mated(depth: float) -> None:
    found = run_insertion(DConnectorScenario(sight=None, obstacle=depth), seed=0)
    assert_failed_and_retracted(found, "rest: jammed")
    taken = path(found)
    assert taken.count(("push", "rest")) == 2
    assert not any(target == "verify" for _, target in taken)
    assert found.traces["depth"].max() == pytest.approx(depth, abs=1e-4)


@pytest.mark.slow
def test_slots_that_are_not_found_fail_after_a_sweep() -> None:
    skill = BncConnectorSkillParams(sweep_frequency=0.4, retries=1)
    scenario = BncConnectorScenario(
        sight=None, obstacle=0.0036, height=0.001, skill=skill, duration=14.0
    )
    found = run_insertion(scenario, seed=0)
    assert ("feel", "find slots") in path(found)
    assert ("find slots", "out") in path(found)
    assert 0.003 < found.traces["depth"].max() < 0.0038
    left = path(found).index(("find slots", "out"))
    sweep = found.path[left - 1].time, found.path[left].time
    turn = found.traces["carriage_rz"]
    swept = turn[(found.traces["time"] > sweep[0]) & (found.traces["time"] < sweep[1])]
    assert np.ptp(swept) == pytest.approx(np.pi, rel=0.1)


@pytest.mark.slow
def test_the_wam_inserts_the_connector_that_has_to_be_turned() -> None:
    scenario = BncConnectorScenario(sight=None, robot="wam")
    assert_inserted(run_insertion(scenario, seed=0), scenario)


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOTH)
def test_the_connector_is_grasped_and_inserted_by_sight(kind: Any) -> None:
    scenario = kind()
    found = run_insertion(scenario, seed=0)
    assert_inserted(found, scenario)
    front = ["reach", "close in", "grasp", "lift", "transport", "tare"]
    assert path(found)[:5] == list(pairwise(front))
    assert found.traces["holding"][[0, -1]].tolist() == [0.0, 1.0]


def test_forces_and_amplitudes_are_those_of_the_connectors() -> None:
    d, b = DConnectorScenario(), BncConnectorScenario()
    for one in (d, b):
        # What is maintained stays below what mates; a pull is stronger than what it has to feel.
        assert one.accommodation.damping[5] * one.skill.maintained < one.connector.mating_force
        assert one.skill.pull_force < one.accommodation.damping[5] * one.skill.pull_speed
    assert b.accommodation.damping[2] * b.skill.turn_speed < b.skill.turn_torque
    assert d.skill.verify_amplitude > d.connector.clearance.max()


@pytest.mark.parametrize("kind", [DConnectorScenario, Rj45ConnectorScenario, PegScenario])
def test_the_gripper_goes_to_the_upper_end_of_the_plug_that_there_is(kind: Any) -> None:
    scenario = kind()
    top = scenario.connector.plug_outline[:, 2].max()
    (reach, *_) = scenario.make_grasp()[0].run
    assert reach.offset[2] == pytest.approx(scenario.sight.motion.mark - top)
    given = replace(scenario.sight.motion, top=0.01)
    (reach, *_) = (
        replace(scenario, sight=replace(scenario.sight, motion=given)).make_grasp()[0].run
    )
    assert reach.offset[2] == pytest.approx(given.mark - 0.01)


def test_a_plug_is_weighed_as_heavy_as_it_is_believed_where_no_finger_feels_it() -> None:
    scenario = DConnectorScenario(believed_connector=DConnector(mass=0.05))
    unfelt = replace(scenario, gripper=replace(scenario.gripper, senses=False))
    (weigh,) = (state for state in unfelt.make_grasp() if state.name == "weigh")
    (held,) = weigh.run
    assert isinstance(held, Held)
    assert held.weight == pytest.approx(0.05 * 9.81)
    assert "weigh" not in {state.name for state in scenario.make_grasp()}


@pytest.mark.slow
@pytest.mark.parametrize("reach", [None, 1e-5])
def test_a_grip_is_checked_by_weight_where_no_finger_feels_it(reach: float | None) -> None:
    """With the noise of realistic sensing; a reach of 10 um is missed."""
    scenario = DConnectorScenario(
        sensing="realistic", sensor=WrenchSensorParams(), duration=8.0 if reach is None else 30.0
    )
    gripper = replace(scenario.gripper, senses=False)
    for seed in range(3):
        one = replace(
            scenario, gripper=gripper if reach is None else replace(gripper, reach=reach)
        )
        found = run_insertion(one, seed)
        if reach is None:
            assert ("weigh", "transport") in path(found)
        else:
            assert_failed_and_retracted(found, "weigh: lost")


@pytest.mark.parametrize("kind", [Rj45ConnectorScenario, PegScenario])
def test_parts_that_are_aligned_by_touch_are_inserted_without_sight(kind: Any) -> None:
    error = (0.02, -0.01, 0.02, 4e-4, -3e-4, 0.0)
    skill = replace(kind().skill, lie_time=2.5)
    scenario = kind(sight=None, height=0.002, initial_error=error, skill=skill, step=0.002)
    found = run_insertion(scenario, seed=0)
    metrics = insertion_metrics(found, scenario)
    assert (metrics["success"], found.reason) == (1.0, "")
    assert metrics["retries"] == 0
    # Flat on the face, whatever the grasp is wrong by.
    above = next(step.time for step in found.path if step.source == "lie")
    tilt = np.interp(above, found.traces["time"], found.traces["tilt"])
    assert tilt < 0.003


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Rj45ConnectorScenario, PegScenario])
def test_parts_that_stop_half_a_millimetre_short_are_not_said_to_be_in(kind: Any) -> None:
    part = kind().connector
    scenario = kind(sight=None, obstacle=part.mated_depth - 5e-4, step=0.002, duration=240.0)
    found = run_insertion(scenario, seed=0)
    assert found.outcome == "failed"
    assert found.reason.endswith("jammed")
    assert [target for _, target in path(found)[-2:]] == ["retract", "failed"]
    assert found.traces["depth"][-1] < -0.01
