"""The errors of drawn cells as their parts touch: the loop of every axis, all draws at once."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.design.cell_region import region_of
from analysis.design.design_scenario import DesignScenario
from analysis.design.settling import ACROSS, SEEN, courses, law_of, loops, settled
from analysis.design.sight import Sight
from systems.servo.compensated_error import CompensatedError, compensated_error
from systems.skills.insertion_decision import SURE
from systems.vision.image_plane_error import AXES

Array = NDArray[np.float64]

_AXES: Final = tuple((kind, axis) for kind, axes in ACROSS.items() for axis in axes)
_LONGER: Final = 1.0  # s, beyond the time at which all errors rest, for noise to hinder no more


class DrawnErrors(NamedTuple):
    """What becomes of drawn errors, shape (draws,) each."""

    started: NDArray[np.bool_]  # whether the springs' force at the start is within the limit
    decided: NDArray[np.bool_]  # whether the errors became small enough in time to insert
    lateral: Array  # m, at the touch; NaN where it was not decided
    tilt: Array  # rad, likewise, of the lateral error's sign where they add
    time: Array  # s, of the decision, likewise


def draw_errors(scenario: DesignScenario, seen: Sight, seed: int, draws: int) -> DrawnErrors:
    """Return the errors of drawn starts, models and pictures as the parts touch.

    Every axis is a loop of its own: linear arms behind the play of their dry friction, measured
    with the cameras' bias of either sign and their noise. What couples the axes is left out.
    """
    generator = np.random.default_rng([seed, 0])
    period, insert = scenario.cameras.frames.period, scenario.insert
    approach = (insert.pause + scenario.gap / insert.speed) / period
    last = ticks_until(scenario, seen)
    ticks = last + math.ceil(approach) + 1
    courses, force = [], np.zeros(draws)
    for kind, axis in _AXES:
        k, loop = AXES.index(axis), loops(scenario)[axis]
        commanded = getattr(scenario.spread, kind) * generator.uniform(-1.0, 1.0, draws)
        others = loop.reach - getattr(scenario.spread, kind)
        start = loop.middle - commanded + others * generator.uniform(-1.0, 1.0, draws)
        if kind == "lateral":
            off = scenario.initial_error[k] + commanded
            force = np.hypot(force, scenario.impedance.stiffness[k] * off)
        sign = generator.choice([-1.0, 1.0], draws)
        courses.append(
            compensated_error(
                law_of(scenario, axis),
                loop.plant,
                start,
                play=loop.play,
                place=generator.uniform(-1.0, 1.0, draws),
                period=period,
                ticks=ticks,
                bias=sign * seen.bias[k],
                noise=seen.spread[k] * generator.standard_normal((ticks, draws)),
            )
        )
    at = _decision(scenario, courses, last)
    decided = at < last
    frozen = insert.compensation == "frozen"
    rows = np.minimum(at + (0 if frozen else math.ceil(approach)), ticks - 1)
    y, z, pitch, yaw = (course.true[rows, np.arange(draws)] for course in courses)
    if frozen:
        # What friction has wound up comes out.
        of = [loops(scenario)[axis].wound for _, axis in _AXES]
        y, z, pitch, yaw = (
            error + play * generator.uniform(-1.0, 1.0, draws)
            for error, play in zip((y, z, pitch, yaw), of, strict=True)
        )
    lateral, tilt = np.hypot(y, z), np.hypot(pitch, yaw)
    tilt = np.copysign(tilt, -y * yaw + z * pitch)
    return DrawnErrors(
        started=force <= insert.force_limit,
        decided=decided,
        lateral=np.where(decided, lateral, np.nan),
        tilt=np.where(decided, tilt, np.nan),
        time=np.where(decided, at * period, np.nan),
    )


def ticks_until(scenario: DesignScenario, seen: Sight) -> int:
    """Return at how many ticks a decision may be made: none once all errors have come to rest."""
    decide, period = scenario.decide, scenario.cameras.frames.period
    if decide.kind != "margin":
        waited = scenario.compensation_time if decide.kind == "wait" else 0.0
        return math.floor(waited / period) + 1
    left = settled(scenario, seen)
    rest = max(courses(scenario, axis, float(left[AXES.index(axis)])).rest for axis in SEEN)
    return math.floor(min(decide.timeout, rest + _LONGER) / period) + decide.frames


def _decision(
    scenario: DesignScenario, courses: list[CompensatedError], last: int
) -> NDArray[np.int64]:
    """Return the tick of every draw's decision, ``last`` where there is none."""
    decide, count = scenario.decide, scenario.decide.frames
    draws = courses[0].true.shape[1]
    if decide.kind != "margin":
        return np.full(draws, min(last - 1, 0 if decide.kind == "at_once" else last - 1))
    means, variances = [], []
    for course in courses:
        windows = np.lib.stride_tricks.sliding_window_view(course.measured[:last], count, axis=0)
        means.append(windows.mean(axis=-1))
        variances.append(windows.var(axis=-1, ddof=1))
    region = region_of(scenario)
    lateral = np.hypot(means[0], means[1]) + SURE * np.sqrt(variances[0] + variances[1])
    tilt = np.hypot(means[2], means[3]) + SURE * np.sqrt(variances[2] + variances[3])
    inside = region.margins(lateral, tilt) >= decide.margin
    first = np.argmax(inside, axis=0) + count - 1
    return np.where(inside.any(axis=0), first, last)
