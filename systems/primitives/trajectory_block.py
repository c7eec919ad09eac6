"""The block that moves along trajectory primitives, for diagrams without a skill."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx


class TrajectoryPrimitive(LeafSystem):
    """Gives the velocity of a trajectory primitive, or of several at once, from t = 0.

    .. pydrake_system::

        name: TrajectoryPrimitive
        output_ports:
        - velocity

    ``velocity``, shape (6,), rad/s above m/s, is a continuous function of time: whoever samples it
    holds it.
    """

    def __init__(self, *primitives: MoveDx | Dither) -> None:
        super().__init__()

        def calc(context: Context, vector: BasicVector) -> None:
            time = context.get_time()
            velocities = [STILL if one.done(time) else one.velocity(time) for one in primitives]
            vector.SetFromVector(np.sum(velocities, axis=0))

        self.DeclareVectorOutputPort("velocity", 6, calc, {self.time_ticket()})
