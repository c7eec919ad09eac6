"""Links from the touch to the depth: reach of the chamfers, wedging, jamming, forces, depth.

Errors are those of the random cells (:mod:`chamfer.analysis.design.remaining_errors`), times the
model's possible error. Each link's bound is that of the worst one. By order statistics it bounds 1
- 3 / n of all with 95 % confidence, for n random ones.
"""

import math
from dataclasses import replace
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.design.design_scenario import ResolvedDesignScenario, target_of
from chamfer.analysis.design.detection import Sight
from chamfer.analysis.design.feed_path import wound_up
from chamfer.analysis.design.link import Link, at_most
from chamfer.analysis.design.remaining_errors import ACROSS, DrawnErrors
from chamfer.models.peg.peg_and_hole import SEATED
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.wedging import sits_on_edge, sliding_bounds, wedging_bounds
from chamfer.systems.strategies.insertion_decision import SURE
from chamfer.systems.vision.cell_error import AXES

Array = NDArray[np.float64]

_LOOKS: Final = 9  # lateral errors at which a region's tilts are known
_DEPTHS: Final = 4  # at which the push that is needed is computed
_WORST: Final = 4  # draws of each kind for which it is


# What the simulated cell may be off by, over the worst of the compiled model's.
MODEL_ERROR: Final = {"lateral": 1.4, "tilt": 1.1, "time": 1.1}


class Starts(NamedTuple):
    """Bounds of the errors at the touch, of the random cells that decide, shape (n,) each."""

    lateral: Array  # m, >= 0
    tilt: Array  # rad, of the same sign if they add

    @classmethod
    def of(cls, drawn: DrawnErrors) -> Self:
        """Return those of random cells, with the possible error of the model."""
        lateral, tilt = drawn.lateral[drawn.decided], drawn.tilt[drawn.decided]
        if drawn.exact:
            return cls(lateral, tilt)
        return cls(MODEL_ERROR["lateral"] * lateral, MODEL_ERROR["tilt"] * tilt)

    @property
    def worst(self) -> "Starts":
        """Those of the largest errors, and of the largest of either sign together."""
        ranks = (self.lateral, np.abs(self.tilt), self.lateral * self.tilt)
        rows = [np.argsort(one)[-_WORST:] for one in (*ranks, -ranks[2])]
        rows_once = np.unique(np.concatenate(rows))
        return Starts(self.lateral[rows_once], self.tilt[rows_once])


def start_link(scenario: ResolvedDesignScenario) -> Link:
    """Return the force of the springs at the start, before commands are on and tared.

    The state machine stops where the arm's springs exceed the limit in any direction.
    """
    spread = (0.0, scenario.spread.lateral, scenario.spread.lateral)
    reach = np.abs(scenario.initial_error[:3]) + spread
    force = float(np.linalg.norm(np.multiply(scenario.impedance.stiffness, reach)))
    source = "the arm's stiffness times the largest initial error; insert.force_limit"
    return at_most("start.force", force, scenario.insert.force_limit, "N", source)


def time_link(scenario: ResolvedDesignScenario, drawn: DrawnErrors) -> list[Link]:
    """Return the time until the errors are small enough to insert, if that decides."""
    if scenario.decide.kind != "margin":
        return []
    source = "slowest of the random cells until decide.margin is kept; decide.timeout"
    started = drawn.force <= scenario.insert.force_limit
    slowest = MODEL_ERROR["time"] * float(drawn.time[started].max(initial=0.0))
    return [at_most("time", slowest, scenario.decide.timeout, "s", source)]


def region_links(scenario: ResolvedDesignScenario, starts: Starts) -> list[Link]:
    """Return the chamfers' reach, wedging and jamming, by the exact limits of the parts."""
    parts, support = scenario.there.parts, scenario.wedging_support
    lateral = float(starts.lateral.max())
    source = "largest error at the touch; width of the chamfers and clearance"
    links = [at_most("chamfer", lateral, parts.chamfer_limit, "m", source)]
    for name, bounds, says in (
        ("wedging", wedging_bounds, "in which two points can't hold the peg"),
        ("jamming", sliding_bounds, "in which some push slides the peg"),
    ):
        at = np.linspace(0.0, lateral, _LOOKS)
        sides = bounds(parts, support, at)
        lower, upper = (np.interp(starts.lateral, at, side) for side in sides)
        allowed = np.where(starts.tilt < 0, -lower, upper)
        row = int(np.argmin((allowed - np.abs(starts.tilt)) / allowed))
        source = f"tilt at the touch; exact region {says}"
        tilt = float(abs(starts.tilt[row]))
        links.append(at_most(name, tilt, float(allowed[row]), "rad", source))
    return links


