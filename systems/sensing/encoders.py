"""Joint encoders: counts, and the velocity that a computer makes of them."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError, known, require_not_negative, require_one_of

Array = NDArray[np.float64]
Velocity = Literal["exact", "differenced", "tracked"]


@dataclass(frozen=True, kw_only=True)
class EncoderParams:
    """Parameters of :class:`Encoders`; None: derived from ``sensing``."""

    counts: float | tuple[float, ...] | None = None
    # per rad or m, of each joint or of all of them; 0: exact positions
    velocity: Velocity | None = None
    # exact; differenced: two counts by the period; tracked: of a tracking filter
    bandwidth: float | None = None
    # Hz, of the low-pass behind the difference, 0 for none, or of the tracking filter

    def __post_init__(self) -> None:
        if self.counts is not None and not all(
            0 <= one < math.inf for one in np.atleast_1d(self.counts)
        ):
            raise ParameterError("counts", self.counts, "finite numbers >= 0")
        if self.velocity is not None:
            require_one_of(self, "velocity", ("exact", "differenced", "tracked"))
        if self.bandwidth is not None:
            require_not_negative(self, "bandwidth")
            if self.velocity == "exact" and self.bandwidth:
                raise ParameterError("bandwidth", self.bandwidth, "0 with an exact velocity")
            if self.velocity == "tracked" and not self.bandwidth:
                raise ParameterError("bandwidth", self.bandwidth, "more than 0 Hz, to track")

    def quanta(self, n: int) -> Array:
        """Return what a count is at n joints, rad or m; 0 where positions are exact.

        Raises:
            ParameterError: If there are counts for more or fewer of them.
        """
        counts = known("counts", self.counts)
        if isinstance(counts, tuple) and len(counts) != n:
            raise ParameterError("counts", counts, f"{n} numbers, or one for all")
        each = np.full(n, counts, dtype=np.float64)
        return np.divide(1.0, each, out=np.zeros(n), where=each > 0)

    @property
    def exact(self) -> bool:
        """Whether they show what is."""
        counts: Any = known("counts", self.counts)
        return self.velocity == "exact" and not np.any(counts)


class Encoders(LeafSystem):
    """Joint positions in whole counts, and velocities that are made of them.

    .. pydrake_system::

        name: Encoders
        input_ports:
        - motion
        output_ports:
        - encoders

    A position is rounded to the next count. A ``differenced`` velocity is the last period's mean,
    half a period old, in steps of a count by the period; ``tracked`` is that of a second-order
    tracking filter (alpha-beta, both poles at the same place), which follows a constant velocity
    without error: with poles p = exp(-2 pi bandwidth T) its gains are 1 - p^2 and (1 - p)^2.

    ``motion`` and ``encoders``, shape (2n,): positions (rad or m), then velocities. The output
    belongs to the tick that reads it.

    Discrete states: position of the tick before, filtered position and velocity, shape (n,) each.

    Args:
        params: Counts and velocity.
        q: Joint positions at the start, at rest, shape (n,).
        period: s, of the computer.

    Raises:
        ParameterError: If parameters are open, or for another number of joints.
    """

    def __init__(self, params: EncoderParams, q: Array, *, period: float) -> None:
        super().__init__()
        n = len(q)
        self._quanta, self._period = params.quanta(n), period
        self._velocity = known("velocity", params.velocity)
        self._pole = math.exp(-2 * math.pi * known("bandwidth", params.bandwidth) * period)
        self._motion = self.DeclareVectorInputPort("motion", 2 * n)
        start = self._counted(q)
        for value in (start, start, np.zeros(n)):
            self.DeclareDiscreteState(value)
        if self._velocity != "exact":
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._tick)
        depends = {self._motion.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort("encoders", 2 * n, self._calc, depends)

    def _counted(self, q: Array) -> Array:
        return np.where(
            self._quanta > 0, self._quanta * np.round(q / np.maximum(self._quanta, 1e-300)), q
        )

    def _read(self, context: Context) -> tuple[Array, Array, Array]:
        """Return position, filtered position and velocity."""
        motion = self._motion.Eval(context)
        n, pole = len(motion) // 2, self._pole
        q = self._counted(motion[:n])
        if self._velocity == "exact":
            return q, q, motion[n:]
        before, tracked, velocity = (context.get_discrete_state(i).value() for i in range(3))
        if self._velocity == "differenced":
            follow = 1 - pole if pole < 1 else 1.0
            return q, q, velocity + follow * ((q - before) / self._period - velocity)
        ahead = tracked + self._period * velocity
        missing = q - ahead
        return (
            q,
            ahead + (1 - pole**2) * missing,
            velocity + (1 - pole) ** 2 / self._period * missing,
        )

    def _calc(self, context: Context, vector: BasicVector) -> None:
        q, _, velocity = self._read(context)
        vector.SetFromVector(np.concatenate([q, velocity]))

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        for i, value in enumerate(self._read(context)):
            values.set_value(i, value)
