"""The observer of an unknown surface's normal as a block, and its inputs (Fig. 5-1)."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem

from chamfer.models.surfaces.surface import Surface, normal
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.normal_filter import ResolvedSurfaceObserverParams
from chamfer.systems.estimation.surface_observer_law import SurfaceObserverLaw
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.law import Array
from chamfer.systems.law_block import LawBlock


class SurfaceObserver(LawBlock[SurfaceObserverLaw]):
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

    All signals have d = 2 or 3 dimensions, world frame. The last two inputs may be left
    unconnected.

    * ``measured_force``, N, and ``measured_force_rate``, N/s, shape (d,), are of the gripper on
      the surface.
    * ``nominal_motion``, shape (2d,), is position (m) and velocity (m/s) of the endpoint with a
      relaxed gripper.
    * ``predicted_normal``, shape (d,), unit, is a prediction, such as a camera's; the estimate
      follows its turning (section 4.5).
    * ``restart``, size 1: while it is 1, the observer uses only the initial normal.
    * ``normal``, shape (d,), unit, points out of the material.
    * ``covariance``, shape (d * d,), is P row by row.
    * ``deviation``, size 1, rad, is the standard deviation of the normal's direction, the largest
      one in space.
    * ``status``, size 1, is a :class:`chamfer.systems.estimation.normal_filter.NormalStatus`:
      whether the last sample was a measurement, and if not, why.

    All outputs are held over the period.

    Args:
        params: The observer.
        initial_normal: Shape (d,), of any length.

    Raises:
        ParameterError: If an input is not finite, or a prediction is not of unit length.
    """

    def __init__(self, params: ResolvedSurfaceObserverParams, initial_normal: Array) -> None:
        super().__init__(SurfaceObserverLaw(params, initial_normal))


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

    The observer assumes that gripper and arm are quasi-static (section 4.1), but an impact is not.
    From an impact it would be certain of a wrong normal, the more the quieter the sensor. It reads
    zeros as no contact.

    ``measured_force``, N, and ``measured_force_rate``, N/s, have shape (d,). ``mode``, size 1, is
    that of :class:`chamfer.systems.force.contact_detection.ContactDetection`. The outputs, shape
    (d,), are zeros in the first ``wait`` seconds of each contact, else the inputs.

    Discrete state: duration of the present contact, s, size 1.

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
    """Looks up the normal of a stored surface at the gripper's position.

    .. pydrake_system::

        name: PredictedNormal
        input_ports:
        - nominal_motion
        output_ports:
        - predicted_normal

    ``nominal_motion``, shape (2d,), is the nominal endpoint's position, m, then its velocity;
    ``predicted_normal``, shape (d,), unit, that of the stored surface's level at this position.

    Args:
        surface: The assumed surface.
    """

    def __init__(self, surface: Surface) -> None:
        super().__init__()
        d = surface.dimension
        motion = self.DeclareVectorInputPort("nominal_motion", 2 * d)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(normal(surface, motion.Eval(context)[:d]))

        self.DeclareVectorOutputPort("predicted_normal", d, calc, {motion.ticket()})
