"""The manipulator and its contact: what the controllers of chapters 2, 3 and 5 act on."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from models.arms.arm import Arm
from models.joint_friction import JointFrictionParams
from models.surfaces.surface import Surface, locate
from models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
)
from systems.contact.arm_dynamics import ArmDynamics
from systems.contact.stick_slip import Frozen, Material, Motion, advance

Array = NDArray[np.float64]

CONTACT_SIGNALS: Final = (
    "gap",
    "approach_speed",
    "slip_speed",
    "peak_force",
    "impact_speed",
    "dissipated",
)


@dataclass(frozen=True, kw_only=True)
class ContactParams:
    """What happens where tip and surface touch."""

    stiffness: float = 1e4  # N/m, of the surface; assumed
    damping: float = 20.0  # N s/m, of the surface; assumed
    friction: float = 0.0  # mu, Coulomb's

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "damping", "friction")


@dataclass(frozen=True, kw_only=True)
class ArmInContactParams:
    """Parameters of :class:`ArmInContact`."""

    joint_friction: JointFrictionParams
    contact: ContactParams = ContactParams()
    contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, in the endpoint's frame
    gravity: bool = True
    step: float = 1e-4  # s, of friction and contact
    held: int = 50  # steps over which dynamics and geometry are held

    def __post_init__(self) -> None:
        require_positive(self, "step")
        if self.held < 1 or self.held != int(self.held):
            raise ParameterError("held", self.held, "a whole number >= 1")

    @property
    def period(self) -> float:
        """Time between updates of the block's outputs, s."""
        return self.step * self.held


class _Groups(NamedTuple):
    """The block's discrete states."""

    encoders: Array
    contact_force: Array
    tool_force: Array
    base_torque: Array
    contact: Array
    solver: Array  # stuck (n,), impulses of the joints (n,) and of the contact (3,)


class ArmInContact(LeafSystem):
    """An arm with joint friction whose tip touches a surface (Fig. 2-4, two blocks in one).

    .. pydrake_system::

        name: ArmInContact
        input_ports:
        - torque
        - disturbance
        output_ports:
        - encoders
        - contact_force
        - tool_force
        - base_torque
        - contact

    Manipulator dynamics and contact model are one block, because dry friction and a stiff contact
    can only be solved together. Each update takes mass matrix, Coriolis and gravity torques,
    Jacobian and the surface's tangent plane from the present state, and integrates friction and
    contact over its period in implicit steps (:mod:`systems.contact.stick_slip`).

    Inputs: ``torque``, shape (n,), held over the period; ``disturbance``, shape (3,), N, a force
    on the tip in the world frame (may be left unconnected).

    Outputs, all of them discrete states:

    * ``encoders``, shape (2n,): joint positions and velocities.
    * ``contact_force``, shape (3,), N: of the surface on the tip, world frame.
    * ``tool_force``, shape (3,), N: the same in the endpoint's frame.
    * ``base_torque``, shape (n,): what the joints transmit to the links, torque less friction;
      what a force and torque sensor under the base resolves (Morel and Dubowsky, 1996).
    * ``contact``, shape (6,): gap m (negative in the material), approach speed m/s (positive
      towards the surface), slip speed m/s, largest normal force of the period N, largest speed
      m/s with which contact was made in it, energy dissipated so far J.

    Args:
        arm: The arm.
        surface: What its tip touches, a surface in space.
        params: Friction, contact and steps.
        q: Joint positions at the start, shape (n,); the arm starts at rest.

    Raises:
        ParameterError: If shapes don't fit, or an input is not finite.
    """

    def __init__(self, arm: Arm, surface: Surface, params: ArmInContactParams, q: Array) -> None:
        super().__init__()
        n = arm.num_joints
        friction, contact = params.joint_friction, params.contact
        if len(friction.coulomb) != n:
            raise ParameterError("joint_friction.coulomb", friction.coulomb, f"{n} numbers")
        if surface.dimension != 3:
            raise ParameterError("surface", surface, "a surface in space")
        if np.shape(q) != (n,) or not np.all(np.isfinite(q)):
            raise ParameterError("q", np.asarray(q).tolist(), f"{n} finite numbers")
        self._name = arm.name
        self._surface = surface
        self._params = params
        self._dynamics = ArmDynamics(
            arm, gravity=params.gravity, contact_offset=params.contact_offset
        )
        self._material = Material(
            np.array(friction.coulomb, dtype=np.float64),
            friction.breakaway,
            friction.stribeck,
            np.array(friction.viscous, dtype=np.float64),
            contact.stiffness,
            contact.damping,
            contact.friction,
        )
        self._torque = self.DeclareVectorInputPort("torque", n)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        rest = self._dynamics.evaluate(q, np.zeros(n))
        gap = locate(surface, rest.p_WC).gap
        initial = _Groups(
            encoders=np.concatenate([q, np.zeros(n)]),
            contact_force=np.zeros(3),
            tool_force=np.zeros(3),
            base_torque=rest.bias,
            contact=np.array([gap, 0.0, 0.0, 0.0, 0.0, 0.0]),
            solver=np.concatenate([np.ones(n), np.zeros(n + 3)]),
        )
        for name, value in initial._asdict().items():
            group = self.DeclareDiscreteState(value)
            if name != "solver":
                self.DeclareStateOutputPort(name, group)
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._step)

    def _step(self, context: Context, values: DiscreteValues) -> None:
        n, params = self._torque.size(), self._params
        encoders, contact, solver = (
            context.get_discrete_state(i).value()
            for i in (0, _Groups._fields.index("contact"), _Groups._fields.index("solver"))
        )
        q, v = encoders[:n], encoders[n:]
        torque = _finite("torque", self._torque.Eval(context))
        state = self._dynamics.evaluate(q, v)
        applied = torque - state.bias
        if self._disturbance.HasValue(context):
            force = _finite("disturbance", self._disturbance.Eval(context))
            applied = applied + state.J_v_WC.T @ force
        gap, normal = locate(self._surface, state.p_WC)
        done = advance(
            Frozen(state.mass, applied, state.J_v_WC, gap, normal),
            self._material,
            Motion(v, solver[:n], solver[n : 2 * n], solver[2 * n :]),
            params.step,
            params.held,
        )
        motion = done.motion
        if not all(map(math.isfinite, motion.velocity.tolist())):
            raise ParameterError(
                f"the {self._name}'s velocity at t = {context.get_time():g} s",
                motion.velocity.tolist(),
                "finite numbers, the run diverges",
            )
        settled = _Groups(
            np.concatenate([q + done.displacement, motion.velocity]),
            done.force,
            state.R_WE.T @ done.force,
            torque + done.dry_friction - self._material.viscous * motion.velocity,
            np.array([*done[4:9], contact[5] + done.dissipated]),
            np.concatenate([motion.stuck, motion.joint_impulse, motion.impulse]),
        )
        for i, value in enumerate(settled):
            values.set_value(i, value)


def _finite(name: str, value: Array) -> Array:
    if not all(map(math.isfinite, value.tolist())):
        raise ParameterError(name, value.tolist(), "finite numbers")
    return value
