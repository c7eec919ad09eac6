"""Contact detection: a state machine on the measured force, with threshold and hysteresis."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.validation import ParameterError, require_not_negative, require_positive
from systems.force.selection import unit
from systems.statechart.chart import Chart, State, Tick, Transition
from systems.statechart.state_machine import MachineOutput, StateMachine

Array = NDArray[np.float64]

APPROACH: Final = 0  # indices of the states, what the port ``state`` carries
CONTACT: Final = 1
LOST: Final = 2


@dataclass(frozen=True, kw_only=True)
class ContactDetectionParams:
    """Parameters of :class:`ContactDetection`."""

    detect: float = 0.1  # N, a larger force is contact
    release: float = 0.0  # N, while in contact a force not above it is its loss

    def __post_init__(self) -> None:
        require_positive(self, "detect")
        require_not_negative(self, "release")
        if not self.release < self.detect:
            raise ParameterError("release", self.release, f"less than detect, {self.detect:g}")


class Inputs(NamedTuple):
    """What the chart sees."""

    measured_force: tuple[float, ...]  # N, shape (m,), of the arm on the surface


class Memory(NamedTuple):
    """What the chart remembers."""

    contact_time: float = -1.0  # s, of the first contact; -1 before


def make_contact_chart(params: ContactDetectionParams, direction: Array) -> Chart[Inputs, Memory]:
    """Return the chart: approach, contact, lost.

    Args:
        params: The thresholds.
        direction: Shape (m,), in which the arm pushes, of any length.
    """
    ahead: list[float] = unit(direction, "direction").tolist()

    def push(tick: Tick[Inputs, Memory]) -> float:
        return sum(d * f for d, f in zip(ahead, tick.inputs.measured_force, strict=True))

    def touches(tick: Tick[Inputs, Memory]) -> bool:
        return push(tick) > params.detect

    return Chart(
        "contact detection",
        states=(State(name="approach"), State(name="contact"), State(name="lost")),
        transitions=(
            Transition(
                source="approach",
                target="contact",
                guard=touches,
                label=f"force > {params.detect:g} N",
                action=lambda tick: Memory(tick.time),
            ),
            Transition(
                source="contact",
                target="lost",
                guard=lambda tick: push(tick) <= params.release,
                label=f"force <= {params.release:g} N",
            ),
            Transition(
                source="lost",
                target="contact",
                guard=touches,
                label=f"force > {params.detect:g} N",
            ),
        ),
        memory=Memory(),
    )


class ContactDetection(StateMachine[Inputs, Memory]):
    """Tells contact from free motion, and remembers when it was first made (section 2.1.4).

    .. pydrake_system::

        name: ContactDetection
        input_ports:
        - measured_force
        output_ports:
        - contact_time
        - state

    ``measured_force``, shape (m,), N, of the arm on the surface. ``state`` is 0 before contact, 1
    in contact and 2 while it is lost; ``contact_time`` the time of the first contact in s, -1
    before.

    Args:
        params: The thresholds.
        direction: Shape (m,), in which the arm pushes, of any length.
        period: s.
    """

    def __init__(self, params: ContactDetectionParams, direction: Array, *, period: float) -> None:
        super().__init__(
            make_contact_chart(params, direction),
            inputs=Inputs,
            sizes={"measured_force": len(direction)},
            outputs={
                "contact_time": MachineOutput(size=1, read=lambda memory: (memory.contact_time,))
            },
            period=period,
        )
