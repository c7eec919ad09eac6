import re

import numpy as np
import pytest

from chamfer.analysis.report.replay import replay_html
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.analysis.skills.connector_replay import replay_insertion
from chamfer.analysis.skills.skill_run import AXES
from chamfer.diagrams.skills.connector_insertion import DConnectorScenario

D = DConnectorScenario()
TRACES = {"time": np.array([0.0, 0.1])} | {
    f"{name}_{axis}": 0.001 * np.arange(2) for name in ("plug", "carriage") for axis in AXES
}


def outcome(**without: None) -> Outcome:
    traces = {name: values for name, values in TRACES.items() if name not in without}
    return Outcome(metrics={}, traces=traces, simulated_seconds=0.1)


@pytest.mark.slow
def test_a_run_becomes_a_page_always_the_same() -> None:
    first, second = (
        replay_html(lambda meshcat: replay_insertion(D, outcome(), meshcat)) for _ in range(2)
    )
    assert first == second
    assert "<script" in first


def test_a_column_that_is_missing_is_named() -> None:
    message = "the traces lack the column 'carriage_ry', which the replay needs"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        replay_html(lambda meshcat: replay_insertion(D, outcome(carriage_ry=None), meshcat))
