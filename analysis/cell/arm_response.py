"""The measured response of the cell's arms, and the compensator that follows from it.

The settling theorem (:mod:`systems.servo.settling`) asks for a plant's gain and step response. The
plant of the alignment is an arm under impedance control as the cameras see it: from a step of one
axis of its commanded pose to pixels, or rad, with the images' dead time. It is measured without
dry friction, which the theorem admits as a play, and which takes time only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.run.simulate import simulate
from diagrams.cell.alignment_scenario import AlignmentScenario, SixAxisPid, SixAxisSettings
from diagrams.cell.arm_response import make_response_diagram
from models.arms.wam import NUM_JOINTS
from systems.servo.compensator import AxisParams
from systems.servo.sampled_pid import PidGains, tuned_gains
from systems.servo.settling import SettlingPlant, allowed_increment, allowed_large_error
from systems.vision.image_plane_error import AXES

Array = NDArray[np.float64]

LATERAL: Final = ("x", "y", "z")
ROTATIONAL: Final = ("pitch", "yaw")  # a turn about X is not seen

_SETTLED: Final = 1.5  # s, until the arm rests at its nominal pose
_LONG: Final = 3.0  # s, of response
_STEPS: Final = {"lateral": 1e-3, "rotational": 1e-2}  # m and rad
# What detection may be off, pixels and rad: five standard deviations of it.
MEASUREMENT_ERROR: Final = {"lateral": 0.1, "rotational": 5e-4}


def dead_samples(scenario: AlignmentScenario) -> int:
    """Return how many periods old an image is when the compensator acts on it."""
    return scenario.cameras.frames.latency + 1


def arm_response(scenario: AlignmentScenario, axis: str) -> SettlingPlant:
    """Return gain (pixels per m, or 1) and response, without friction, of the peg's arm.

    Args:
        scenario: Resolved.
        axis: One of :data:`LATERAL` and :data:`ROTATIONAL`.
    """
    peg = replace(scenario.peg, joint_friction=(0.0,) * NUM_JOINTS)
    period = scenario.cameras.frames.period
    begin = round(_SETTLED / period) * period
    amplitude = _STEPS["lateral" if axis in LATERAL else "rotational"]
    run = simulate(
        make_response_diagram(
            replace(scenario, peg=peg), "peg", axis, amplitude=amplitude, begin=begin
        ),
        duration=begin + _LONG,
        step=period,
    )
    pose = run.outputs["true_pose"][round(begin / period) :]
    turned = Rotation.from_quat(pose[:, :4], scalar_first=True)
    R_WH = scenario.hole_axes.matrix()
    turn = (turned * turned[0].inv()).as_rotvec()
    moved = np.column_stack([(pose[:, 4:] - pose[0, 4:]) @ R_WH, turn @ R_WH])[:, AXES.index(axis)]
    rest = float(moved[-1])
    scale = 1 / scenario.cameras.pixel_size if axis in LATERAL else 1.0
    undelivered = 1 - moved[1:] / rest
    dead = np.ones(dead_samples(scenario))
    return SettlingPlant(scale * rest / amplitude, np.concatenate([dead, undelivered]))


@dataclass(frozen=True, kw_only=True)
class Increments:
    """The small increments, from which everything else follows."""

    lateral: float  # m
    rotational: float  # rad


def design(
    plants: Sequence[SettlingPlant],
    small_increment: float,
    *,
    measurement_error: float,
    limit: float,
) -> AxisParams:
    """Return the smallest dead zone that settles with a small increment on every plant.

    Args:
        plants: Responses, all of which one set of parameters has to serve.
        small_increment: Of the compensation, its unit.
        measurement_error: nu, in the output's unit.
        limit: Of the compensation.
    """
    divider = AxisParams.divider
    increment = divider * small_increment
    # allowed_increment() is linear in what the dead zone has beyond the measurement error.
    unit = [
        allowed_increment(plant, dead_zone=1.0, measurement_error=0.0, divider=divider)
        for plant in plants
    ]
    dead_zone = measurement_error + increment / min(unit)
    large = max(
        allowed_large_error(
            plant,
            dead_zone=dead_zone,
            measurement_error=measurement_error,
            increment=increment,
            divider=divider,
        )
        for plant in plants
    )
    return AxisParams(
        dead_zone=dead_zone, large_error=large, increment=increment, divider=divider, limit=limit
    )


Responses = Mapping[str, SettlingPlant]  # by axis


def arm_responses(scenario: AlignmentScenario) -> Responses:
    """Return the response along every axis that the cameras see."""
    return {axis: arm_response(scenario, axis) for axis in (*LATERAL, *ROTATIONAL)}


def design_compensator(
    scenario: AlignmentScenario, responses: Responses, small: Increments
) -> SixAxisSettings:
    """Return the state machine's elements; the limits are the scenario's."""
    given = scenario.compensator
    return SixAxisSettings(
        lateral=design(
            [responses[axis] for axis in LATERAL],
            small.lateral,
            measurement_error=MEASUREMENT_ERROR["lateral"],
            limit=given.lateral.limit,
        ),
        rotational=design(
            [responses[axis] for axis in ROTATIONAL],
            small.rotational,
            measurement_error=MEASUREMENT_ERROR["rotational"],
            limit=given.rotational.limit,
        ),
    )


def design_pid(
    scenario: AlignmentScenario, responses: Responses, closed_loop: float
) -> SixAxisPid:
    """Return the baseline's gains by SIMC, of the axes that share them the most careful ones.

    Args:
        scenario: Its limits are kept.
        responses: From :func:`arm_responses`.
        closed_loop: s, wanted time constant.
    """
    period = scenario.cameras.frames.period

    def gains(axes: Sequence[str], limit: float) -> PidGains:
        tuned = [
            tuned_gains(responses[axis], closed_loop=closed_loop, period=period, limit=limit)
            for axis in axes
        ]
        return PidGains(
            proportional=min(one.proportional for one in tuned),
            integral=min(one.integral for one in tuned),
            limit=limit,
        )

    given = scenario.pid
    return SixAxisPid(
        lateral=gains(LATERAL, given.lateral.limit),
        rotational=gains(ROTATIONAL, given.rotational.limit),
    )
