"""What an observer is given of the force: nothing while an impact fades."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem

from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import CONTACT


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
