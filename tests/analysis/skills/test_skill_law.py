"""A skill's law outside its diagram: without Drake, on a log, and with ticks that fail."""

import subprocess
import sys
from dataclasses import replace
from typing import Final

import numpy as np
import pytest

from chamfer.analysis.skills.skill_file import skill_text
from chamfer.analysis.skills.skill_run import run_skill
from chamfer.diagrams.skills.connector_scenario import (
    BNC_CONNECTOR,
    D_CONNECTOR,
    RJ45_CONNECTOR,
    ROUND_PEG,
    StrategyScenario,
    resolve,
)
from chamfer.systems.primitives.force_primitives import GuardedMove, Obstructed, Stick
from chamfer.systems.primitives.primitive import Observation
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE, Skill, SkillState
from chamfer.systems.primitives.skill_law import SkillLaw, SkillMemory
from chamfer.systems.primitives.skill_machine import SkillMachine
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.recording import Recorder, recording
from chamfer.systems.statechart.chart_law import ChartLaw, ChartState
from chamfer.systems.statechart.state_machine import StateMachine
from chamfer.systems.strategies.grasp_and_transport import PARTS

FINE: Final = 10  # steps in a tick


def test_a_law_fed_with_what_its_block_saw_answers_the_same_to_the_bit() -> None:
    shake = Dither(axis="x", amplitude=0.002, frequency=2.0, cycles=4.0)
    feel = [Stick(threshold=0.003), shake, Obstructed(axes=("x",), cycle=(0.5,))]
    skill = Skill(
        name="touch and feel",
        states=[
            SkillState(name="touch", run=[GuardedMove()], on={"contact": "feel"}, timeout=5.0),
            SkillState(name="feel", run=feel, on={"done": DONE}, timeout=5.0),
        ],
        retract=[MoveDx()],
        held=True,
    )
    with recording(recorder := Recorder()):
        assert run_skill(skill, resolve(replace(D_CONNECTOR, sight=None))).outcome == "done"
    (records,) = next(runs for path, runs in recorder.runs.items() if path.endswith("::skill"))
    law = SkillLaw(skill, parts=PARTS, period=records.law.period)
    state, steps = law.start(), list(records)
    assert len(steps) > 200
    for record in steps:
        state, command = law.step(state, law.observe(record.observation), record.time)
        assert {name: list(getattr(command, name)) for name in law.outputs} == record.command


def test_a_strategy_as_yaml_is_a_law_where_no_drake_is() -> None:
    program = """
import sys

sys.modules |= dict.fromkeys(("pydrake", "scipy", "cv2", "numba", "matplotlib"))
from chamfer.analysis.scenario.scenario_yaml import parse_value
from chamfer.analysis.skills.skill_file import skill_of
from chamfer.systems.primitives.skill_law import SkillLaw

law = SkillLaw(skill_of(parse_value(sys.stdin.read())), parts=4, period=0.01)
values = {name: None if one.optional else [0.0] * one.size for name, one in law.inputs.items()}
state, _ = law.step(law.start(), law.observe(values), 0.0)
print(state.snapshot.state, len(law.chart.state_names))
"""
    skill = resolve(D_CONNECTOR).make_skill()
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=skill_text(skill),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == (f"reach {len(skill.states) + 3}\n", "")


class Block(SkillMachine):
    """Runs any law of a skill's chart."""

    def __init__(self, law: ChartLaw[Observation, SkillMemory]) -> None:
        StateMachine.__init__(self, law)


class Unpunctual(ChartLaw[Observation, SkillMemory]):
    """A law of which a fifth of the steps is missing; the others are up to half a period off."""

    def __init__(self, law: SkillLaw, seed: int) -> None:
        vars(self).update(vars(law))
        self.period = law.period / FINE
        random = np.random.default_rng(seed)
        steps = FINE * np.arange(10_000) + random.integers(-FINE // 2, FINE // 2 + 1, 10_000)
        self.steps = {0, *steps[random.random(len(steps)) > 0.2].tolist()}

    def update(
        self, state: ChartState[SkillMemory], observation: Observation, time: float
    ) -> ChartState[SkillMemory]:
        late = round(time / self.period) not in self.steps
        return state if late else super().update(state, observation, time)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "more"),
    # A D is laid down by the push's last command: a window more, and it has grown once more.
    [
        (D_CONNECTOR, 1.01 * Seat().growth),
        (BNC_CONNECTOR, 1.03),
        (RJ45_CONNECTOR, 1.03),
        (ROUND_PEG, 1.03),
    ],
)
def test_a_skill_ends_as_before_where_ticks_are_missing_early_and_late(
    part: StrategyScenario, more: float
) -> None:
    scenario = resolve(part)
    skill = scenario.make_skill()
    usual = run_skill(skill, scenario)
    law = SkillLaw(skill, parts=PARTS, period=scenario.accommodation.period)
    found = run_skill(Block(Unpunctual(law, seed=0)), scenario)
    assert found.outcome == usual.outcome == "done"
    assert [one.label for one in found.path] == [one.label for one in usual.path]
    assert found.traces["time"][-1] <= 1.03 * usual.traces["time"][-1]
    for axes in (slice(0, 3), slice(3, 6)):  # torques, forces
        assert found.peaks[axes].max() <= more * usual.peaks[axes].max()
