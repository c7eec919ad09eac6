"""Errors after the compensation, its time, and the stability of the arms' loops.

The compiled model of arms, cameras, compensator and decision
(:mod:`chamfer.diagrams.insertion.compiled_alignment`) runs each random cell until the parts touch.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.cell.alignment_runs import draw_errors, true_errors
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario
from chamfer.analysis.design.detection import Sight
from chamfer.analysis.design.link import Link, at_least, at_most
from chamfer.diagrams.cell.alignment_scenario import (
    KINDS,
    Kind,
    SixAxisPid,
    SixAxisSettings,
    true_pose,
    wrong_pose,
)
from chamfer.diagrams.cell.controller_design import small_share
from chamfer.diagrams.cell.work_cell import CellArmSettings
from chamfer.diagrams.insertion.compiled_alignment import Draws, growth, run_alignments
from chamfer.diagrams.insertion.insertion import region_of, task_params
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.cell_error import AXES

Array = NDArray[np.float64]

ACROSS: Final[Mapping[Kind, tuple[str, str]]] = {
    "lateral": ("y", "z"),
    "rotational": ("pitch", "yaw"),
}
_UNITS: Final[Mapping[Kind, str]] = {"lateral": "m", "rotational": "rad"}
HELD_OUT: Final = 10_000  # trials of a seed, before those that are drawn for a prediction
_DESIGNED: Final = 0.91  # of the theorem's bound, which designed increments use, rounded


class DrawnErrors(NamedTuple):
    """The results of random cells, shape (draws,) each except for the pairs."""

    force: Array  # N, of the peg's springs as the arms begin
    push: Array  # N, most that they take along the feed up to the mouth
    time: Array  # s, of the decision since the cameras count; infinite: there is none
    lateral: Array  # m, as the parts touch; NaN where it is not decided
    tilt: Array  # rad, likewise, of the lateral error's sign where they add
    turn: Array  # rad, likewise, about the axis, which no camera sees
    sure: Array  # m and rad, errors by which it is decided, the least where it isn't; (draws, 2)
    reach: Array  # m and rad, largest compensation, shape (draws, 2)
    saturated: Array  # s, longest that a joint is at its torque limit
    growth: float = 0.0  # of the worst arm's sampled impedance loop, a period; 0: it has none
    delayed: float = 0.0  # likewise, with a torque that is a period late
    exact: bool = False  # whether no model of arms had to be run, which may be wrong

    @property
    def decided(self) -> NDArray[np.bool_]:
        """Whether an insertion begins."""
        return np.isfinite(self.time)


def drawn_cells(
    scenario: ResolvedDesignScenario, seen: Sight, seed: int, draws: int
) -> DrawnErrors:
    """Return the results of random starts, models and pictures until the parts touch.

    They follow the same law as the simulated trials, with other draws of the seed. The cameras'
    bias has either sign, their noise is that of every frame.
    """
    arms, spread = scenario.arms, scenario.spread
    trials = [
        draw_errors(scenario.initial_error, spread, len(arms), seed, HELD_OUT + k)
        for k in range(draws)
    ]
    wrong = np.array([one.arms for one in trials])
    settings: list[CellArmSettings] = [getattr(scenario, arm) for arm in arms]
    signs = np.random.default_rng([seed, 0]).choice([-1.0, 1.0], (draws, len(AXES)))
    drawn = Draws(
        commanded=np.array([one.error for one in trials]),
        payload=np.array([one.payload_error for one in settings]) * (1 + wrong[:, :, 0]),
        link_mass=np.array([one.mass_scale for one in settings]) * (1 + wrong[:, :, 1]),
        friction=1 + wrong[:, :, 2],
        bias=seen.bias * signs,
    )
    still = replace(scenario, initial_error=(0.0,) * len(AXES))
    found = run_alignments(
        scenario, drawn, start=start_error(still), spread=seen.spread, seed=seed
    )
    decided = np.isfinite(found.decided)
    lateral, tilt, turn = (np.where(decided, one, np.nan) for one in in_one_plane(found.touch))
    return DrawnErrors(
        force=found.force,
        push=found.push,
        time=found.decided,
        lateral=lateral,
        tilt=tilt,
        turn=turn,
        sure=found.sure,
        reach=found.reach,
        saturated=found.saturated,
        growth=growth(scenario, drawn),
        delayed=growth(scenario, drawn, late=True),
    )


def in_one_plane(error: Array) -> tuple[Array, Array, Array]:
    """Return lateral error, m, tilt, of its sign where they add, and turn, rad, of (n, 6)."""
    _, y, z, roll, pitch, yaw = error.T
    tilt = np.copysign(np.hypot(pitch, yaw), z * pitch - y * yaw)
    return np.hypot(y, z), tilt, np.abs(roll)


def start_error(scenario: ResolvedDesignScenario) -> Array:
    """Return the true error, desired minus actual, from commands and bases, shape (6,).

    It is that of the middle of the starts, in AXES' order along and about the hole's axes, m and
    rad.
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


