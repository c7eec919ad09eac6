"""Joint torques out of what a sensor under the base reads (Morel and Dubowsky, 1996)."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.serial_chain import link_forces, pose

Array = NDArray[np.float64]


class BaseWrenchTorque(LeafSystem):
    """Resolves the wrench of the base on an arm into what its joints transmit.

    .. pydrake_system::

        name: BaseWrenchTorque
        input_ports:
        - base_wrench
        - encoders
        output_ports:
        - base_torque

    Through joint j goes what the base gives less what the links before it take, and of that the
    joint transmits what lies along its axis: ``tau_j = s_j . (W - sum_(i < j) w_i)``, with the
    joint's screw s_j and the weight and the velocity terms w_i of link i, all about the world's
    origin. What is left out is what links take as they speed up, as in the paper: the method is
    for slow motions. Whatever the links beyond carry or touch is in W.

    ``base_wrench``, shape (6,): moment about the world's origin, N m, and force, N, of the base on
    the arm, world axes. ``encoders``, shape (2n,), q and velocity. ``base_torque``, shape (n,),
    N m or N: torque of the motors less friction of the joints, and less what the rotors take.

    Args:
        dynamics: What is known of the arm.
    """

    def __init__(self, dynamics: ArmDynamics) -> None:
        super().__init__()
        n, chain = dynamics.arm.num_joints, dynamics.chain
        wrench = self.DeclareVectorInputPort("base_wrench", 6)
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)

        def calc(context: Context, vector: BasicVector) -> None:
            motion = encoders.Eval(context)
            at = pose(chain, motion[:n].copy())
            taken = link_forces(chain, at, motion[n:].copy())
            before = np.cumsum(taken, axis=0) - taken
            through: Array = wrench.Eval(context) - before
            vector.SetFromVector(np.sum(at.twist * through, axis=1))

        self.DeclareVectorOutputPort("base_torque", n, calc, {wrench.ticket(), encoders.ticket()})