def turn_link(scenario: ResolvedDesignScenario, drawn: DrawnErrors) -> list[Link]:
    """Return the push that turns square parts about the axis to where they fit.

    They fit where ``r (cos phi + sin phi) <= R``. Beyond, the chamfers push the corners, with
    friction, against the spring about the axis: an estimate.
    """
    parts = scenario.there.parts
    if parts.is_round:
        return []
    room = parts.hole_radius / (parts.peg_radius * math.sqrt(2))
    fits = math.asin(min(room, 1.0)) - math.pi / 4
    beyond = max(MODEL_ERROR["tilt"] * float(drawn.turn[drawn.decided].max()) - fits, 0.0)
    moment = scenario.stiffness[3] / len(scenario.arms) * beyond
    angle = parts.hole_chamfer.angle
    along, across = math.sin(angle), math.cos(angle)
    slides = across - parts.friction * along
    ratio = (along + parts.friction * across) / slides if slides > 0 else math.inf
    push = moment / (math.sqrt(2) * parts.peg_radius) * ratio if beyond else 0.0
    source = "push that turns the worst square peg about the axis by its chamfers; insert.push"
    return [at_most("turn", push, scenario.insert.push, "N", source, by_design=not push)]


def stiffened(
    scenario: ResolvedDesignScenario, support: Support, lateral: float, tilt: float
) -> Support:
    """Return a support with the joints' dry friction represented as stiffness.

    A spring that an error moves pushes with its own force and the friction of the joints: the
    secant, for arms that share the error. So two-point forces are 2 to 4 times those of the
    springs.
    """
    wound = wound_up(scenario)
    springs = (*scenario.impedance.stiffness, *scenario.impedance.rotational_stiffness)
    more = []
    for axes, error in zip(ACROSS.values(), (lateral, tilt), strict=True):
        each = max(wound[k] / springs[k] for k in map(AXES.index, axes))
        more.append(1 + float(each) * len(scenario.arms) / error if error > 0 else 1.0)
    return replace(
        support,
        lateral_stiffness=support.lateral_stiffness * more[0],
        angular_stiffness=support.angular_stiffness * more[1],
    )


def worst_push(scenario: ResolvedDesignScenario, starts: Starts) -> tuple[float, float]:
    """Return the largest forces on the way in, along and across, N, by exact statics.

    Infinite where no push slides the peg.
    """
    parts, worst = scenario.there.parts, starts.worst
    lateral, tilt = float(worst.lateral.max()), float(np.abs(worst.tilt).max())
    axial, across = 0.0, 0.0
    for depth in np.linspace(0.0, target_of(scenario), _DEPTHS + 1)[1:].tolist():
        support = stiffened(scenario, scenario.support_at(depth), lateral, tilt)
        found = equilibrium(
            parts, support, worst.lateral, worst.tilt, depth - parts.chamfer_height
        )
        axial = max(axial, float(found.insertion_force.max()))
        across = max(across, float(np.nan_to_num(np.abs(found.lateral_force)).max()))
    return axial, across


def force_links(scenario: ResolvedDesignScenario, starts: Starts) -> list[Link]:
    """Return the required push, and the force that the arm senses, against their limits."""
    insert, (axial, across) = scenario.insert, worst_push(scenario, starts)
    push = axial + 2 * float(wound_up(scenario)[0])
    source = "exact statics of the worst errors, joints' friction as stiffness and twice along"
    felt = math.hypot(push, across)
    return [
        at_most("push", push, insert.push, "N", f"{source}; insert.push"),
        at_most("force", felt, insert.force_limit, "N", f"{source}; insert.force_limit"),
        edge_link(scenario, starts),
    ]


def edge_link(scenario: ResolvedDesignScenario, starts: Starts) -> Link:
    """Return the push that turns the worst rim upright that may sit on the bore's edge."""
    source = "push that turns a rim upright that may sit on the bore's edge; insert.push"
    edge = float(edge_forces(scenario, starts).max())
    return at_most("edge", edge, scenario.insert.push, "N", source, by_design=not edge)


def edge_forces(scenario: ResolvedDesignScenario, starts: Starts) -> Array:
    """Return the pushes, N, that turn pegs upright whose rim may sit on the bore's edge, or 0.

    The two points on which the rim sits, across the plane of the errors, are a radius from the
    middle. The push turns the support by its lever on the chamfer, less the friction of the
    points.
    """
    parts = scenario.there.parts
    sits = sits_on_edge(parts, starts.lateral, starts.tilt)
    angle = parts.hole_chamfer.angle
    lever = math.sin(angle) - parts.friction * math.cos(angle)
    lever *= parts.peg_radius / (math.cos(angle) + parts.friction * math.sin(angle))
    spring = scenario.support_at(parts.chamfer_height).angular_stiffness
    turns = spring * np.abs(starts.tilt) / lever if lever > 0 else math.inf
    return np.where(sits, turns, 0.0)


def depth_link(scenario: ResolvedDesignScenario, seen: Sight, tilt: float) -> Link:
    """Return how far short the peg may stop, because only cameras measure the gap.

    For parts tilted by an angle, rad, the cameras see the nearer or the farther edge.
    """
    along = AXES.index("x")
    frames = scenario.decide.frames
    short = float(seen.bias[along] + SURE * seen.spread[along] / math.sqrt(frames))
    short += scenario.parts.peg_radius * tilt
    allowed = (1 - SEATED) * target_of(scenario)
    source = "cameras' error along the axis, and the radius times the tilt; a tenth of the depth"
    return at_most("depth", short, allowed, "m", source)
