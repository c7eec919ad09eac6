"""The experiment peg-insertion: its public names, traces and figure."""

from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.peg_insertion import PegInsertionScenario

(PEG_INSERTION_ENTRY,) = select(CATALOGUE.entries, ["peg-insertion"])
PEG_INSERTION = load(PEG_INSERTION_ENTRY)


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def reduced() -> tuple[PegInsertionScenario, Outcome]:
    scenario = PEG_INSERTION.resolve(
        make_scenario(PegInsertionScenario(), settings=PEG_INSERTION_ENTRY.reduced)
    )
    return scenario, PEG_INSERTION.run(scenario, 0, quiet)


PUBLIC_FIELDS = {
    "parts.peg_radius": 0.0097,
    "parts.hole_radius": 0.0101,
    "parts.friction": 0.3,
    "parts.chamfer_width": 0.003,
    "support.lateral_stiffness": 521.7,
    "support.angular_stiffness": 1.5,
    "support.centre_distance": 0.04,
    "lateral": 0.001,
    "tilt": 0.05,
    "speed": 0.012,
    "force_cap": 30.0,
    "step": 0.002,
}


@pytest.mark.parametrize("path", PUBLIC_FIELDS)
def test_public_fields(path: str) -> None:
    scenario: Any = make_scenario(
        PegInsertionScenario(), settings=[f"{path}={PUBLIC_FIELDS[path]}"]
    )
    for name in path.split("."):
        scenario = getattr(scenario, name)
    assert scenario == PUBLIC_FIELDS[path]


def test_public_metrics(reduced: tuple[PegInsertionScenario, Outcome]) -> None:
    metrics = reduced[1].metrics
    units = {
        "seated": "",
        "depth": "m",
        "force.axial": "N",
        "force.lateral": "N",
        "force.raw_peak": "N",
        "two_point.onset": "m",
        "wedged": "",
        "jammed": "",
        "pull_out.force": "N",
        "predicted.seated": "",
        "predicted.force.axial": "N",
        "predicted.force.lateral": "N",
        "predicted.two_point.onset": "m",
        "predicted.simple.force.axial": "N",
        "predicted.simple.two_point.onset": "m",
    }
    assert {name: metrics[name].unit for name in units} == units


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
