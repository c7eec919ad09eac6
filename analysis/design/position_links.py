"""Links of a position-controlled cell: contact loop, first touch, way in, RCC, cycle time.

The admittance yields as its springs do, but not at once. From the touch on, over a distance s at
the feed's speed v, it counts as a spring of ``K + D v / s``.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.design.design_scenario import ResolvedDesignScenario, target_of
from chamfer.analysis.design.feed_path import path_links
from chamfer.analysis.design.insertion_links import (
    Starts,
    edge_forces,
    region_links,
    turn_link,
)
from chamfer.analysis.design.link import Link, at_least, at_most, supposed
from chamfer.analysis.design.position_errors import hanging, unrest_of
from chamfer.analysis.design.remaining_errors import DrawnErrors
from chamfer.diagrams.cell.controller_design import measurement_error
from chamfer.diagrams.contact.hybrid_loop_stability import Stability, stability_of
from chamfer.diagrams.insertion.contact_loop import ContactLoop, contact_loop
from chamfer.diagrams.insertion.insertion import task_params
from chamfer.models.peg.peg_and_hole import SEATED
from chamfer.models.peg.support import Support, stacked, strain
from chamfer.models.peg_theory.fed_insertion import limits
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.search_capture import SpiralCoverage
from chamfer.models.validation import known

Array = NDArray[np.float64]

MODEL_ERROR: Final = 1.8  # what simulated forces may be over those of the statics
_PLACES: Final = 9  # on the way in, closer where it begins
_SURE: Final = 3.0  # standard deviations
_TOUCHING: Final = 3  # points that touch first
_CREEPS: Final = 0.01  # of the feed, the least that a peg goes on with
_MOST_GAIN: Final = 1e3  # that is looked at
_MOST_DELAY: Final = 10  # periods, likewise


@lru_cache(maxsize=64)
def _stability(loop: ContactLoop) -> Stability:
    return stability_of(loop.loops())


def contact_links(scenario: ResolvedDesignScenario) -> list[Link]:
    """Return whether the force loop settles in contact and free, and its margins."""
    if scenario.admittance.kind == "none":
        return []
    found = _stability(contact_loop(scenario))
    decay = -max(found.growth_contact, found.growth or found.growth_contact)
    none, most = "none looked at", _MOST_DELAY * scenario.arm.servo.period
    gain = found.gain_margin or _MOST_GAIN
    delay = most if found.delay_margin is None else found.delay_margin
    source = "slowest decay of the sampled loop of force, in contact and free"
    more = f"factor on 1 / damping at which it grows: {found.least_gain or none}"
    late = f"further delay at which it grows: {found.least_delay or none}"
    return [
        at_least("loop.contact", decay, 0.0, "1/s", source),
        at_least("loop.gain", gain, 1.0, "", more),
        at_least("loop.delay", delay, 0.0, "s", late),
    ]


def touch_force(scenario: ResolvedDesignScenario, *, beside: bool) -> float:
    """Return the largest force of the first touch, N, at the feed's speed v.

    ``v (sqrt(k_c m) + k tau + D)``: the touching points, k_c, stop the tool of mass m. The springs
    in series, k, are compressed until the loop answers after its lag, tau. The damping D adds its
    force. For ``D x'(t) = -k x(t - tau)`` the force is k tau v after tau, and exceeds that by less
    than D v where the loop is stable. Without an admittance the state machine stops the feed,
    after its own period. The touch is next to the hole, or on a chamfer.
    """
    loop, parts, insert = contact_loop(scenario), scenario.parts, scenario.insert
    stiff, axial = _TOUCHING * scenario.contact.stiffness / 2, scenario.compliance.resolved().axial
    angle = parts.hole_chamfer.angle
    lag, damping, already = loop.lag, 0.0, 0.0
    if scenario.admittance.kind == "wrist":
        damping = loop.damping[3]
    else:
        lag += scenario.cameras.frames.period
        slides = math.sin(angle) - parts.friction * math.cos(angle)
        across = scenario.wedging_support.lateral_stiffness
        if not beside and slides > 0:
            ratio = (math.cos(angle) + parts.friction * math.sin(angle)) / slides
            axial = min(axial, across * ratio / math.tan(angle))
        else:
            already = insert.push
    k, impact = 1 / (1 / axial + 1 / stiff), math.sqrt(stiff * scenario.wrist.mass)
    return already + insert.speed * (impact + k * lag + damping)


def repeatability_link(scenario: ResolvedDesignScenario) -> Link:
    """Return the error of the arm itself at the touch, which no search corrects."""
    since = scenario.insert.pause + scenario.gap / scenario.insert.speed
    unsure = _SURE * float(np.hypot(*unrest_of(scenario, since)[:2]))
    down = float(np.hypot(*hanging(scenario, np.zeros(1))[0, 1:3]))
    off = math.sqrt(2) * scenario.repeatability + unsure + down
    source = "arm's repeatability, its sensor's drift, and how far the tip hangs; chamfers' reach"
    return at_most("repeatability", off, scenario.parts.chamfer_limit, "m", source)


def detection_links(scenario: ResolvedDesignScenario) -> list[Link]:
    """Return the error of a hole's position as a camera in the hand measures it."""
    if scenario.cameras.kind != "hand":
        return []
    off = scenario.cameras.pixel_size * measurement_error(scenario, "lateral")
    off += _SURE * scenario.cameras.hand.deviations[0]
    source = "detection of the mouth, and what calibration leaves of the camera; chamfers' reach"
    return [at_most("detection", off, scenario.parts.chamfer_limit, "m", source)]


