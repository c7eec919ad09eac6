"""Many alignments from different starts, with different errors of the controllers' models."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import product
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import bootstrap_interval, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import alignment_metrics, run_alignment
from chamfer.analysis.scenario.experiment import Metric, Progress
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_support import wedging_support
from chamfer.diagrams.cell.in_view import require_in_view
from chamfer.diagrams.cell.start_apart import require_start_apart
from chamfer.diagrams.cell.work_cell import ArmSettings
from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg.support import OpenSupport, Support
from chamfer.models.peg_theory.wedging import (
    box_margin,
    least_margin,
    require_stiff,
    rotation_margin,
    wedges,
)
from chamfer.models.validation import ParameterError, require_not_negative

Array = NDArray[np.float64]

_MOST: Final = 10_000  # trials


@dataclass(frozen=True, kw_only=True)
class Spread:
    """By how much trials differ: each value is uniform within plus and minus its range."""

    lateral: float = 0.01  # m, initial error of the peg's command along Y and Z; assumed
    rotational: float = 0.1  # rad, initial error of the peg's command about Y and Z; assumed
    payload: float = 0.5  # relative, of each arm's payload error; assumed
    link_mass: float = 0.02  # relative, of each arm's links; assumed
    joint_friction: float = 0.5  # relative, of each arm's; assumed

    def __post_init__(self) -> None:
        require_not_negative(self, "lateral", "rotational", "link_mass")
        for name in ("payload", "joint_friction", "link_mass"):
            value = getattr(self, name)
            if not 0 <= value < 1:
                raise ParameterError(name, value, "from 0 to less than 1")


DrawnT = TypeVar("DrawnT", bound=AlignmentScenario)


def drawn(scenario: DrawnT, spread: Spread, seed: int, trial: int) -> DrawnT:
    """Return the scenario with initial and model errors of one of a seed's trials."""
    generator = np.random.default_rng([seed, trial])
    error = generator.uniform(-1.0, 1.0, 6)
    error *= [0.0, spread.lateral, spread.lateral, 0.0, spread.rotational, spread.rotational]
    error += scenario.initial_error

    def arm(settings: ArmT) -> ArmT:
        payload, mass, friction = generator.uniform(-1.0, 1.0, 3).tolist()
        return replace(
            settings,
            payload_error=settings.payload_error * (1 + spread.payload * payload),
            mass_scale=settings.mass_scale * (1 + spread.link_mass * mass),
            joint_friction=tuple(
                one * (1 + spread.joint_friction * friction) for one in settings.arm.dry_friction
            ),
        )

    return replace(
        scenario,
        initial_error=tuple(error.tolist()),
        **{name: arm(getattr(scenario, name)) for name in scenario.arms},
    )


@dataclass(frozen=True, kw_only=True)
class AlignmentTrialsScenario(AlignmentScenario):
    """The alignment with many starts and many model errors (section 5)."""

    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # the middle of the starts
    spread: Spread = field(default_factory=Spread)
    trials: int = 20  # ten in the paper

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.trials <= _MOST:
            raise ParameterError("trials", self.trials, f"1 to {_MOST}")


ArmT = TypeVar("ArmT", bound=ArmSettings)
TrialsT = TypeVar("TrialsT", bound=AlignmentTrialsScenario)


def resolve_trials(scenario: TrialsT) -> TrialsT:
    """Resolve the scenario, once it is sure that every trial has something to see.

    All trials have the controllers that are designed for its middle.

    Raises:
        ParameterError: If a part is out of an image where a compensation could begin.
    """
    scenario = resolve(scenario)
    require_starts(scenario, scenario.spread)
    return scenario


def require_starts(scenario: AlignmentScenario, spread: Spread) -> None:
    """Refuse a spread of which a start has nothing to see, or parts in each other.

    Args:
        scenario: Resolved.
        spread: Of its starts.

    Raises:
        ParameterError: It names ``spread.lateral``.
    """
    far = spread.lateral
    for y, z in product((-far, far), repeat=2):
        error = np.add(scenario.initial_error, (0.0, y, z, 0.0, 0.0, 0.0))
        start = replace(scenario, initial_error=tuple(error.tolist()))
        try:
            require_in_view(start)
            require_start_apart(start)
        except ParameterError as refused:
            raise ParameterError("spread.lateral", far, refused.allowed) from refused


@dataclass(frozen=True, kw_only=True)
class RepeatabilityScenario(AlignmentTrialsScenario):
    """The same, with the support to whose wedging diagram the errors belong."""

    support: OpenSupport = field(default_factory=OpenSupport)
    # for the margins; what is left open: of the arms, where two points may begin to wedge
    UNUSED_OF_PARTS: ClassVar[tuple[str, ...]] = ("bore_depth",)

    def held(self) -> Support:
        """Return the support that the margins are of."""
        return self.support.over(wedging_support(self))


