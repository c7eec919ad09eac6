"""Selects the part of a measured error that a controller compensates, as a block."""

from chamfer.systems.law_block import LawBlock
from chamfer.systems.servo.selector_law import SelectorLaw


class MeasurementSelector(LawBlock[SelectorLaw]):
    """Passes a measured error to a controller, or blocks it.

    .. pydrake_system::

        name: MeasurementSelector
        input_ports:
        - error
        - valid
        - open
        output_ports:
        - error
        - valid

    The inputs ``error``, shape (size,), and ``valid``, shape (1,), are the measurement. The input
    ``open``, shape (2,), controls it:

    - First element: 1 passes errors. Else none is valid, so that a controller holds its output.
    - Second element: 1 passes the error along the first axis. Else that error is 0.

    Args:
        size: Number of elements of the error.
        period: s, between errors.
    """

    def __init__(self, size: int, *, period: float = 1 / 80) -> None:
        super().__init__(SelectorLaw(size, period=period))
