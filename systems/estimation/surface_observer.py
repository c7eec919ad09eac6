"""The observer of an unknown surface's normal as a block, and what it is given (Fig. 5-1)."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.surfaces.surface import Surface, normal
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
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.ports import finite_input

Array = NDArray[np.float64]


def make_filter(params: ResolvedSurfaceObserverParams) -> NormalFilter:
    """Return the filter that runs in the block."""
    if params.kind in ("thesis", "gated", "prior_weights"):
        return ConstrainedFilter(params)
    return ContactFrameFilter(params)


class SurfaceObserver(LeafSystem):
    """Estimates the normal of the surface that a compliant gripper slides on.

    .. pydrake_system::

        name: SurfaceObserver
        input_ports:
        - measured_force
        - measured_force_rate
        - nominal_motion
        - predicted_normal
        - restart
        output_ports:
        - normal
        - covariance
        - deviation
        - status

    In d = 2 or 3 dimensions, world frame. ``measured_force``, N, and ``measured_force_rate``, N/s,
    shape (d,), are of the gripper on the surface; ``nominal_motion``, shape (2d,), is position (m)
    and velocity (m/s) of the endpoint as it would be with a relaxed gripper. ``predicted_normal``,
    shape (d,), unit, may be left unconnected: a prediction, such as a camera's, whose turning the
    estimate follows (section 4.5). ``restart``, size 1, may be left unconnected too: while it is 1
    the observer knows the initial normal alone.

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
        d = len(params.stiffness)
        normal = np.asarray(initial_normal, dtype=np.float64)
        length = float(np.linalg.norm(normal))
        if normal.shape != (d,) or not 0 < length < np.inf:
            allowed = f"{d} finite numbers, not all zero"
            raise ParameterError("initial_normal", normal.tolist(), allowed)
        normal = normal / length
        self._filter = make_filter(params)
        sizes = {"measured_force": d, "measured_force_rate": d, "nominal_motion": 2 * d}
        self._ports = [self.DeclareVectorInputPort(*one) for one in sizes.items()]
        self._predicted = self.DeclareVectorInputPort("predicted_normal", d)
        self._restart = self.DeclareVectorInputPort("restart", 1)
        self._d = d
        P = params.initial_deviation**2 * np.eye(d)
        memory = self._filter.start(normal)
        self._start = Estimate(memory, normal, P, NormalStatus.NO_CONTACT)
        self._memory = self.DeclareDiscreteState(memory)
        self._outputs = []
        for name, value in _outputs(self._start).items():
            group = self.DeclareDiscreteState(value)
            self.DeclareStateOutputPort(name, group)
            self._outputs.append(group)
        # Unrestricted updates come before the discrete ones of the same instant, so that a plant
        # sees what a controller makes of the new estimate without another step's delay.
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._tick)

    def _tick(self, context: Context, state: DrakeState) -> None:
        force, rate, motion = (finite_input(port, context) for port in self._ports)
        predicted = None
        if self._predicted.HasValue(context):
            predicted = finite_input(self._predicted, context)
            length = float(np.linalg.norm(predicted))
            if not abs(length - 1) < 1e-6:
                allowed = "a vector of length 1"
                raise ParameterError("predicted_normal", predicted.tolist(), allowed)
            predicted = predicted / length  # or what is turned along would grow with every sample
        memory = context.get_discrete_state(self._memory).value()
        # The sensor gives the gripper's force on the surface, the observer uses the opposite.
        sample = Sample(-force, -rate, motion[: self._d], motion[self._d :], predicted)
        found = self._filter.update(memory, sample)
        if self._restart.HasValue(context) and self._restart.Eval(context)[0]:
            found = self._start
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
