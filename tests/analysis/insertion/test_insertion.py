"""The experiment: what it measures is what it promises, and its pictures are of its moments."""

import numpy as np
import pytest

from chamfer.analysis.cell.alignment import picture
from chamfer.analysis.insertion.cell_runs import CellInsertion
from chamfer.analysis.insertion.insertion import run
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve


@pytest.fixture(scope="module")
def outcome(quick: InsertionScenario, done: CellInsertion) -> Outcome:
    """Of the quick insertion, which is run but once."""

    def ran(scenario: InsertionScenario, seed: int, told: object) -> CellInsertion:
        assert (scenario, seed) == (resolve(quick), 0)
        return done

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("chamfer.analysis.insertion.insertion.run_cell_insertion", ran)
        return run(resolve(quick), 0, lambda fraction, doing="": None)


def test_it_measures_what_it_promises(outcome: Outcome) -> None:
    promised = {
        "seated": "",
        "depth": "m",
        "force.axial": "N",
        "force.lateral": "N",
        "force.raw_peak": "N",
        "time_to_seated": "s",
        "touch.lateral_error": "m",
        "touch.rotational_error": "rad",
        "two_point.onset": "m",
        "predicted.seated": "",
        "predicted.force.axial": "N",
        "predicted.two_point.onset": "m",
    }
    found = {name: outcome.metrics[name].unit for name in promised}
    assert found == promised
    assert outcome.metrics["seated.said"].note.startswith("seated, 2")
    assert "cap of 8 N" in outcome.metrics["wedged"].note


def test_the_pictures_are_before_at_the_touch_and_at_the_end(
    quick: InsertionScenario, outcome: Outcome
) -> None:
    gaps = []
    for moment in ("before", "touch", "end"):
        image = picture(quick, outcome.tables["pictures"], "xy", moment).astype(int)
        red, blue = image[:, :, 0] - image[:, :, 2], image[:, :, 2] - image[:, :, 0]
        left = [np.argmax((colour > 80).any(axis=0)) for colour in (red, blue)]
        between = (left[1] - left[0]) * quick.cameras.pixel_size
        gaps.append(between - quick.parts.peg_length)
    assert gaps == pytest.approx([quick.gap, 0.0, -outcome.traces["depth"][-1]], abs=0.0025)
