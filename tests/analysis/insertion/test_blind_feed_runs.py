"""What is said of a blind feed: how the parts met, and what became of the peg."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.insertion.blind_feed_runs import (
    BlindFeed,
    FeedOutcome,
    errors_in,
    feed_blind,
    measured,
    outcome,
)
from chamfer.diagrams.insertion.blind_feed import BlindFeedScenario
from chamfer.models.peg.bore_contact import ContactMaterial
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES, ContactState
from chamfer.systems.pose import pose_vector

SCENARIO = BlindFeedScenario(speed=0.1, step=0.002)  # released after 1.4 s
ROWS = 1000
_ON = {ContactState.CHAMFER: "chamfer", ContactState.FACE: "face"}


def finished(
    state: ContactState, depth: float, *, push: float = 20.0, comes_out: float = 0.0
) -> BlindFeed:
    """Return a feed that ends in a state, and from then on comes out as the push goes."""
    time = SCENARIO.step * np.arange(ROWS)
    gone = np.clip((time - SCENARIO.released) / 0.2, 0.0, 1.0)
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
    assert outcome(SCENARIO, run) == expected


def test_a_peg_that_the_face_carries_has_missed_though_its_rim_touches_the_chamfer() -> None:
    run = finished(ContactState.CHAMFER, 0.0003)
    run.normal[:, FEATURES.index("face")] = 40.0
    assert outcome(SCENARIO, run) == FeedOutcome.MISSED


def test_what_happens_once_the_push_is_taken_away_is_no_seat() -> None:
    run = finished(ContactState.TWO_POINT, 0.012, comes_out=0.002)
    run.state[-5:] = ContactState.SEATED
    assert outcome(SCENARIO, run) == FeedOutcome.JAMMED


def test_forces_are_medians_until_the_push_is_taken_away() -> None:
    run = finished(ContactState.TWO_POINT, 0.012)
    run.wrench[50, 3] = -90.0  # for one step
    run.wrench[-10:, 3] = -99.0
    found = measured(SCENARIO, run)
    assert found["force.axial"] == pytest.approx(20.0)
    assert found["force.raw_peak"] == pytest.approx(90.0)
    assert found["two_point.onset"] == pytest.approx(0.012 - 0.004)
    assert found["touch.lateral_error"] is None


def test_pressing_on_the_bottom_is_no_force_of_the_insertion() -> None:
    run = finished(ContactState.ONE_POINT, 0.03, push=2.0)
    run.wrench[100:, 3] = -50.0
    run.normal[100:, FEATURES.index("bottom")] = 48.0
    found = measured(SCENARIO, run)
    assert found["force.axial"] == pytest.approx(2.0)
    assert found["force.raw_peak"] == pytest.approx(2.0)


def test_a_feed_ends_on_the_bottom_of_a_blind_hole() -> None:
    scenario = BlindFeedScenario(
        parts=ColouredParts(bore_depth=0.008),
        lateral=0.0,
        tilt=0.0,
        depth=0.012,
        feed=0.04,
        gap=0.002,
        speed=0.1,
        step=0.002,
        contact=ContactMaterial(facets=32),
    )
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
    scenario = BlindFeedScenario(
        lateral=0.001,
        tilt=0.01,
        depth=0.01,
        feed=0.04,
        gap=0.002,
        speed=0.1,
        step=0.002,
        contact=ContactMaterial(facets=32),
    )
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
