"""Which joints a command moves."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.arms.arm import Kinematics


class JointsToMove(LeafSystem):
    """Tells the joints that a command moves from those that are to stand.

    .. pydrake_system::

        name: JointsToMove
        input_ports:
        - encoders
        - desired_velocity
        output_ports:
        - moving

    ``encoders``, shape (2n,), q and velocity; ``desired_velocity``, shape (n,), of the endpoint's
    coordinates, m/s and rad/s. ``moving``, shape (n,): 1 for a joint whose entry of
    ``J(q)^-1 desired_velocity`` is at least the rest speed, else 0.

    Args:
        arm: Its kinematics, with as many coordinates as joints.
        rest_speed: rad/s, m/s of sliding joints.
    """

    def __init__(self, arm: Kinematics, *, rest_speed: float) -> None:
        super().__init__()
        n = arm.num_joints
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)
        desired = self.DeclareVectorInputPort("desired_velocity", n)

        def calc(context: Context, vector: BasicVector) -> None:
            jacobian = arm.jacobian(encoders.Eval(context)[:n])
            speeds = np.abs(np.linalg.solve(jacobian, desired.Eval(context)))
            vector.SetFromVector((speeds >= rest_speed).astype(np.float64))

        self.DeclareVectorOutputPort("moving", n, calc, {encoders.ticket(), desired.ticket()})
