"""What of a measured error a controller is to compensate."""

import math
from typing import NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError
from chamfer.systems.law import Array, Law, Signal


class SelectorObservation(NamedTuple):
    """What the law reads."""

    error: Array
    valid: Array
    open: Array


class SelectorCommand(NamedTuple):
    """What the law lets through."""

    error: Array
    valid: Array


class SelectorLaw(Law[None, SelectorObservation, SelectorCommand]):
    """See :class:`chamfer.systems.servo.measurement_selector.MeasurementSelector`.

    It remembers nothing: all that it gives is of what it reads.
    """

    observation = SelectorObservation

    def __init__(self, size: int, *, period: float = 1 / 80) -> None:
        if not (math.isfinite(size) and size >= 1):
            raise ParameterError("size", size, "a whole number >= 1")
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        self.period = period
        self.inputs = {"error": Signal(size), "valid": Signal(), "open": Signal(2)}
        self.outputs = {"error": Signal(size), "valid": Signal()}

    def start(self) -> None:
        """Return the state, of which there is none."""

    def step(
        self, state: None, observation: SelectorObservation, time: float
    ) -> tuple[None, SelectorCommand]:
        """Return what goes through."""
        error, valid, opened = observation
        if opened[1] < 0.5:
            error = np.concatenate([[0.0], error[1:]])
        return None, SelectorCommand(error, valid if opened[0] >= 0.5 else np.zeros(1))
