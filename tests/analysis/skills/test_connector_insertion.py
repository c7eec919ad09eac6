from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.sensorimotor_primitives import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Experiment, Outcome, load, select
from chamfer.analysis.skills.connector_runs import INSERTION
from chamfer.diagrams.skills.connector_insertion import (
    AnyConnectorScenario,
    BncConnectorScenario,
    DConnectorScenario,
)
from chamfer.systems.strategies.bnc_strategy import BncConnectorSkillParams
from chamfer.systems.strategies.d_strategy import DConnectorSkillParams

BNC_CONNECTOR = load(select(CATALOGUE.entries, ["bnc-connector"])[0])
D_CONNECTOR = load(select(CATALOGUE.entries, ["d-connector"])[0])

EXPERIMENTS: dict[str, Experiment[AnyConnectorScenario]] = {
    "d-connector": D_CONNECTOR,
    "bnc-connector": BNC_CONNECTOR,
}
# From just above the socket, with little to search for.
SHORT: dict[str, AnyConnectorScenario] = {
    "d-connector": DConnectorScenario(
        sight=None,
        height=0.001,
        initial_error=(0.01, 0.0, 0.005, 1e-4, 5e-5, 0.0),
        skill=DConnectorSkillParams(settle_cycles=0.5),
    ),
    "bnc-connector": BncConnectorScenario(
        sight=None,
        height=0.001,
        initial_error=(0.0, 0.0, -0.12, 3e-4, 0.0, 0.0),
        skill=BncConnectorSkillParams(),
    ),
}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1
    assert doing


@pytest.fixture(scope="module", params=EXPERIMENTS)
def ran(request: pytest.FixtureRequest) -> tuple[str, Outcome]:
    experiment, scenario = EXPERIMENTS[request.param], SHORT[request.param]
    return request.param, experiment.run(experiment.resolve(scenario), 0, quiet)


def value(outcome: Outcome, name: str) -> float:
    measured = outcome.metrics[name].value
    assert measured is not None
    return measured


def contents(outcome: Outcome) -> dict[str, bytes]:
    tables = {"traces": outcome.traces, **outcome.tables}
    return {
        f"{table}.{name}": np.asarray(values).tobytes()
        for table, columns in tables.items()
        for name, values in columns.items()
    }


@pytest.mark.slow
def test_metrics_and_published_values(ran: tuple[str, Outcome]) -> None:
    name, outcome = ran
    assert {key: metric.unit for key, metric in outcome.metrics.items()} == {
        key: quantity.unit for key, quantity in INSERTION.items()
    }
    asked = [one for one in PUBLISHED if one.experiment == name]
    checks = check(asked, outcome.metrics)
    assert [(one.published.metric, one.ok) for one in checks] == [("success", True)]
    assert outcome.metrics["success"].note == ""
    connector = SHORT[name].connector
    assert value(outcome, "depth") == pytest.approx(connector.mated_depth, abs=1e-4)
    assert 1.0 < value(outcome, "force.peak_share") < 1.5
    assert value(outcome, "duration") == outcome.simulated_seconds


def test_the_path_holds_every_state_with_its_outcome(ran: tuple[str, Outcome]) -> None:
    _, outcome = ran
    path = outcome.tables["path"]
    assert path["source"][0] == "tare"
    assert path["outcome"][0] == "done"
    assert path["target"][-1] == "done"
    np.testing.assert_array_equal(path["source"][1:], path["target"][:-1])
    np.testing.assert_array_equal(path["entered"][1:], path["time"][:-1])
    assert (np.diff(path["time"]) > 0).all()
    assert path["time"][-1] <= outcome.traces["time"][-1]


def test_the_figures(ran: tuple[str, Outcome]) -> None:
    name, outcome = ran
    figures = EXPERIMENTS[name].plot(SHORT[name], outcome)
    assert list(figures) == ["path", "signals"]
    assert all(isinstance(figure, Figure) for figure in figures.values())
    texts = [text.get_text() for text in figures["path"].axes[0].texts]
    assert any("inserted, after" in text for text in texts)


def failing() -> tuple[AnyConnectorScenario, Outcome]:
    scenario = replace(SHORT["d-connector"], obstacle=0.001, duration=0.5)
    return scenario, D_CONNECTOR.run(scenario, 3, quiet)


def test_a_run_that_fails_says_why_and_its_seed_decides_every_byte() -> None:
    scenario, outcome = failing()
    assert value(outcome, "success") == 0.0
    note = outcome.metrics["success"].note
    assert note.endswith("still running after 0.5 s")
    figures = D_CONNECTOR.plot(scenario, outcome)
    texts = [text.get_text() for text in figures["path"].axes[0].texts]
    assert f"D connector: failed: {note}, after 0.50 s" in texts
    assert contents(failing()[1]) == contents(outcome)
    other: Any = D_CONNECTOR.run(scenario, 4, quiet)
    assert contents(other)["traces.wrench_z"] != contents(outcome)["traces.wrench_z"]
