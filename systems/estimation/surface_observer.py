"""The observer of an unknown surface's normal as a block, and what it is given (Fig. 5-1)."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.surfaces.surface import Surface, normal
from chamfer.models.validation import ParameterError, require_not_negative, require_one_of
from chamfer.systems.estimation.contact_frame_filter import (
    ContactFrameFilter,
    ContactFrameFilterParams,
)
from chamfer.systems.estimation.model_error import ModelErrorParams
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    ConstrainedFilterParams,
    Estimate,
    NormalFilter,
    NormalStatus,
    ResolvedSensingParams,
    Sample,
    SensingParams,
    tangential_deviation,
)
from chamfer.systems.force.contact_detection import CONTACT

Array = NDArray[np.float64]
ObserverKind = Literal["adaptive", "thesis", "gated", "prior_weights", "curvature", "friction"]
KINDS: Final[tuple[ObserverKind, ...]] = get_args(ObserverKind)


@dataclass(frozen=True, kw_only=True)
class SurfaceObserverParams(SensingParams):
    """Parameters of :class:`SurfaceObserver`.

    * ``adaptive``: a multiple-model extended Kalman filter that follows the Darboux frame of the
      contact point's path
      (:class:`chamfer.systems.estimation.contact_frame_filter.ContactFrameFilter`). It assumes
      nothing about the friction coefficient, and can be told what it may be told wrong.
    * ``thesis``: the constrained Kalman filter of section 4.3 as printed.
    * ``gated``: the same, without update and process noise while the gripper is at a halt, and
      without update while the contact point sticks.
    * ``prior_weights``: gated, and the force is divided by the prior estimate in (4-18).
    * ``curvature``: follows direction of motion and curvature, gated.
    * ``friction``: the same with the friction angle as a state, for friction known to be constant.
    """

    kind: ObserverKind = "adaptive"  # which observer estimates the normal; thesis: the paper's own
    # Of kind adaptive only:
    model_error: ModelErrorParams = ModelErrorParams()  # of what it is told
    rate_lag: float | None = None  # s, by which a rate that was made of the force lags
    # 0: measured beside it; None: derived, the sensor's

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "kind", KINDS)
        if self.kind == "adaptive":
            if self.rate_lag is not None:
                require_not_negative(self, "rate_lag")
            return
        if self.model_error != ModelErrorParams():
            raise ParameterError("model_error", self.model_error, "none, but for kind=adaptive")
        if self.rate_lag is not None:
            raise ParameterError("rate_lag", self.rate_lag, "null, but for kind=adaptive")


@dataclass(frozen=True, kw_only=True)
class ResolvedSurfaceObserverParams(ResolvedSensingParams, SurfaceObserverParams):
    """The same, with nothing left open."""


# Of each kind what the filter is told beside gripper, sensor and surface.
_CONSTRAINED: Final[Mapping[str, Mapping[str, Any]]] = {
    "thesis": {},
    "gated": {"gated": True},
    "prior_weights": {"gated": True, "weights": "prior"},
}
_FOLLOWING: Final[Mapping[str, Mapping[str, Any]]] = {
    "curvature": {"models": 1, "by_point": False},
    "friction": {"models": 1, "by_point": False, "by_friction": True},
    "adaptive": {},
}


def make_filter(params: ResolvedSurfaceObserverParams) -> NormalFilter:
    """Return the filter that runs in the block."""
    sensing = {field.name: getattr(params, field.name) for field in fields(SensingParams)}
    if params.kind in _CONSTRAINED:
        return ConstrainedFilter(ConstrainedFilterParams(**sensing, **_CONSTRAINED[params.kind]))
    return ContactFrameFilter(
        ContactFrameFilterParams(
            **sensing,
            **_FOLLOWING[params.kind],
            model_error=params.model_error,
            rate_lag=params.rate_lag or 0.0,
        )
    )


class SurfaceObserver(LeafSystem):
    """Estimates the normal of the surface that a compliant gripper slides on.

    .. pydrake_system::

        name: SurfaceObserver
        input_ports:
        - measured_force
        - measured_force_rate
        - nominal_motion
        - predicted_normal
        output_ports:
        - normal
        - covariance
        - deviation
        - status

    In d = 2 or 3 dimensions, world frame. ``measured_force``, N, and ``measured_force_rate``, N/s,
    shape (d,), are of the gripper on the surface; ``nominal_motion``, shape (2d,), is position (m)
    and velocity (m/s) of the endpoint as it would be with a relaxed gripper. ``predicted_normal``,
    shape (d,), unit, may be left unconnected: a prediction, such as a camera's, whose turning the
    estimate follows (section 4.5).

    ``normal``, shape (d,), unit, points out of the material; ``covariance``, shape (d * d,), is
    P row by row; ``deviation``, size 1, rad, is the standard deviation of the normal's direction,
    the largest one in space; ``status``, size 1, is a
    :class:`chamfer.systems.estimation.normal_filter.NormalStatus`: whether the last sample was a
    measurement, and if not, why. All are held over the period.

    Args:
        params: The observer.
        initial_normal: Shape (d,), of any length.

    Raises:
        ParameterError: If an input is not finite, or a prediction is not of unit length.
    """

    def __init__(self, params: ResolvedSurfaceObserverParams, initial_normal: Array) -> None:
        super().__init__()
        d = len(params.sensing.stiffness)
        normal = np.asarray(initial_normal, dtype=np.float64)
        length = float(np.linalg.norm(normal))
        if normal.shape != (d,) or not 0 < length < np.inf:
            raise ParameterError(
                "initial_normal", normal.tolist(), f"{d} finite numbers, not all zero"
            )
        normal = normal / length
        self._filter = make_filter(params)
        self._ports = [
            self.DeclareVectorInputPort(name, size)
            for name, size in (
                ("measured_force", d),
                ("measured_force_rate", d),
                ("nominal_motion", 2 * d),
            )
        ]
        self._predicted = self.DeclareVectorInputPort("predicted_normal", d)
        self._d = d
        self._memory = self.DeclareDiscreteState(self._filter.start(normal))
        start = Estimate(
            memory=np.zeros(0),
            normal=normal,
            covariance=params.initial_deviation**2 * np.eye(d),
            status=NormalStatus.NO_CONTACT,
        )
        self._outputs = []
        for name, value in _outputs(start).items():
            group = self.DeclareDiscreteState(value)
            self.DeclareStateOutputPort(name, group)
            self._outputs.append(group)
        # Unrestricted updates come before the discrete ones of the same instant, so that a plant
        # sees what a controller makes of the new estimate without another step's delay.
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._tick)

    def _tick(self, context: Context, state: DrakeState) -> None:
        force, rate, motion = (_finite(port, port.Eval(context)) for port in self._ports)
        predicted = None
        if self._predicted.HasValue(context):
            predicted = _finite(self._predicted, self._predicted.Eval(context))
            length = float(np.linalg.norm(predicted))
            if not abs(length - 1) < 1e-6:
                raise ParameterError(
                    "predicted_normal", predicted.tolist(), "a vector of length 1"
                )
            predicted = predicted / length  # or what is turned along would grow with every sample
        memory = context.get_discrete_state(self._memory).value()
        # The sensor gives the gripper's force on the surface, the observer uses the opposite.
        sample = Sample(-force, -rate, motion[: self._d], motion[self._d :], predicted)
        found = self._filter.update(memory, sample)
        values = state.get_mutable_discrete_state()
        values.set_value(self._memory, found.memory)
        for group, value in zip(self._outputs, _outputs(found).values(), strict=True):
            values.set_value(group, value)


def _outputs(estimate: Estimate) -> dict[str, Array]:
    return {
        "normal": estimate.normal,
        "covariance": estimate.covariance.ravel(),
        "deviation": np.array([tangential_deviation(estimate.normal, estimate.covariance)]),
        "status": np.array([float(estimate.status)]),
    }


def _finite(port: object, value: Array) -> Array:
    if not np.all(np.isfinite(value)):
        name = port.get_name()  # type: ignore[attr-defined]
        raise ParameterError(name, value.tolist(), "finite numbers")
    return value


class SettledForce(LeafSystem):
    """Hides force and rate for some time after contact is made.

    .. pydrake_system::

        name: SettledForce
        input_ports:
        - mode
        - measured_force
        - measured_force_rate
        output_ports:
        - settled_force
        - settled_force_rate

    The observer takes gripper and arm to be quasi-static (section 4.1), which an impact is not: it
    would be sure of a wrong normal, the more the quieter the sensor. Zeros are no contact to it.

    ``measured_force``, N, and ``measured_force_rate``, N/s, shape (d,); ``mode``, size 1, as
    :class:`chamfer.systems.force.contact_detection.ContactDetection` gives it. The outputs, shape
    (d,), are zeros in the first ``wait`` seconds of each contact, else what is measured.

    Discrete state: for how long there has been contact, s, size 1.

    Args:
        wait: s, >= 0.
        dimension: d.
        period: s.
    """

    def __init__(self, wait: float, *, dimension: int, period: float) -> None:
        super().__init__()
        if not 0 <= wait < np.inf:
            raise ParameterError("wait", wait, "a finite number >= 0")
        mode = self.DeclareVectorInputPort("mode", 1)
        lasted = self.DeclareDiscreteState(1)

        def declare(name: str) -> None:
            measured: InputPort = self.DeclareVectorInputPort(f"measured_{name}", dimension)

            def calc(context: Context, vector: BasicVector) -> None:
                age = context.get_discrete_state(lasted).value()[0]
                fades = mode.Eval(context)[0] == CONTACT and age < wait - 0.5 * period
                vector.SetFromVector(np.zeros(dimension) if fades else measured.Eval(context))

            sources = {measured.ticket(), mode.ticket(), self.discrete_state_ticket(lasted)}
            self.DeclareVectorOutputPort(f"settled_{name}", dimension, calc, sources)

        declare("force")
        declare("force_rate")

        def tick(context: Context, values: DiscreteValues) -> None:
            age = context.get_discrete_state(lasted).value()
            values.set_value(lasted, age + period if mode.Eval(context)[0] == CONTACT else 0 * age)

        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)


class PredictedNormal(LeafSystem):
    """Gives the normal of a stored surface where the gripper is.

    .. pydrake_system::

        name: PredictedNormal
        input_ports:
        - nominal_motion
        output_ports:
        - predicted_normal

    ``nominal_motion``, shape (2d,), is the nominal endpoint's position, m, then its velocity;
    ``predicted_normal``, shape (d,), unit, that of the stored surface's level at this position.

    Args:
        surface: The surface as it is taken to be.
    """

    def __init__(self, surface: Surface) -> None:
        super().__init__()
        d = surface.dimension
        motion = self.DeclareVectorInputPort("nominal_motion", 2 * d)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(normal(surface, motion.Eval(context)[:d]))

        self.DeclareVectorOutputPort("predicted_normal", d, calc, {motion.ticket()})
