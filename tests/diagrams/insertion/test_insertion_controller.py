"""The insertion's controller as one law: what the diagram's blocks answer, and it, to the bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from chamfer.diagrams.cell.alignment_scenario import ControllerChoice
from chamfer.diagrams.cell.work_cell import HOLE_ARM
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    controller_of,
    make_insertion_diagram,
    resolve,
)
from chamfer.models.peg.peg_and_hole import PRESETS, ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.law_block import LawBlock
from chamfer.systems.recording import Recorder, Records, recording
from chamfer.systems.strategies.insertion_decision import DecisionParams
from chamfer.systems.strategies.insertion_law import InsertParams
from chamfer.systems.strategies.insertion_search import SearchParams

QUICK = InsertionScenario(
    begin=0.2,
    gap=0.01,
    initial_error=(0.0, 0.001, -0.001, 0.0, 0.01, -0.01),
    insert=InsertParams(depth=0.015, speed=0.06, rest=0.05),
)
MOVES = replace(QUICK, start_offset=(-0.01, 0.0, 0.0), motion_time=0.3)
BLIND = replace(
    QUICK,
    hole=replace(HOLE_ARM, kind="fixture"),
    parts=ColouredParts(**PRESETS["nist-16mm"]),
    compensated="none",
    insert=InsertParams(depth=0.015, speed=0.04, rest=0.05),
    initial_error=(0.0, 0.0018, -0.0005, 0.0, 0.0, 0.0),
    decide=DecisionParams(kind="at_once"),
    search=SearchParams(kind="spiral", radius=0.005),
)
SCENARIOS = {
    "two arms": QUICK,
    "pid": replace(QUICK, controller=ControllerChoice(kind="pid")),
    "fixture, searches": BLIND,
    "fixture, moves": replace(MOVES, hole=replace(HOLE_ARM, kind="fixture")),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_over_an_insertion_it_answers_what_the_diagrams_blocks_do(name: str) -> None:
    scenario = resolve(SCENARIOS[name])
    law, cell = controller_of(scenario), make_insertion_diagram(scenario)
    builder = DiagramBuilder()
    builder.AddNamedSystem("cell", cell)
    beside = builder.AddNamedSystem("beside", LawBlock(law))
    seen = {one: one for one in ("error", "valid", "blind")} | {
        f"{arm}_{one}": f"{arm}.{one}"
        for arm in scenario.arms
        for one in ("tool_pose", "saturated")
    }
    for port, measured in seen.items():
        builder.Connect(cell.GetOutputPort(measured), beside.GetInputPort(port))
    root = builder.Build()
    simulator = Simulator(root)
    context = simulator.get_mutable_context()
    root.SetRandomContext(context, RandomGenerator(0))
    arm = cell.GetSubsystemByName("peg impedance control")
    told: Any = {one: arm.GetInputPort(f"desired_{one}") for one in ("pose", "velocity")}
    with recording(recorder := Recorder()):
        for k in range(96):
            simulator.AdvanceTo(0.0125 * k + 0.002 * (k % 5))
            state = beside.state(beside.GetMyContextFromRoot(context))
            now = law.command(state._replace(time=context.get_time()))
            for one, port in told.items():
                commanded = port.Eval(arm.GetMyContextFromRoot(context))
                np.testing.assert_array_equal(getattr(now, f"peg_{one}"), commanded)
    runs = {path.rpartition("::")[2]: records for path, (records,) in recorder.runs.items()}
    state, kept = law.start(), {one: Records(each) for one, each in law.laws.items()}
    for record in runs["beside"]:
        state, each = law.steps(state, law.observe(record.observation), record.time)
        for one, part in each.items():
            kept[one].append(part)
    end = "spiral" if name == "fixture, searches" else "seated"
    assert state.task.snapshot.state == end
    for one, records in kept.items():
        for mine, theirs in zip(records, runs[one], strict=True):
            np.testing.assert_equal(mine[1:], theirs[1:], err_msg=one)


def test_a_pose_that_is_not_finite_is_refused_before_anything_moves() -> None:
    law = controller_of(resolve(QUICK))
    pose = [1.0, 0, 0, 0, 0, 0, 0]
    values = {"error": [0.0] * 6, "valid": [1.0], "blind": [0.0], "peg_saturated": [0.0] * 7}
    with pytest.raises(ParameterError, match=r"peg_tool_pose is .*nan.*, allowed: finite"):
        law.observe({**values, "peg_tool_pose": [*pose[:6], float("nan")]})
