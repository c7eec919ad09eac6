"""A wrench on a body of a plant, as the plant's port wants it."""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem

from chamfer.models.validation import ParameterError

SIZE = 6


class ToolForce(LeafSystem):
    """Applies a wrench to a body at its origin.

    .. pydrake_system::

        name: ToolForce
        input_ports:
        - wrench
        output_ports:
        - spatial_forces

    ``wrench``, shape (6,), N m above N, world axes. ``spatial_forces`` goes to the plant's
    ``applied_spatial_force``.

    Raises:
        ParameterError: In a run if the wrench is not finite.
    """

    def __init__(self, body: BodyIndex) -> None:
        super().__init__()
        wrench = self.DeclareVectorInputPort("wrench", SIZE)

        def calc(context: Context, output: Any) -> None:
            value = wrench.Eval(context)
            if not np.isfinite(value).all():
                raise ParameterError("wrench", value.tolist(), "finite numbers")
            force = ExternallyAppliedSpatialForce()
            force.body_index = body
            force.F_Bq_W = SpatialForce(tau=value[:3], f=value[3:])
            output.set_value([force])

        self.DeclareAbstractOutputPort(
            "spatial_forces",
            lambda: Value[list[ExternallyAppliedSpatialForce]](),
            calc,
            {wrench.ticket()},
        )
