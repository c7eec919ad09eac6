"""Selects the part of a measured error that a controller compensates."""

from typing import NamedTuple

import numpy as np

from chamfer.systems.law import Array, Law, Signal


class SelectorObservation(NamedTuple):
    """The inputs of the law."""

    error: Array
    valid: Array
    open: Array


class SelectorCommand(NamedTuple):
    """The outputs of the law."""

    error: Array
    valid: Array


class SelectorLaw(Law[None, SelectorObservation, SelectorCommand]):
    """See :class:`chamfer.systems.servo.measurement_selector.MeasurementSelector`.

    It remembers nothing: all that it gives is of what it reads.
    """

    observation = SelectorObservation

    def __init__(self, size: int, *, period: float = 1 / 80) -> None:
        super().__init__(
            period=period,
            inputs={"error": Signal(size), "valid": Signal(), "open": Signal(2)},
            outputs={"error": Signal(size), "valid": Signal()},
            start=None,
        )

    def step(
        self, state: None, observation: SelectorObservation, time: float
    ) -> tuple[None, SelectorCommand]:
        """Return the outputs."""
        error, valid, opened = observation
        if opened[1] < 0.5:
            error = np.concatenate([[0.0], error[1:]])
        return None, SelectorCommand(error, valid if opened[0] >= 0.5 else np.zeros(1))
