"""Steps a controller's law through a log, and compares what it commands with what is logged.

It is open loop: the law sees what was logged, whatever it commands.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.errors import UserError
from chamfer.systems.recording import AnyLaw, Record, Records, signals

STATE: Final = "command.state"  # the index of a chart's state
Array = NDArray[np.float64]


class Output(NamedTuple):
    """What is commanded at an output."""

    name: str  # command.<output>
    units: tuple[str, ...]  # of each element
    logged: Array | None  # shape (steps, size), NaN where it is missing; None if everywhere
    replayed: Array  # the same shape
    differs: NDArray[np.bool_]  # the same shape


class Difference(NamedTuple):
    """The first number that is another one."""

    time: float  # s
    column: str
    unit: str
    logged: float
    replayed: float
    states: tuple[str, ...]  # in the log and replayed, of a chart whose state is logged


@dataclass(frozen=True, kw_only=True)
class Replay:
    """What a controller would have done beside what it did."""

    controller: str  # the path of its block
    states: Sequence[str]  # the names of its chart's states, if it has one
    times: Array  # s
    outputs: tuple[Output, ...]

    @property
    def compared(self) -> bool:
        """Whether there is any command in the log."""
        return any(one.logged is not None for one in self.outputs)

    @property
    def differs(self) -> NDArray[np.bool_]:
        """At which steps a command differs."""
        differs: NDArray[np.bool_] = np.hstack([one.differs for one in self.outputs])
        return np.asarray(differs.any(axis=1))

    @property
    def first(self) -> Difference | None:
        """Where it first differs."""
        if not self.differs.any():
            return None
        row = int(np.argmax(self.differs))
        one = next(one for one in self.outputs if one.differs[row].any())
        i = int(np.argmax(one.differs[row]))
        assert one.logged is not None
        return Difference(
            float(self.times[row]),
            f"{one.name}[{i}]",
            one.units[i],
            float(one.logged[row, i]),
            float(one.replayed[row, i]),
            self.state_names(row),
        )

    def state_names(self, row: int) -> tuple[str, ...]:
        """Return a chart's state at a step, in the log if it is there, and replayed."""
        state = next((one for one in self.outputs if one.name == STATE and self.states), None)
        both = () if state is None else (state.logged, state.replayed)
        return tuple(
            self.states[int(one[row, 0])]
            for one in both
            if one is not None and 0 <= one[row, 0] < len(self.states)
        )


def replay(controller: str, law: AnyLaw, logged: Records) -> Replay:
    """Step a law through a log, and compare.

    Raises:
        UserError: If the law refuses what it sees.
    """
    state, replayed = law.start(), Records(law)
    for record in logged:
        try:
            state, command = law.step(state, law.observe(record.observation), record.time)
        except (ValueError, ArithmeticError) as error:
            raise UserError(f"{controller} at {record.time} s: {error}") from error
        replayed.append(Record(record.time, record.observation, command._asdict()))
    chart = getattr(law, "chart", None)
    return Replay(
        controller=controller,
        states=() if chart is None else chart.state_names,
        times=logged.times,
        outputs=tuple(_outputs(law, logged, replayed)),
    )


def _outputs(law: AnyLaw, logged: Records, replayed: Records) -> list[Output]:
    outputs = []
    for (name, was, missing), (_, now, _) in zip(
        logged.vectors(), replayed.vectors(), strict=True
    ):
        if name.startswith("command."):
            same = (was == now) | (np.isnan(was) & np.isnan(now)) | missing[:, np.newaxis]
            of = signals(law)[name].units
            outputs.append(Output(name, of, None if missing.all() else was, now, ~same))
    return outputs
