"""What may happen in any state of the charging cycle: each is answered in each, and named."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from chamfer.models.charging.packing import PlanItem
from chamfer.systems.charging.charging_chart import AWAY, BRAKE, DONE, HALTED, MODE_OF, STOPPED
from chamfer.systems.charging.charging_params import ChargingInputs, Trouble
from chamfer.systems.force.contact_detection import CONTACT
from chamfer.systems.statechart.chart import Snapshot

Cells = Callable[..., Any]

PERIOD = 0.01  # s, of the cell
RUNNING = [name for name in MODE_OF if name not in (BRAKE, AWAY, DONE, STOPPED)]
START = (0.40, -0.20, 0.55, 0.0, 0.0, 0.0, 0.2)
QUIET = ChargingInputs(
    endpoint_motion=(*START, *[0.0] * 7),
    desired_position=START,
    desired_velocity=(0.0,) * 7,
    progress=(0.0,),
    measured_force=(0.0,) * 3,
    mean_force=(0.0,) * 3,
    held=(1.0,),
    homed=(1.0,),
    alive=(1.0,),
    halt=(0.0,),
)
FAR = (*START[:2], START[2] + 0.04, *START[3:], *[0.0] * 7)
TROUBLES = {
    Trouble.SENSOR_DEAD: QUIET._replace(alive=(0.0,)),
    Trouble.TOO_MUCH_FORCE: QUIET._replace(measured_force=(0.0, 21.0, 0.0)),
    Trouble.DROPPED: QUIET._replace(held=(0.0,)),
    Trouble.OFF_PATH: QUIET._replace(endpoint_motion=FAR),
}


def put_in(cell: Any, state: str, at: float = 0.0) -> Snapshot[Any]:
    """Return the chart in a state since a time, with a part in the gripper; halted: in a slew."""
    begun = cell.chart.start()
    left = "slew.over" if state == HALTED else ""
    memory = begun.memory._replace(at=state, left=left, mode=MODE_OF.get(state, 0), carries=True)
    result: Snapshot[Any] = Snapshot(state, at, memory, True)
    return result


def test_what_lasts_too_long_times_out(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()])
    for state in RUNNING:
        after, _ = cell.chart.step(put_in(cell, state), QUIET, 20.0 + PERIOD)
        assert after.state == BRAKE
        assert after.memory.said() == f"timed out, in {state}, item 0"


def test_a_halt_may_last(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()])
    after, _ = cell.chart.step(put_in(cell, HALTED), QUIET._replace(halt=(1.0,)), 1e4)
    assert after.state == HALTED


@pytest.mark.parametrize("trouble", TROUBLES)
def test_trouble_stops_any_state_and_names_it(cell_with: Cells, trouble: Trouble) -> None:
    cell = cell_with([PlanItem()])
    for state in (*RUNNING, HALTED):
        # Nothing else ends a state meanwhile.
        inputs = TROUBLES[trouble]._replace(
            halt=(float(state == HALTED),),
            homed=(float(state != "home.settle"),),
            mean_force=(1.2 * (MODE_OF.get(state) == CONTACT), 0.0, 0.0),
        )
        snapshot = put_in(cell, state)
        for k in range(5):  # the last one finds three readings in a row
            snapshot, _ = cell.chart.step(snapshot, inputs, k * PERIOD)
            if snapshot.memory.trouble:
                break
        assert snapshot.state == BRAKE, state
        assert snapshot.memory.trouble is trouble, state
        assert snapshot.memory.trouble_at == ("slew.over" if state == HALTED else state)


forces = st.tuples(*[st.floats(-9.0, 9.0)] * 3)


@settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # it only makes cells
)
@given(
    state=st.sampled_from([*RUNNING, BRAKE, AWAY]),
    arrives=st.booleans(),
    held=st.booleans(),
    homed=st.booleans(),
    force=forces,
)
def test_there_is_a_way_out_of_each_state_whatever_sensors_say(
    cell_with: Cells,
    state: str,
    *,
    arrives: bool,
    held: bool,
    homed: bool,
    force: tuple[float, float, float],
) -> None:
    cell = cell_with([PlanItem(), PlanItem(kind="crown", azimuth=0.5), PlanItem(kind="bulk")])
    inputs = QUIET._replace(
        progress=(float(arrives),),
        held=(float(held),),
        homed=(float(homed),),
        measured_force=force,
        mean_force=force,
    )
    snapshot = put_in(cell, state)
    visits: list[str] = []
    time = 0.0
    while snapshot.state not in (DONE, STOPPED):
        time += 0.5
        snapshot, record = cell.chart.step(snapshot, inputs, time)
        visits += [record.target] if record else []
        assert time < 20.5 * (len(visits) + 1)
        assert len(visits) < 120