class WayIn(NamedTuple):
    """The largest values on the way to the depth for each start, shape (n,) each."""

    push: Array  # N, along; infinite: no push slides it
    across: Array  # N
    lag: Array  # s, that it takes longer than the feed
    deflection: Array  # of an RCC, as a share of its limits


def way_in(scenario: ResolvedDesignScenario, starts: Starts) -> WayIn:
    """Return the forces on pegs during the feed, by exact statics and the admittance's damping.

    The feed goes along the peg's own axis: across the hole it moves by the tilt. Along its axis
    the admittance yields too. With b N at rest, a N s/m of damping across, and a deflection of x
    m::

        b + a w = D (v - w) + K x,  x' = v - w
    """
    v, depth, count = scenario.insert.speed, target_of(scenario), len(starts.lateral)
    places = depth * np.linspace(0.0, 1.0, _PLACES + 1) ** 2
    gives = scenario.admittance.kind == "wrist"
    K = scenario.admittance.spring[3]
    D = contact_loop(scenario).damping[3] if gives else 0.0
    own, (push, across, given, share, none) = scenario.compliance.resolved(), np.zeros((5, count))
    for before, tip in zip(places[:-1].tolist(), places[1:].tolist(), strict=True):
        lateral, inner = starts.lateral - tip * starts.tilt, tip - scenario.parts.chamfer_height
        support = yielding(scenario, tip)
        fast = equilibrium(scenario.parts, support, lateral, starts.tilt, inner)
        felt, way = fast.insertion_force, tip - before
        if gives:
            slow = equilibrium(
                scenario.parts, scenario.support_at(tip), lateral, starts.tilt, inner
            )
            b = slow.insertion_force
            with np.errstate(invalid="ignore"):
                # Implicit: what is given way at the end of the step pushes.
                against = D + np.maximum(felt - b, 0.0) / v
                drives = D * v + K * (given - way) - b
                w = (drives + np.sqrt(drives**2 + 4 * against * K * way * v)) / (2 * against)
                w = np.maximum(np.nan_to_num(w), _CREEPS * v)
                felt = np.where(np.isfinite(b), b + (against - D) * w, b)
            given = given + way * (v / w - 1)
        push, across = np.maximum(push, felt), np.fmax(across, np.abs(fast.lateral_force))
        off = strain(own.support, support, lateral - fast.tip, starts.tilt - fast.tilt)
        moved = [none, off[1], none, off[0], none, felt / own.axial]
        share = np.fmax(share, own.deflection(np.stack(moved, axis=-1)))
    return WayIn(push, across, given / v, share)


