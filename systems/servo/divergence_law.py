"""Whether a compensation makes the error that it measures grow instead of shrink."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.law import Array, Law, Signal

TAKES_BACK: Final = 0.25  # of a frame that says that an error has grown, one that does not


class Watched(NamedTuple):
    """Axes of an error whose size is watched together."""

    axes: tuple[int, ...]
    least: float  # in the error's unit: a smaller start counts as this


@dataclass(frozen=True, kw_only=True)
class DivergenceParams:
    """Parameters of :class:`DivergenceLaw`."""

    watched: tuple[Watched, ...]
    size: int  # of the error
    factor: float = 1.5  # ratio to the start beyond which an error has grown; infinity: never
    frames: int = 5
    # frames with grown errors until it reports; each other frame takes back a quarter; assumed
    period: float = 1 / 80  # s, section 4

    def __post_init__(self) -> None:
        require_positive(self, "period")
        if not self.factor > 1:
            raise ParameterError("factor", self.factor, "a number > 1, infinity for no watch")
        if not self.frames >= 1:
            raise ParameterError("frames", self.frames, "a whole number >= 1")
        for one in self.watched:
            if not (one.axes and min(one.axes) >= 0 and max(one.axes) < self.size):
                raise ParameterError("watched", one.axes, f"indices below {self.size}")
            if not 0 < one.least < math.inf:
                raise ParameterError("watched", one.least, "a finite number > 0")


class DivergenceState(NamedTuple):
    """The state between two frames."""

    start: Array  # sizes of the first valid error, shape (watched,), NaN before
    frames: Array  # that said that it has grown, shape (1,)
    diverged: Array  # shape (1,), 1 once it is told


class DivergenceObservation(NamedTuple):
    """The inputs of the law."""

    error: Array
    valid: Array
    blind: Array | None


class DivergenceCommand(NamedTuple):
    """The outputs of the law, shape (1,) each."""

    valid: Array
    diverged: Array
    stop: Array


class DivergenceLaw(Law[DivergenceState, DivergenceObservation, DivergenceCommand]):
    """The watch of :class:`chamfer.systems.servo.divergence_watch.DivergenceWatch`.

    The command is that of the frames before, so that it does not wait for this one's.
    """

    observation = DivergenceObservation

    def __init__(self, params: DivergenceParams) -> None:
        unknown = np.full(len(params.watched), math.nan)
        super().__init__(
            period=params.period,
            # Axes of an error have units of their own, that of a cell pixels and rad.
            inputs={
                "error": Signal(params.size),
                "valid": Signal(),
                "blind": Signal(optional=True),
            },
            outputs={"valid": Signal(), "diverged": Signal(), "stop": Signal()},
            start=DivergenceState(unknown, np.zeros(1), np.zeros(1)),
        )
        self.params = params

    def step(
        self, state: DivergenceState, observation: DivergenceObservation, time: float
    ) -> tuple[DivergenceState, DivergenceCommand]:
        """Return the state after a frame, and the outputs."""
        blind = observation.blind is not None and bool(observation.blind[0] >= 0.5)
        valid = np.zeros(1) if state.diverged[0] else observation.valid
        stop = np.maximum(state.diverged, float(blind))
        return (
            self._look(state, observation, blind),
            DivergenceCommand(valid, state.diverged, stop),
        )

    def _look(
        self, state: DivergenceState, observation: DivergenceObservation, blind: bool
    ) -> DivergenceState:
        params = self.params
        if state.diverged[0]:
            return state
        count = state.frames[0]
        if observation.valid[0] >= 0.5:
            error = observation.error
            sizes = np.array([np.linalg.norm(error[list(one.axes)]) for one in params.watched])
            if np.isnan(state.start).any():
                least = [one.least for one in params.watched]
                return state._replace(start=np.maximum(sizes, least))
            grown = bool((sizes > params.factor * state.start).any())
            count = max(count + (1.0 if grown else -TAKES_BACK), 0.0)
        enough = 1 if blind else params.frames
        return DivergenceState(state.start, np.array([count]), np.array([float(count >= enough)]))
