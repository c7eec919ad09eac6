"""What the compensation leaves of the errors, and how soon: the settling theorem's part."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.cell.alignment_runs import true_errors
from chamfer.analysis.design.cell_region import region_of
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario
from chamfer.analysis.design.detection import Sight
from chamfer.analysis.design.link import Link, at_most
from chamfer.diagrams.cell.alignment import SHARES
from chamfer.diagrams.cell.alignment_scenario import KINDS, Kind, true_pose, wrong_pose
from chamfer.diagrams.cell.controller_design import arm_responses, small_share
from chamfer.diagrams.cell.work_cell import ArmName, CellArmSettings, WorkCellScenario
from chamfer.systems.force.tool_friction import tool_friction
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.compensator import AxisParams
from chamfer.systems.servo.sampled_pid import PidGains
from chamfer.systems.servo.settling import SettlingPlant
from chamfer.systems.strategies.insertion_decision import SURE
from chamfer.systems.vision.image_plane_error import AXES

Array = NDArray[np.float64]

ACROSS: Final[Mapping[Kind, tuple[str, str]]] = {
    "lateral": ("y", "z"),
    "rotational": ("pitch", "yaw"),
}
SEEN: Final = tuple(axis for axes in ACROSS.values() for axis in axes)
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
    for kind, axes in ACROSS.items():
        unit = 1 / scenario.cameras.pixel_size if kind == "lateral" else 1.0
        for axis in axes:
            k = AXES.index(axis)
            plants = [one[axis] for one in responses]
            gain = float(np.mean([plant.gain for plant in plants])) / unit
            longest = max(len(plant.undelivered) for plant in plants)
            undelivered = np.mean([_padded(plant, longest) for plant in plants], axis=0)
            held, wound = (
                sum(float(getattr(at_tool[arm], name)[k]) for arm in scenario.arms if shares[arm])
                for name in ("held", "wound")
            )
            middle, reach = start[k], float(getattr(scenario.spread, kind))
            for arm, sign in (("peg", -1.0), ("hole", 1.0)):
                if arm in at_tool:
                    moved, off = _moved(scenario, at_tool, arm)
                    middle, reach = middle + sign * moved[k], reach + off[k]
            found[axis] = Loop(
                SettlingPlant(gain, undelivered),
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
    for kind, axes in ACROSS.items():
        for axis in axes:
            k = AXES.index(axis)
            if scenario.compensated == "none":
                loop = loops(scenario)[axis]
                left = abs(loop.middle) + loop.reach
            elif scenario.controller.kind == "fsm":
                pixel = scenario.cameras.pixel_size if kind == "lateral" else 1.0
                left = pixel * getattr(scenario.compensator, kind).closed.dead_zone
            else:
                left = loops(scenario)[axis].play + _SURE * seen.spread[k]
            found[k] = left + seen.bias[k]
    return found


def metric_axis(scenario: ResolvedDesignScenario, kind: Kind) -> AxisParams:
    """Return one of the state machine's elements in m and rad instead of pixels."""
    axis: AxisParams = getattr(scenario.compensator, kind).closed
    if kind == "rotational":
        return axis
    pixel = scenario.cameras.pixel_size
    return replace(axis, dead_zone=pixel * axis.dead_zone, large_error=pixel * axis.large_error)


def metric_gains(scenario: ResolvedDesignScenario, kind: Kind) -> PidGains:
    """Return one of the PID laws for errors in m and rad instead of pixels."""
    gains: PidGains = getattr(scenario.pid, kind).closed
    pixel = scenario.cameras.pixel_size if kind == "lateral" else 1.0
    more = {
        name: getattr(gains, name) / pixel for name in ("proportional", "integral", "derivative")
    }
    return replace(gains, **more)


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


def _padded(plant: SettlingPlant, length: int) -> Array:
    return np.pad(plant.undelivered, (0, length - len(plant.undelivered)))


def _moved(
    scenario: ResolvedDesignScenario, at_tool: Mapping[ArmName, ArmAtTool], arm: ArmName
) -> tuple[Array, Array]:
    """Return where unknown masses move a tool to, and how unsure that is, m and rad, (6,)."""
    settings: CellArmSettings = getattr(scenario, arm)
    one, spread = at_tool[arm], scenario.spread
    middle = one.payload + (settings.mass_scale - 1) * one.links
    off = spread.payload * one.payload, settings.mass_scale * spread.link_mass * one.links
    return middle, np.abs(off[0]) + np.abs(off[1])