def yielding(scenario: ResolvedDesignScenario, tip: float) -> Support:
    """Return the support of a peg fed to a depth, m, with the admittance's damping."""
    admittance, device = scenario.admittance, scenario.compliance.resolved().support
    if admittance.kind == "none":
        return scenario.support_at(tip)
    damping = np.array(contact_loop(scenario).damping)
    springs = admittance.spring + damping * scenario.insert.speed / tip
    behind = known("support", replace(admittance, spring=tuple(springs.tolist())).support)
    return scenario.support.over(stacked(device, behind))


def way_links(scenario: ResolvedDesignScenario, found: WayIn) -> list[Link]:
    """Return the push on the way in, the force that the arm senses, and an RCC's deflection."""
    insert, push = scenario.insert, MODEL_ERROR * float(found.push.max())
    felt = math.hypot(push, MODEL_ERROR * float(found.across.max()))
    source = "exact statics of the worst errors at the speed of the feed"
    links = [
        at_most("push", push, insert.push, "N", f"{source}; insert.push"),
        at_most("force", felt, insert.force_limit, "N", f"{source}; insert.force_limit"),
    ]
    if scenario.compliance.kind == "rcc":
        share = float(found.deflection.max())
        links.append(at_most("deflection", share, 1.0, "", f"{source}; limits of the RCC"))
    return links


def short_link(scenario: ResolvedDesignScenario, tilt: float) -> Link:
    """Return how far short the peg stops: springs that the push compresses, and the tilt."""
    target, compliance = target_of(scenario), scenario.compliance.resolved()
    short = scenario.insert.push / compliance.axial + scenario.parts.peg_radius * tilt
    short += (scenario.gap + target) * (1 - math.cos(tilt))
    source = "springs at insert.push, and the radius times the tilt; a tenth of the depth"
    return at_most("depth", short, (1 - SEATED) * target, "m", source)


def after_search(scenario: ResolvedDesignScenario, starts: Starts) -> Starts:
    """Return the starts after a search by contact: those next to the hole at its chamfers."""
    if scenario.search.kind == "none":
        return starts
    edge = (1 - 1e-9) * scenario.parts.chamfer_limit
    return Starts(np.minimum(starts.lateral, edge), starts.tilt)


def search_links(scenario: ResolvedDesignScenario, starts: Starts) -> list[Link]:
    """Return whether a search reaches the possible places of the hole, and does not pass it.

    Tracks of a spiral leave half a pitch between; the arm's uncertainty adds to it.
    """
    search, captures = scenario.search, scenario.parts.chamfer_limit
    if (touch := task_params(scenario).search) is None:
        return []
    far, unsure = float(starts.lateral.max()), repeatability_link(scenario).bound
    reach = touch.reaches + (0.0 if touch.leans else captures)
    source = "largest error at the touch; radius of the search, and the chamfers' reach"
    links = [at_most("search", far, reach, "m", source)]
    if search.kind == "spiral":
        passes = known("search.pitch", search.pitch) / 2 + unsure
        source = "half of the spiral's pitch and the uncertainty of the arm; chamfers' reach"
        links.append(at_most("search.pitch", passes, captures, "m", source))
    return links


def search_time(scenario: ResolvedDesignScenario, lateral: Array) -> Array:
    """Return how long the search may take to holes at an offset, m, s, shape (n,).

    All pegs that press on the face or the chamfers search. A spiral takes ``pi r^2 / (p v)``, and
    up to half of it more where it is held on its way. A tilting peg tilts, stands up, and slides:
    at a third of its speed as it yields.
    """
    search = scenario.search
    if search.kind == "spiral":
        return 1.5 * np.pi * lateral**2 / (known("search.pitch", search.pitch) * search.speed)
    if (touch := task_params(scenario).search) is None:
        return np.zeros_like(lateral)
    return np.full_like(lateral, 3 * search.lean_time + 3 * touch.way / search.speed)


