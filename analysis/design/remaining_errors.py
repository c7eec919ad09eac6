"""What the compensation leaves of the errors, and how soon: by theorem, and of randomised cells.

Drawn are the loops of all axes, all draws at once, until the parts touch.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.cell.alignment_runs import true_errors
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario, region_of
from chamfer.analysis.design.detection import Sight
from chamfer.analysis.design.link import Link, at_most
from chamfer.diagrams.cell.alignment import SHARES
from chamfer.diagrams.cell.alignment_scenario import KINDS, Kind, true_pose, wrong_pose
from chamfer.diagrams.cell.controller_design import arm_responses, small_share
from chamfer.diagrams.cell.work_cell import ArmName, CellArmSettings, WorkCellScenario
from chamfer.systems.force.arm_model import tool_friction
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.compensated_error import (
    CompensatedErrors,
    Law,
    fsm_law,
    no_law,
    pid_law,
)
from chamfer.systems.servo.compensator import AxisParams
from chamfer.systems.servo.sampled_pid import PidGains
from chamfer.systems.servo.settling import SettlingPlant
from chamfer.systems.strategies.insertion_decision import SURE, InsertionRegion
from chamfer.systems.vision.cell_error import AXES

Array = NDArray[np.float64]

_AT_A_TIME: Final = 40  # ticks, after which it is asked whether all draws are over
ACROSS: Final[Mapping[Kind, tuple[str, str]]] = {
    "lateral": ("y", "z"),
    "rotational": ("pitch", "yaw"),
}
SEEN: Final = {axis: kind for kind, axes in ACROSS.items() for axis in axes}
GRAVITY: Final = 9.81  # m/s^2
_SURE: Final = 3.0  # standard deviations of a frame that a bound has
_DESIGNED: Final = 0.91  # of the theorem's bound, which designed increments use, rounded


class ArmAtTool(NamedTuple):
    """What an arm's joints are at its tool, along and about the hole's axes in AXES' order."""

    held: Array  # N and N m, shape (6,), up to which dry friction holds
    wound: Array  # likewise, that it takes of a motion
    payload: Array  # m and rad, that the unknown payload moves the tool by
    links: Array  # likewise, of links that are heavier by their own weight


class Loop(NamedTuple):
    """One axis of the alignment, seen by the controller."""

    plant: SettlingPlant  # m or rad per m or rad, without the controller's unit
    play: float  # m or rad of compensation, half of the width in which dry friction holds all
    wound: float  # likewise, by which the arms' springs are wound up once all joints slide
    middle: float  # m or rad, of the true error as the compensation begins
    reach: float  # likewise, to both sides


def arm_at_tool(scenario: ResolvedDesignScenario, arm: ArmName) -> ArmAtTool:
    """Return what dry friction, the most that is drawn, and unknown masses are at an arm's tool.

    The arm is at rest on its springs: deflections are those of the wrench over the stiffness.
    """
    alone = WorkCellScenario(
        peg=scenario.peg,
        hole=scenario.hole,
        impedance=scenario.impedance,
        axis=scenario.axis,
        meeting_point=scenario.mouth,
        gap=scenario.gap,
        step=scenario.step,
    )
    return _arm_at_tool(alone, arm, 1 + scenario.spread.joint_friction)


@lru_cache(maxsize=64)
def _arm_at_tool(scenario: WorkCellScenario, arm: ArmName, more_friction: float) -> ArmAtTool:
    settings: CellArmSettings = getattr(scenario, arm)
    model = settings.known_arm()
    state = model.evaluate(scenario.rest_posture(arm))
    axes = scenario.hole_axes.matrix()
    J = np.kron(np.eye(2), axes.T) @ state.J_V_WT
    friction = tool_friction(J, more_friction * np.array(settings.arm.dry_friction))
    down = axes.T @ [0.0, 0.0, -GRAVITY * settings.payload_error]
    at = axes.T @ state.X_WT.rotation().matrix() @ settings.payload_position
    springs = np.array([*scenario.impedance.rotational_stiffness, *scenario.impedance.stiffness])
    payload = np.concatenate([np.cross(at, down), down]) / springs
    links = np.linalg.pinv(J.T) @ -state.gravity / springs
    return ArmAtTool(*(np.roll(one, 3) for one in (*friction, payload, links)))


