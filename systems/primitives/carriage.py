"""The gripper of a carriage, the parts that it carries, and the guard of its plant."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    InputPortIndex,
    LeafSystem,
    OutputPort,
    State,
)
from pydrake.systems.primitives import Adder, PortSwitch

from chamfer.models.arms.wrist import SIZE, tip_displacement, tip_pose
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.pose import POSE_SIZE, pose_from_vector, pose_vector

Array = NDArray[np.float64]

# Where the part is to be, as an input of a PortSwitch, whose first one is what selects.
HELD: Final = InputPortIndex(1)
RESTS: Final = InputPortIndex(2)


@dataclass(frozen=True, kw_only=True)
class PartGripperParams:
    """Parameters of :class:`PartGripper`."""

    reach: float = 0.004  # m, between fingers and part, within which it grips; assumed
    period: float = 0.01  # s, between two readings of its command; assumed
    senses: bool = True
    # whether its fingers detect a part; without, a part is weighed at the wrist

    def __post_init__(self) -> None:
        require_positive(self, "reach", "period")


class PartGripper(LeafSystem):
    """Decides which part the gripper holds, and in which pose.

    .. pydrake_system::

        name: PartGripper
        input_ports:
        - carriage
        - closed
        output_ports:
        - offset
        - resting
        - selection
        - holding

    Inputs:

    - ``carriage``, shape (12,): a displacement, rad above m, and its rate.
    - ``closed``, size 1: 1 for closed fingers.

    Outputs, which change at ticks only:

    - ``offset``, shape (12,): the displacement of a held part relative to the carriage, with a
      rate of zero.
    - ``resting``, shape (12,): the displacement at which a part rests that is not held, with a
      rate of zero.
    - ``selection``, an ``InputPortIndex``: :data:`HELD` or :data:`RESTS`.
    - ``holding``, size 1: 1 while it holds a part.

    The gripper takes a part if the fingers close within reach of it, in its pose at that time.
    Before that, and after the fingers have opened, the part rests where it is. :func:`add_gripper`
    makes the pose of the part from the outputs.

    Discrete state: whether it holds the part; ``offset``; ``resting``; whether the fingers were
    closed at the last tick.

    The part is ``resting`` at first, rad above m, shape (6,). A part that is held from the start
    has an ``offset``, likewise.

    Raises:
        ParameterError: At construction if ``resting`` or ``offset`` is not six finite numbers; in
            a run if ``carriage`` is not finite when the fingers close or open.
    """

    def __init__(
        self, params: PartGripperParams, *, resting: Array, offset: Array | None = None
    ) -> None:
        super().__init__()
        for name, value in (("resting", resting), ("offset", offset)):
            if value is not None and not (np.shape(value) == (SIZE,) and np.isfinite(value).all()):
                raise ParameterError(name, np.asarray(value).tolist(), "six finite numbers")
        self._params = params
        self._carriage = self.DeclareVectorInputPort("carriage", 2 * SIZE)
        self._closed = self.DeclareVectorInputPort("closed", 1)
        self._holds = self.DeclareDiscreteState([float(offset is not None)])
        self._offset = self.DeclareDiscreteState(
            _at_rest(np.zeros(SIZE) if offset is None else offset)
        )
        self._resting = self.DeclareDiscreteState(_at_rest(resting))
        self._were_closed = self.DeclareDiscreteState([float(offset is not None)])
        self.DeclareStateOutputPort("offset", self._offset)
        self.DeclareStateOutputPort("resting", self._resting)
        self.DeclareAbstractOutputPort(
            "selection",
            lambda: Value[InputPortIndex](HELD),
            self._calc_selection,
            {self.discrete_state_ticket(self._holds)},
        )
        self.DeclareStateOutputPort("holding", self._holds)
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._tick)

    def _calc_selection(self, context: Context, value: AbstractValue) -> None:
        value.set_value(HELD if context.get_discrete_state(self._holds)[0] else RESTS)

    def _tick(self, context: Context, state: State) -> None:
        holds = bool(context.get_discrete_state(self._holds)[0])
        closed = self._closed.Eval(context)[0] >= 0.5
        were_closed = bool(context.get_discrete_state(self._were_closed)[0])
        if closed == were_closed:
            return
        values = state.get_mutable_discrete_state()
        values.set_value(self._were_closed, [float(closed)])
        if holds == closed:
            return
        carriage: Array = self._carriage.Eval(context)[:SIZE]
        if not np.isfinite(carriage).all():
            raise ParameterError("carriage", carriage.tolist(), "finite numbers")
        if closed:
            offset = context.get_discrete_state(self._resting).value()[:SIZE] - carriage
            if math.hypot(*offset[3:]) <= self._params.reach:
                values.set_value(self._holds, [1.0])
                values.set_value(self._offset, _at_rest(offset))
        else:
            offset = context.get_discrete_state(self._offset).value()[:SIZE]
            values.set_value(self._holds, [0.0])
            values.set_value(self._resting, _at_rest(carriage + offset))


class Gripped(NamedTuple):
    """The output ports that :func:`add_gripper` adds."""

    part: OutputPort  # of the part: displacement, rad above m, and rate, shape (12,)
    holding: OutputPort  # 1 while it holds the part, size 1


def add_gripper(
    builder: DiagramBuilder, gripper: PartGripper, *, carriage: OutputPort, closed: OutputPort
) -> Gripped:
    """Add a gripper and the systems that move its part; no Python runs between its ticks.

    The ``carriage`` is a displacement, rad above m, and its rate, shape (12,).
    """
    builder.AddNamedSystem("gripper", gripper)
    held = builder.AddNamedSystem("held part", Adder(2, 2 * SIZE))
    switch = builder.AddNamedSystem("part", PortSwitch(2 * SIZE))
    assert switch.DeclareInputPort("held").get_index() == HELD
    assert switch.DeclareInputPort("resting").get_index() == RESTS
    connect = builder.Connect
    connect(carriage, gripper.GetInputPort("carriage"))
    connect(closed, gripper.GetInputPort("closed"))
    connect(carriage, held.get_input_port(0))
    connect(gripper.GetOutputPort("offset"), held.get_input_port(1))
    connect(held.get_output_port(), switch.GetInputPort("held"))
    connect(gripper.GetOutputPort("resting"), switch.GetInputPort("resting"))
    connect(gripper.GetOutputPort("selection"), switch.get_port_selector_input_port())
    return Gripped(switch.get_output_port(), gripper.GetOutputPort("holding"))


def _at_rest(displacement: Array) -> Array:
    """Return a displacement with a rate of zero, shape (12,)."""
    return np.concatenate([displacement, np.zeros(SIZE)])


class CarriedPoses(LeafSystem):
    """Computes the poses of the things that are fixed to a carriage.

    .. pydrake_system::

        name: CarriedPoses
        input_ports:
        - displacement
        output_ports:
        - (<name>_pose of each thing)

    ``displacement``, shape (6,), rad above m, is that of
    :func:`chamfer.models.arms.wrist.tip_pose`. It is the integral of a velocity while the carriage
    turns about one axis, and nearly so for small turns. The poses are in the world, shape (7,):
    quaternion w, x, y, z and position in m. ``carried`` has the pose X_EB of each thing in the
    carriage's frame, by its name.

    Raises:
        ParameterError: If nothing is carried.
    """

    def __init__(self, carried: Mapping[str, RigidTransform]) -> None:
        super().__init__()
        if not carried:
            raise ParameterError("carried", dict(carried), "one thing or more")
        displacement = self.DeclareVectorInputPort("displacement", 6)

        def reader(X_EB: RigidTransform) -> Callable[[Context, BasicVector], None]:
            def calc(context: Context, vector: Any) -> None:
                X_WE = tip_pose(displacement.Eval(context))
                vector.SetFromVector(pose_vector(X_WE @ X_EB))

            return calc

        for name, X_EB in carried.items():
            self.DeclareVectorOutputPort(
                f"{name}_pose", POSE_SIZE, reader(X_EB), {displacement.ticket()}
            )


class PoseDisplacement(LeafSystem):
    """Computes the displacement of a pose, the inverse of :class:`CarriedPoses`.

    .. pydrake_system::

        name: PoseDisplacement
        input_ports:
        - pose
        output_ports:
        - displacement

    ``pose``, shape (7,), quaternion and position, m; ``displacement``, shape (6,), rad above m.
    """

    def __init__(self) -> None:
        super().__init__()
        pose = self.DeclareVectorInputPort("pose", POSE_SIZE)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(tip_displacement(pose_from_vector(pose.Eval(context))))

        self.DeclareVectorOutputPort("displacement", SIZE, calc, {pose.ticket()})


class TrueMotion(LeafSystem):
    """Returns the true displacement and velocity of a plant's body; not for controllers.

    .. pydrake_system::

        name: TrueMotion
        input_ports:
        - body_poses
        - body_velocities
        output_ports:
        - motion

    The inputs are the plant's ports of these names. ``motion``, shape (12,), is the displacement,
    rad above m, and the velocity, rad/s above m/s in the world's axes.
    """

    def __init__(self, body: BodyIndex) -> None:
        super().__init__()
        index = int(body)
        poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        velocities = self.DeclareAbstractInputPort(
            "body_velocities", Value[list[SpatialVelocity]]()
        )

        def calc(context: Context, vector: BasicVector) -> None:
            X, V = poses.Eval(context)[index], velocities.Eval(context)[index]
            vector.SetFromVector(
                np.concatenate([tip_displacement(X), V.rotational(), V.translational()])
            )

        self.DeclareVectorOutputPort(
            "motion", 2 * SIZE, calc, {poses.ticket(), velocities.ticket()}
        )


class DivergenceGuard(LeafSystem):
    """Stops a simulation whose signals exceed physical limits.

    .. pydrake_system::

        name: DivergenceGuard
        input_ports:
        - (one per entry of ``limits``)

    It checks once a period, s, before the systems that were added to the diagram after it. The
    limits are the size and the largest element of each signal.

    Raises:
        ParameterError: In a run, if a signal is not finite or beyond its limit, with its time.
    """

    def __init__(
        self, plant: str, *, limits: Mapping[str, tuple[int, float]], period: float
    ) -> None:
        super().__init__()
        ports = [
            (self.DeclareVectorInputPort(name, size), most)
            for name, (size, most) in limits.items()
        ]

        def look(context: Context, state: State) -> None:
            for port, most in ports:
                values = port.Eval(context)
                bad = values[~(np.abs(values) <= most)]
                if bad.size:
                    raise ParameterError(
                        f"simulation failed: {port.get_name()} of the {plant} at "
                        f"{context.get_time():.6g} s",
                        float(bad[0]),
                        f"at most {most:g}, it diverges; a shorter step may help",
                    )

        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, look)