def loop_links(scenario: ResolvedDesignScenario, drawn: DrawnErrors) -> list[Link]:
    """Return whether the sampled impedance loops settle, and how long torques are limited.

    Dry friction stabilises a growing loop until a disturbance is large enough, so a calm run
    proves nothing.
    """
    decay = -math.log(drawn.growth) / scenario.impedance.period if drawn.growth > 0 else math.inf
    source = "slowest decay of the sampled impedance loops, random arms, no dry friction"
    longest = float(drawn.saturated.max())
    says = "longest that a joint is at its torque limit in random cells; the chart's limit"
    return [
        at_least("loop", decay, 0.0, "1/s", source),
        at_most("torque.saturated", longest, task_params(scenario).most_saturated, "s", says),
    ]


def settling_links(scenario: ResolvedDesignScenario, drawn: DrawnErrors) -> list[Link]:
    """Return how small the compensation makes errors, whether by design, and its range."""
    region, margin = region_of(scenario), 0.0
    source = "largest error of the random cells, with the confidence of the decision"
    if by_margin := scenario.decide.kind == "margin":
        source, margin = f"{source}; region less decide.margin", scenario.decide.margin
    controller: SixAxisSettings | SixAxisPid = scenario.pid
    if scenario.controller.kind == "fsm":
        controller = scenario.compensator
    limits = np.array([getattr(controller, kind).closed.limit for kind in ACROSS])
    # Where the compensation has come to its limit, or the force to its own, that is what stops it.
    short = drawn.reach >= limits
    others = ~short.any(axis=1) & (drawn.force <= scenario.insert.force_limit)
    sure = drawn.sure[others] if others.any() else drawn.sure
    allowed = region.tilts_at(sure[:, 0]) - margin * region.rotation_limit
    row = int(np.argmin(allowed - sure[:, 1]))
    # Whoever waits for a margin decides as soon as there is one.
    kept = by_margin and bool(np.isfinite(drawn.time[others]).all())
    lateral, most = float(sure[:, 0].max()), (1 - margin) * region.lateral_limit
    tilt = float(sure[row, 1])
    links = [
        at_most("settled.lateral", lateral, most, "m", source, by_design=kept),
        at_most("settled.tilt", tilt, float(allowed[row]), "rad", source, by_design=kept),
    ]
    if scenario.compensated == "none":
        return links
    if scenario.controller.kind == "fsm":
        share = max(small_share(scenario, kind) for kind in KINDS)
        source = "increment over what the settling theorem allows for arms and dead time"
        links.append(at_most("settling", share, 1.0, "", source, by_design=share <= _DESIGNED))
    source = (
        "largest compensation of the random cells, with the error left at the limit; its limit"
    )
    needs = (drawn.reach + np.where(short, drawn.sure, 0.0)).max(axis=0)
    for need, limit, (kind, unit) in zip(needs, limits, _UNITS.items(), strict=True):
        links.append(at_most(f"range.{kind}", float(need), float(limit), unit, source))
    return links
