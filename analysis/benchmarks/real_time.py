"""How much faster than real time the contact loops run, each on one core."""

import gc
import statistics
from collections.abc import Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import Final

from analysis.simulate import simulate
from diagrams.adept_scenarios import (
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
)
from diagrams.hybrid_loop import make_hybrid_diagram
from diagrams.hybrid_scenario import HybridScenario, resolve
from diagrams.planar_scenarios import PlanarSlideScenario
from diagrams.puma_scenarios import PumaRollerMotionScenario

SCENARIOS: Final[Mapping[str, HybridScenario]] = {
    "planar-slide": PlanarSlideScenario(),
    "puma-roller-motion": PumaRollerMotionScenario(),
    "adept-roller-hold": AdeptRollerHoldScenario(),
    "adept-roller-motion": AdeptRollerMotionScenario(),
    "adept-nugget-hold": AdeptNuggetHoldScenario(),
    "adept-nugget-motion": AdeptNuggetMotionScenario(),
}
TARGETS: Final = {
    "planar-slide": 10.0,
    "adept-roller-hold": 3.0,
    "adept-roller-motion": 3.0,
    "adept-nugget-hold": 3.0,
    "adept-nugget-motion": 3.0,
}


@dataclass
class RealTime:
    """Simulated over elapsed seconds, a value per round, by experiment."""

    factors: dict[str, list[float]] = field(default_factory=dict)

    def median(self, name: str) -> float | None:
        """Return the median factor, or None if it was never measured."""
        return statistics.median(self.factors[name]) if self.factors.get(name) else None


def measure(
    found: RealTime, *, rounds: int, scenarios: Mapping[str, HybridScenario] = SCENARIOS
) -> None:
    """Run each loop once a round; a first short run compiles what is compiled at first use."""
    scenarios = {name: resolve(scenario) for name, scenario in scenarios.items()}
    for scenario in scenarios.values():
        _run(scenario, 10 * scenario.plant.period)
    for _ in range(rounds):
        for name, scenario in scenarios.items():
            elapsed = _run(scenario, scenario.duration)
            found.factors.setdefault(name, []).append(scenario.duration / elapsed)


def _run(scenario: HybridScenario, duration: float) -> float:
    diagram = make_hybrid_diagram(scenario)
    gc.collect()
    start = perf_counter()
    simulate(diagram, duration=duration, step=scenario.plant.period)
    return perf_counter() - start
