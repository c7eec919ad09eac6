"""One insertion: what it measures, its figures, and its replay."""

import re
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.report.replay import replay_html
from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.analysis.skills.connector_insertion import figures, replay_insertion, run
from chamfer.analysis.skills.skill_run import AXES
from chamfer.diagrams.skills.connector_scenario import DConnectorScenario, resolve
from chamfer.systems.strategies.d_strategy import DConnectorSkillParams

# From just above the socket, with little to search for.
SHORT = resolve(
    DConnectorScenario(
        height=0.001,
        initial_error=(0.01, 0.0, 0.005, 1e-4, 5e-5, 0.0),
        skill=DConnectorSkillParams(settle_cycles=0.5),
    )
)


def test_a_connector_is_inserted_and_the_path_holds_every_state_with_its_outcome() -> None:
    outcome = run(SHORT, 0, quiet)
    values = {name: metric.value for name, metric in outcome.metrics.items()}
    assert values["success"] == 1.0
    assert values["depth"] == pytest.approx(SHORT.connector.mated_depth, abs=1e-4)
    assert 1.0 < (values["force.peak_share"] or 0.0) < 1.5
    assert values["duration"] == outcome.simulated_seconds
    texts = [text.get_text() for text in figures(SHORT, outcome)["path"].axes[0].texts]
    assert any("inserted, after" in text for text in texts)
    path = outcome.tables["path"]
    assert path["source"][0] == "tare"
    assert path["outcome"][0] == "done"
    assert path["target"][-1] == "done"
    np.testing.assert_array_equal(path["source"][1:], path["target"][:-1])
    np.testing.assert_array_equal(path["entered"][1:], path["time"][:-1])
    assert (np.diff(path["time"]) > 0).all()
    assert path["time"][-1] <= outcome.traces["time"][-1]


def test_a_run_that_fails_says_why() -> None:
    scenario = replace(SHORT, obstacle=0.001, duration=0.5)
    outcome = run(scenario, 3, quiet)
    assert outcome.metrics["success"].value == 0.0
    note = outcome.metrics["success"].note
    assert note.startswith("tare: still running at ")
    texts = [text.get_text() for text in figures(scenario, outcome)["path"].axes[0].texts]
    assert f"D connector: failed: {note}, after 0.50 s" in texts


def test_a_column_that_is_missing_is_named() -> None:
    message = "the traces lack the column 'carriage_ry', which the replay needs"
    columns = [f"{name}_{axis}" for name in ("plug", "carriage") for axis in AXES]
    traces = {"time": np.arange(2.0)} | {name: np.zeros(2) for name in columns}
    del traces["carriage_ry"]
    outcome = Outcome(metrics={}, traces=traces, simulated_seconds=0.1)
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        replay_html(lambda meshcat: replay_insertion(SHORT, outcome, meshcat))