@lru_cache(maxsize=32)
def loops(scenario: ResolvedDesignScenario) -> dict[str, Loop]:
    """Return the loop of every axis across, from what is resolved.

    Both arms share the compensation as the diagram does. Friction is a play: a spring of the
    stiffness against what the joints hold, so that at 5 N m/rad the wrist's friction is worth
    some ten milliradians.
    """
    shares = SHARES[scenario.compensated]
    responses = arm_responses(scenario)
    at_tool = {arm: arm_at_tool(scenario, arm) for arm in scenario.arms}
    stiffness = (*scenario.impedance.stiffness, *scenario.impedance.rotational_stiffness)
    start = start_error(scenario)
    found = {}
    for axis, kind in SEEN.items():
        k = AXES.index(axis)
        unit = 1 / scenario.cameras.pixel_size if kind == "lateral" else 1.0
        plants = [one[axis] for one in responses]
        gain = float(np.mean([plant.gain for plant in plants])) / unit
        longest = max(len(plant.undelivered) for plant in plants)
        late = [np.pad(one.undelivered, (0, longest - len(one.undelivered))) for one in plants]
        held, wound = (
            sum(float(getattr(at_tool[arm], name)[k]) for arm in scenario.arms if shares[arm])
            for name in ("held", "wound")
        )
        middle, reach = start[k], float(getattr(scenario.spread, kind))
        for arm, sign in (("peg", -1.0), ("hole", 1.0)):
            if arm in at_tool:
                moved, off = _moved(scenario, at_tool[arm], arm)
                middle, reach = middle + sign * moved[k], reach + off[k]
        found[axis] = Loop(
            SettlingPlant(gain, np.mean(late, axis=0)),
            held / stiffness[k],
            wound / stiffness[k],
            middle,
            reach,
        )
    return found


def start_error(scenario: ResolvedDesignScenario) -> Array:
    """Return the true error, desired minus actual, that commands and bases make, shape (6,).

    Of the middle of the starts, in AXES' order along and about the hole's axes, m and rad.
    """
    peg = true_pose(scenario, "peg", wrong_pose(scenario, scenario.nominal_pose("peg")))
    hole = scenario.nominal_pose("hole")
    if "hole" in scenario.arms:
        hole = true_pose(scenario, "hole", hole)
    found = true_errors(*(pose_vector(one)[np.newaxis] for one in (peg, hole)))
    axes = scenario.hole_axes.matrix()
    way, turn = found.way[0] @ axes, found.turn[0] @ axes
    way[0] = found.gap[0] - scenario.gap
    return np.concatenate([way, turn])


def settled(scenario: ResolvedDesignScenario, seen: Sight) -> Array:
    """Return the bound on the true error that is left of every axis, m and rad, shape (6,).

    At rest the measured error is inside the state machine's dead zone, by the settling theorem,
    and the true one differs by the cameras' bias. A PID has none: it hunts in the play that dry
    friction leaves, and follows the noise. Along the axis and about it nothing is said.
    """
    found = np.full(len(AXES), math.inf)
    for axis, kind in SEEN.items():
        k, loop = AXES.index(axis), loops(scenario)[axis]
        if scenario.compensated == "none":
            left = abs(loop.middle) + loop.reach
        elif scenario.controller.kind == "fsm":
            left = metric_axis(scenario, kind).dead_zone
        else:
            left = loop.play + _SURE * seen.spread[k]
        found[k] = left + seen.bias[k]
    return found


def metric_axis(scenario: ResolvedDesignScenario, kind: Kind) -> AxisParams:
    """Return one of the state machine's elements in m and rad instead of pixels."""
    axis: AxisParams = getattr(scenario.compensator, kind).closed
    pixel = scenario.cameras.pixel_size if kind == "lateral" else 1.0
    return replace(axis, dead_zone=pixel * axis.dead_zone, large_error=pixel * axis.large_error)


