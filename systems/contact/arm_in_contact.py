"""The manipulator and its contact: the plant of the controllers of chapters 2, 3 and 5."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.surface import Surface, locate, proximity
from chamfer.models.surfaces.surface_code import surface_code
from chamfer.models.validation import (
    ParameterError,
    finite,
    require_not_negative,
    require_numbers,
    require_positive,
    require_same,
)
from chamfer.systems.contact.arm_dynamics import (
    Chain,
    base_wrench,
    bias,
    make_chain,
    point_jacobian,
    pose,
)
from chamfer.systems.contact.arm_motion import (
    FAR,
    NOWHERE,
    Contacts,
    Patch,
    Tool,
    advance,
    coefficient,
    energies,
    gaps,
    make_room,
    output_sizes,
    roughen,
    update,
)
from chamfer.systems.contact.stick_slip import Material

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ContactParams:
    """Parameters of the contact between tip and surface."""

    stiffness: float = 1e4  # N/m, of the surface; assumed
    damping: float = 20.0  # N s/m, of the surface; assumed
    friction: SurfaceFriction = SurfaceFriction(coefficient=0.0)  # Coulomb's, along the world's x
    friction_noise: float | None = None  # relative, deviation along the path; None: of sensing

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "damping", "friction_noise")

    def coefficient(self, point: Array, force: Array, normal: Array) -> float:
        """Return the coefficient of friction at a point, m, where the surface pushes back.

        Shape (3,) each; the force, N, is that of the surface, the normal is out of it.
        """
        return coefficient(self.numbers, float(point[0]), float(force @ normal), float(normal[2]))

    @property
    def loose(self) -> tuple[float, float]:
        """Mass, kg, and slip friction of a body that lies loose and is touched, or 0."""
        return 0.0, 0.0

    @cached_property
    def numbers(self) -> Array:
        """The friction in the form of :class:`chamfer.systems.contact.arm_motion.Contacts`."""
        return np.array([*self.friction.numbers, self.friction_noise or 0.0, *self.loose])


@dataclass(frozen=True)
class ContactPoint:
    """A point of the tip and the surface that it may touch."""

    offset: tuple[float, float, float]  # m, in the endpoint's frame
    surface: Surface  # in space
    contact: ContactParams

    def __post_init__(self) -> None:
        if self.surface.dimension != 3:
            raise ParameterError("surface", self.surface, "a surface in space")
        require_numbers(self, 3, "offset")


@dataclass(frozen=True, eq=False)
class Load:
    """A rigid body that the endpoint holds; axes of its frame."""

    mass: float  # kg
    centre: tuple[float, float, float]  # m, of mass
    inertia: Array  # (3, 3), kg m^2, about the centre of mass

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        require_numbers(self, 3, "centre")
        inertia = np.asarray(self.inertia)
        symmetric = inertia.shape == (3, 3) and np.array_equal(inertia, inertia.T)
        if not (symmetric and np.all(np.linalg.eigvalsh(inertia) >= 0.0)):
            allowed = "a symmetric matrix of 3 rows, positive semidefinite"
            raise ParameterError("inertia", inertia.tolist(), allowed)


@dataclass(frozen=True, eq=False)
class Scene:
    """A phase of a run: the points that may touch, and the load."""

    points: tuple[ContactPoint, ...]
    load: Load | None = None

    def __post_init__(self) -> None:
        if not self.points:
            raise ParameterError("points", self.points, "at least one point")


def with_load(chain: Chain, load: Load | None) -> Chain:
    """Return an arm whose last link is one body with a load."""
    if load is None:
        return chain
    inertia = np.array(load.inertia, dtype=np.float64)
    added = chain.endpoint + chain.R_WE @ np.array(load.centre)
    mass, centre, total = chain.mass.copy(), chain.centre.copy(), chain.inertia.copy()
    mass[-1] += load.mass
    centre[-1] = (chain.mass[-1] * chain.centre[-1] + load.mass * added) / mass[-1]
    total[-1] += chain.R_WE @ inertia @ chain.R_WE.T
    for part, place in ((chain.mass[-1], chain.centre[-1]), (load.mass, added)):
        arm = place - centre[-1]
        total[-1] += part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return chain._replace(mass=mass, centre=centre, inertia=total)


@dataclass(frozen=True, kw_only=True)
class ArmInContactParams:
    """Parameters of :class:`ArmInContact`."""

    joint_friction: JointFrictionParams
    contact: ContactParams = ContactParams()  # with scenes theirs, and not this
    contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, in the endpoint's frame; so
    gripper: GripperCompliance | None = None  # None: rigid
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


class _World(NamedTuple):
    """A scene in the form that the computation of motion needs."""

    points: tuple[ContactPoint, ...]
    chain: Chain
    material: Material
    tool: Tool
    contacts: Contacts | None  # None: with surfaces or friction of unknown classes


class ArmInContact(LeafSystem):
    """Simulates an arm with joint friction whose tip touches surfaces (Fig. 2-4, two blocks).

    .. pydrake_system::

        name: ArmInContact
        input_ports:
        - torque
        - disturbance
        - scene
        - friction_noise
        output_ports:
        - encoders
        - contact_force
        - tool_force
        - base_torque
        - contact
        - tip
        - energy
        - base_wrench

    Manipulator dynamics and contact model are one block, because dry friction and a stiff contact
    must be solved together. Each update holds the torque. It approximates the surface to second
    order where the tip will be in the middle of the update. Then it integrates the arm's full
    dynamics with friction and contact in implicit steps
    (:mod:`chamfer.systems.contact.arm_motion`).

    A gripper is a massless spring and damper between the endpoint and the tip. All points of
    contact are on the tip, which does not turn on the gripper. A load moves with the endpoint.
    Points and load may change from scene to scene. A new load has the arm's velocity at once; the
    energy for that counts as work.

    Kinetic, potential, elastic and dissipated energy less work stay constant within 1e-5 of the
    energy turned over, at the default steps. The bound is 1e-4 where a contact of 1e6 N/m and more
    bounces undamped on a curved surface. The block has no backlash in the joints (the Adept's
    quill), and no rolling or line contact of a roller.

    Inputs; the last three may be left unconnected (no force, scene 0, no noise):

    * ``torque``, shape (n,), is held over the period.
    * ``disturbance``, shape (3,), N, is a force on the arm at the tip's first point, world frame.
    * ``scene``, shape (1,), is the index of the scene.
    * ``friction_noise``, shape (M,), is white with deviation 1; the contact's own noise is made
      from it.

    All outputs belong to the discrete state. M is the largest number of points of a scene. Outputs
    with (M, .) list the points one after the other; points that a scene lacks are 1 km away.

    * ``encoders``, shape (2n,): joint positions and velocities.
    * ``contact_force``, shape (M, 3), N: of the surface on the tip, world frame; zero where the
      gap is positive.
    * ``tool_force``, shape (3,), N: their sum in the endpoint's frame with the load's weight and
      inertia, the reading of a sensor behind the gripper.
    * ``base_torque``, shape (n,): the joints' torque on the links, torque less friction.
    * ``contact``, shape (M, 6): gap m (negative in the material), approach speed m/s (positive
      towards the surface) and slip speed m/s. Then largest normal force N and largest impact speed
      m/s in the last ``window`` updates, and the energy J dissipated so far by all.
    * ``tip``, shape (M, 6): the point that touches, m, and the arm's velocity there, m/s, which
      with a gripper is not the tip's own.
    * ``energy``, shape (5,), J: kinetic, potential, elastic, dissipated, and work of torque and
      disturbance, the last two so far.
    * ``base_wrench``, shape (6,): moment about the base's origin, N m, and force, N, of the base
      on the arm, world axes. It has weight, inertia and contact of all links; at rest the weight
      upwards.

    ``world`` is a surface in space, with the contact of ``params``, or scenes. The arm starts at
    rest at ``q``, shape (n,), in scene 0.

    Raises:
        ParameterError: If shapes don't fit, or, while running, if an input is not finite, the
            scene does not exist, the arm diverges or the conditions of friction and contact are
            not solved.
    """

    def __init__(
        self, arm: Arm, world: Surface | Sequence[Scene], params: ArmInContactParams, q: Array
    ) -> None:
        super().__init__()
        n = arm.num_joints
        friction = params.joint_friction
        if len(friction.coulomb) != n:
            raise ParameterError("joint_friction.coulomb", friction.coulomb, f"{n} numbers")
        if np.shape(q) != (n,) or not np.all(np.isfinite(q)):
            raise ParameterError("q", np.asarray(q).tolist(), f"{n} finite numbers")
        if isinstance(world, Sequence):
            scenes = tuple(world)
            plain = ArmInContactParams(joint_friction=friction)
            why = "without effect where scenes have the points of contact"
            require_same(params, plain, "params", "contact", "contact_offset", why=why)
        else:
            scenes = (Scene((ContactPoint(params.contact_offset, world, params.contact),)),)
        if not scenes:
            raise ParameterError("world", world, "at least one scene")
        self._name = arm.name
        self._params = params
        chain = make_chain(arm)
        self._worlds = [_make_world(chain, scene, params) for scene in scenes]
        most = max(len(scene.points) for scene in scenes)
        self._torque = self.DeclareVectorInputPort("torque", n)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self._scene = self.DeclareVectorInputPort("scene", 1)
        self._friction_noise = self.DeclareVectorInputPort("friction_noise", most)
        self._uneven = self.DeclareDiscreteState(most)
        self._parts: dict[str, slice] = {}
        first = 0
        for name, size in output_sizes(n, most).items():
            self._parts[name] = slice(first, first + size)
            first += size
        state = np.concatenate([q, np.zeros(n), np.ones(n), np.zeros(2 * n + 3 * most + 3)])
        self._state = self.DeclareDiscreteState(state)
        self._outputs = self.DeclareDiscreteState(self._at_rest(np.array(q), first))
        self._last_scene = self.DeclareDiscreteState(1)
        self._declare_output("encoders", self._state, slice(2 * n))
        for name, part in self._parts.items():
            self._declare_output(name, self._outputs, part)
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._step)

    def start(self) -> tuple[_World, Array, Array]:
        """Return scene 0, and state and outputs at rest, from which :func:`update` continues."""
        values = self.CreateDefaultContext().get_discrete_state()
        return self._worlds[0], *(values.value(i).copy() for i in (self._state, self._outputs))

    def _at_rest(self, q: Array, size: int) -> Array:
        world, still = self._worlds[0], np.zeros(len(q))
        outputs, parts = np.zeros(size), self._parts
        at = pose(world.chain, q)
        tips = _tips(world, q, still, np.zeros(3))
        contact = np.zeros_like(outputs[parts["contact"]]).reshape(-1, 6)
        contact[:, 0] = NOWHERE
        for i, (point, tip) in enumerate(zip(world.points, tips, strict=True)):
            contact[i, 0] = locate(point.surface, tip[:3]).gap
        outputs[parts["contact"]] = contact.ravel()
        outputs[parts["tip"]][: tips.size] = tips.ravel()
        found = contact[: len(tips), 0].copy()
        energy = energies(world.chain, world.material, world.tool, q, still, np.zeros(3), found)
        outputs[parts["energy"]][:3] = energy
        outputs[parts["base_torque"]] = bias(world.chain, at, still)
        outputs[parts["base_wrench"]] = base_wrench(world.chain, at, still, still)
        outputs[parts["tool_force"]] = world.tool.load * (at.R_WE.T @ world.chain.gravity)
        return outputs

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
        torque, disturbance = self._torque.Eval(context).copy(), np.zeros(3)
        if self._disturbance.HasValue(context):
            disturbance = self._disturbance.Eval(context).copy()
        scene, last = 0, round(float(context.get_discrete_state(self._last_scene)[0]))
        if self._scene.HasValue(context):
            asked = float(self._scene.Eval(context)[0])
            if asked not in range(len(self._worlds)):
                raise ParameterError("scene", asked, f"0 to {len(self._worlds) - 1}")
            scene = int(asked)
        world = self._worlds[scene]
        if scene != last:
            self._change_scene(world, state, outputs)
            values.set_value(self._last_scene, [scene])
        uneven = context.get_discrete_state(self._uneven).value().copy()
        if self._friction_noise.HasValue(context):
            # The noise is one of places: it changes as far as the points slip.
            drawn = finite("friction_noise", self._friction_noise.Eval(context)).copy()
            roughen(uneven, drawn, outputs, len(torque), params.period)
            values.set_value(self._uneven, uneven)
        lasting = round(context.get_time() / params.period) % params.window > 0
        pushes, times = (torque, disturbance), (params.step, params.held)
        arm = world.chain, world.material, world.tool
        if world.contacts is None:
            room = make_room(*arm, params.step)
            for own, found in zip(room.patch, self._patch(world, outputs, uneven), strict=True):
                own[:] = found
            error, unsolved = advance(*arm, room, state, outputs, *pushes, lasting, *times)
        else:
            now = state, outputs, uneven
            error, unsolved = update(*arm, world.contacts, *now, *pushes, lasting, *times)
        if unsolved:
            finite("torque", torque)
            finite("disturbance", disturbance)
            self._refuse(context.get_time(), state, error)
        values.set_value(self._state, state)
        values.set_value(self._outputs, outputs)

    def _refuse(self, time: float, state: Array, error: float) -> None:
        """Raise an error for a run that diverges, or a step that is not solved."""
        n, at = len(self._worlds[0].chain.mass), f"at t = {time:g} s"
        if not np.all(np.isfinite(state)):
            speed, allowed = state[n : 2 * n].tolist(), "finite numbers, the run diverges"
            raise ParameterError(f"the {self._name}'s velocity {at}", speed, allowed)
        allowed = "less, which a shorter step may reach"
        raise ParameterError(f"the error of the {self._name}'s contact {at}", error, allowed)

    def _change_scene(self, world: _World, state: Array, outputs: Array) -> None:
        """Start a scene at the arm's position; the energy for the change counts as work."""
        n = len(world.chain.mass)
        q, v, stretch = state[:n].copy(), state[n : 2 * n].copy(), state[-3:].copy()
        state[5 * n : -3] = 0.0  # no contact of the last scene goes on
        outputs[self._parts["contact"]].reshape(-1, 6)[:, 3:5] = 0.0  # nor do its peaks
        outputs[self._parts["contact_force"]] = 0.0
        tips = _tips(world, q, v, stretch)
        outputs[self._parts["tip"]][: tips.size] = tips.ravel()
        found = gaps(
            world.chain,
            world.tool,
            self._patch(world, outputs, np.zeros(len(world.points))),
            q,
            stretch,
        )
        energy, now = outputs[self._parts["energy"]], world.material
        stored = energies(world.chain, now, world.tool, q, v, stretch, found)
        energy[4] += float(np.sum(stored - energy[:3]))
        energy[:3] = stored

    def _patch(self, world: _World, outputs: Array, uneven: Array) -> Patch:
        """Return the surfaces about where the points, with velocities, are in half a period."""
        m = len(world.points)
        tips = outputs[self._parts["tip"]].reshape(-1, 6)
        forces = outputs[self._parts["contact_force"]].reshape(-1, 3)
        patch = Patch(*(np.zeros((m, *shape)) for shape in ((3,), (), (3,), (3, 3), ())))
        for i, (place, tip) in enumerate(zip(world.points, tips[:m], strict=True)):
            surface = place.surface
            way = self._params.period / 2 * tip[3:]
            point = tip[:3] + way
            level, gradient = surface.level(point), surface.gradient(point)
            far = FAR + 2 * math.hypot(*way.tolist())
            patch.point[i] = point
            if level > far * math.hypot(*gradient.tolist()):
                # Out of reach, where a level function may have any shape.
                patch.level[i], patch.gradient[i] = proximity(level, gradient)
                continue
            patch.level[i], patch.gradient[i] = level, gradient
            patch.hessian[i] = surface.hessian(point)
            normal = gradient / math.hypot(*gradient.tolist())
            patch.mu[i] = place.contact.coefficient(point, forces[i], normal)
            patch.mu[i] *= max(1 + (place.contact.friction_noise or 0.0) * uneven[i], 0.0)
        return patch


