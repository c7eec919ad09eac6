"""What an update of each observer of the surface normal costs, on one core."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Final

from chamfer.analysis.surface.normal_trials import Contender, contender, cost, slide
from chamfer.diagrams.surface.surface_estimation import EstimationScenario, resolve_estimation
from chamfer.diagrams.surface.surface_scenario import ObserverSettings
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    ConstrainedFilterParams,
    SensingParams,
)
from chamfer.systems.estimation.surface_observer import KINDS

NEWTON: Final = "thesis, by Newton's iteration"
TARGETS: Final[Mapping[str, float]] = {"thesis": 40e-6, "adaptive": 200e-6}  # s
_UPDATES: Final = 5000


@dataclass
class Updates:
    """The least time of an update, s, by observer."""

    seconds: dict[str, float] = field(default_factory=dict)


def measure(found: Updates, *, updates: int = _UPDATES) -> None:
    """Time every kind of observer on the slide of Fig. 5-3."""
    scenario = resolve_estimation(EstimationScenario(duration=15.0))
    on = slide(scenario)
    contenders: dict[str, Contender] = {}
    for kind in KINDS:
        contenders[kind] = contender(scenario, ObserverSettings(kind=kind), on)
    known = {one.name: getattr(scenario.observer, one.name) for one in fields(SensingParams)}
    newton = ConstrainedFilter(ConstrainedFilterParams(**known, solver="newton"))
    contenders[NEWTON] = Contender(filter=newton, predicted=None)
    for name, one in contenders.items():
        found.seconds[name] = cost(one, on, up=scenario.up, updates=updates)
