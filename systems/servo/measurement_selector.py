"""What of a measured error a controller is to compensate, as a block."""

from chamfer.systems.law_block import LawBlock
from chamfer.systems.servo.selector_law import SelectorLaw


class MeasurementSelector(LawBlock[SelectorLaw]):
    """Lets a measured error through to a controller, or holds it back.

    .. pydrake_system::

        name: MeasurementSelector
        input_ports:
        - error
        - valid
        - open
        output_ports:
        - error
        - valid

    ``error``, shape (size,), and ``valid``, shape (1,), are as measured. ``open``, shape (2,): 1
    in the first element lets errors through, else none is valid, so that a controller holds what
    it has; 1 in the second one lets that along the first axis through, else it is 0.

    Args:
        size: Of the error.
        period: s, in which errors come.
    """

    def __init__(self, size: int, *, period: float = 1 / 80) -> None:
        super().__init__(SelectorLaw(size, period=period))
