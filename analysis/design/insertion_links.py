"""What the errors at the touch make of the insertion: reach, wedging, jamming, forces, depth."""

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.design.cell_region import region_of, target_of
from analysis.design.design_scenario import DesignScenario
from analysis.design.link import Link, at_most
from analysis.design.settling import ACROSS, arm_at_tool, courses, loops
from analysis.design.sight import Sight
from models.planar_limits import sits_on_edge
from models.planar_statics import equilibrium
from models.support import Support
from models.wedging import sliding_bounds, wedging_bounds
from systems.contact.part_contact import SEATED
from systems.skills.insertion_decision import SURE
from systems.vision.image_plane_error import AXES

Array = NDArray[np.float64]

_DEPTHS: Final = 9  # at which the push that is needed is computed
_TILTS: Final = 41  # at which the rim may sit on the bore's edge


class ErrorsAtTouch(NamedTuple):
    """Bounds on the errors as the parts touch, both planes together, >= 0."""

    lateral: float  # m
    tilt: float  # rad


class Loads(NamedTuple):
    """What the arm needs and feels on the way in, at the worst of the errors, N."""

    axial: float  # against the insertion, by the contacts; infinite: no push slides the peg
    lateral: float  # across


def combined(errors: Array) -> ErrorsAtTouch:
    """Return bounds on lateral error and tilt from those of the axes, shape (6,)."""
    y, z, pitch, yaw = (float(errors[AXES.index(axis)]) for axis in ("y", "z", "pitch", "yaw"))
    return ErrorsAtTouch(math.hypot(y, z), math.hypot(pitch, yaw))


def errors_at_touch(scenario: DesignScenario, left: Array) -> ErrorsAtTouch:
    """Return the bound on the errors as the parts touch.

    The largest of every axis over all starts, from the time on that the approach takes after its
    error is small enough to decide, and no less than what is left at rest. A compensation that
    is frozen leaves what friction has wound up in the arms to come out.

    Args:
        scenario: Resolved.
        left: From :func:`analysis.design.settling.settled`.
    """
    decide, insert, period = scenario.decide, scenario.insert, scenario.cameras.frames.period
    region = region_of(scenario)
    decided = {
        "lateral": (1 - decide.margin) * region.lateral_limit,
        "rotational": region.tilt_at(0.0) - decide.margin * region.rotation_limit,
    }
    running = insert.compensation == "running"
    approach = math.floor((insert.pause + scenario.gap / insert.speed) / period) if running else 0
    found = {}
    for kind, axes in ACROSS.items():
        for axis in axes:
            error = courses(scenario, axis, float(left[AXES.index(axis)])).error
            begin = np.zeros(error.shape[1], dtype=np.int64)
            if decide.kind == "wait":
                begin[:] = math.floor(scenario.compensation_time / period)
            elif decide.kind == "margin":
                inside = error <= decided[kind]
                begin = np.where(inside.any(axis=0), np.argmax(inside, axis=0), len(error) - 1)
            touch = np.minimum(begin + approach, len(error) - 1)
            later = np.maximum.accumulate(error[::-1], axis=0)[::-1]
            worst = float(later[touch, np.arange(error.shape[1])].max())
            worst = max(worst, float(left[AXES.index(axis)]))
            found[axis] = worst if running else worst + loops(scenario)[axis].wound
    return combined(_per_axis(found))


def _per_axis(values: dict[str, float]) -> Array:
    found = np.full(len(AXES), math.inf)
    for name, value in values.items():
        found[AXES.index(name)] = value
    return found


def decision_links(scenario: DesignScenario, seen: Sight, left: Array) -> list[Link]:
    """Return whether the errors that are left are small enough to decide for an insertion."""
    if scenario.decide.kind != "margin":
        return []
    rest = combined(left + SURE * seen.spread)
    region, margin = region_of(scenario), scenario.decide.margin
    allowed_tilt = region.tilt_at(rest.lateral) - margin * region.rotation_limit
    source = "errors at rest, with two standard deviations; region less decide.margin"
    return [
        at_most(
            "decision.lateral", rest.lateral, (1 - margin) * region.lateral_limit, "m", source
        ),
        at_most("decision.tilt", rest.tilt, allowed_tilt, "rad", source),
    ]


def start_link(scenario: DesignScenario) -> Link:
    """Return what the springs pull with as the arms begin: commands are off, and not yet tared.

    The chart stops where the arm's springs say more than the limit in any direction.
    """
    spread = (0.0, scenario.spread.lateral, scenario.spread.lateral)
    reach = np.abs(scenario.initial_error[:3]) + spread
    force = math.hypot(
        *(k * one for k, one in zip(scenario.impedance.stiffness, reach, strict=True))
    )
    source = "the arm's stiffness times the largest initial error; insert.force_limit"
    return at_most("start.force", force, scenario.insert.force_limit, "N", source)


