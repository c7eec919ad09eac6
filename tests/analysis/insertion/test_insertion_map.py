"""The map: its cells and draws, what is counted, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.insertion.blind_feed_runs import FeedOutcome
from chamfer.analysis.insertion.insertion_map import (
    DrawnCells,
    InsertionMapScenario,
    ModelErrors,
    confusion,
    drawn_cells,
    push_at,
    run,
)
from chamfer.analysis.insertion.insertion_map_figures import wrong
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import load, select
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.models.peg_theory.fed_insertion import Verdict

(INSERTION_MAP_ENTRY,) = select(CATALOGUE.entries, ["insertion-map"])
INSERTION_MAP = load(INSERTION_MAP_ENTRY)

SCENARIO = InsertionMapScenario()


def test_the_grid_has_both_signs_and_the_middle() -> None:
    starts = replace(SCENARIO, points=5).starts("xz", 5)
    assert len(starts) == 25
    assert {one.plane for one in starts} == {"xz"}
    assert sorted({one.lateral for one in starts}) == pytest.approx(
        [-5e-3, -2.5e-3, 0, 2.5e-3, 5e-3]
    )
    assert sorted({one.tilt for one in starts}) == pytest.approx([-0.1, -0.05, 0, 0.05, 0.1])
    assert len({(one.lateral, one.tilt) for one in starts}) == 25
    (middle,) = SCENARIO.starts("xy", 1)
    assert (middle.lateral, middle.tilt) == (0.0, 0.0)


def test_draws_differ_by_seed_cell_and_draw_and_stay_in_their_range() -> None:
    errors = ModelErrors(payload=0.05, link_mass=0.1, joint_friction=0.3)
    drawn = DrawnCells(points=2, draws=6, errors=errors)
    found = drawn_cells(replace(SCENARIO, drawn=drawn), seed=1)
    assert len(found) == 24
    for arm in ("peg", "hole"):
        arms = [getattr(one, arm) for one in found]
        assert len({one.payload_error for one in arms}) == 24
        assert all(0 <= one.payload_error <= 0.05 for one in arms)
        assert all(0.9 <= one.mass_scale <= 1.1 for one in arms)
        own = getattr(SCENARIO.cell, arm).arm.dry_friction
        scales = np.array([one.arm.dry_friction for one in arms]) / own
        assert np.ptp(scales, axis=1).max() < 1e-12
        assert scales.min() >= 0.7
        assert scales.max() <= 1.3
        assert np.ptp(scales[:, 0]) > 0.2
    assert found == drawn_cells(replace(SCENARIO, drawn=drawn), seed=1)
    assert found != drawn_cells(replace(SCENARIO, drawn=drawn), seed=2)
    assert drawn_cells(replace(SCENARIO, drawn=None), seed=1) == []


def test_the_feed_pushes_with_what_is_left_of_it() -> None:
    """The more of it is depth, the less strains the arms: here 150 N/m, one behind the other."""
    impedance = replace(SCENARIO.cell.impedance, stiffness=(300.0, 400.0, 600.0))
    cell = replace(SCENARIO.cell, impedance=impedance)
    assert push_at(cell, np.array(0.014)) == pytest.approx(150 * (0.12 - 0.006 - 0.014))
    fixed = replace(cell, hole=replace(cell.hole, kind="fixture"))
    assert push_at(fixed, np.array(0.014)) == pytest.approx(300 * (0.12 - 0.006 - 0.014))


def test_a_fixture_has_no_model_to_be_wrong() -> None:
    cell = replace(SCENARIO.cell, hole=replace(SCENARIO.cell.hole, kind="fixture"))
    found = drawn_cells(replace(SCENARIO, cell=cell, drawn=DrawnCells(points=1, draws=2)), seed=1)
    assert [one.hole for one in found] == [cell.hole] * 2
    assert found[0].peg != found[1].peg


def cells(*rows: tuple[Verdict, FeedOutcome, bool]) -> dict[str, np.ndarray]:
    verdict, outcome, edge = (np.array(one, dtype=float) for one in zip(*rows, strict=True))
    return {
        "predicted_verdict": verdict,
        "outcome": outcome,
        "predicted_may_sit_on_edge": edge,
        "predicted_inside": np.ones(len(rows)),
    }


def test_failures_and_agreement_are_counted_where_theory_is_sure() -> None:
    traces = cells(
        (Verdict.SAFE, FeedOutcome.SEATED, False),
        (Verdict.SAFE, FeedOutcome.SEATED, False),
        (Verdict.SAFE, FeedOutcome.WEDGED, False),
        (Verdict.MAY, FeedOutcome.SEATED, True),
        (Verdict.MAY, FeedOutcome.ON_EDGE, True),
        (Verdict.STOPPED, FeedOutcome.MISSED, False),
        (Verdict.STOPPED, FeedOutcome.SEATED, False),
    )
    found = {name: metric.value for name, metric in confusion(traces).items()}
    assert found["predicted_safe.cells"] == 3
    assert found["predicted_safe.failed"] == 1
    assert found["agreement"] == pytest.approx(100 * 3 / 5)
    assert found["predicted_may.share"] == pytest.approx(100 * 2 / 7)
    assert (found["predicted_edge.cells"], found["predicted_edge.failed"]) == (2, 1)
    assert found["seated"] == 4
    assert found["confusion.safe.wedged"] == found["confusion.stopped.missed"] == 1
    assert found["confusion.may.wedged"] == 0
    assert sum(value or 0 for name, value in found.items() if name.startswith("confusion.")) == 7
    np.testing.assert_array_equal(wrong(traces), [0, 0, 1, 0, 0, 0, 1])


def test_theory_that_is_never_sure_agrees_with_nothing() -> None:
    found = confusion(cells((Verdict.MAY, FeedOutcome.SEATED, True)))
    assert found["agreement"].value is None


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("points=0", "points is 0, allowed: 1 to 101"),
        ("planes=[xy,xy]", "planes is ('xy', 'xy'), allowed: one of each at most, at least one"),
        ("planes=[]", "planes is (), allowed: one of each"),
        ("largest_tilt=0.8", "largest_tilt is 0.8, allowed: between 0 and pi/4"),
        ("largest_lateral=0", "largest_lateral is 0.0, allowed: a finite number > 0"),
        ("drawn.draws=0", "drawn.draws is 0, allowed: 1 to 10000"),
        ("drawn.errors.link_mass=1", "drawn.errors.link_mass is 1.0, allowed: from 0 to less"),
    ],
)
def test_mistakes_are_said_in_one_line(setting: str, message: str) -> None:
    with pytest.raises(UserError) as caught:
        make_scenario(SCENARIO, settings=[setting])
    assert str(caught.value).startswith(message)


@pytest.mark.slow
def test_a_map_of_one_cell_and_a_draw() -> None:
    settings = [one for one in INSERTION_MAP_ENTRY.reduced if not one.startswith("drawn")]
    settings += ["drawn.points=1", "drawn.draws=1"]
    scenario = make_scenario(SCENARIO, settings=settings)
    outcome = run(scenario, 0, lambda fraction, doing="": None)
    assert outcome.metrics["predicted_safe.cells"].value == 1
    assert outcome.metrics["predicted_safe.failed"].value == 0
    assert outcome.metrics["agreement"].value == 100
    assert outcome.metrics["drawn.safe.success_rate"].value == 100
    probability = outcome.tables["probability"]
    assert probability["low"][0] == pytest.approx(2.5)  # of one draw
    assert outcome.tables["region"]["verdict"].min() == Verdict.SAFE
    assert outcome.tables["region"]["verdict"].max() == Verdict.STOPPED
    assert math.isfinite(outcome.traces["touch_lateral_error"][0])
    assert set(INSERTION_MAP.plot(scenario, outcome)) == {"insertion-map"}
