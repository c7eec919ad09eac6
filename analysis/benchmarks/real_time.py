"""How much faster than real time the loops run, each on one core."""

import gc
import statistics
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Final, NamedTuple

from pydrake.systems.framework import Diagram

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell.alignment import make_alignment_diagram
from chamfer.diagrams.cell.alignment import resolve as resolve_alignment
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import CameraSettings, Renderer
from chamfer.diagrams.contact.adept_scenarios import (
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_resolve import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.diagrams.contact.planar_scenarios import PlanarSlideScenario
from chamfer.diagrams.contact.puma_scenarios import PumaRollerMotionScenario
from chamfer.diagrams.skills.connector_insertion import (
    BncConnectorScenario,
    DConnectorScenario,
    make_connector_diagram,
)
from chamfer.diagrams.surface.surface_scenario import ObserverSettings
from chamfer.diagrams.surface.surface_tracking import make_tracking_diagram, resolve_tracking
from chamfer.diagrams.surface.tracking_scenario import TrackingScenario
from chamfer.systems.cameras.vtk_camera import missing_graphics
from chamfer.systems.estimation.surface_observer import Kind


class Loop(NamedTuple):
    """A loop to be timed."""

    make: Callable[[], Diagram]
    duration: float  # s
    period: float  # s, between two rows of the log
    missing: Callable[[], str | None] = lambda: None  # why it can't run on this machine


def _hybrid(scenario: HybridScenario) -> Loop:
    resolved = resolve(scenario)
    make = partial(make_hybrid_diagram, resolved)
    return Loop(make, resolved.duration, resolved.plant.period)


def _tracking(kind: Kind) -> Loop:
    scenario = TrackingScenario(observer=ObserverSettings(kind=kind))
    make = partial(make_tracking_diagram, resolve_tracking(scenario))
    return Loop(make, scenario.duration, scenario.controller.period)


def _alignment(renderer: Renderer) -> Loop:
    scenario = resolve_alignment(AlignmentScenario(cameras=CameraSettings(renderer=renderer)))
    make = partial(make_alignment_diagram, scenario)
    period = scenario.cameras.frames.period
    if renderer == "vtk":
        return Loop(make, scenario.duration, period, missing_graphics)
    return Loop(make, scenario.duration, period)


def _insertion(scenario: DConnectorScenario | BncConnectorScenario, duration: float) -> Loop:
    make = partial(make_connector_diagram, scenario)
    return Loop(make, duration, scenario.accommodation.period)


def loops() -> Mapping[str, Loop]:
    """Return what is timed, by experiment."""
    return {
        "planar-slide": _hybrid(PlanarSlideScenario()),
        "puma-roller-motion": _hybrid(PumaRollerMotionScenario()),
        "adept-roller-hold": _hybrid(AdeptRollerHoldScenario()),
        "adept-roller-motion": _hybrid(AdeptRollerMotionScenario()),
        "adept-nugget-hold": _hybrid(AdeptNuggetHoldScenario()),
        "adept-nugget-motion": _hybrid(AdeptNuggetMotionScenario()),
        "unknown-surface-control": _tracking("thesis"),
        "unknown-surface-control, adaptive": _tracking("adaptive"),
        "alignment": _alignment("software"),
        "alignment, VTK": _alignment("vtk"),
        "d-connector": _insertion(DConnectorScenario(), 20.0),
        "bnc-connector": _insertion(BncConnectorScenario(), 25.0),
        "d-connector, WAM": _insertion(DConnectorScenario(robot="wam"), 20.0),
    }


TARGETS: Final = {
    "planar-slide": 10.0,
    "adept-roller-hold": 3.0,
    "adept-roller-motion": 3.0,
    "adept-nugget-hold": 3.0,
    "adept-nugget-motion": 3.0,
    "unknown-surface-control": 5.0,
    "unknown-surface-control, adaptive": 5.0,
    "alignment": 1.0,
    "alignment, VTK": 0.5,
    "d-connector": 1.0,
    "bnc-connector": 1.0,
}


@dataclass
class RealTime:
    """Simulated over elapsed seconds, a value per round, by experiment."""

    factors: dict[str, list[float]] = field(default_factory=dict)

    def median(self, name: str) -> float | None:
        """Return the median factor, or None if it was never measured."""
        return statistics.median(self.factors[name]) if self.factors.get(name) else None


def measure(found: RealTime, *, rounds: int, timed: Mapping[str, Loop] | None = None) -> None:
    """Run each loop once a round; a first short run compiles what is compiled at first use.

    Loops for which something is missing are left out.
    """
    timed = loops() if timed is None else timed
    timed = {name: loop for name, loop in timed.items() if loop.missing() is None}
    for loop in timed.values():
        _run(loop, 10 * loop.period)
    for _ in range(rounds):
        for name, loop in timed.items():
            elapsed = _run(loop, loop.duration)
            found.factors.setdefault(name, []).append(loop.duration / elapsed)


def _run(loop: Loop, duration: float) -> float:
    diagram = loop.make()
    gc.collect()
    start = perf_counter()
    simulate(diagram, duration=duration, step=loop.period)
    return perf_counter() - start
