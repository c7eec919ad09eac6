"""The manipulator and its contact: what the controllers of chapters 2, 3 and 5 act on."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from models.arms.arm import Arm
from models.gripper import GripperParams
from models.joint_friction import JointFrictionParams
from models.surfaces.friction import SurfaceFriction
from models.surfaces.surface import Surface, locate
from models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
)
from systems.contact.arm_dynamics import ArmDynamics
from systems.contact.arm_motion import OUTPUTS, Patch, Tool, advance, energies
from systems.contact.stick_slip import Material

Array = NDArray[np.float64]

_FAR: Final = 0.01  # m, more of a gap than the tip gains on what its speed says in an update
_FLAT: Final = np.zeros((3, 3))


@dataclass(frozen=True, kw_only=True)
class ContactParams:
    """What happens where tip and surface touch."""

    RENAMED: ClassVar[Mapping[str, str]] = {"friction": "friction.coefficient"}

    stiffness: float = 1e4  # N/m, of the surface; assumed
    damping: float = 20.0  # N s/m, of the surface; assumed
    friction: SurfaceFriction = SurfaceFriction(coefficient=0.0)  # Coulomb's, along the world's x

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "damping")


@dataclass(frozen=True, kw_only=True)
class ArmInContactParams:
    """Parameters of :class:`ArmInContact`."""

    joint_friction: JointFrictionParams
    contact: ContactParams = ContactParams()
    contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, in the endpoint's frame
    gripper: GripperParams | None = None  # None: rigid
    gravity: bool = True
    step: float = 1e-4  # s, of dynamics, friction and contact
    held: int = 10  # steps over which the torque, and the surface to second order, are held
    window: int = 1  # updates of which peak force and impact speed are the largest

    def __post_init__(self) -> None:
        require_positive(self, "step")
        for name in ("held", "window"):
            value = getattr(self, name)
            if value < 1 or value != int(value):
                raise ParameterError(name, value, "a whole number >= 1")

    @property
    def period(self) -> float:
        """Time between updates of the block's outputs, s."""
        return self.step * self.held


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
        - tip
        - energy

    Manipulator dynamics and contact model are one block, because dry friction and a stiff contact
    can only be solved together. Each update holds the torque and takes the surface, to second
    order, as it is where the tip will be in the middle of it, and integrates the arm's full
    dynamics with friction and contact in implicit steps (:mod:`systems.contact.arm_motion`). A
    gripper, if there is one, is a spring and a damper without mass between the endpoint, with the
    contact offset, and the tip.

    Energy: kinetic, potential, elastic and dissipated energy less work stay what they were to
    within 1e-5 of the energy that is turned over, at the default steps; 1e-4 where a contact of
    1e6 N/m and more bounces undamped on a curved surface. Tests hold it to that.
    Left out: play in the joints (the Adept's quill), and rolling or line contact of a roller,
    which touches in a point and slides with the surface's friction.

    Inputs: ``torque``, shape (n,), held over the period; ``disturbance``, shape (3,), N, a force
    on the arm at the tip in the world frame (may be left unconnected).

    Outputs, all of them of the discrete state:

    * ``encoders``, shape (2n,): joint positions and velocities.
    * ``contact_force``, shape (3,), N: of the surface on the tip, world frame; zero where the gap
      is positive.
    * ``tool_force``, shape (3,), N: the same in the endpoint's frame.
    * ``base_torque``, shape (n,): what the joints transmit to the links, torque less friction;
      what a force and torque sensor under the base resolves (Morel and Dubowsky, 1996).
    * ``contact``, shape (6,): gap m (negative in the material), approach speed m/s (positive
      towards the surface), slip speed m/s, largest normal force N and largest speed m/s with which
      contact was made in the last ``window`` updates, energy dissipated so far J.
    * ``tip``, shape (6,): the point that touches, m, and the arm's velocity there, m/s, which
      with a gripper is not the tip's own.
    * ``energy``, shape (5,), J: kinetic, potential, elastic, dissipated, and work of torque and
      disturbance, the last two so far.

    Args:
        arm: The arm.
        surface: What its tip touches, a surface in space.
        params: Friction, contact and steps.
        q: Joint positions at the start, shape (n,); the arm starts at rest.

    Raises:
        ParameterError: If shapes don't fit, or, while running, if an input is not finite, the arm
            runs away or the conditions of friction and contact are not solved.
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
        dynamics = ArmDynamics(arm, gravity=params.gravity, contact_offset=params.contact_offset)
        self._chain = dynamics.chain
        self._material = Material(
            np.array(friction.coulomb, dtype=np.float64),
            friction.breakaway,
            friction.stribeck,
            np.array(friction.viscous, dtype=np.float64),
            contact.stiffness,
            contact.damping,
        )
        self._tool = Tool(
            dynamics.contact_offset,
            params.gripper is None,
            np.array(params.gripper.matrix(3)) if params.gripper else np.zeros((3, 3)),
            np.array(params.gripper.damping_matrix(3)) if params.gripper else np.zeros((3, 3)),
        )
        self._torque = self.DeclareVectorInputPort("torque", n)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        rest = dynamics.evaluate(q, np.zeros(n))
        gap = locate(surface, rest.p_WC).gap
        at_rest = energies(
            self._chain, self._material, self._tool, np.array(q), np.zeros(n), np.zeros(3), gap
        )
        initial = {
            "contact_force": np.zeros(3),
            "tool_force": np.zeros(3),
            "base_torque": rest.bias,
            "contact": [gap, 0.0, 0.0, 0.0, 0.0, 0.0],
            "tip": [*rest.p_WC, 0.0, 0.0, 0.0],
            "energy": [*at_rest, 0.0, 0.0],
        }
        state = np.concatenate([q, np.zeros(n), np.ones(n), np.zeros(2 * n + 6)])
        self._state = self.DeclareDiscreteState(state)
        self._outputs = self.DeclareDiscreteState(
            np.concatenate([initial[name] for name in OUTPUTS])
        )
        self._declare_output("encoders", self._state, slice(2 * n))
        first = 0
        for name, size in OUTPUTS.items():
            last = first + (size or n)
            self._declare_output(name, self._outputs, slice(first, last))
            if name == "tip":
                self._tip = slice(first, last)
            first = last
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._step)

    def _declare_output(self, name: str, group: DiscreteStateIndex, part: slice) -> None:
        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(context.get_discrete_state(group).value()[part])

        size = part.stop - (part.start or 0)
        self.DeclareVectorOutputPort(name, size, calc, {self.discrete_state_ticket(group)})

    def _step(self, context: Context, values: DiscreteValues) -> None:
        params = self._params
        # Copies, because compiled code tells views of a Context from arrays.
        state = context.get_discrete_state(self._state).value().copy()
        outputs = context.get_discrete_state(self._outputs).value().copy()
        torque = _finite("torque", self._torque.Eval(context))
        disturbance = np.zeros(3)
        if self._disturbance.HasValue(context):
            disturbance = _finite("disturbance", self._disturbance.Eval(context))
        state, outputs, error, unsolved = advance(
            self._chain,
            self._material,
            self._tool,
            self._patch(outputs[self._tip]),
            state,
            outputs,
            round(context.get_time() / params.period) % params.window > 0,
            torque.copy(),
            disturbance.copy(),
            params.step,
            params.held,
        )
        n = len(torque)
        if not all(map(math.isfinite, state.tolist())):
            raise ParameterError(
                f"the {self._name}'s velocity at t = {context.get_time():g} s",
                state[n : 2 * n].tolist(),
                "finite numbers, the run diverges",
            )
        if unsolved:
            raise ParameterError(
                f"the error of the {self._name}'s contact at t = {context.get_time():g} s",
                error,
                "less, which a shorter step may reach",
            )
        values.set_value(self._state, state)
        values.set_value(self._outputs, outputs)

    def _patch(self, tip: Array) -> Patch:
        """Return the surface about the place where the tip will be in the middle of the period."""
        surface, params = self._surface, self._params
        way = params.period / 2 * tip[3:]
        point = tip[:3] + way
        level, gradient = surface.level(point), surface.gradient(point)
        far = _FAR + 2 * math.hypot(*way.tolist())
        if level > far * math.hypot(*gradient.tolist()):
            # Out of reach, where a level function may have any shape.
            gap, normal = locate(surface, point)
            return Patch(point, gap, normal, _FLAT, 0.0)
        friction = params.contact.friction.at(point)
        return Patch(point, level, gradient, surface.hessian(point), friction)


def _finite(name: str, value: Array) -> Array:
    if not all(map(math.isfinite, value.tolist())):
        raise ParameterError(name, value.tolist(), "finite numbers")
    return value
