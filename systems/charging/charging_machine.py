"""The block that runs the charging cycle's chart."""

from functools import lru_cache
from typing import Final

import numpy as np
from pydrake.systems.framework import Context

from chamfer.systems.charging.charging_chart import DONE, STOPPED, make_charging_chart, tares
from chamfer.systems.charging.charging_memory import ChargingInputs, ChargingMemory
from chamfer.systems.charging.charging_params import ChargingBeliefs, ChargingParams
from chamfer.systems.force.contact_detection import APPROACH
from chamfer.systems.force.selection import position_selection
from chamfer.systems.statechart.state_machine import MachineOutput, StateMachine
from chamfer.systems.trajectory.segment import COORDINATES, SIZE, Vector3

_SIZES: Final = {
    "endpoint_motion": 2 * COORDINATES,
    "desired_position": COORDINATES,
    "desired_velocity": COORDINATES,
    "progress": 1,
    "measured_force": 3,
    "mean_force": 3,
    "held": 1,
    "homed": 1,
    "alive": 1,
    "halt": 1,
}


class ChargingMachine(StateMachine[ChargingInputs, ChargingMemory]):
    """Charges a crucible, nugget by nugget.

    .. pydrake_system::

        name: ChargingMachine
        input_ports:
        - endpoint_motion
        - desired_position
        - desired_velocity
        - progress
        - measured_force
        - mean_force
        - held
        - homed (optional)
        - alive (optional)
        - halt (optional)
        output_ports:
        - segment
        - hold
        - mode
        - desired_force
        - selection
        - grip
        - tare
        - item
        - finished
        - trouble
        - state

    ``endpoint_motion``, shape (14,), by the encoders; ``desired_position``, ``desired_velocity``,
    shape (7,) each, and ``progress``, size 1, what
    :class:`chamfer.systems.trajectory.path_follower.PathFollower` gives; ``measured_force``, shape
    (3,), N, of the nugget on its environment, world axes, tared, and ``mean_force``, shape (3,),
    N, the mean of its last readings, by which contact is told. Size 1 each: ``held``, 1 with a
    part in the gripper; ``homed``, 1 with the encoders' zeros known; ``alive``, 1 while the force
    sensor works; ``halt``, 1 while the operator wants all to stand still.

    ``segment``, shape (25,), and ``hold``, size 1, are for the path follower; ``mode``, size 1,
    ``desired_force``, shape (7,), N, and ``selection``, shape (49,), for the hybrid controller.
    Size 1 each: ``grip``, 1 to close the gripper; ``tare``, 1 while the force sensor's zero is
    taken; ``item``, index in the plan; ``finished``, 1 done, 2 stopped, 0 before; ``trouble``,
    :class:`chamfer.systems.charging.charging_memory.Trouble`.

    Args:
        params: Speeds, forces, patience; the detection resolved.
        beliefs: Of the cell.
    """

    def __init__(self, params: ChargingParams, beliefs: ChargingBeliefs) -> None:
        def number(read: str) -> MachineOutput[ChargingMemory]:
            return MachineOutput(size=1, read=lambda memory: (float(getattr(memory, read)),))

        super().__init__(
            make_charging_chart(params, beliefs),
            inputs=ChargingInputs,
            sizes=_SIZES,
            optional=("homed", "alive", "halt"),
            outputs={
                "segment": MachineOutput(size=SIZE, read=lambda memory: memory.segment.vector()),
                "hold": number("hold"),
                "mode": number("mode"),
                "desired_force": MachineOutput(
                    size=COORDINATES, read=lambda memory: memory.desired_force(params.wall_force)
                ),
                "selection": MachineOutput(
                    size=COORDINATES**2,
                    read=lambda memory: _selection(memory.mode, memory.normal),
                ),
                "grip": number("grip"),
                "tare": MachineOutput(size=1, read=lambda memory: (float(tares(memory.at)),)),
                "item": number("item"),
                "finished": MachineOutput(size=1, read=_finished),
                "trouble": number("trouble"),
            },
            period=params.period,
        )

    def reason(self, context: Context) -> str:
        """Return what stopped the cycle, in words; "" if nothing did."""
        return self.snapshot(context).memory.said()


def _finished(memory: ChargingMemory) -> tuple[float]:
    return ({DONE: 1.0, STOPPED: 2.0}.get(memory.at, 0.0),)


@lru_cache(maxsize=64)
def _selection(mode: int, normal: Vector3) -> tuple[float, ...]:
    """Return the position domain, row by row: all but, in contact, the way into the wall."""
    if mode == APPROACH:
        free: list[float] = np.eye(COORDINATES).ravel().tolist()
        return tuple(free)
    touching: list[float] = (
        position_selection(np.array([*normal, *[0.0] * (COORDINATES - 3)])).ravel().tolist()
    )
    return tuple(touching)
