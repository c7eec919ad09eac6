"""A wrist sensor's reading, turned into the world's axes."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.systems.contact.arm_dynamics import ArmDynamics

Array = NDArray[np.float64]


class ForceInWorld(LeafSystem):
    """Decouples a wrist sensor's reading and turns it into the world's axes (section 3.3).

    .. pydrake_system::

        name: ForceInWorld
        input_ports:
        - reading
        - encoders
        output_ports:
        - measured_force

    ``measured = R(q) D reading``, with what undoes the cross-talk, D, and the endpoint's
    orientation R at the joint positions that the encoders show.

    ``reading``, shape (k,), N (N m), in the endpoint's axes; ``encoders``, shape (2n,), q and
    velocity, of which q is used. ``measured_force``, shape (m,), N; angular coordinates read 0.

    Args:
        dynamics: Of the arm.
        undoing: D, shape (3, k).
        coordinates: m, size of the endpoint vector; the first of x, y, z, then angles.
    """

    def __init__(self, dynamics: ArmDynamics, undoing: Array, *, coordinates: int) -> None:
        super().__init__()
        n = dynamics.arm.num_joints
        pick = np.eye(coordinates, 3)
        reading = self.DeclareVectorInputPort("reading", undoing.shape[1])
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)

        def calc(context: Context, vector: BasicVector) -> None:
            R_WE = dynamics.orientation(encoders.Eval(context)[:n])
            vector.SetFromVector(pick @ (R_WE @ (undoing @ reading.Eval(context))))

        self.DeclareVectorOutputPort(
            "measured_force", coordinates, calc, {reading.ticket(), encoders.ticket()}
        )
