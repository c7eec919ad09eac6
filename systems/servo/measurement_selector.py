"""What of a measured error a controller is to compensate."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import ParameterError


class MeasurementSelector(LeafSystem):
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
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        if not (math.isfinite(size) and size >= 1):
            raise ParameterError("size", size, "a whole number >= 1")
        error = self.DeclareVectorInputPort("error", size)
        valid = self.DeclareVectorInputPort("valid", 1)
        opened = self.DeclareVectorInputPort("open", 2)

        def calc_error(context: Context, vector: BasicVector) -> None:
            through = np.array(error.Eval(context))
            if opened.Eval(context)[1] < 0.5:
                through[0] = 0.0
            vector.SetFromVector(through)

        def calc_valid(context: Context, vector: BasicVector) -> None:
            vector[0] = valid.Eval(context)[0] if opened.Eval(context)[0] >= 0.5 else 0.0

        self.DeclareVectorOutputPort("error", size, calc_error, {error.ticket(), opened.ticket()})
        self.DeclareVectorOutputPort("valid", 1, calc_valid, {valid.ticket(), opened.ticket()})
