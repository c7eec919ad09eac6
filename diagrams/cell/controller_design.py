"""The alignment's controllers, designed for the scenario's arms and cameras.

The settling theorem (:mod:`chamfer.systems.servo.settling`) and SIMC ask for a plant's gain and
step response. The plant of the alignment is an arm under impedance control as the cameras see it:
from a step of one axis of its commanded pose to pixels, or rad, with the images' dead time. It is
that without dry friction, which the theorem admits as a backlash, and which takes time only.

What is held, whatever the cameras are, is how fast errors are compensated: the increment per
period, and the PID's closed loop. How small a dead zone can be follows. With the default cameras
that is what ``alignment-fsm-vs-pid`` found to be best.

The linear response is exact for small steps: the arm under impedance control, at rest at its
nominal pose, as one map of a period of its controller, by finite differences. It is that of the
simulation to 3e-8 of its Jacobian, and costs 20 ms for all axes.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant

from chamfer.diagrams.cell.alignment_scenario import (
    KINDS,
    AlignmentScenario,
    Kind,
    OpenAxis,
    OpenGains,
    ResolvedAlignmentScenario,
    SixAxisPid,
    SixAxisSettings,
)
from chamfer.diagrams.cell.cell_vision import VIEWS, CellCameras
from chamfer.diagrams.cell.work_cell import ArmName, WorkCellScenario, add_holders
from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.plants.linear_response import free_response
from chamfer.models.validation import ParameterError, within
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.force.impedance_controller import make_impedance_law
from chamfer.systems.force.tool_pose import compensate
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.sampled_pid import designed_gains
from chamfer.systems.servo.settling import SettlingPlant, designed_axis, guarantee
from chamfer.systems.vision.cell_error import AXES

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
        """Return the missing part of a step at the ends of periods, s, shape (k,).

        Who looks at the very instant of a step of the arm looks just before it.
        """
        left = self.undelivered[AXES.index(axis)]
        count = int((len(left) - 1) * self.period / period)
        rows = np.ceil(np.arange(1, count + 1) * (period / self.period) - 1e-6).astype(int) - 1
        found: Array = left[rows]
        return found


def step_responses(scenario: WorkCellScenario, arm: ArmName) -> StepResponses:
    """Return an arm's linear responses, without friction and torque limits, until it rests."""
    if scenario.servo is not None:
        return servo_responses(scenario.servo)
    settings = getattr(scenario, arm)
    n = settings.arm.num_joints
    same = {name: getattr(scenario, name) for name in ("axis", "gap", "step")}
    alone = WorkCellScenario(
        **same,
        impedance=replace(scenario.impedance, torque_limits=(_MOST_TORQUE,) * n),
        meeting_point=scenario.mouth,
    )
    return _step_responses(replace(alone, **{arm: settings.with_friction(0.0)}), arm)


def servo_responses(servo: ServoParams) -> StepResponses:
    """Return those of an arm that takes positions: of its joints, without their limits."""
    period, w = servo.period, servo.frequency
    late = np.arange(math.ceil(-math.log(_SETTLED) * 2 / (w * period)) + servo.delay) * period
    left = np.maximum(late - servo.delay * period, 0.0)
    undelivered: Array = (1 + w * left) * np.exp(-w * left)
    return StepResponses(np.ones(len(AXES)), np.tile(undelivered, (len(AXES), 1)), period)


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
        self._law = make_impedance_law(model, self._posture, scenario.impedance)
        self._steps = round(scenario.impedance.period / scenario.step)

    def after(self, x: Array, compensation: Array) -> Array:
        """Return the state, shape (2 n,), a period later, with a compensation, m and rad, (6,)."""
        command = compensate(self._pose, compensation)
        torque = self._law.torque(self._pose, x, command)[: len(self._posture)]
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


ResolvedT = TypeVar("ResolvedT", bound=ResolvedAlignmentScenario)

SEEN: Final[dict[Kind, tuple[str, ...]]] = {
    "lateral": ("x", "y", "z"),
    "rotational": ("pitch", "yaw"),  # a turn about X is not seen
}
# What detection may be off, pixels and rad, with images of the usual noise. Of parts at rest it is
# four standard deviations of the lateral error, and two of the rotational one.
MEASUREMENT_ERROR: Final[dict[Kind, float]] = {"lateral": 0.1, "rotational": 5e-4}
_USUAL_LENGTH: Final = ColouredParts.hole_length / CellCameras.pixel_size  # pixels
_ENDS: Final = 6.0  # pixels of a part's length, at which its edges are not measured
_SHORTEST: Final = 20.0  # pixels, of edges; parts with shorter ones are hardly found
SPEED: Final[dict[Kind, float]] = {"lateral": 8e-3, "rotational": 0.32}
# m/s and rad/s, of the large increments
# Of a camera in the hand: what its detection may be off, and how fast, relatively, its errors are
# compensated, since it looks more rarely.
IN_THE_HAND: Final[dict[Kind, float]] = {"lateral": 0.03, "rotational": 1.5e-3}
_SLOWER: Final = 0.12
CLOSED_LOOP: Final = 0.05  # s, time constant beyond the dead time
_ALONE: Final[dict[str, ArmName]] = {"peg": "peg", "hole": "hole", "none": "peg"}
_LIMITS: Final[dict[Kind, float]] = {"lateral": 0.03, "rotational": 0.3}  # m and rad

Responses = Mapping[str, SettlingPlant]  # by axis