def _make_world(chain: Chain, scene: Scene, params: ArmInContactParams) -> _World:
    friction, gripper = params.joint_friction, params.gripper
    contacts = [point.contact for point in scene.points]
    return _World(
        scene.points,
        with_load(chain, scene.load),
        Material(
            np.array(friction.coulomb, dtype=np.float64),
            friction.breakaway,
            friction.stribeck,
            np.array(friction.viscous, dtype=np.float64),
            np.array([contact.stiffness for contact in contacts], dtype=np.float64),
            np.array([contact.damping for contact in contacts], dtype=np.float64),
        ),
        Tool(
            np.array([point.offset for point in scene.points], dtype=np.float64),
            gripper is None,
            np.array(gripper.matrix(3)) if gripper else np.zeros((3, 3)),
            np.array(gripper.damping_matrix(3)) if gripper else np.zeros((3, 3)),
            float(scene.load.mass) if scene.load else 0.0,
            np.array(scene.load.centre if scene.load else (0.0, 0.0, 0.0), dtype=np.float64),
        ),
        _contacts(scene.points),
    )


def _contacts(points: Sequence[ContactPoint]) -> Contacts | None:
    code = surface_code(*(point.surface for point in points))
    own = ContactParams.coefficient
    if code is None or any(type(point.contact).coefficient is not own for point in points):
        return None
    return Contacts(code, np.array([point.contact.numbers for point in points]))


def _tips(world: _World, q: Array, v: Array, stretch: Array) -> Array:
    """Return where the points are, m, and the arm's velocity there, m/s, shape (m, 6)."""
    at = pose(world.chain, q)
    places = [at.p_WE + at.R_WE @ (offset + stretch) for offset in world.tool.offset]
    return np.array([[*place, *(point_jacobian(at, place) @ v)] for place in places])
