"""Selection matrices: which directions are under position and which under force control."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.systems.force.projection import position_selection

Array = NDArray[np.float64]


class Selection(LeafSystem):
    """Selects the position domain: everything before contact, then all but the normal.

    .. pydrake_system::

        name: Selection
        input_ports:
        - mode
        output_ports:
        - selection

    Section 2.1.4. ``mode``, size 1, is 0 before contact. ``selection``, size m * m, is P row by
    row; the force domain is F = I - P. The surface normal, shape (m,), is of any length.
    """

    def __init__(self, normal: Array) -> None:
        super().__init__()
        free = np.eye(len(normal)).ravel()
        touching = position_selection(np.asarray(normal)).ravel()
        mode = self.DeclareVectorInputPort("mode", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(free if mode.Eval(context)[0] == 0 else touching)

        self.DeclareVectorOutputPort("selection", len(free), calc, {mode.ticket()})
