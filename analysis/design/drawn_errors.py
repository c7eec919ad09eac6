"""The errors of drawn cells as their parts touch: the loops of all axes, all draws at once."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.design.cell_region import region_of
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario
from chamfer.analysis.design.detection import Sight
from chamfer.analysis.design.settling import ACROSS, SEEN, loops, metric_axis, metric_gains
from chamfer.diagrams.cell.alignment_scenario import Kind
from chamfer.systems.servo.compensated_error import (
    CompensatedErrors,
    Law,
    fsm_law,
    no_law,
    pid_law,
)
from chamfer.systems.strategies.insertion_decision import SURE, InsertionRegion
from chamfer.systems.vision.image_plane_error import AXES

Array = NDArray[np.float64]

_KINDS: Final[tuple[Kind, ...]] = tuple(kind for kind, axes in ACROSS.items() for _ in axes)
_AT_A_TIME: Final = 40  # ticks, after which it is asked whether all draws are over


class DrawnErrors(NamedTuple):
    """What becomes of drawn errors, shape (draws,) each."""

    force: Array  # N, of the peg's springs as the arms begin
    time: Array  # s, of the decision since the cameras count; infinite: there is none
    lateral: Array  # m, as the parts touch; NaN where it is not decided
    tilt: Array  # rad, likewise, of the lateral error's sign where they add

    @property
    def decided(self) -> NDArray[np.bool_]:
        """Whether an insertion begins."""
        return np.isfinite(self.time)


def draw_errors(
    scenario: ResolvedDesignScenario, seen: Sight, seed: int, draws: int
) -> DrawnErrors:
    """Return the errors of drawn starts, models and pictures as the parts touch.

    Every axis is a loop of its own: linear arms behind the play of their dry friction, measured
    with the cameras' bias of either sign and their noise. What couples the axes is left out.
    """
    generator = np.random.default_rng([seed, 0])
    of = [loops(scenario)[axis] for axis in SEEN]
    spread = np.array([[getattr(scenario.spread, kind)] for kind in _KINDS])
    shape = (len(of), draws)
    commanded = spread * generator.uniform(-1.0, 1.0, shape)
    others = np.array([[loop.reach] for loop in of]) - spread
    middle = np.array([[loop.middle] for loop in of])
    numbers = [AXES.index(axis) for axis in SEEN]
    bias = seen.bias[numbers][:, np.newaxis] * generator.choice([-1.0, 1.0], shape)
    errors = CompensatedErrors(
        _law(scenario),
        [loop.plant for loop in of],
        middle - commanded + others * generator.uniform(-1.0, 1.0, shape),
        play=np.array([loop.play for loop in of]),
        place=generator.uniform(-1.0, 1.0, shape),
        period=scenario.cameras.frames.period,
        bias=bias,
        spread=seen.spread[numbers],
        generator=generator,
    )
    time, left = _until_touch(scenario, errors)
    if scenario.insert.compensation == "frozen":
        # What friction has wound up comes out.
        wound = np.array([[loop.wound] for loop in of])
        left = left + wound * generator.uniform(-1.0, 1.0, shape)
    y, z, pitch, yaw = left
    initial = np.array(scenario.initial_error)[[AXES.index(axis) for axis in SEEN[:2]]]
    pull = np.array(scenario.impedance.stiffness)[1:, np.newaxis]
    return DrawnErrors(
        force=np.linalg.norm(pull * (initial[:, np.newaxis] + commanded[:2]), axis=0),
        time=time,
        lateral=np.hypot(y, z),
        tilt=np.copysign(np.hypot(pitch, yaw), z * pitch - y * yaw),
    )


def _law(scenario: ResolvedDesignScenario) -> Law:
    if scenario.compensated == "none":
        return no_law
    if scenario.controller.kind == "fsm":
        return fsm_law([metric_axis(scenario, kind) for kind in _KINDS])
    return pid_law([metric_gains(scenario, kind) for kind in _KINDS])


def _until_touch(
    scenario: ResolvedDesignScenario, errors: CompensatedErrors
) -> tuple[Array, Array]:
    """Run the loops until all draws touch, or it is too late to decide.

    Returns:
        Time of the decision, s, shape (draws,), and the true errors at the touch, (4, draws).
    """
    decide, insert, period = scenario.decide, scenario.insert, scenario.cameras.frames.period
    running = insert.compensation == "running"
    feed = scenario.gap / insert.speed
    approach = math.ceil((insert.pause + feed) / period) if running else 0
    waits = {"margin": decide.timeout, "wait": scenario.compensation_time, "at_once": 0.0}
    last = math.floor(waits[decide.kind] / period)
    region = region_of(scenario)
    at = np.full(errors.true.shape[2], math.inf if decide.kind == "margin" else float(last))
    while len(errors.true) <= min(last + approach, float(at.max()) + approach):
        before = max(len(errors.true) - decide.frames + 1, 0)
        errors.advance(min(_AT_A_TIME, last + approach + 1 - len(errors.true)))
        if math.isinf(at.max()):
            new = errors.measured[before : last + 1]
            at = np.minimum(at, before + first_inside(region, new, decide.frames, decide.margin))
    touch = at + approach
    decided = np.isfinite(at)
    rows = np.where(decided, touch, 0).astype(np.int64)
    left = errors.true[rows, :, np.arange(len(rows))].T
    return period * at, np.where(decided, left, np.nan)


def first_inside(region: InsertionRegion, measured: Array, frames: int, margin: float) -> Array:
    """Return the tick at which the chart decides, shape (draws,); infinite: at none.

    Args:
        region: It goes by.
        measured: Errors across and about, m and rad, shape (ticks, 4, draws).
        frames: Over which it takes the mean and the standard deviation.
        margin: Of the region, that is wanted.
    """
    if len(measured) < frames:
        return np.full(measured.shape[2], math.inf)
    sums = [
        np.concatenate([np.zeros((1, *one.shape[1:])), one.cumsum(axis=0)])
        for one in (measured, measured**2)
    ]
    total, squares = (one[frames:] - one[:-frames] for one in sums)
    mean = total / frames
    variance = np.maximum(squares - frames * mean**2, 0.0) / (frames - 1)
    y, z, pitch, yaw = mean.transpose(1, 0, 2)
    lateral = np.hypot(y, z) + SURE * np.sqrt(variance[:, :2].sum(axis=1))
    tilt = np.hypot(pitch, yaw) + SURE * np.sqrt(variance[:, 2:].sum(axis=1))
    margins = region.margins(lateral, tilt)
    inside = margins >= margin
    first = np.argmax(inside, axis=0) + frames - 1.0
    return np.where(inside.any(axis=0), first, math.inf)
