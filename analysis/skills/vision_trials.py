"""Trials of the vision primitives: random starts, wrong calibration, and where they end."""

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from chamfer.diagrams.skills.vision_servo import (
    PARTS,
    STATIC,
    CameraBelief,
    VisionPrimitive,
    VisionServoScenario,
    VisionServoSetup,
    make_vision_servo_diagram,
    view_of,
)
from chamfer.models.arms.wrist import tip_pose
from chamfer.models.validation import ParameterError
from chamfer.systems.pose import pose_vector
from chamfer.systems.primitives.primitive import TICK, Event
from chamfer.systems.primitives.vision_primitives import (
    FixedPointRotation,
    VisGrasp,
    VisRotation,
    VisTranslation,
)
from chamfer.systems.primitives.visual_servoing import half_turn, slowest_root
from chamfer.systems.vision.cross_section import cross_section
from chamfer.systems.vision.part_detection import detect

Array = NDArray[np.float64]

_RIGHT: Final = CameraBelief()


@dataclass(frozen=True, kw_only=True)
class VisionTrial:
    """What became of one primitive."""

    event: Event | None  # None: time was up, or the primitive refused what it was to believe
    time: float  # s, when it ended
    times: Array  # s, shape (n,)
    displacement: Array  # rad above m, of the carriage, shape (n, 6)
    errors: Array  # m and rad, of true_errors, shape (n, 2)
    seen: float | None  # pixels, in the end; None: undefined
    slowest_root: float  # of the theory; below 1 the loop settles


def calibration(angle: float, focal_factor: float, random: np.random.Generator) -> CameraBelief:
    """Return a belief with a given size of the orientation's error, rad, about a random axis."""
    axis = random.normal(size=3)
    x, y, z = (angle * axis / np.linalg.norm(axis)).tolist()
    return CameraBelief(focal_factor=focal_factor, turn=(x, y, z))


def draw(
    loop: VisionServoSetup,
    name: VisionPrimitive,
    *,
    focal_error: float,
    orientation_error: float,
    trial: int,
    random: np.random.Generator,
) -> VisionServoScenario:
    """Return a trial of a primitive: a random start, every camera wrong.

    Args:
        loop: What does not change.
        name: The primitive.
        focal_error: Relative, of every focal length; trials go through the signs.
        orientation_error: rad, of every camera, about a random axis.
        trial: Its number.
        random: Where start, target and axes come from.
    """
    signs = [1 if trial >> k & 1 else -1 for k in range(3)]
    beliefs = [
        calibration(orientation_error, 1 + sign * focal_error, random) for sign in signs[:2]
    ]
    start, target = np.zeros(6), np.zeros(6)
    start[3:] = random.uniform((-0.02, -0.02, 0.005), (0.02, 0.02, 0.03))
    target[3:] = random.uniform((-0.008, -0.008, -0.02), (0.008, 0.008, -0.012))
    angle = loop.angle
    if name == "rotation":
        start[:2], target[:2] = random.uniform(-0.25, 0.25, 2), random.uniform(-0.1, 0.1, 2)
        start[3:5] /= 2
    elif name == "fixed_point":
        start[3:] -= loop.lever
        angle *= random.uniform(0.5, 1.0) * random.choice((-1.0, 1.0))
    elif name == "grasp":
        start[2], start[5] = random.uniform(-0.5, 0.5), 0.0
        target[2], target[5] = random.uniform(-0.2, 0.2), 0.0
    return VisionServoScenario(
        **{field.name: getattr(loop, field.name) for field in fields(loop)} | {"angle": angle},
        primitive=name,
        start=tuple(start.tolist()),
        target=tuple(target.tolist()),
        believed_lever=1 + signs[2] * focal_error,
        xz=beliefs[0],
        yz=beliefs[1],
        hand=beliefs[0],
    )


def true_errors(scenario: VisionServoScenario, displacement: Array) -> tuple[float, float]:
    """Return how far from its goal a primitive truly is, m and rad; NaN: it has no such goal.

    Args:
        scenario: The trial.
        displacement: Of the carriage, rad above m, shape (6,).
    """
    X_WE = tip_pose(displacement)
    X_WT = X_WE @ scenario.held_at
    target = tip_pose(np.array(scenario.target))
    tip, mouth = X_WT.translation(), target.translation()
    if scenario.primitive == "translation":
        return float(np.linalg.norm(tip - mouth - [0.0, 0.0, scenario.gap])), math.nan
    if scenario.primitive == "rotation":
        axes = [X.rotation().matrix()[:, 2] for X in (X_WT, target)]
        sine = float(np.linalg.norm(np.cross(*axes)))
        return math.nan, math.asin(min(1.0, sine))
    if scenario.primitive == "fixed_point":
        first = (tip_pose(np.array(scenario.start)) @ scenario.held_at).translation()
        turned = float(displacement[1]) - scenario.start[1]
        return float(np.linalg.norm((tip - first)[[0, 2]])), abs(turned - scenario.angle)
    away = (X_WE.inverse() @ mouth)[:2]
    return float(np.linalg.norm(away)), abs(half_turn(float(displacement[2]) - scenario.target[2]))


