"""The observer of an unknown surface's normal (Fig. 5-1)."""

from typing import NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.contact_frame_filter import ContactFrameFilter
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    Estimate,
    NormalFilter,
    NormalStatus,
    ResolvedSurfaceObserverParams,
    Sample,
    tangential_deviation,
)
from chamfer.systems.law import Array, HeldLaw, Signal


def make_filter(params: ResolvedSurfaceObserverParams) -> NormalFilter:
    """Return the filter that runs in the observer."""
    if params.kind in ("thesis", "gated", "prior_weights"):
        return ConstrainedFilter(params)
    return ContactFrameFilter(params)


class ObserverObservation(NamedTuple):
    """Inputs of the law, in d = 2 or 3 dimensions."""

    measured_force: Array
    measured_force_rate: Array
    nominal_motion: Array
    predicted_normal: Array | None
    restart: Array | None


class ObserverState(NamedTuple):
    """Memory from one sample to the next: the filter's memory, and its outputs."""

    memory: Array
    normal: Array  # (d,)
    covariance: Array  # (d * d,)
    deviation: Array  # (1,), rad
    status: Array  # (1,)


class SurfaceObserverLaw(HeldLaw[ObserverState, ObserverObservation, ObserverState]):
    """See :class:`chamfer.systems.estimation.surface_observer.SurfaceObserver`."""

    observation = ObserverObservation

    def __init__(self, params: ResolvedSurfaceObserverParams, initial_normal: Array) -> None:
        d = len(params.stiffness)
        normal = np.asarray(initial_normal, dtype=np.float64)
        length = float(np.linalg.norm(normal))
        if normal.shape != (d,) or not 0 < length < np.inf:
            allowed = f"{d} finite numbers, not all zero"
            raise ParameterError("initial_normal", normal.tolist(), allowed)
        normal = normal / length
        self.params = params
        self._filter = make_filter(params)
        P = params.initial_deviation**2 * np.eye(d)
        memory = self._filter.start(normal)
        super().__init__(
            period=params.period,
            inputs={
                "measured_force": Signal(d, "N", finite=True),
                "measured_force_rate": Signal(d, "N/s", finite=True),
                "nominal_motion": Signal(2 * d, ("m",) * d + ("m/s",) * d, finite=True),
                "predicted_normal": Signal(d, optional=True, finite=True),
                "restart": Signal(optional=True),
            },
            outputs={
                "normal": Signal(d),
                "covariance": Signal(d * d),
                "deviation": Signal(1, "rad"),
                "status": Signal(),
            },
            start=_state(Estimate(memory, normal, P, NormalStatus.NO_CONTACT)),
        )

    def update(
        self, state: ObserverState, observation: ObserverObservation, time: float
    ) -> ObserverState:
        """Return the state after a sample."""
        force, rate, motion, predicted, restart = observation
        if predicted is not None:
            length = float(np.linalg.norm(predicted))
            if not abs(length - 1) < 1e-6:
                allowed = "a vector of length 1"
                raise ParameterError("predicted_normal", predicted.tolist(), allowed)
            predicted = predicted / length  # or what is turned along would grow with every sample
        if restart is not None and restart[0]:
            return self._start
        d = len(force)
        # The sensor gives the gripper's force on the surface, the observer uses the opposite.
        sample = Sample(-force, -rate, motion[:d], motion[d:], predicted)
        return _state(self._filter.update(state.memory, sample))


def _state(estimate: Estimate) -> ObserverState:
    return ObserverState(
        estimate.memory,
        estimate.normal,
        estimate.covariance.ravel(),
        np.array([tangential_deviation(estimate.normal, estimate.covariance)]),
        np.array([float(estimate.status)]),
    )