def passed(scenario: ResolvedDesignScenario) -> float:
    """Return the chance that a spiral's turns pass a hole that they reach, by theory."""
    if (search := scenario.search).kind != "spiral":
        return 1.0
    return SpiralCoverage(
        pitch=known("search.pitch", search.pitch),
        radius=known("search.radius", search.radius),
        capture=scenario.parts.chamfer_limit,
        noise=repeatability_link(scenario).bound / _SURE,
    ).between_turns()


def attempts_of(scenario: ResolvedDesignScenario, starts: Starts) -> float:
    """Return how many attempts the farthest hole takes: each further spiral is wider."""
    search, links = scenario.search, search_links(scenario, starts)
    if search.kind != "spiral" or links[0].margin >= 0 or not search.widen:
        return 1.0
    return 1.0 + math.ceil(
        -links[0].margin / (search.widen * known("search.radius", search.radius))
    )


def cycle_link(
    scenario: ResolvedDesignScenario, drawn: DrawnErrors, starts: Starts, found: WayIn
) -> Link:
    """Return the cycle time from the start until the peg is seated, including retries."""
    insert, way = scenario.insert, scenario.gap + target_of(scenario)
    searched = search_time(scenario, starts.lateral)
    once = drawn.time.max() + insert.pause + way / insert.speed + found.lag.max() + searched.max()
    again = once + 2 * scenario.gap / insert.speed + insert.rest
    time = float(once + (attempts_of(scenario, starts) - 1) * again)
    source = "cycle: decision, feed, search, lag of the peg, and retries; duration"
    return at_most("time", time, scenario.duration - scenario.begin, "s", source)


def position_links(scenario: ResolvedDesignScenario, drawn: DrawnErrors) -> tuple[Link, ...]:
    """Return the links of a position-controlled arm, from its posture to the seated peg."""
    touched = Starts.of(drawn)
    starts, searches = after_search(scenario, touched), scenario.search.kind != "none"
    found = way_in(scenario, starts.worst)
    planar, tries = region_links(scenario, starts), attempts_of(scenario, touched)
    beside = bool((touched.lateral > scenario.parts.chamfer_limit).any())
    force = touch_force(scenario, beside=beside)
    first = "v (sqrt(k m) + k lag + D) of the first touch; insert.force_limit"
    until = "attempts until the search reaches the farthest hole; insert.attempts"
    return (
        *supposed([*path_links(scenario), *contact_links(scenario)]),
        repeatability_link(scenario),
        *detection_links(scenario),
        at_most("touch", force, scenario.insert.force_limit, "N", first),
        *search_links(scenario, touched),
        *(link for link in planar if not (searches and link.name == "chamfer")),
        *turn_link(scenario, drawn),
        *way_links(scenario, found),
        short_link(scenario, float(np.abs(starts.tilt).max())),
        cycle_link(scenario, drawn, touched, found),
        *([at_most("attempts", tries, scenario.insert.attempts, "", until)] if searches else []),
    )


def goes_in(scenario: ResolvedDesignScenario, touched: Starts) -> NDArray[np.bool_]:
    """Return which starts reach the mouth, and need less push than available."""
    starts, insert = after_search(scenario, touched), scenario.insert
    found = way_in(scenario, starts)
    meets = ~limits(scenario.parts, scenario.support_at, *starts).misses
    if links := search_links(scenario, touched):
        meets &= touched.lateral <= links[0].allowed
    felt = np.hypot(found.push, found.across)
    kept = (found.push < insert.push) & (felt < insert.force_limit) & (found.deflection <= 1)
    return np.asarray(meets & kept)


def position_warnings(scenario: ResolvedDesignScenario, drawn: DrawnErrors) -> tuple[str, ...]:
    """Return the warnings about a position-controlled arm."""
    starts = after_search(scenario, Starts.of(drawn))
    sits = int(np.sum(edge_forces(scenario, starts) > scenario.insert.push))
    says = (
        f"of {len(starts.lateral)} random rims {sits} may sit on the bore's edge and take more "
        "than insert.push to turn upright, by an estimate that no simulated one has confirmed"
    )
    return (says,) if sits else ()