def metric_gains(scenario: ResolvedDesignScenario, kind: Kind) -> PidGains:
    """Return one of the PID laws for errors in m and rad instead of pixels."""
    gains: PidGains = getattr(scenario.pid, kind).closed
    pixel = scenario.cameras.pixel_size if kind == "lateral" else 1.0
    names = ("proportional", "integral", "derivative")
    return replace(gains, **{name: getattr(gains, name) / pixel for name in names})


def settling_links(scenario: ResolvedDesignScenario, seen: Sight) -> list[Link]:
    """Return the links of the compensation: that it rests, how near, and how far it has to go."""
    left, region = settled(scenario, seen), region_of(scenario)
    lateral, tilt = (
        math.hypot(*(left[AXES.index(axis)] for axis in axes)) for axes in ACROSS.values()
    )
    what = "dead zones" if scenario.controller.kind == "fsm" else "play of the joints' friction"
    if scenario.compensated == "none":
        what = "starts"
    source, margin = f"{what} and the cameras' bias, both planes", 0.0
    if scenario.decide.kind == "margin":
        unsure = SURE * math.sqrt(2) * seen.spread
        lateral += float(unsure[AXES.index("y")])
        tilt += float(unsure[AXES.index("yaw")])
        source, margin = f"{source}, and noise; region less decide.margin", scenario.decide.margin
    limit = region.tilt_at(lateral) - margin * region.rotation_limit
    links = [
        at_most("settled.lateral", lateral, (1 - margin) * region.lateral_limit, "m", source),
        at_most("settled.tilt", tilt, limit, "rad", source),
    ]
    if scenario.compensated == "none":
        return links
    if scenario.controller.kind == "fsm":
        share = max(small_share(scenario, kind) for kind in KINDS)
        source = "increment over what the settling theorem allows for arms and dead time"
        links.append(at_most("settling", share, 1.0, "", source, by_design=share <= _DESIGNED))
    for kind, axes in ACROSS.items():
        limit = getattr(
            scenario.compensator if scenario.controller.kind == "fsm" else scenario.pid, kind
        ).closed.limit
        of = [loops(scenario)[axis] for axis in axes]
        need = max(abs(loop.middle) + loop.reach + loop.play for loop in of)
        unit = "m" if kind == "lateral" else "rad"
        source = "start, sag of unknown masses, and play; limit of the compensation"
        links.append(at_most(f"range.{kind}", need, limit, unit, source))
    return links


def _moved(scenario: ResolvedDesignScenario, one: ArmAtTool, arm: ArmName) -> tuple[Array, Array]:
    """Return where unknown masses move a tool to, and how unsure that is, m and rad, (6,)."""
    settings: CellArmSettings = getattr(scenario, arm)
    spread = scenario.spread
    middle = one.payload + (settings.mass_scale - 1) * one.links
    off = spread.payload * one.payload, settings.mass_scale * spread.link_mass * one.links
    return middle, np.abs(off[0]) + np.abs(off[1])


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
    spread = np.array([[getattr(scenario.spread, kind)] for kind in SEEN.values()])
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
    initial = np.array(scenario.initial_error)[[AXES.index(axis) for axis in ACROSS["lateral"]]]
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
        return fsm_law([metric_axis(scenario, kind) for kind in SEEN.values()])
    return pid_law([metric_gains(scenario, kind) for kind in SEEN.values()])


def _until_touch(
    scenario: ResolvedDesignScenario, errors: CompensatedErrors
) -> tuple[Array, Array]:
    """Run the loops until all draws touch, or it is too late to decide.

    Returned are the time of the decision, s, (draws,), and true errors at the touch, (4, draws).
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

    The errors are those across and about, m and rad, shape (ticks, 4, draws). The chart goes by
    means and standard deviations over some frames, and wants a margin of the region.
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
