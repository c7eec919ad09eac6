"""Joint encoders: counts, the velocity that a computer derives, homing, and the endpoint."""

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import (
    ParameterError,
    known,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.compiled import compiled
from chamfer.systems.force.sampled_loop import Sampled

Array = NDArray[np.float64]
Velocity = Literal["exact", "differenced", "tracked"]
VELOCITIES: Final = get_args(Velocity)
EXACT, DIFFERENCED, TRACKED = range(3)  # their indices


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
        counts = 0.0 if self.counts is None else self.counts
        if not all(0 <= one < math.inf for one in np.atleast_1d(counts)):
            raise ParameterError("counts", self.counts, "finite numbers >= 0")
        if self.velocity is not None:
            require_one_of(self, "velocity", VELOCITIES)
        require_not_negative(self, "bandwidth")
        if self.velocity == "exact" and self.bandwidth:
            raise ParameterError("bandwidth", self.bandwidth, "0 with an exact velocity")
        if self.velocity == "tracked" and self.bandwidth == 0:
            raise ParameterError("bandwidth", self.bandwidth, "more than 0 Hz, to track")

    def quanta(self, n: int) -> Array:
        """Return the size of a count at n joints, rad or m; 0 where positions are exact."""
        counts = known("counts", self.counts)
        if isinstance(counts, tuple) and len(counts) != n:
            raise ParameterError("counts", counts, f"{n} numbers, or one for all")
        each = np.full(n, counts, dtype=np.float64)
        return np.divide(1.0, each, out=np.zeros(n), where=each > 0)

    @property
    def exact(self) -> bool:
        """Whether positions and velocities are exact."""
        counts: Any = known("counts", self.counts)
        return self.velocity == "exact" and not np.any(counts)


class EncoderCode(NamedTuple):
    """Encoders of n joints for machine code."""

    quanta: Array  # (n,), rad or m, of a count, 0 where positions are exact
    velocity: int  # EXACT, DIFFERENCED or TRACKED
    pole: float  # of the filter, in a period
    period: float  # s


def encoder_code(params: EncoderParams, n: int, *, period: float) -> EncoderCode:
    """Return the encoders of n joints for :func:`read_encoders`."""
    velocity = VELOCITIES.index(known("velocity", params.velocity))
    pole = math.exp(-2 * math.pi * known("bandwidth", params.bandwidth) * period)
    return EncoderCode(params.quanta(n), velocity, pole, period)


@compiled
def counted(quanta: Array, q: Array) -> Array:
    """Return joint positions rounded to counts."""
    result = q.copy()
    for j in range(len(q)):
        if quanta[j] > 0.0:
            result[j] = quanta[j] * np.rint(q[j] / quanta[j])
    return result


@compiled
def read_encoders(
    code: EncoderCode, q: Array, v: Array, before: Array, tracked: Array, velocity: Array
) -> tuple[Array, Array, Array]:
    """Return position, filtered position and velocity at this tick from those of the last one.

    Shape (n,) each; see :class:`Encoders`.
    """
    q, pole = counted(code.quanta, q), code.pole
    if code.velocity == EXACT:
        return q, q, v
    if code.velocity == DIFFERENCED:
        follow = 1.0 - pole if pole < 1.0 else 1.0
        return q, q, velocity + follow * ((q - before) / code.period - velocity)
    ahead = tracked + code.period * velocity
    missing = q - ahead
    faster = velocity + (1.0 - pole) ** 2 / code.period * missing
    return q, ahead + (1.0 - pole**2) * missing, faster


class Encoders(LeafSystem):
    """Measures joint positions in whole counts, and derives velocities from them.

    .. pydrake_system::

        name: Encoders
        input_ports:
        - motion
        output_ports:
        - encoders

    A position is rounded to the nearest count. A ``differenced`` velocity is the mean over the
    last period, half a period old, in steps of a count per period. A ``tracked`` velocity comes
    from a second-order tracking filter (alpha-beta, two equal poles), which follows a constant
    velocity without error. With poles p = exp(-2 pi bandwidth T) its gains are 1 - p^2 and
    (1 - p)^2.

    ``motion`` and ``encoders``, shape (2n,): positions (rad or m), then velocities. The output
    is that of the tick that reads it; the period, s, is the computer's.

    Discrete states: position of the tick before, filtered position and velocity, shape (n,) each,
    at first at rest at ``q``.

    Raises:
        ParameterError: If parameters are open, or their number of joints differs.
    """

    def __init__(self, params: EncoderParams, q: Array, *, period: float) -> None:
        super().__init__()
        n = len(q)
        self._code = code = encoder_code(params, n, period=period)
        self._motion = self.DeclareVectorInputPort("motion", 2 * n)
        start = counted(code.quanta, np.array(q, np.float64))
        for value in (start, start, np.zeros(n)):
            self.DeclareDiscreteState(value)
        if code.velocity != EXACT:
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._tick)
        depends = {self._motion.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort("encoders", 2 * n, self._calc, depends)

    def _read(self, context: Context) -> tuple[Array, Array, Array]:
        """Return position, filtered position and velocity."""
        q, v = np.split(self._motion.Eval(context).copy(), 2)
        held = (context.get_discrete_state(i).value().copy() for i in range(3))
        return read_encoders(self._code, q, v, *held)

    def _calc(self, context: Context, vector: BasicVector) -> None:
        q, _, velocity = self._read(context)
        vector.SetFromVector(np.concatenate([q, velocity]))

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        for i, value in enumerate(self._read(context)):
            values.set_value(i, value)


def linear_encoders(params: EncoderParams, n: int, *, period: float, beside: int) -> Sampled:
    """Return exact :class:`Encoders`, and ``beside`` signals that pass unchanged.

    Input and output: n joint positions, then velocities, and what passes beside the encoders.
    States: position before and velocity, or position and velocity of the tracking filter, shape
    (n,) each.
    """
    pole = math.exp(-2 * math.pi * known("bandwidth", params.bandwidth) * period)
    if params.velocity == "exact":
        none = np.zeros((0, 2 * n + beside))
        return Sampled(np.zeros((0, 0)), none, none.T, np.eye(2 * n + beside))
    if params.velocity == "differenced":
        follow = 1 - pole if pole < 1 else 1.0
        keeps = np.array([[0.0, 0.0], [-follow / period, 1 - follow]])
        takes = np.array([1.0, follow / period])
    else:
        stiff, fast = 1 - pole**2, (1 - pole) ** 2 / period
        keeps = np.array([[1 - stiff, (1 - stiff) * period], [-fast, 1 - fast * period]])
        takes = np.array([stiff, fast])
    each = np.eye(n)
    A = np.kron(keeps, each)
    B = np.hstack([np.kron(takes[:, np.newaxis], each), np.zeros((2 * n, n + beside))])
    C, D = np.zeros((2 * n + beside, 2 * n)), np.eye(2 * n + beside)
    C[n : 2 * n], D[n : 2 * n] = A[n:], B[n:]
    return Sampled(A, B, C, D)


@dataclass(frozen=True, kw_only=True)
class HomingParams:
    """Parameters of :class:`Homing`."""

    zero_error: tuple[float, ...] = ()
    # rad or m, of each joint: error of its encoder when it is switched on; empty: 0
    mark_distance: tuple[float, ...] = ()
    # rad or m, of each joint: from its position at switch-on to its index mark; empty or 0: the
    # zero is known
    settle: float = 0.5  # s, over which a new zero is taken over; assumed

    def __post_init__(self) -> None:
        require_positive(self, "settle")
        for name in ("zero_error", "mark_distance"):
            if not all(map(math.isfinite, getattr(self, name))):
                raise ParameterError(name, getattr(self, name), "finite numbers")

    def for_joints(self, n: int) -> tuple[Array, Array]:
        """Return zero errors and marks' distances of n joints, shape (n,) each."""
        for name in ("zero_error", "mark_distance"):
            if len(getattr(self, name)) not in (0, n):
                raise ParameterError(name, getattr(self, name), f"{n} numbers, or none")
        error = np.array(self.zero_error or [0.0] * n)
        distance = np.array(self.mark_distance or [0.0] * n)
        if np.any((error != 0) & (distance == 0)):
            raise ParameterError("zero_error", self.zero_error, "0 where mark_distance is 0")
        return error, distance


class Homing(LeafSystem):
    """Counts from an unknown zero until each joint has passed its index mark.

    .. pydrake_system::

        name: Homing
        input_ports:
        - motion
        output_ports:
        - encoders
        - homed

    Behind its mark a joint's zero is known to a count. The block takes it over gradually, so that
    an arm under position control follows smoothly to its correct position. Velocities are
    differences of counts, and always correct.

    ``motion``, shape (2n,), joint positions (rad or m) from the true zero, then velocities, of
    encoders with a known zero. ``encoders``, shape (2n,), is the reading; ``homed``, size 1, is 1
    once all zeros are known and taken over.

    Discrete states: side of the mark on which a joint was, and time since it passed the mark, s,
    -1 before, shape (n,) each. It starts at ``q``, shape (n,).

    Raises:
        ParameterError: If parameters are for another number of joints.
    """

    def __init__(self, params: HomingParams, q: Array, *, period: float) -> None:
        super().__init__()
        n = len(q)
        error, distance = params.for_joints(n)
        marks = q + distance
        motion = self.DeclareVectorInputPort("motion", 2 * n)
        side = self.DeclareDiscreteState(np.sign(-distance))
        since = self.DeclareDiscreteState(np.where(distance == 0, params.settle, -1.0))

        def left(context: Context) -> Array:
            """Return the remaining share of each joint's error, 1 to 0."""
            u = np.clip(context.get_discrete_state(since).value() / params.settle, 0.0, 1.0)
            share: Array = 1 - u**3 * (10 - 15 * u + 6 * u**2)
            return share

        def calc(context: Context, vector: BasicVector) -> None:
            true = motion.Eval(context)
            vector.SetFromVector([*(true[:n] + error * left(context)), *true[n:]])

        def calc_homed(context: Context, vector: BasicVector) -> None:
            vector.SetAtIndex(0, float(not left(context).any()))

        def tick(context: Context, values: DiscreteValues) -> None:
            now = np.sign(motion.Eval(context)[:n] - marks)
            before = context.get_discrete_state(since).value()
            passed = (now != context.get_discrete_state(side).value()) | (before >= 0)
            values.set_value(side, now)
            values.set_value(since, np.where(passed, np.maximum(before, 0.0) + period, -1.0))

        known = self.discrete_state_ticket(since)
        self.DeclareVectorOutputPort("encoders", 2 * n, calc, {motion.ticket(), known})
        self.DeclareVectorOutputPort("homed", 1, calc_homed, {known})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)


class EndpointMotion(LeafSystem):
    """Computes the endpoint's motion from joint positions and velocities.

    .. pydrake_system::

        name: EndpointMotion
        input_ports:
        - encoders
        output_ports:
        - endpoint_motion
        - nominal_motion

    The endpoint is the tip of a relaxed gripper, the nominal endpoint of chapter 4. ``encoders``,
    shape (2n,), is q and velocity. ``endpoint_motion``, shape (2m,), is the endpoint vector x,
    m (rad), then ``J v``. ``nominal_motion``, shape (2d,), has the same for its first d
    coordinates; d is the ``dimension`` of the plane or of space.
    """

    def __init__(self, arm: Kinematics, *, dimension: int) -> None:
        super().__init__()
        n, m = arm.num_joints, arm.num_coordinates
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)

        def declare(name: str, size: int) -> None:
            def calc(context: Context, vector: BasicVector) -> None:
                measured = encoders.Eval(context)
                q, v = measured[:n], measured[n:]
                vector.SetFromVector([*arm.endpoint(q)[:size], *(arm.jacobian(q) @ v)[:size]])

            self.DeclareVectorOutputPort(name, 2 * size, calc, {encoders.ticket()})

        declare("endpoint_motion", m)
        declare("nominal_motion", dimension)
