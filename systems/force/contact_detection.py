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
    """Detects contact, and remembers the time of the first one (section 2.1.4).

    .. pydrake_system::

        name: ContactDetection
        input_ports:
        - measured_force
        output_ports:
        - contact_time
        - state

    ``measured_force``, shape (m,), N, is of the arm on the surface. ``state`` is 0 before contact,
    1 in contact and 2 while it is lost. ``contact_time`` is the time of the first contact in s, -1
    before. The arm pushes along ``direction``, shape (m,), of any length.
    """

    def __init__(self, params: ContactDetectionParams, direction: Array, *, period: float) -> None:
        super().__init__(ContactDetectionLaw(params, direction, period=period))
