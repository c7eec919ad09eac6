"""The zero of a force sensor, and the scatter of its readings."""

from typing import NamedTuple

import numpy as np

from chamfer.systems.law import Array, Law, Signal


class TareState(NamedTuple):
    """Memory from one reading to the next."""

    mean: Array  # N, or N m above N, shape (size,)
    squares: Array  # sum of squared deviations from it, shape (size,)
    counts: Array  # readings of the zero that is being taken, and of the last one, shape (2,)


class TareObservation(NamedTuple):
    """Inputs of the law."""

    force: Array
    tare: Array


class TareCommand(NamedTuple):
    """Outputs of the law, shape (size,) each."""

    tared_force: Array
    spread: Array


class TareLaw(Law[TareState, TareObservation, TareCommand]):
    """See :class:`chamfer.systems.sensing.force_sensor.Tare`.

    It subtracts the mean of the readings before this one.
    """

    observation = TareObservation

    def __init__(self, *, period: float, size: int = 3) -> None:
        unit = ("N m",) * 3 + ("N",) * 3 if size == 6 else "N"
        super().__init__(
            period=period,
            inputs={"force": Signal(size, unit, finite=True), "tare": Signal()},
            outputs={"tared_force": Signal(size, unit), "spread": Signal(size, unit)},
            start=TareState(np.zeros(size), np.zeros(size), np.zeros(2)),
        )

    def step(
        self, state: TareState, observation: TareObservation, time: float
    ) -> tuple[TareState, TareCommand]:
        """Return the state after a reading, and the reading minus the last zero."""
        force, tare = observation
        running, last = state.counts.tolist()
        spread = np.sqrt(state.squares / max(last - 1, 1))
        if not tare[0] > 0.5:
            rest = state._replace(counts=np.array([0.0, last]))
            return rest, TareCommand(force - state.mean, spread)
        # The first one of a new zero leaves nothing of the last.
        sums = state.squares if running else np.zeros_like(force)
        mean = state.mean + (force - state.mean) / (running + 1) if running else force
        squares = sums + (force - state.mean) * (force - mean)
        taken = TareState(mean, squares, np.full(2, running + 1))
        return taken, TareCommand(np.zeros_like(force), spread)
