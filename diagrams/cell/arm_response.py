"""How an arm of the cell answers a step of its commanded pose: linear, and simulated.

The linear response is exact for small steps: the arm under impedance control, at rest at its
nominal pose, as one map of a period of its controller, by finite differences. It is that of the
simulation to 3e-8 of its Jacobian, and costs 20 ms for all axes.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.cell.work_cell import ArmName, WorkCellScenario, add_holders, add_work_cell
from chamfer.models.plants.linear_response import free_response
from chamfer.models.validation import ParameterError
from chamfer.systems.force.desired_pose import compensate
from chamfer.systems.force.impedance_controller import ImpedanceController
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.image_plane_error import AXES

Array = NDArray[np.float64]

_STEP: Final = 1e-6  # rad, rad/s and m, of the finite differences
_AT_REST: Final = 1e-10  # rad, that Newton's method still moves a joint
_MOST_ITERATIONS: Final = 20
_SETTLED: Final = 1e-6  # of a mode, that no longer counts
_FREE: Final = 1e-7  # from 1, of an eigenvalue: what nothing brings back, as the elbow may be
_MOST_TORQUE: Final = 1e9  # N m, that no joint reaches
_LONGEST: Final = 60.0  # s, of a response


class StepResponses(NamedTuple):
    """How the tool answers steps of the command, along and about the hole's axes."""

    gain: Array  # at rest, in the order of AXES, shape (6,)
    undelivered: Array  # of each axis' own step, at the controller's k-th period, shape (6, n)
    period: float  # s, of the controller

    def sampled(self, axis: str, period: float) -> Array:
        """Return what has not arrived at the ends of periods after the step, shape (k,).

        Args:
            axis: One of AXES.
            period: s, of who looks: at the very instant of a step of the arm just before it.
        """
        left = self.undelivered[AXES.index(axis)]
        count = int((len(left) - 1) * self.period / period)
        rows = np.ceil(np.arange(1, count + 1) * (period / self.period) - 1e-6).astype(int) - 1
        found: Array = left[rows]
        return found


def step_responses(scenario: WorkCellScenario, arm: ArmName) -> StepResponses:
    """Return the linear responses of an arm, without friction and torque limits, until it rests.

    Raises:
        ParameterError: If the arm does not come to rest under its control.
    """
    settings = getattr(scenario, arm)
    n = settings.arm.num_joints
    free = replace(settings, joint_friction=(0.0,) * n)
    alone = WorkCellScenario(
        impedance=replace(scenario.impedance, torque_limits=(_MOST_TORQUE,) * n),
        axis=scenario.axis,
        meeting_point=scenario.mouth,
        gap=scenario.gap,
        step=scenario.step,
    )
    return _step_responses(replace(alone, **{arm: free}), arm)


@lru_cache(maxsize=32)
def _step_responses(scenario: WorkCellScenario, arm: ArmName) -> StepResponses:
    motion = _ControlledArm(scenario, arm)
    x, transition = motion.rest()
    sizes = np.abs(np.linalg.eigvals(transition))
    if sizes.max() > 1 + _FREE:
        allowed = "one under which the arms come to rest, or give the controllers' fields"
        raise ParameterError("impedance.damping_ratio", scenario.impedance.damping_ratio, allowed)
    axes = np.kron(np.eye(2), scenario.hole_axes.matrix())
    command = _jacobian(lambda u: motion.after(x, axes @ u), np.zeros(len(AXES)))
    pose = motion.tool(x)
    output = _jacobian(lambda moved: axes.T @ _way(pose, motion.tool(moved)), x)
    # What a step has moved once all is at rest; what nothing brings back does not move the tool.
    left = np.eye(len(x)) - transition
    rest = np.asarray(np.linalg.lstsq(left, command, rcond=None)[0], np.float64)
    gain = np.asarray(np.diag(output @ rest), np.float64)
    period = scenario.impedance.period
    slowest = sizes[sizes < 1 - _FREE].max()
    count = math.ceil(min(math.log(_SETTLED) / math.log(slowest), _LONGEST / period)) + 1
    undelivered = [
        output[k] @ free_response(transition, rest[:, k], count) / gain[k]
        for k in range(len(AXES))
    ]
    return StepResponses(gain, np.array(undelivered), period)


