"""Friction compensation from a base torque sensor (Morel and Dubowsky, 1996)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.compiled import compiled
from chamfer.systems.contact.arm_dynamics import ArmDynamics, link_forces, pose
from chamfer.systems.ports import finite_input

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FrictionCompensationParams:
    """Parameters of :class:`FrictionCompensation`."""

    bandwidth: float  # Hz, of the estimate's first-order lag
    joints: tuple[int, ...] | None = None  # indices of those compensated; None: all

    def __post_init__(self) -> None:
        require_positive(self, "bandwidth")

    def compensated(self, n: int) -> Array:
        """Return 1 for each of n joints that is compensated and 0 for the others, shape (n,)."""
        joints = range(n) if self.joints is None else self.joints
        if not set(joints) <= set(range(n)) or len(set(joints)) < len(joints):
            raise ParameterError("joints", self.joints, f"different indices below {n}")
        return np.isin(np.arange(n), list(joints)).astype(np.float64)

    def follow(self, period: float) -> float:
        """Return the estimate's response to a change after one period, s."""
        return 1 - math.exp(-2 * math.pi * self.bandwidth * period)


@compiled
def friction_estimate(estimate: Array, command: Array, base_torque: Array, follow: Array) -> Array:
    """Return the friction's estimate a period later; it follows by a part for each joint, (n,)."""
    return estimate + follow * ((command + estimate - base_torque) - estimate)


class FrictionCompensation(LeafSystem):
    """Adds to a torque the joint friction that a base sensor shows.

    .. pydrake_system::

        name: FrictionCompensation
        input_ports:
        - command
        - base_torque
        - moving
        output_ports:
        - torque

    Morel and Dubowsky (1996): a sensor under the base resolves the torque that the joints transmit
    to the links. The difference from the motors' torque is friction. The estimate follows it with
    a first-order lag and is fed forward. An arm's own ``base_torque`` is that of an ideal sensor;
    :class:`BaseWrenchTorque` resolves the reading of a real one.

    ``command`` and ``torque``, shape (n,), have the units of ``base_torque``. ``moving``, shape
    (n,), may be left open. The estimate of a joint with 0 there is kept, that of one with 1
    follows. A joint that sticks takes any torque, so a following estimate grows until the joint
    breaks loose, and is then too large: a joint at rest limit-cycles. A kept estimate is right
    when the joint moves again.

    Discrete state: the friction estimate, shape (n,). The period is in s.

    Raises:
        ParameterError: If a compensated joint does not exist.
    """

    def __init__(self, params: FrictionCompensationParams, *, joints: int, period: float) -> None:
        super().__init__()
        n = joints
        compensated = params.follow(period) * params.compensated(n)
        command = self.DeclareVectorInputPort("command", n)
        base_torque = self.DeclareVectorInputPort("base_torque", n)
        moving = self.DeclareVectorInputPort("moving", n)
        held = self.DeclareDiscreteState(np.zeros(n))

        def calc(context: Context, vector: BasicVector) -> None:
            friction = context.get_discrete_state(held).value()
            vector.SetFromVector(command.Eval(context) + friction)

        depends = {command.ticket(), self.discrete_state_ticket(held)}
        self.DeclareVectorOutputPort("torque", n, calc, depends)

        def tick(context: Context, state: DrakeState) -> None:
            estimate = context.get_discrete_state(held).value()
            transmitted = finite_input(base_torque, context)
            follow = compensated
            if moving.HasValue(context):
                follow = follow * moving.Eval(context)
            estimate = friction_estimate(
                estimate.copy(), command.Eval(context).copy(), transmitted.copy(), follow
            )
            state.get_mutable_discrete_state().set_value(held, estimate)

        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, tick)


class JointsToMove(LeafSystem):
    """Marks the joints that a command moves.

    .. pydrake_system::

        name: JointsToMove
        input_ports:
        - encoders
        - desired_velocity
        output_ports:
        - moving

    ``encoders``, shape (2n,), is q and velocity; ``desired_velocity``, shape (n,), is that of the
    endpoint's coordinates, m/s and rad/s. ``moving``, shape (n,), is 1 for a joint whose entry of
    ``J(q)^-1 desired_velocity`` is at least the rest speed, else 0.

    The arm has as many coordinates as joints; the rest speed is in rad/s, m/s of sliding joints.
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


class BaseWrenchTorque(LeafSystem):
    """Resolves the wrench of the base on an arm into the torques that its joints transmit.

    .. pydrake_system::

        name: BaseWrenchTorque
        input_ports:
        - base_wrench
        - encoders
        output_ports:
        - base_torque

    The wrench through joint j is that of the base minus those of the links before it. The joint
    transmits its part along its axis: ``tau_j = s_j . (W - sum_(i < j) w_i)``. Here s_j is the
    joint's screw and w_i has the weight and the velocity terms of link i, all about the world's
    origin. The links' acceleration is left out, as in the paper.

    ``base_wrench``, shape (6,): moment about the world's origin, N m, and force, N, of the base on
    the arm, world axes. ``encoders``, shape (2n,), q and velocity. ``base_torque``, shape (n,),
    N m or N: torque of the motors minus friction of the joints and minus the rotors' inertia.
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
