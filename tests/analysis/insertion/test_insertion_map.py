"""Blind feeds: what becomes of them, and the map over their errors."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.insertion.contact_convergence import ConvergenceScenario
from chamfer.analysis.insertion.insertion_map import (
    BlindFeed,
    DrawnCells,
    FeedOutcome,
    InsertionMapScenario,
    ModelErrors,
    confusion,
    drawn_cells,
    errors_in,
    feed_blind,
    measured,
    outcome,
    push_at,
    wrong,
)
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.blind_feed import BlindFeedScenario
from chamfer.models.peg.bore_contact import ContactMaterial
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.peg_theory.fed_insertion import FeedVerdict
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES, ContactState
from chamfer.systems.pose import pose_vector

SCENARIO = InsertionMapScenario()


def test_the_grid_has_both_signs_and_the_middle() -> None:
    starts = replace(SCENARIO, points=5).starts("xz", 5)
    assert len(starts) == 25
    assert {one.plane for one in starts} == {"xz"}
    assert sorted({one.lateral for one in starts}) == pytest.approx(
        [-5e-3, -2.5e-3, 0, 2.5e-3, 5e-3]
    )
    assert sorted({one.tilt for one in starts}) == pytest.approx([-0.1, -0.05, 0, 0.05, 0.1])
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


def cells(*rows: tuple[FeedVerdict, FeedOutcome, bool]) -> dict[str, np.ndarray]:
    verdict, outcome, edge = (np.array(one, dtype=float) for one in zip(*rows, strict=True))
    return {
        "predicted_verdict": verdict,
        "outcome": outcome,
        "predicted_may_sit_on_edge": edge,
        "predicted_inside": np.ones(len(rows)),
    }


def test_failures_and_agreement_are_counted_where_theory_is_sure() -> None:
    traces = cells(
        (FeedVerdict.SAFE, FeedOutcome.SEATED, False),
        (FeedVerdict.SAFE, FeedOutcome.SEATED, False),
        (FeedVerdict.SAFE, FeedOutcome.WEDGED, False),
        (FeedVerdict.MAY, FeedOutcome.SEATED, True),
        (FeedVerdict.MAY, FeedOutcome.ON_EDGE, True),
        (FeedVerdict.STOPPED, FeedOutcome.MISSED, False),
        (FeedVerdict.STOPPED, FeedOutcome.SEATED, False),
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
    # Theory that is never sure agrees with nothing.
    unsure = confusion(cells((FeedVerdict.MAY, FeedOutcome.SEATED, True)))
    assert unsure["agreement"].value is None


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("planes=[xy,xy]", "planes is ('xy', 'xy'), allowed: one of each at most, at least one"),
        ("planes=[]", "planes is (), allowed: one of each"),
        ("drawn.errors.link_mass=1", "drawn.errors.link_mass is 1.0, allowed: from 0 to less"),
        ("steps=[0.001,-1]", "steps is (0.001, -1.0), allowed: finite numbers > 0"),
    ],
)
def test_mistakes_are_said_in_one_line(setting: str, message: str) -> None:
    scenario = ConvergenceScenario() if setting.startswith("steps") else SCENARIO
    with pytest.raises(UserError) as caught:
        make_scenario(scenario, settings=[setting])
    assert str(caught.value).startswith(message)


FED = BlindFeedScenario(speed=0.1, step=0.002)  # released after 1.4 s
ROWS = 1000
_ON = {ContactState.CHAMFER: "chamfer", ContactState.FACE: "face"}


def finished(
    state: ContactState, depth: float, *, push: float = 20.0, comes_out: float = 0.0
) -> BlindFeed:
    """Return a feed that ends in a state, and from then on comes out as the push goes."""
    time = FED.step * np.arange(ROWS)
    gone = np.clip((time - FED.released) / 0.2, 0.0, 1.0)
    wrench = np.zeros((ROWS, 6))
    wrench[:, 3] = -push * (1 - gone)
    normal = np.zeros((ROWS, len(FEATURES)))
    if state in _ON:
        normal[:, FEATURES.index(_ON[state])] = push * (1 - gone)
    return BlindFeed(
        time=time,
        depth=depth - comes_out * gone,
        state=np.full(ROWS, float(state)),
        wrench=wrench,
        normal=normal,
        touch=None,
    )


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        (finished(ContactState.SEATED, 0.036), FeedOutcome.SEATED),
        (finished(ContactState.TWO_POINT, 0.012), FeedOutcome.WEDGED),
        (finished(ContactState.TWO_POINT, 0.012, comes_out=0.002), FeedOutcome.JAMMED),
        (finished(ContactState.ONE_POINT, 0.02, comes_out=0.002), FeedOutcome.JAMMED),
        (finished(ContactState.CHAMFER, 0.0043), FeedOutcome.ON_EDGE),
        (finished(ContactState.FACE, 0.0), FeedOutcome.MISSED),
        (finished(ContactState.NONE, -0.01), FeedOutcome.MISSED),
    ],
)
def test_what_became_of_a_peg(run: BlindFeed, expected: FeedOutcome) -> None:
    assert outcome(FED, run) == expected


def test_a_peg_that_the_face_carries_has_missed_though_its_rim_touches_the_chamfer() -> None:
    run = finished(ContactState.CHAMFER, 0.0003)
    run.normal[:, FEATURES.index("face")] = 40.0
    assert outcome(FED, run) == FeedOutcome.MISSED


def test_what_happens_once_the_push_is_taken_away_is_no_seat() -> None:
    run = finished(ContactState.TWO_POINT, 0.012, comes_out=0.002)
    run.state[-5:] = ContactState.SEATED
    assert outcome(FED, run) == FeedOutcome.JAMMED


def test_forces_are_medians_until_the_push_is_taken_away() -> None:
    run = finished(ContactState.TWO_POINT, 0.012)
    run.wrench[50, 3] = -90.0  # for one step
    run.wrench[-10:, 3] = -99.0
    found = measured(FED, run)
    assert found["force.axial"] == pytest.approx(20.0)
    assert found["force.raw_peak"] == pytest.approx(90.0)
    assert found["two_point.onset"] == pytest.approx(0.012 - 0.004)
    assert found["touch.lateral_error"] is None
    # Pressing on the bottom is no force of the insertion.
    run = finished(ContactState.ONE_POINT, 0.03, push=2.0)
    run.wrench[100:, 3] = -50.0
    run.normal[100:, FEATURES.index("bottom")] = 48.0
    found = measured(FED, run)
    assert found["force.axial"] == found["force.raw_peak"] == pytest.approx(2.0)


SHORT: dict[str, Any] = {"feed": 0.04, "gap": 0.002, "speed": 0.1, "step": 0.002}
SHORT["contact"] = ContactMaterial(facets=32)


def test_a_feed_ends_on_the_bottom_of_a_blind_hole() -> None:
    parts = ColouredParts(bore_depth=0.008)
    scenario = BlindFeedScenario(parts=parts, lateral=0.0, tilt=0.0, depth=0.012, **SHORT)
    run = feed_blind(scenario)
    assert outcome(scenario, run) == FeedOutcome.SEATED
    assert run.time[-1] < 0.2
    assert run.depth[-1] == pytest.approx(0.008, abs=1e-4)
    assert scenario.deepest == 0.008


@pytest.mark.parametrize(("plane", "k"), [("xy", 1), ("xz", 2)])
def test_errors_are_those_of_the_tip_in_the_mouth_s_frame(plane: str, k: int) -> None:
    scenario = BlindFeedScenario(plane=plane, lateral=0.002, tilt=-0.03)  # type: ignore[arg-type]
    X_WM = RigidTransform(RollPitchYaw(0.1, 0.2, -0.3), np.array([0.4, 0.5, 0.6]))
    X_MT = scenario.nominal_pose("hole").inverse() @ scenario.start()
    found = errors_in(pose_vector(X_WM @ X_MT), pose_vector(X_WM))
    np.testing.assert_allclose(found[scenario.plane], (0.002, -0.03), atol=1e-12)
    other = found["xz" if k == 1 else "xy"]
    np.testing.assert_allclose(other, (0.0, 0.0), atol=1e-12)


def test_a_feed_with_small_errors_ends_as_soon_as_the_peg_is_deep_enough() -> None:
    errors = {"lateral": 0.001, "tilt": 0.01}
    scenario = BlindFeedScenario(depth=0.01, **SHORT | errors | {"step": 0.001})
    run = feed_blind(scenario)
    assert outcome(scenario, run) == FeedOutcome.SEATED
    assert run.time[-1] < scenario.fed
    assert (run.wrench.shape[1], run.normal.shape[1]) == (6, len(FEATURES))
    np.testing.assert_allclose(np.diff(run.time), scenario.step, atol=1e-9)
    assert run.touch is not None
    assert run.touch["xy"].lateral == pytest.approx(0.001, abs=5e-4)
    assert run.touch["xy"].tilt == pytest.approx(0.01, abs=3e-3)
    assert abs(run.touch["xz"].tilt) < 0.005
    found = measured(scenario, run)
    assert found["depth"] == pytest.approx(0.01, abs=2e-3)
    assert 0.3 < found["force.axial"] < 10  # type: ignore[operator]