def seen_error(scenario: VisionServoScenario, displacement: Array) -> float | None:
    """Return the error in images without noise, pixels, the largest of a primitive's features.

    Of the translation it is the part that is believed to be reducible. None: the primitive has no
    error in pixels, or sees nothing.

    Args:
        scenario: The trial.
        displacement: Of the carriage, rad above m, shape (6,).
    """
    primitive = scenario.parameters
    if isinstance(primitive, VisGrasp):
        section = cross_section(view_of(scenario, "hand", displacement))
        return float(np.abs(np.subtract(section.centroid, scenario.hand_camera.centre)).max())
    if isinstance(primitive, VisTranslation):
        found = [
            [detect(view_of(scenario, view, displacement), part).tip for part in PARTS]
            for view in STATIC
        ]
        tips, mouths = np.swapaxes(np.array(found), 0, 1)
        J, servoing = primitive.jacobian([*tips]), primitive.servoing
        u = servoing.solve(J, primitive.deviation([*tips], [*mouths]))
        return float(np.abs(servoing.reducible(J, u)).max())
    if isinstance(primitive, FixedPointRotation):
        first, last = (
            detect(view_of(scenario, "xz", one), PARTS[0]).tip
            for one in (np.array(scenario.start), displacement)
        )
        return float(np.abs(np.subtract(last, first)).max())
    return None


def shares(scenario: VisionServoScenario) -> NDArray[np.complex128]:
    """Return which shares of its errors the loop truly takes away in a frame, complex, (n,).

    The eigenvalues of ``gain pinv(J_believed) J_true`` in the middle of the images.

    Raises:
        ParameterError: If the primitive refuses what it is to believe.
    """
    believed, true = (
        _jacobian(one) for one in (scenario, replace(scenario, xz=_RIGHT, yz=_RIGHT, hand=_RIGHT))
    )
    eigenvalues = np.linalg.eigvals(scenario.servoing.gain * np.linalg.pinv(believed) @ true)
    return eigenvalues.astype(np.complex128)


def _jacobian(scenario: VisionServoScenario) -> Array:
    primitive = scenario.parameters
    middle = np.array(scenario.hand_camera.centre)
    if isinstance(primitive, VisTranslation):
        return primitive.jacobian([middle, middle])
    if isinstance(primitive, VisRotation):
        return primitive.jacobian
    assert isinstance(primitive, FixedPointRotation | VisGrasp)
    return primitive.jacobian(middle)


@lru_cache(maxsize=8)
def _diagram(scenario: VisionServoScenario) -> Diagram:
    return make_vision_servo_diagram(scenario)


def run_trial(scenario: VisionServoScenario, *, seed: int, most: float) -> VisionTrial:
    """Run a primitive until it has an event, or its time is up.

    Args:
        scenario: The trial.
        seed: Of the images' noise.
        most: s, time that it has.
    """
    start = np.array(scenario.start)
    try:
        primitive = scenario.parameters
        root = max(
            slowest_root(one, delay=scenario.frames.latency) for one in shares(scenario).tolist()
        )
    except ParameterError:
        return VisionTrial(
            event=None,
            time=0.0,
            times=np.zeros(1),
            displacement=start[np.newaxis],
            errors=np.array([true_errors(scenario, start)]),
            seen=None,
            slowest_root=math.inf,
        )
    # What a Context holds does not make another diagram.
    plain = VisionServoScenario()
    diagram = _diagram(
        replace(
            scenario,
            start=plain.start,
            target=plain.target,
            gap=plain.gap,
            angle=plain.angle,
            servoing=plain.servoing,
            believed_lever=plain.believed_lever,
            xz=_RIGHT,
            yz=_RIGHT,
            hand=_RIGHT,
        )
    )
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    carriage, runner, target = (
        diagram.GetSubsystemByName(name) for name in ("carriage", "primitive", "target")
    )
    carriage.GetMyMutableContextFromRoot(context).SetContinuousState(start)
    target.get_mutable_source_value(target.GetMyMutableContextFromRoot(context)).SetFromVector(
        pose_vector(tip_pose(np.array(scenario.target)))
    )
    runner.set_primitive(runner.GetMyMutableContextFromRoot(context), primitive)

    output = diagram.GetOutputPort("displacement")
    times, displacements = [0.0], [start]
    event = None
    # Half a tick later than the ticks, so that rounding cannot change what is seen.
    for k in range(1, math.ceil(most / scenario.frames.period) + 1):
        time = (round(k * scenario.frames.period / TICK) + 0.5) * TICK
        simulator.AdvanceTo(time)
        times.append(time)
        displacements.append(np.array(output.Eval(context)))
        event = runner.event(runner.GetMyContextFromRoot(context))
        if event is not None:
            break
    return VisionTrial(
        event=event,
        time=times[-1],
        times=np.array(times),
        displacement=np.array(displacements),
        errors=np.array([true_errors(scenario, one) for one in displacements]),
        seen=seen_error(scenario, displacements[-1]) if event == "done" else None,
        slowest_root=root,
    )
