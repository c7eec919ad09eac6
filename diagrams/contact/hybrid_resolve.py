"""Fills in what a hybrid position/force loop's scenario leaves to be derived, and checks it."""

from typing import TypeVar

from chamfer.diagrams.contact.hybrid_filled import filled
from chamfer.diagrams.contact.hybrid_loop_stability import require_stable
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario

HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


def resolve(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return the scenario with what it leaves open filled in, and checked.

    Raises:
        ParameterError: If blocks refuse their parameters, the arm can't reach the task, or the
            loop would be unstable and ``controller.allow_unstable`` is not set.
    """
    scenario = filled(scenario)
    scenario.make_surface()
    scenario.plant  # noqa: B018 - checks
    require_stable(scenario)
    return scenario
