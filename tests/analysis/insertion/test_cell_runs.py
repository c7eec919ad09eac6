"""An insertion in the cell: what it does, and what is measured of it."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.cell.alignment_runs import true_errors
from chamfer.analysis.insertion.cell_runs import (
    INSERTION,
    CellInsertion,
    ending,
    errors_in_one_plane,
    errors_in_planes,
    force_medians,
    insertion_metrics,
    loads_in_planes,
    predict,
    run_cell_insertion,
    touch_row,
)
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve
from chamfer.systems.contact.peg_hole_contact_monitor import ContactState
from chamfer.systems.pose import POSE_NAMES
from chamfer.systems.strategies.insertion_decision import DecisionParams

Values = dict[str, float | None]


@pytest.fixture(scope="module")
def scenario(quick: InsertionScenario) -> InsertionScenario:
    """The quick one, resolved."""
    return resolve(quick)


@pytest.fixture(scope="module")
def measured(scenario: InsertionScenario, done: CellInsertion) -> Values:
    """What is measured of it."""
    return insertion_metrics(done, scenario)


@pytest.mark.slow
def test_it_is_seated_and_says_so(done: CellInsertion, measured: Values) -> None:
    states = [one.target for one in done.path]
    assert states == ["align", "decide", "insert", "check", "seated"]
    assert list(measured) == list(INSERTION)
    for name in ("seated", "seated.said", "seated.first", "attempts"):
        assert measured[name] == 1
    assert measured["depth"] == done.traces["depth"].max() > 0.018
    assert measured["wedged"] == measured["jammed"] == 0
    assert measured["pull_out.force"] is None


def test_times_count_from_the_first_frame(
    scenario: InsertionScenario, done: CellInsertion, measured: Values
) -> None:
    decided = next(one.time for one in done.path if one.target == "insert")
    assert measured["decision.time"] == pytest.approx(decided - scenario.begin)
    deep = done.traces["time"][np.argmax(done.traces["depth"] >= 0.018)]
    assert measured["time_to_seated"] == pytest.approx(deep - scenario.begin)


def test_the_decision_knows_what_it_may_know(measured: Values) -> None:
    found = {name: value for name, value in measured.items() if value is not None}
    off = found["decision.lateral_error"] - found["decision.true_lateral_error"]
    assert abs(off) < 2e-4 + found["decision.lateral_uncertainty"]
    assert 0 < found["decision.lateral_uncertainty"] < 5e-4
    turned = found["decision.rotational_error"] - found["decision.true_rotational_error"]
    assert abs(turned) < 0.005


def test_the_touch_is_at_the_mouth(done: CellInsertion, measured: Values) -> None:
    row = touch_row(done)
    assert row is not None
    assert done.traces["depth"][row] == pytest.approx(0.0, abs=2e-4)
    assert measured["touch.lateral_error"] == done.traces["lateral_error"][row]
    lateral, tilt = errors_in_one_plane(done.traces, row)
    assert lateral == pytest.approx(done.traces["lateral_error"][row], rel=1e-6)
    assert abs(tilt) == pytest.approx(done.traces["rotational_error"][row], rel=1e-3)


def test_errors_in_planes_are_those_of_tip_and_axis(done: CellInsertion) -> None:
    poses = {
        arm: np.column_stack([done.traces[f"{arm}_true_{name}"] for name in POSE_NAMES])
        for arm in ("peg", "hole")
    }
    true = true_errors(poses["peg"], poses["hole"])
    (y, tilt_y), (z, tilt_z) = errors_in_planes(done.traces).values()
    np.testing.assert_allclose(np.column_stack([y, z]), -true.way[:, 1:])
    # The peg's far end is to where the tilt is positive.
    back = [
        (1 - 2 * (p[2] ** 2 + p[3] ** 2), 2 * (p[1] * p[2] + p[0] * p[3]),
         2 * (p[1] * p[3] - p[0] * p[2]))
        for p in (poses["peg"][0], poses["hole"][0])
    ]  # fmt: skip
    leans = -np.subtract(back[0], back[1])
    assert [tilt_y[0], tilt_z[0]] == pytest.approx(leans[1:], abs=1e-4)


def test_what_the_arm_knows_is_near_the_truth(
    scenario: InsertionScenario, done: CellInsertion
) -> None:
    feeding = done.when("insert", "check")
    off = done.traces["sensed_depth"] - done.traces["depth"]
    # Of a tick that is held, at 60 mm/s.
    assert np.abs(off[feeding]).max() < 0.0012
    axial, _ = force_medians(done.traces, scenario.step)
    assert np.abs(done.traces["sensed_x"] - axial)[feeding].max() < 2.0


def test_theory_says_that_it_goes_in(scenario: InsertionScenario, done: CellInsertion) -> None:
    found = {name: metric.value for name, metric in predict(scenario, done).items()}
    assert found["predicted.seated"] == 1
    assert found["predicted.may_wedge"] == 0
    margin = found["touch.margin"]
    assert margin is not None
    assert 50 < margin < 100


def test_theory_is_silent_of_square_parts_off_the_planes_of_their_faces(
    scenario: InsertionScenario, done: CellInsertion
) -> None:
    square = replace(scenario, parts=replace(scenario.parts, section="square"))
    metrics = predict(square, done)
    assert all(metric.value is None for metric in metrics.values())
    assert "errors in no plane along faces" in metrics["predicted.seated"].note
    still = np.zeros_like(done.traces["true_z"])
    in_plane = done._replace(traces=done.traces | {"true_z": still, "true_pitch": still})
    assert predict(square, in_plane)["predicted.seated"].value == 1


def test_loads_are_those_of_a_peg_that_slides(
    scenario: InsertionScenario, done: CellInsertion
) -> None:
    for loads in loads_in_planes(done.traces, scenario.parts, scenario.step).values():
        assert loads.size == len(loads.level)
        assert (loads.depth > 0).all()
        assert np.isfinite(loads.level).all()


@pytest.mark.slow
def test_halving_the_step_changes_nothing_that_matters(
    scenario: InsertionScenario, done: CellInsertion, measured: Values
) -> None:
    half = replace(scenario, step=scenario.step / 2)
    fine = run_cell_insertion(half, seed=0)
    values = insertion_metrics(fine, half)
    assert [one.target for one in fine.path] == [one.target for one in done.path]
    for name, tolerance in (
        ("time_to_seated", 0.03),
        ("touch.lateral_error", 5e-5),
        ("touch.rotational_error", 1e-3),
        ("force.axial", 0.3),
        ("force.lateral", 0.15),
        ("depth", 1e-3),
    ):
        assert values[name] == pytest.approx(measured[name], abs=tolerance), name


def test_before_the_advance_a_run_may_end(quick: InsertionScenario) -> None:
    paused = resolve(
        replace(
            quick,
            decide=DecisionParams(kind="at_once"),
            insert=replace(quick.insert, pause=0.2),
        )
    )
    run = run_cell_insertion(paused, seed=0, until_advance=True)
    assert run.state == "insert"
    assert run.traces["feed"].max() < 0.001  # runs are asked ten rows apart
    assert (run.traces["contact_state"] == ContactState.NONE).all()
    values = insertion_metrics(run, paused)
    assert values["seated"] == 0
    assert values["touch.lateral_error"] is None
    assert ending(run, paused).startswith("not over after 0.")
