"""The experiment peg-insertion: its public names, traces and figure."""

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.peg_insertion import PegInsertionScenario

(ENTRY,) = select(CATALOGUE.entries, ["peg-insertion"])
PEG_INSERTION = load(ENTRY)


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def reduced() -> tuple[PegInsertionScenario, Outcome]:
    scenario = PEG_INSERTION.resolve(make_scenario(PegInsertionScenario(), settings=ENTRY.reduced))
    return scenario, PEG_INSERTION.run(scenario, 0, quiet)


def test_traces_and_predictions_belong_together(
    reduced: tuple[PegInsertionScenario, Outcome],
) -> None:
    scenario, outcome = reduced
    traces, predicted = outcome.traces, outcome.tables["predicted"]
    assert traces["tip"][0] == pytest.approx(scenario.lateral)
    assert traces["tilt"][0] == pytest.approx(scenario.tilt)
    assert traces["depth"][0] == pytest.approx(-scenario.gap)
    deep = traces["depth"] > 0.0065
    l_of = traces["depth"][deep] - scenario.parts.chamfer_height
    said = np.interp(l_of, predicted["depth"], predicted["axial"])
    np.testing.assert_allclose(np.median(traces["force_x"][deep] - said), 0.0, atol=0.05)


def test_the_figure_shows_forces_states_and_the_path(
    reduced: tuple[PegInsertionScenario, Outcome],
) -> None:
    scenario, outcome = reduced
    (figure,) = PEG_INSERTION.plot(scenario, outcome).values()
    above, below, diagram = figure.axes
    labels = above.get_legend_handles_labels()[1]
    for name in ("simulated, median of 10 ms", "exact statics", "Whitney", "one point"):
        assert name in labels
    (path,) = (line for line in diagram.lines if line.get_label() == "tip and tilt")
    np.testing.assert_allclose(
        [np.asarray(path.get_xdata())[0], np.asarray(path.get_ydata())[0]],
        [1e3 * scenario.lateral, 1e3 * scenario.tilt],
    )
    assert below.get_xlim() == above.get_xlim()