def region_links(scenario: DesignScenario, touch: ErrorsAtTouch) -> list[Link]:
    """Return chamfers' reach, wedging, and jamming, by the exact limits of the parts there are."""
    parts, support = scenario.there.parts, scenario.wedging_support
    lateral = np.array([0.0, touch.lateral, -touch.lateral])
    wedge = np.min(np.abs(wedging_bounds(parts, support, lateral)))
    slide = np.min(np.abs(sliding_bounds(parts, support, lateral)))
    return [
        at_most(
            "chamfer",
            touch.lateral,
            parts.chamfer_limit,
            "m",
            "error at the touch; width of the chamfers and clearance",
        ),
        at_most(
            "wedging",
            touch.tilt,
            float(wedge),
            "rad",
            "tilt at the touch; exact region in which two points can't hold the peg",
        ),
        at_most(
            "jamming",
            touch.tilt,
            float(slide),
            "rad",
            "tilt at the touch; exact region in which some push slides the peg",
        ),
    ]


def stiffened(scenario: DesignScenario, support: Support, touch: ErrorsAtTouch) -> Support:
    """Return a support with the joints' dry friction as if it were stiffness.

    A spring that is moved by an error pushes with its own force and what the joints hold: the
    secant, for arms that share the error. It is why two-point forces are 2 to 4 times those of the
    springs.
    """
    friction = np.max([arm_at_tool(scenario, arm).wound for arm in scenario.arms], axis=0)
    arms, more = len(scenario.arms), []
    for kind, error in zip(ACROSS, touch, strict=True):
        axes = [AXES.index(axis) for axis in ACROSS[kind]]
        springs = (*scenario.impedance.stiffness, *scenario.impedance.rotational_stiffness)
        each = max(friction[k] / springs[k] for k in axes)
        more.append(1 + each * arms / error if error > 0 else 1.0)
    return replace(
        support,
        lateral_stiffness=support.lateral_stiffness * more[0],
        angular_stiffness=support.angular_stiffness * more[1],
    )


def worst_loads(scenario: DesignScenario, touch: ErrorsAtTouch) -> Loads:
    """Return the largest forces on the way in, by exact statics at the bounds of the errors."""
    target = target_of(scenario)
    parts = scenario.there.parts
    lateral = np.array([touch.lateral, touch.lateral, 0.0])
    tilt = np.array([touch.tilt, -touch.tilt, touch.tilt])
    axial, across = 0.0, 0.0
    for depth in np.linspace(0.0, target, _DEPTHS)[1:].tolist():
        support = stiffened(scenario, scenario.support_at(depth), touch)
        found = equilibrium(parts, support, lateral, tilt, depth - parts.chamfer_height)
        axial = max(axial, float(found.insertion_force.max()))
        across = max(across, float(np.nan_to_num(np.abs(found.lateral_force)).max()))
    return Loads(axial, across)


def force_links(scenario: DesignScenario, touch: ErrorsAtTouch) -> list[Link]:
    """Return the push that is needed, and what the arm feels, against their limits."""
    insert, loads = scenario.insert, worst_loads(scenario, touch)
    push = loads.axial + 2 * float(arm_at_tool(scenario, "peg").wound[0])
    felt = math.hypot(push, loads.lateral)
    source = "exact statics at the errors' bounds, joints' friction as stiffness and twice along"
    return [
        at_most("push", push, insert.push, "N", f"{source}; insert.push"),
        at_most("force", felt, insert.force_limit, "N", f"{source}; insert.force_limit"),
        at_most(
            "edge",
            edge_force(scenario, touch),
            insert.push,
            "N",
            "push that turns a rim upright that may sit on the bore's edge; insert.push",
        ),
    ]


def edge_force(scenario: DesignScenario, touch: ErrorsAtTouch) -> float:
    """Return the push, N, that turns a peg upright whose rim may sit on the bore's edge, or 0.

    The two points on which it sits, across the plane of the errors, are a radius from the middle:
    the push turns the support by its lever on the chamfer, less what friction takes of it.
    """
    parts = scenario.there.parts
    tilts = np.linspace(0.0, touch.tilt, _TILTS)
    sits = tilts[sits_on_edge(parts, touch.lateral, -tilts)]
    if not len(sits):
        return 0.0
    angle = parts.hole_chamfer.angle
    lever = math.sin(angle) - parts.friction * math.cos(angle)
    if not lever > 0:
        return math.inf
    lever *= parts.peg_radius / (math.cos(angle) + parts.friction * math.sin(angle))
    support = stiffened(scenario, scenario.support_at(parts.chamfer_height), touch)
    return float(support.angular_stiffness * sits[-1] / lever)


def depth_link(scenario: DesignScenario, seen: Sight) -> Link:
    """Return how far short the peg may stop because the gap is known by the cameras alone."""
    along = AXES.index("x")
    frames = max(scenario.decide.frames, 1)
    short = float(seen.bias[along] + SURE * seen.spread[along] / math.sqrt(frames))
    allowed = (1 - SEATED) * target_of(scenario)
    source = "cameras' error along the axis; a tenth of the depth"
    return at_most("depth", short, allowed, "m", source)
