"""Laws: controllers without Drake, which start, and make a command of each observation.

A law holds its parameters, which never change. The changing part is its state, an immutable value
that one step hands to the next. The same law runs in a diagram, in a
:class:`~chamfer.systems.law_block.LawBlock`, on a robot, and on a log.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, finite

State = TypeVar("State")
Observation = TypeVar("Observation")
Command = TypeVar("Command")
Array: TypeAlias = NDArray[np.float64]
Vectors: TypeAlias = Mapping[str, Sequence[float] | Array | None]  # by name, None where missing


class Signal(NamedTuple):
    """A vector that a law reads or gives."""

    size: int = 1
    unit: str | tuple[str, ...] = ""  # of all elements, or of each
    optional: bool = False  # may be missing: the law then reads None
    finite: bool = False  # is refused if an element is not

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each element."""
        return (self.unit,) * self.size if isinstance(self.unit, str) else self.unit


class Law(ABC, Generic[State, Observation, Command]):
    """A controller that decides once a ``period``, s, from its first state, ``start``, on.

    ``inputs`` and ``outputs`` have a :class:`Signal` for each field of the named tuples of
    observation and command, in their order. ``observation`` is the class of the former.

    Raises:
        ParameterError: If the period or a size is not positive.
    """

    observation: Callable[..., Observation]

    def __init__(
        self,
        *,
        period: float,
        inputs: Mapping[str, Signal],
        outputs: Mapping[str, Signal],
        start: State,
    ) -> None:
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        for name, signal in (*inputs.items(), *outputs.items()):
            if signal.size < 1:
                raise ParameterError(f"size of {name}", signal.size, "a whole number >= 1")
            if len(signal.units) != signal.size:
                raise ParameterError(f"units of {name}", signal.units, f"one, or {signal.size}")
        self.period, self.inputs, self.outputs = period, inputs, outputs
        self._start = start

    def in_units(self, **units: str | tuple[str, ...]) -> None:
        """Set the units of the named inputs and outputs, of a law that takes any unit."""
        self.inputs, self.outputs = (
            {name: one._replace(unit=units.get(name, one.unit)) for name, one in signals.items()}
            for signals in (self.inputs, self.outputs)
        )

    def start(self) -> State:
        """Return the state before the first step."""
        return self._start

    @abstractmethod
    def step(self, state: State, observation: Observation, time: float) -> tuple[State, Command]:
        """Return the state after a step, and its command; the time is in s."""

    def abort(self, state: State, observation: Observation, time: float) -> State:
        """Return the state after a step in which the robot is stopped; a chart handles that."""
        return state

    def observe(self, values: Vectors) -> Observation:
        """Return the observation from vectors by name.

        They are copies, so that a state may hold them though a robot writes its next reading
        there.

        Raises:
            ParameterError: If one is missing, has another size, or is not finite and has to be.
        """
        return self.observation(*vectors(self.inputs, values))


class HeldLaw(Law[State, Observation, Command]):
    """A law whose command is a function of its state, and held until the next step.

    By default it is the state itself, which then has the fields of the ``outputs``.
    """

    @abstractmethod
    def update(self, state: State, observation: Observation, time: float) -> State:
        """Return the state after a step."""

    def command(self, state: State) -> Any:
        """Return the command in a state."""
        return state

    def step(self, state: State, observation: Observation, time: float) -> tuple[State, Command]:
        """Return the state after a step, and its command; the time is in s."""
        state = self.update(state, observation, time)
        return state, self.command(state)


def vectors(inputs: Mapping[str, Signal], values: Vectors) -> list[Array | None]:
    """Return the vectors of an observation, checked copies, in the order of the inputs."""
    return [_checked(name, signal, values.get(name)) for name, signal in inputs.items()]


def _checked(name: str, signal: Signal, value: Sequence[float] | Array | None) -> Array | None:
    if value is None:
        if not signal.optional:
            raise ParameterError(name, None, f"{signal.size} numbers")
        return None
    array = np.array(value, dtype=np.float64)
    if array.shape != (signal.size,):
        raise ParameterError(name, array.tolist(), f"{signal.size} numbers")
    return finite(name, array) if signal.finite else array
