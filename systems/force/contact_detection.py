"""Contact detection by the measured force, as a block."""

from chamfer.systems.force.contact_detection_law import (
    ContactDetectionLaw,
    ContactDetectionParams,
    Inputs,
    Memory,
)
from chamfer.systems.law import Array
from chamfer.systems.statechart.state_machine import StateMachine


class ContactDetection(StateMachine[Inputs, Memory]):
    """Tells contact from free motion, and remembers when it was first made (section 2.1.4).

    .. pydrake_system::

        name: ContactDetection
        input_ports:
        - measured_force
        output_ports:
        - contact_time
        - state

    ``measured_force``, shape (m,), N, of the arm on the surface. ``state`` is 0 before contact, 1
    in contact and 2 while it is lost; ``contact_time`` the time of the first contact in s, -1
    before. ``direction``, shape (m,), in which the arm pushes, is of any length.
    """

    def __init__(self, params: ContactDetectionParams, direction: Array, *, period: float) -> None:
        super().__init__(ContactDetectionLaw(params, direction, period=period))
