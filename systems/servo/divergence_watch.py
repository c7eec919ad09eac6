"""Whether a compensation makes the error that it measures grow instead of shrink."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from chamfer.models.validation import ParameterError, require_positive

Array = NDArray[np.float64]

TAKES_BACK: Final = 0.25  # of a frame that says that an error has grown, one that does not


class Watched(NamedTuple):
    """Axes of an error whose size is watched together."""

    axes: tuple[int, ...]
    least: float  # in the error's unit: a smaller start counts as this


@dataclass(frozen=True, kw_only=True)
class DivergenceParams:
    """Parameters of :class:`DivergenceWatch`."""

    watched: tuple[Watched, ...]
    size: int  # of the error
    factor: float = 1.5  # of the start, beyond which an error has grown; infinity: none has
    frames: int = 5  # that have to say so, each that does not takes back a quarter; assumed
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


class DivergenceWatch(LeafSystem):
    """Stops a compensation for good once the measured error has grown beyond its start.

    .. pydrake_system::

        name: DivergenceWatch
        input_ports:
        - error
        - valid
        - blind (optional)
        output_ports:
        - valid
        - diverged
        - stop

    ``error``, shape (size,), and ``valid``, shape (1,), are what a controller measures and acts
    on. The start is the first valid error. Once the size of some axes together has been more than
    ``factor`` times its start in ``frames`` valid frames, ``diverged``, shape (1,), turns to 1
    and stays so, and ``valid``, shape (1,), is 0 from then on, so that a controller holds what it
    has. A frame in which none has takes a quarter of one back, so that an error that swings to
    and fro is told, and a wrong frame now and then is not. While ``blind`` is 1 a single frame is
    enough, and one before it that nothing took back: what gets lost while its error grows is
    driven out of sight, and must not be driven on when it is seen again. ``stop``, shape (1,), is
    1 once it is told, and while ``blind`` is 1.

    A camera that is turned around, or gains that are too high, make the loop diverge. It is told
    by measured errors alone: where they grow though the parts come closer it is told too.

    Discrete state: the sizes at the start, NaN before; the frames; ``diverged``.
    """

    def __init__(self, params: DivergenceParams) -> None:
        super().__init__()
        self._params = params
        self._error = self.DeclareVectorInputPort("error", params.size)
        self._valid = self.DeclareVectorInputPort("valid", 1)
        blind = self._blind = self.DeclareVectorInputPort("blind", 1)
        self._start = self.DeclareDiscreteState(np.full(len(params.watched), math.nan))
        self._count = self.DeclareDiscreteState(1)
        diverged = self._diverged = self.DeclareDiscreteState(1)
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._look)
        told = {self.discrete_state_ticket(diverged)}

        def calc_valid(context: Context, vector: BasicVector) -> None:
            through = context.get_discrete_state(diverged)[0] < 0.5
            vector[0] = self._valid.Eval(context)[0] if through else 0.0

        def calc_stop(context: Context, vector: BasicVector) -> None:
            told = context.get_discrete_state(diverged)[0]
            vector[0] = max(float(self._is_blind(context)), told)

        self.DeclareVectorOutputPort("valid", 1, calc_valid, {self._valid.ticket(), *told})
        self.DeclareStateOutputPort("diverged", diverged)
        self.DeclareVectorOutputPort("stop", 1, calc_stop, {blind.ticket(), *told})

    def _is_blind(self, context: Context) -> bool:
        return bool(self._blind.HasValue(context) and self._blind.Eval(context)[0] >= 0.5)

    def _look(self, context: Context, state: State) -> None:
        values, params = context.get_discrete_state(), self._params
        if values.value(self._diverged)[0]:
            return
        changed = state.get_mutable_discrete_state()
        count = values.value(self._count)[0]
        if self._valid.Eval(context)[0] >= 0.5:
            error = self._error.Eval(context)
            sizes = np.array([np.linalg.norm(error[list(one.axes)]) for one in params.watched])
            start = values.value(self._start)
            if np.isnan(start).any():
                least = [one.least for one in params.watched]
                changed.set_value(self._start, np.maximum(sizes, least))
                return
            grown = bool((sizes > params.factor * start).any())
            count = max(count + (1.0 if grown else -TAKES_BACK), 0.0)
            changed.set_value(self._count, np.array([count]))
        enough = 1 if self._is_blind(context) else params.frames
        changed.set_value(self._diverged, np.array([float(count >= enough)]))
