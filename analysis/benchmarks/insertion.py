"""A sprung peg fed into its hole: Chamfer in Drake, a peer in MuJoCo, and exact statics.

Part, spring, speed and cap are the same for all; ``fullseye``'s peg has its chamfer on the hole
alone, and its carriage in series with its wrist, which is why a stiffness of 521.7 N/m holds for
both directions.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from chamfer.analysis.benchmarks.engine import Source, installed
from chamfer.analysis.insertion.insertion_runs import insert, measure
from chamfer.analysis.insertion.insertion_runs import predict as statics
from chamfer.diagrams.insertion.peg_insertion import (
    FeedSupport,
    PegInsertionScenario,
    resolve_peg_insertion,
)
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.peg_theory.insertion_statics import two_point_onset

# Lateral error, mm, and tilt, degrees: of the reference table, and the grid of the peer's own.
TABLE: Final = ((0.0, 3.0), (0.0, 5.0), (1.0, 5.0), (0.0, 7.0), (0.0, 9.0))
GRID: Final = tuple((x, t) for x in (0.0, 1.0, 2.0, 3.0) for t in (1.0, 2.0, 3.0))
CELLS: Final = {"table": TABLE, "all": (*TABLE, *GRID)}
TARGETS: Final = {"agreement": 100.0, "onset": 0.1, "force": 6.0}  # %, mm and %
SOURCE: Final = Source(
    module="fullseye_peer", requires="pegsim", distribution="fullseye", extra="bench"
)
CHAMFER: Final = "Chamfer, Drake"
PEER: Final = "fullseye, MuJoCo"
_WRIST, _SERVO = 600.0, 4000.0  # N/m, of the peer, in series


class Result(NamedTuple):
    """What an engine makes of a cell."""

    seated: bool
    onset: float | None  # l, m; None: two points never touch
    force: float  # N, the largest 10 ms median along the axis
    seconds: float  # of the process


@dataclass
class Insertions:
    """Results by engine and cell, and what exact statics say."""

    results: dict[str, dict[tuple[float, float], Result]] = field(default_factory=dict)
    predicted: dict[tuple[float, float], Result] = field(default_factory=dict)


def cell(lateral: float, degrees: float) -> PegInsertionScenario:
    """Return a cell as an insertion of Chamfer's: mm and degrees."""
    return resolve_peg_insertion(
        PegInsertionScenario(
            parts=PegAndHole(
                hole_radius=0.0052,
                peg_radius=0.005,
                friction=0.3,
                chamfer_width=0.001,
                peg_chamfer_share=0.0,
                peg_length=0.04,
                hole_length=0.02,
                outer_radius=0.012,
            ),
            support=FeedSupport(
                lateral_stiffness=1 / (1 / _WRIST + 1 / _SERVO),
                angular_stiffness=1.5,
                centre_distance=0.04,
            ),
            lateral=1e-3 * lateral,
            tilt=math.radians(degrees),
            speed=0.012,
            depth=0.015,
            gap=0.002,
        )
    )


def engines() -> dict[str, Callable[[PegInsertionScenario], Result]]:
    """Return the engines that are installed."""
    found: dict[str, Callable[[PegInsertionScenario], Result]] = {CHAMFER: insert_in_drake}
    if installed([SOURCE])[0]:
        from chamfer.analysis.benchmarks.fullseye_peer import insert_in_mujoco

        found[PEER] = insert_in_mujoco
    return found


def measure_cells(found: Insertions, cells: Sequence[tuple[float, float]]) -> None:
    """Run every engine on every cell."""
    for name, run in engines().items():
        results = found.results.setdefault(name, {})
        for one in cells:
            results[one] = run(cell(*one))
    for one in cells:
        found.predicted[one] = predict(cell(*one))


def insert_in_drake(scenario: PegInsertionScenario) -> Result:
    """Run an insertion of Chamfer's."""
    started = time.process_time()
    run = insert(scenario, withdraw=False)
    seconds = time.process_time() - started
    metrics = {name: metric.value for name, metric in measure(scenario, run).items()}
    onset, force = metrics["two_point.onset"], metrics["force.axial"]
    assert onset is not None
    assert force is not None
    return Result(metrics["seated"] == 1.0, None if math.isnan(onset) else onset, force, seconds)


def predict(scenario: PegInsertionScenario) -> Result:
    """Return what exact statics say; the force is infinite where no push slides the peg."""
    started = time.process_time()
    said = {name: metric.value for name, metric in statics(scenario).items()}
    seconds = time.process_time() - started
    onset, force = said["predicted.two_point.onset"], said["predicted.force.axial"]
    enters = abs(scenario.lateral) < scenario.parts.chamfer_limit
    deep = scenario.depth - scenario.parts.chamfer_height
    within = enters and onset is not None and onset < deep
    return Result(
        said["predicted.seated"] == 1.0,
        onset if within else None,
        math.inf if force is None else force,
        seconds,
    )


def sure(found: Insertions, one: tuple[float, float]) -> bool:
    """Whether the statics leave no doubt of a cell: a tenth more or less tilt changes nothing."""
    scenario = cell(*one)
    seated = found.predicted[one].seated
    return all(
        predict(replace(scenario, tilt=share * scenario.tilt)).seated == seated
        for share in (0.9, 1.1)
    )


def agreement(found: Insertions, engine: str) -> float | None:
    """Return in which share of the sure cells an engine does what the statics say, %."""
    results = found.results.get(engine, {})
    certain = [one for one in results if sure(found, one)]
    if not certain:
        return None
    right = [results[one].seated == found.predicted[one].seated for one in certain]
    return 100 * sum(right) / len(right)


def worst_onset(found: Insertions, engine: str) -> float | None:
    """Return by how much onsets differ at most from Whitney's closed form, mm."""
    differences = []
    for one, result in found.results.get(engine, {}).items():
        if result.onset is not None:
            scenario = cell(*one)
            said = two_point_onset(
                scenario.parts, scenario.support, scenario.lateral, scenario.tilt
            )
            differences.append(1e3 * abs(result.onset - float(said)))
    return max(differences, default=None)


def worst_force(found: Insertions, engine: str) -> float | None:
    """Return by how much peaks at 3 to 5 degrees differ at most from exact statics, %."""
    results = found.results.get(engine, {})
    differences = [
        100 * abs(result.force / found.predicted[one].force - 1)
        for one, result in results.items()
        if 3.0 <= one[1] <= 5.0 and found.predicted[one].seated
    ]
    return max(differences, default=None)