class _ControlledArm:
    """An arm and its controller, from one period to the next; a state is q and its rates."""

    def __init__(self, scenario: WorkCellScenario, arm: ArmName) -> None:
        self._plant = MultibodyPlant(scenario.step)
        self._plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
        self._plant.SetUseSampledOutputPorts(False)
        _, tools = add_holders(self._plant, scenario, (arm,))
        self._plant.Finalize()
        self._tool = tools[arm]
        self._context = self._plant.CreateDefaultContext()
        self._pose = pose_vector(scenario.nominal_pose(arm))
        self._posture = scenario.rest_posture(arm)
        model = getattr(scenario, arm).known_arm()
        self._controller = ImpedanceController(model, self._posture, scenario.impedance)
        self._steps = round(scenario.impedance.period / scenario.step)

    def after(self, x: Array, compensation: Array) -> Array:
        """Return the state, shape (2 n,), a period later, with a compensation, m and rad, (6,)."""
        command = compensate(self._pose, compensation)
        torque = self._controller.step(self._pose, x, command)[: len(self._posture)]
        self._plant.get_actuation_input_port().FixValue(self._context, torque)
        for _ in range(self._steps):
            self._plant.SetPositionsAndVelocities(self._context, x)
            x = self._plant.EvalUniquePeriodicDiscreteUpdate(self._context).value().copy()
        return x

    def rest(self) -> tuple[Array, Array]:
        """Return the state at rest, and the map's Jacobian there, shape (2 n, 2 n)."""
        x = np.concatenate([self._posture, np.zeros(len(self._posture))])
        still = np.zeros(len(AXES))
        for _ in range(_MOST_ITERATIONS):
            transition = _jacobian(lambda moved: self.after(moved, still), x)
            left = np.eye(len(x)) - transition
            change = np.linalg.lstsq(left, self.after(x, still) - x, rcond=None)[0]
            x = x + change
            if np.abs(change).max() < _AT_REST:
                break
        return x, transition

    def tool(self, x: Array) -> RigidTransform:
        """Return the tool's pose."""
        self._plant.SetPositionsAndVelocities(self._context, x)
        pose: RigidTransform = self._plant.EvalBodyPoseInWorld(self._context, self._tool)
        return pose


def _way(start: RigidTransform, end: RigidTransform) -> Array:
    """Return how a pose has moved, m, and turned, rad, in the world, shape (6,)."""
    turn = (end.rotation() @ start.rotation().inverse()).ToAngleAxis()
    return np.concatenate([end.translation() - start.translation(), turn.angle() * turn.axis()])


def _jacobian(function: Callable[[Array], Array], at: Array) -> Array:
    """Return the derivative of a function by central differences, a column an argument."""
    steps = _STEP * np.eye(len(at))
    columns = [(function(at + step) - function(at - step)) / (2 * _STEP) for step in steps]
    return np.column_stack(columns)


def make_response_diagram(
    scenario: WorkCellScenario, arm: ArmName, axis: str, *, amplitude: float, begin: float
) -> Diagram:
    """Build one arm that holds its nominal pose until one axis of the command makes a step.

    It exports ``true_pose``, shape (7,), of the tool.

    Args:
        scenario: The cell.
        arm: Which arm.
        axis: One of :data:`chamfer.systems.vision.image_plane_error.AXES`, of the hole's axes.
        amplitude: Of the step, m or rad.
        begin: s, when.
    """
    builder = DiagramBuilder()
    ports = add_work_cell(builder, scenario, arms=(arm,)).arms[arm]
    before = pose_vector(scenario.nominal_pose(arm))
    moved = np.reshape(amplitude * np.eye(len(AXES))[AXES.index(axis)], (2, 3))
    after = compensate(before, (moved @ scenario.hole_axes.matrix().T).ravel())
    step = PiecewisePolynomial.ZeroOrderHold(
        [0.0, begin, 2 * begin], np.column_stack([before, after, after])
    )
    command = builder.AddNamedSystem("command", TrajectorySource(step))
    builder.Connect(command.get_output_port(), ports.desired_pose)
    builder.ExportOutput(ports.true_pose, "true_pose")
    diagram = builder.Build()
    diagram.set_name(f"Response of the {arm}'s arm along {axis}")
    return diagram
