"""The alignment's controllers, designed for the arms and cameras that there are.

The settling theorem (:mod:`chamfer.systems.servo.settling`) and SIMC ask for a plant's gain and
step response. The plant of the alignment is an arm under impedance control as the cameras see it:
from a step of one axis of its commanded pose to pixels, or rad, with the images' dead time. It is
that without dry friction, which the theorem admits as a play, and which takes time only.

What is held, whatever the cameras are, is how fast errors are compensated: the increment per
period, and the PID's closed loop. How small a dead zone can be follows. With the default cameras
that is what ``alignment-fsm-vs-pid`` found to be best.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np

from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.arm_response import step_responses
from chamfer.diagrams.cell.cell_cameras import VIEWS, CellCameras
from chamfer.diagrams.cell.six_axis_settings import (
    KINDS,
    Kind,
    OpenAxis,
    OpenGains,
    SixAxisPid,
    SixAxisSettings,
)
from chamfer.diagrams.cell.work_cell import ArmName
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import known, within
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.servo.sampled_pid import designed_gains
from chamfer.systems.servo.settling import SettlingPlant, designed_axis, guarantee
from chamfer.systems.vision.cell_error import AXES

ScenarioT = TypeVar("ScenarioT", bound=AlignmentScenario)

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
CLOSED_LOOP: Final = 0.05  # s, time constant beyond the dead time
_ALONE: Final[dict[str, tuple[ArmName, ...]]] = {
    "peg": ("peg",),
    "hole": ("hole",),
    "none": ("peg",),
}
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
    """Return what detection may be off, pixels or rad, with the images of the noisier camera.

    Detection's standard deviation is proportional to their noise: of parts at rest it was 0.011,
    0.026, 0.05 and 0.071 pixels at 2, 4, 8 and 12 grey levels. With 20 parts get lost. An edge
    that is measured over n pixels has an angle as sure as n to the power of 1.5, and so has the
    lateral error of parts that stand some way apart.
    """
    cameras, parts = scenario.cameras, scenario.parts
    noise = max(cameras.frames_of(view).noise for view in VIEWS)
    shorter = min(parts.peg_length, parts.hole_length) / cameras.pixel_size
    edge = max(shorter - _ENDS, _SHORTEST)
    short: float = max((_USUAL_LENGTH - _ENDS) / edge, 1.0) ** 1.5
    return MEASUREMENT_ERROR[kind] * max(noise / FrameGrabberParams.noise, 1.0) * short


def arm_responses(scenario: AlignmentScenario) -> tuple[Responses, ...]:
    """Return the response along every axis that the cameras see, of each arm that compensates.

    Gains are in pixels per m, or 1. Where none compensates it is that of the peg's arm.
    """
    chosen = known("compensated", scenario.compensated)
    arms = scenario.arms if chosen == "both" else _ALONE[chosen]
    period = scenario.cameras.frames.period
    dead = np.ones(dead_samples(scenario))
    pixels: dict[Kind, float] = {"lateral": 1 / scenario.cameras.pixel_size, "rotational": 1.0}
    found = []
    for arm in arms:
        responses = step_responses(scenario, arm)
        plants = {}
        for kind, axes in SEEN.items():
            for axis in axes:
                left = np.concatenate([dead, responses.sampled(axis, period)])
                gain = pixels[kind] * float(responses.gain[AXES.index(axis)])
                plants[axis] = SettlingPlant(gain, left)
        found.append(plants)
    return tuple(found)


def of_kind(responses: Sequence[Responses], kind: Kind) -> list[SettlingPlant]:
    """Return the plants of all arms that one element, or one law, has to serve."""
    return [plants[axis] for plants in responses for axis in SEEN[kind]]


def resolve_controllers(scenario: ScenarioT) -> ScenarioT:
    """Fill in what of the compensator and of the PID is open.

    Raises:
        ParameterError: If a dead zone leaves nothing beyond the measurement error, or the arms
            don't come to rest.
    """
    elements = (scenario.compensator.lateral, scenario.compensator.rotational)
    laws = (scenario.pid.lateral, scenario.pid.rotational)
    if not any(None in vars(one).values() for one in (*elements, *laws)):
        return scenario
    responses = arm_responses(scenario)
    increments = {kind: SPEED[kind] * scenario.cameras.frames.period for kind in KINDS}
    return replace(
        scenario,
        compensator=design_compensator(scenario, responses, increments),
        pid=design_pid(scenario, responses, CLOSED_LOOP),
    )


def design_compensator(
    scenario: AlignmentScenario,
    responses: Sequence[Responses],
    increments: Mapping[Kind, float],
) -> SixAxisSettings:
    """Return the state machine's elements, what is given kept.

    Args:
        scenario: Its compensator is what is given.
        responses: From :func:`arm_responses`.
        increments: That are wanted, m and rad.
    """

    def element(kind: Kind) -> OpenAxis:
        given: OpenAxis = getattr(scenario.compensator, kind)
        with within(f"compensator.{kind}"):
            axis = designed_axis(
                given,
                of_kind(responses, kind),
                increment=increments[kind],
                measurement_error=measurement_error(scenario, kind),
                limit=_LIMITS[kind],
            )
            return replace(given, **vars(axis))

    return SixAxisSettings(lateral=element("lateral"), rotational=element("rotational"))


def design_pid(
    scenario: AlignmentScenario, responses: Sequence[Responses], closed_loop: float
) -> SixAxisPid:
    """Return the baseline's gains by SIMC, what is given kept.

    Args:
        scenario: Its PID is what is given.
        responses: From :func:`arm_responses`.
        closed_loop: s, wanted time constant.
    """

    def law(kind: Kind) -> OpenGains:
        given: OpenGains = getattr(scenario.pid, kind)
        gains = designed_gains(
            given,
            of_kind(responses, kind),
            closed_loop=closed_loop,
            period=scenario.cameras.frames.period,
            limit=_LIMITS[kind],
        )
        return replace(given, **vars(gains))

    return SixAxisPid(lateral=law("lateral"), rotational=law("rotational"))


def small_share(scenario: AlignmentScenario, kind: Kind) -> float:
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
