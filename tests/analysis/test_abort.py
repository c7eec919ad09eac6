"""Whatever a chart does, an abort leads to where nothing is commanded on, and it stays there."""

from typing import Any

import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import prepare
from chamfer.analysis.scenario.experiment import load
from chamfer.systems.charging.charging_params import ChargingInputs, ChargingMemory
from chamfer.systems.force.contact_detection_law import Inputs as ContactInputs
from chamfer.systems.force.contact_detection_law import Memory as ContactMemory
from chamfer.systems.primitives.primitive import STILL, Observation
from chamfer.systems.primitives.skill_law import SkillMemory
from chamfer.systems.servo.compensator_law import (
    AxisMemory,
    CompensatorInputs,
    CompensatorMemory,
)
from chamfer.systems.statechart.chart import Snapshot
from chamfer.systems.strategies.insertion_law import InsertionInputs, InsertionMemory

ZERO, ONE = (0.0,), (1.0,)
SEEN: dict[type, Any] = {  # what would drive each chart on
    AxisMemory: 1.0,
    SkillMemory: Observation(carriage=STILL, motion=STILL, wrench=STILL),
    InsertionMemory: InsertionInputs(
        *(STILL, ONE, ZERO, ZERO, STILL, (0.0,) * 3, ZERO, (0.0,) * 7, None)
    ),
    ChargingMemory: ChargingInputs(
        *((0.1,) * 14, (0.1,) * 7, (0.1,) * 7, ZERO, (0.0,) * 3, (0.0,) * 3, ONE, ONE, ONE, ZERO)
    ),
}


def moving(memory: Any) -> Any:
    """Return a memory in which something is commanded, as far as that is in it."""
    if isinstance(memory, SkillMemory):
        return memory._replace(velocity=(0.1,) * 6, damping=(1.0,) * 6)
    if isinstance(memory, InsertionMemory):
        return memory._replace(rate=0.01, feed=0.02)
    if isinstance(memory, AxisMemory):
        return AxisMemory(0.3, 0.1)
    if isinstance(memory, CompensatorMemory):
        axes = [axis._replace(memory=AxisMemory(0.3, 0.1)) for axis in memory.axes]
        return memory._replace(axes=tuple(axes))
    return memory


def commands_on(before: Any, after: Any) -> bool:
    """Return whether something is still changed by a chart that was aborted."""
    match after:
        case SkillMemory():
            return (after.velocity, after.damping) != (STILL, STILL)
        case InsertionMemory():
            return after.rate != 0 or after.compensates
        case ChargingMemory():
            still = after.segment.start == after.segment.goal
            return not (after.hold or still)
        case AxisMemory():
            return after != (before.compensation, 0.0)
        case CompensatorMemory():
            return [axis.memory for axis in after.axes] != [(0.3, 0.0)] * len(after.axes)
        case ContactMemory():
            return after.contact_time != before.contact_time
    raise AssertionError(type(after))


@pytest.mark.filterwarnings("ignore:the loop is unstable")
@pytest.mark.parametrize("name", [entry.name for entry in CATALOGUE.entries])
def test_an_abort_ends_what_any_state_commands(name: str) -> None:
    (entry,) = (entry for entry in CATALOGUE.entries if entry.name == name)
    if (charts := load(entry).charts) is None:
        return
    (job,) = prepare([entry])
    for chart in charts(job.scenario):
        memory = moving(chart.memory)
        inputs = SEEN.get(type(memory))
        if isinstance(memory, CompensatorMemory):
            inputs = CompensatorInputs((9.0,) * len(memory.axes), None, None)
        elif isinstance(memory, ContactMemory):
            inputs = ContactInputs((50.0,) * len(job.scenario.direction))
        for state in chart.states:
            before = memory
            if isinstance(memory, ChargingMemory):
                before = memory._replace(at=state.name, carries=True)
            snapshot = Snapshot(state.name, 0.0, before, True)
            if state.outcome is not None:
                assert chart.step(snapshot, inputs, 0.1, abort=True)[1] is None
                continue
            snapshot, record = chart.step(snapshot, inputs, 0.1, abort=True)
            assert record is not None
            assert record[1:4] == (state.name, chart.on_abort, "abort")
            for k in range(9):
                assert snapshot.state == chart.on_abort
                assert not commands_on(before, snapshot.memory), state.name
                snapshot, record = chart.step(snapshot, inputs, 0.2 + k)
                assert record is None
