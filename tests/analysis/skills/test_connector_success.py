from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.sensorimotor_primitives import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Experiment, Outcome, load, select
from chamfer.analysis.skills.connector_trials import (
    BncConnectorSuccessScenario,
    DConnectorSuccessScenario,
    Rj45ConnectorSuccessScenario,
    SuccessScenario,
)
from chamfer.analysis.skills.randomised_scenario import WorldSpread

BNC_SUCCESS = load(select(CATALOGUE.entries, ["bnc-connector-success"])[0])
D_SUCCESS = load(select(CATALOGUE.entries, ["d-connector-success"])[0])
RJ45_SUCCESS = load(select(CATALOGUE.entries, ["rj45-connector-success"])[0])

EXPERIMENTS: dict[str, Experiment[SuccessScenario]] = {
    "d-connector-success": D_SUCCESS,
    "bnc-connector-success": BNC_SUCCESS,
    "rj45-connector-success": RJ45_SUCCESS,
}
FREE = WorldSpread(obstacles=0.0)
# So short that no insertion comes to its end.
CUT: dict[str, SuccessScenario] = {
    "d-connector-success": DConnectorSuccessScenario(trials=4, duration=0.3, spread=FREE),
    "bnc-connector-success": BncConnectorSuccessScenario(trials=2, duration=0.3, spread=FREE),
    "rj45-connector-success": Rj45ConnectorSuccessScenario(trials=2, duration=0.3, spread=FREE),
}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def contents(outcome: Outcome) -> dict[str, bytes]:
    return {name: np.asarray(values).tobytes() for name, values in outcome.traces.items()}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_published_values_metrics_rows_and_figure(name: str) -> None:
    experiment, scenario = EXPERIMENTS[name], CUT[name]
    outcome = experiment.run(experiment.resolve(scenario), 0, quiet)
    asked = [one for one in PUBLISHED if one.experiment == name]
    checks = {one.published.metric: one for one in check(asked, outcome.metrics)}
    assert set(checks) == {"success_rate", "false_done", "force.peak_share"}
    assert not checks["success_rate"].ok
    for metric, one in checks.items():
        assert outcome.metrics[metric].unit == one.published.unit
    note = outcome.metrics["success_rate"].note
    assert note.startswith(f"0 of {scenario.trials}; failed: reach: still running")
    assert outcome.simulated_seconds == pytest.approx(0.3 * scenario.trials)
    assert all(len(values) == scenario.trials for values in outcome.traces.values())
    figures = experiment.plot(scenario, outcome)
    assert isinstance(figures["success"], Figure)


@pytest.mark.slow
def test_any_number_of_processes_gives_the_same_rows() -> None:
    scenario = CUT["d-connector-success"]
    alone = D_SUCCESS.run(scenario, 5, quiet)
    with parallel(2):
        together = D_SUCCESS.run(scenario, 5, quiet)
    assert contents(together) == contents(alone)
    assert contents(D_SUCCESS.run(scenario, 6, quiet)) != contents(alone)


def test_what_no_run_can_have_is_the_user_s_error() -> None:
    scenario = replace(CUT["d-connector-success"], spread=WorldSpread(obstacle_short=0.01))
    said = rf"^all {scenario.trials} trials failed: spread\.obstacle_short is 0\.01, allowed: less"
    with pytest.raises(UserError, match=said):
        D_SUCCESS.run(scenario, 0, quiet)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_largest_force_stays_near_the_mating_force(name: str) -> None:
    """The whole task in one drawn world; rates are what the campaigns measure."""
    experiment = EXPERIMENTS[name]
    scenario = replace(experiment.scenario(), trials=1)
    outcome = experiment.run(experiment.resolve(scenario), 0, quiet)
    free, share = (outcome.metrics[f"force.{one}_share"].value for one in ("free", "peak"))
    assert free is not None
    assert share is not None
    assert free < 1.5
    assert share < 2.5  # something in the way where a lead-in may be
    assert outcome.metrics["success_rate"].value == 100.0