RepeatabilityT = TypeVar("RepeatabilityT", bound=RepeatabilityScenario)


def resolve_repeatability(scenario: RepeatabilityT) -> RepeatabilityT:
    """Fill in the support too.

    Raises:
        ParameterError: As of :func:`resolve_trials`, or of a support that turns over.
    """
    held = scenario.held()
    require_stiff(scenario.parts, held)
    known = OpenSupport(**{one.name: getattr(held, one.name) for one in fields(held)})
    return replace(resolve_trials(scenario), support=known)


def align(scenario: AlignmentTrialsScenario, seed: int, trial: int) -> Row:
    """Run one of a seed's trials; it depends on its arguments alone, but for how long it takes.

    Returns:
        What :data:`chamfer.analysis.cell.alignment_runs.ALIGNMENT` has; ``time`` s, and at these
        times the true ``lateral_errors`` m and ``rotational_errors`` rad, each of shape (n,);
        ``wall_seconds``.
    """
    started = time.perf_counter()
    one = drawn(scenario, scenario.spread, seed, trial)
    traces = run_alignment(one, trial_seed(seed, trial))
    return {
        **alignment_metrics(traces, one),
        "time": traces["time"],
        "lateral_errors": traces["lateral_error"],
        "rotational_errors": traces["rotational_error"],
        "wall_seconds": time.perf_counter() - started,
    }


def align_all(scenario: AlignmentTrialsScenario, seed: int, progress: Progress) -> Trials[int]:
    """Run as many trials as the scenario asks for; a task is a trial's number."""
    return run_each(partial(align, scenario, seed), range(scenario.trials), progress)


def statistics(finished: Trials[Any], name: str, unit: str) -> dict[str, Metric]:
    """Return mean, 95 % interval of the mean, and maximum of a metric that is never negative."""
    of = finished.column(name)
    n = len(of)
    low, high = bootstrap_interval(of)
    note = "one trial has no interval"
    if n > 1:
        note = f"95 % interval of the mean of {n} trials, by bootstrap (BCa)"
    return {
        f"{name}.mean": Metric(value=float(np.mean(of)), unit=unit, note=f"{n} trials"),
        f"{name}.mean_low": Metric(value=low, unit=unit, note=note),
        f"{name}.mean_high": Metric(value=high, unit=unit, note=note),
        f"{name}.max": Metric(value=float(np.max(of)), unit=unit, note=f"{n} trials"),
    }


def margins(finished: Trials[Any], parts: PegHoleGeometry, support: Support) -> dict[str, Metric]:
    """Return what the worst trial leaves to the wedging diagram's box and to its sides.

    As the signs of the two errors in the plane of insertion are not known from their sizes, the
    worse one is taken; of the least over all compliance centres the same sign, which is.
    """
    lateral, rotational = map(finished.column, ("lateral_error", "rotational_error"))
    box = [box_margin(parts, x, angle) for x, angle in zip(lateral, rotational, strict=True)]
    sloped = [
        least_margin(parts, support, x, angle)[0]
        for x, angle in zip(lateral.tolist(), rotational.tolist(), strict=True)
    ]
    signs = np.array([[1.0], [-1.0]])
    here = rotation_margin(parts, support, lateral, signs * rotational)
    wedged = wedges(parts, support, lateral, signs * rotational).any(axis=0)
    at = f"L_g = {1e3 * support.centre_distance:.3g} mm, K_x = {support.lateral_stiffness:.4g} N/m"
    least: Callable[[list[float]], float] = min
    return {
        "box_margin.lateral": Metric(
            value=100 * least([float(one.lateral) for one in box]), unit="%", note="of all trials"
        ),
        "box_margin.rotation": Metric(
            value=100 * least([float(one.rotation) for one in box]), unit="%", note="of all trials"
        ),
        "chamfer_margin": Metric(
            value=100 * (1 - float(np.max(lateral)) / parts.chamfer_limit),
            unit="%",
            note="of the lateral error that the chamfers still guide, of all trials",
        ),
        "parallelogram_margin": Metric(
            value=100 * least(sloped), unit="%", note="exact sides, the least over L_g and trials"
        ),
        "margin": Metric(
            value=100 * float(here.min()), unit="%", note=f"exact sides, at {at}, of all trials"
        ),
        "wedging": Metric(
            value=100 * float(np.mean(wedged)), unit="%", note="trials that may wedge"
        ),
    }