def dead_samples(scenario: AlignmentScenario) -> int:
    """Return how many of the controller's periods old an image may be when it acts on it.

    It is the one of the slower camera, from the middle of its exposure, just before its next one
    arrives.
    """
    cameras = scenario.cameras
    oldest = max(cameras.delay(view) + cameras.frames_of(view).period for view in VIEWS)
    return math.ceil(oldest / cameras.frames.period - 1e-6)


def measurement_error(scenario: AlignmentScenario, kind: Kind) -> float:
    """Return the largest error of detection, pixels or rad, with the noisier camera.

    Detection's standard deviation is proportional to their noise: of parts at rest it was 0.011,
    0.026, 0.05 and 0.071 pixels at 2, 4, 8 and 12 grey levels. With 20 parts get lost. An edge
    that is measured over n pixels has an angle as sure as n to the power of 1.5, and so has the
    lateral error of parts that stand some way apart.
    """
    cameras, parts = scenario.cameras, scenario.parts
    if cameras.kind == "hand":
        return IN_THE_HAND[kind]
    noise = max(cameras.frames_of(view).noise for view in VIEWS)
    shorter = min(parts.peg_length, parts.hole_length) / cameras.pixel_size
    edge = max(shorter - _ENDS, _SHORTEST)
    short: float = max((_USUAL_LENGTH - _ENDS) / edge, 1.0) ** 1.5
    return MEASUREMENT_ERROR[kind] * max(noise / FrameGrabberParams.noise, 1.0) * short


def arm_responses(scenario: ResolvedAlignmentScenario) -> tuple[Responses, ...]:
    """Return the response along every axis that the cameras see, of each arm that compensates.

    Gains are in pixels per m, or 1. Where none compensates it is that of the peg's arm.
    """
    chosen = scenario.compensated
    arms = scenario.arms if chosen == "both" else (_ALONE[chosen],)
    period = scenario.cameras.frames.period
    dead = np.ones(dead_samples(scenario))
    pixels: dict[Kind, float] = {"lateral": 1 / scenario.cameras.pixel_size, "rotational": 1.0}

    def plant(responses: StepResponses, kind: Kind, axis: str) -> SettlingPlant:
        left = np.concatenate([dead, responses.sampled(axis, period)])
        return SettlingPlant(pixels[kind] * float(responses.gain[AXES.index(axis)]), left)

    return tuple(
        {axis: plant(responses, kind, axis) for kind, axes in SEEN.items() for axis in axes}
        for responses in (step_responses(scenario, arm) for arm in arms)
    )


def of_kind(responses: Sequence[Responses], kind: Kind) -> list[SettlingPlant]:
    """Return the plants of all arms that one element, or one law, has to serve."""
    return [plants[axis] for plants in responses for axis in SEEN[kind]]


def resolve_controllers(scenario: ResolvedT) -> ResolvedT:
    """Fill in the open fields of the compensator and of the PID."""
    elements = (scenario.compensator.lateral, scenario.compensator.rotational)
    laws = (scenario.pid.lateral, scenario.pid.rotational)
    if not any(None in vars(one).values() for one in (*elements, *laws)):
        return scenario
    responses = arm_responses(scenario)
    slower = _SLOWER if scenario.cameras.kind == "hand" else 1.0
    increments = {kind: slower * SPEED[kind] * scenario.cameras.frames.period for kind in KINDS}
    return replace(
        scenario,
        compensator=design_compensator(scenario, responses, increments),
        pid=design_pid(scenario, responses, CLOSED_LOOP),
    )


def design_compensator(
    scenario: AlignmentScenario, responses: Sequence[Responses], increments: Mapping[Kind, float]
) -> SixAxisSettings:
    """Return the state machine's elements; given values are kept."""
    elements: dict[Kind, OpenAxis] = {}
    for kind in KINDS:
        given: OpenAxis = getattr(scenario.compensator, kind)
        with within(f"compensator.{kind}"):
            axis = designed_axis(
                given,
                of_kind(responses, kind),
                increment=increments[kind],
                measurement_error=measurement_error(scenario, kind),
                limit=_LIMITS[kind],
            )
            elements[kind] = replace(given, **vars(axis))
    return SixAxisSettings(**elements)


def design_pid(
    scenario: AlignmentScenario, responses: Sequence[Responses], closed_loop: float
) -> SixAxisPid:
    """Return the baseline's gains by SIMC; given values are kept."""
    laws: dict[Kind, OpenGains] = {}
    for kind in KINDS:
        given: OpenGains = getattr(scenario.pid, kind)
        gains = designed_gains(
            given,
            of_kind(responses, kind),
            closed_loop=closed_loop,
            period=scenario.cameras.frames.period,
            limit=_LIMITS[kind],
        )
        laws[kind] = replace(given, **vars(gains))
    return SixAxisPid(**laws)


def small_share(scenario: ResolvedAlignmentScenario, kind: Kind) -> float:
    """Return the share of the settling theorem's bound that a resolved scenario's elements use.

    It is the largest of all axes and arms; infinity where the dead zone is within the measurement
    error. Above 1 the theorem promises no rest.
    """
    element: OpenAxis = getattr(scenario.compensator, kind)
    error = measurement_error(scenario, kind)
    if element.closed.dead_zone <= error:
        return math.inf
    plants = of_kind(arm_responses(scenario), kind)
    return max(guarantee(element.closed, plant, error).small_share for plant in plants)
