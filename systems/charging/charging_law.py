"""The charging cycle as a law: what it senses, what it commands, once a period."""

from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np

from chamfer.systems.charging.charging_chart import DONE, STOPPED, make_charging_chart, tares
from chamfer.systems.charging.charging_params import (
    ChargingBeliefs,
    ChargingInputs,
    ChargingMemory,
    ResolvedChargingParams,
)
from chamfer.systems.force.projection import position_selection
from chamfer.systems.law import Signal
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput
from chamfer.systems.trajectory.segment import (
    COORDINATES,
    POSITION,
    SEGMENT,
    SIZE,
    VELOCITY,
    Vector3,
)

_FORCE: Final = ("N",) * 3 + ("N m",) * 4
_INPUTS: Final = {
    "endpoint_motion": Signal(2 * COORDINATES, POSITION + VELOCITY),
    "desired_position": Signal(COORDINATES, POSITION),
    "desired_velocity": Signal(COORDINATES, VELOCITY),
    "progress": Signal(),
    "measured_force": Signal(3, "N"),
    "mean_force": Signal(3, "N"),
    "held": Signal(),
    "homed": Signal(optional=True),
    "alive": Signal(optional=True),
    "halt": Signal(optional=True),
    "layer_normal": Signal(3, optional=True),
}


class ChargingLaw(ChartLaw[ChargingInputs, ChargingMemory]):
    """Charges a crucible, nugget by nugget.

    Args:
        params: Speeds, forces, patience.
        beliefs: Of the cell.
    """

    def __init__(self, params: ResolvedChargingParams, beliefs: ChargingBeliefs) -> None:
        def number(read: Callable[[ChargingMemory], float]) -> MachineOutput[ChargingMemory]:
            return MachineOutput(size=1, read=lambda memory: (float(read(memory)),))

        ends = {DONE: 1.0, STOPPED: 2.0}
        super().__init__(
            make_charging_chart(params, beliefs),
            observation=ChargingInputs,
            inputs=_INPUTS,
            outputs={
                "segment": MachineOutput(
                    size=SIZE, unit=SEGMENT, read=lambda memory: memory.segment.vector()
                ),
                "hold": number(lambda memory: memory.hold),
                "mode": number(lambda memory: memory.mode),
                "desired_force": MachineOutput(
                    size=COORDINATES, unit=_FORCE, read=lambda memory: memory.desired_force(params)
                ),
                "selection": MachineOutput(
                    size=COORDINATES**2,
                    read=lambda memory: _selection(memory.pressed),
                ),
                "grip": number(lambda memory: memory.grip),
                "tare": number(lambda memory: tares(memory.at)),
                "below": MachineOutput(size=3, read=lambda memory: memory.below),
                "restart": number(lambda memory: not memory.on_layer),
                "wall": MachineOutput(size=3, read=lambda memory: memory.wall),
                "item": number(lambda memory: memory.item),
                "finished": number(lambda memory: ends.get(memory.at, 0.0)),
                "trouble": number(lambda memory: memory.trouble),
            },
            period=params.period,
        )


@lru_cache(maxsize=64)
def _selection(pressed: tuple[Vector3, ...]) -> tuple[float, ...]:
    """Return the position domain, row by row: all but the ways into what is pressed on."""
    domain = np.eye(COORDINATES)
    for normal in pressed:
        domain = domain @ position_selection(np.array([*normal, *[0.0] * (COORDINATES - 3)]))
    return tuple(domain.ravel().tolist())
