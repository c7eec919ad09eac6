"""Insertions in the work cell: measured, told, and with faults."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.cell.alignment import picture
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
from chamfer.analysis.insertion.insertion import run
from chamfer.analysis.insertion.insertion_repeatability import (
    InsertionTrialsScenario,
    _saved,
    _settled_statistics,
    _statistics,
    in_a_way,
    resolve_insertion_trials,
)
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.contact.peg_hole_contact_monitor import ContactState
from chamfer.systems.pose import POSE_NAMES
from chamfer.systems.strategies.insertion_decision import DecisionParams
from chamfer.systems.strategies.insertion_law import InsertParams

Values = dict[str, float | None]


@pytest.fixture(scope="module")
def quick() -> InsertionScenario:
    """Close, nearly aligned, fast, not deep: a second of simulation, if all is well."""
    return InsertionScenario(
        initial_error=(0.0, 0.001, -0.001, 0.0, 0.01, -0.01),
        begin=0.2,
        gap=0.012,
        insert=InsertParams(depth=0.02, speed=0.06, rest=0.1, attempts=1),
        duration=8.0,
    )


@pytest.fixture(scope="module")
def scenario(quick: InsertionScenario) -> InsertionScenario:
    """The quick one, resolved."""
    return resolve(quick)


@pytest.fixture(scope="module")
def done(scenario: InsertionScenario) -> CellInsertion:
    """The quick one's run."""
    return run_cell_insertion(scenario, seed=0)


@pytest.fixture(scope="module")
def measured(scenario: InsertionScenario, done: CellInsertion) -> Values:
    """What is measured of it."""
    return insertion_metrics(done, scenario)


@pytest.mark.slow
def test_it_is_seated_and_says_so(done: CellInsertion, measured: Values) -> None:
    states = [one.target for one in done.path]
    assert states == ["align", "decide", "insert", "check", "seated"]
    for name in ("seated", "said_seated", "seated.first", "attempts"):
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


def test_a_search_is_part_of_its_attempt(done: CellInsertion) -> None:
    began, last = done.began(), done.path[-1]
    back = last._replace(source="spiral", target="insert", time=last.time)
    assert done._replace(path=(*done.path, back)).began() == began == done.entered("insert")


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
    off = np.abs(done.traces["sensed_x"] - axial)[feeding]
    assert np.quantile(off, 0.99) < 2.0
    # For some milliseconds at the touch the arm's springs do not show it.
    assert off.max() < 4.0


def test_theory_says_that_it_goes_in(scenario: InsertionScenario, done: CellInsertion) -> None:
    for loads in loads_in_planes(done.traces, scenario.parts, scenario.step).values():
        assert (loads.depth > 0).all()
        assert np.isfinite(loads.level).all()
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


def test_before_the_advance_a_run_may_end(quick: InsertionScenario) -> None:
    paused = resolve(
        replace(
            quick, decide=DecisionParams(kind="at_once"), insert=replace(quick.insert, pause=0.2)
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


def test_the_pictures_are_before_at_the_touch_and_at_the_end(
    quick: InsertionScenario, done: CellInsertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ran(scenario: InsertionScenario, seed: int, told: object) -> CellInsertion:
        assert (scenario, seed) == (resolve(quick), 0)
        return done

    monkeypatch.setattr("chamfer.analysis.insertion.insertion.run_cell_insertion", ran)
    outcome = run(resolve(quick), 0, lambda fraction, doing="": None)
    gaps = []
    for moment in ("before", "touch", "end"):
        image = picture(quick, outcome.tables["pictures"], "xy", moment).astype(int)
        red, blue = image[:, :, 0] - image[:, :, 2], image[:, :, 2] - image[:, :, 0]
        left = [np.argmax((colour > 80).any(axis=0)) for colour in (red, blue)]
        between = (left[1] - left[0]) * quick.cameras.pixel_size
        gaps.append(between - quick.parts.peg_length)
    assert gaps == pytest.approx([quick.gap, 0.0, -outcome.traces["depth"][-1]], abs=0.0025)


Run = tuple[CellInsertion, InsertionScenario]


def run_of_insertion_faults(scenario: InsertionScenario) -> Run:
    resolved = resolve(scenario)
    return run_cell_insertion(resolved, seed=0), resolved


def assert_ended(found: Run, state: str, words: str) -> None:
    """It is not seated, does not say so, says why, stays below the limit, and stands still."""
    done, scenario = found
    values = insertion_metrics(done, scenario)
    assert done.state == state
    assert values["seated"] == values["said_seated"] == 0
    assert words in ending(done, scenario)
    assert np.hypot(*force_medians(done.traces, scenario.step)).max() < scenario.insert.force_limit
    assert done.traces["feed"][-1] == pytest.approx(done.traces["feed"][-20], abs=0.001)


def test_without_frames_nothing_moves(quick: InsertionScenario) -> None:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=1.0))
    done, scenario = run_of_insertion_faults(replace(quick, cameras=cameras))
    assert_ended((done, scenario), "blind", "stopped: the cameras see no parts")
    assert not done.traces["feed"].any()


@pytest.mark.slow
def test_a_peg_that_is_too_thick_does_not_enter(quick: InsertionScenario) -> None:
    insert = replace(quick.insert, attempts=2)
    thick = run_of_insertion_faults(replace(quick, peg_excess=0.0003, insert=insert))
    assert_ended(
        thick, "gave_up", "gave up after 2 attempts: stuck at the mouth, the peg does not"
    )
    done, scenario = thick
    assert done.traces["depth"].max() < scenario.parts.chamfer_height
    values = insertion_metrics(done, scenario)
    assert values["wedged"] == values["jammed"] == 0  # that is said of the bore


@pytest.mark.slow
def test_a_wedge_is_told_and_pulled_out(quick: InsertionScenario) -> None:
    insert = replace(quick.insert, compensation="frozen", speed=0.04)
    leaning = replace(quick, initial_error=(0.0, 0.002, 0.0, 0.0, 0.0, -0.1), insert=insert)
    wedge = run_of_insertion_faults(replace(leaning, decide=DecisionParams(kind="at_once")))
    done, scenario = wedge
    assert_ended(wedge, "gave_up", "gave up after 1 attempt: wedged")
    values = insertion_metrics(done, scenario)
    assert (values["wedged"], values["jammed"]) == (1, 0)
    pull = values["pull_out.force"]
    assert pull is not None
    assert 3 < pull < scenario.insert.force_limit
    assert done.traces["depth"][-1] < 0  # it came out
    assert values["depth"] == done.traces["depth"].max()
    assert done.traces["depth"].max() == pytest.approx(0.010, abs=0.002)


def trials(way: str, *changes: dict[str, Any]) -> Trials[tuple[int, str]]:
    """Trials of a way, seated but for the changes."""
    usual = dict.fromkeys(INSERTION, 1.0) | {"ending": "seated", "state": "seated"}
    return Trials(
        tasks=tuple((i, way) for i in range(len(changes))),
        rows=tuple(usual | change for change in changes),
    )


def test_success_has_its_exact_interval_and_says_what_failed() -> None:
    stuck: dict[str, Any] = {
        "seated": 0.0,
        "seated.first": 0.0,
        "said_seated": 0.0,
        "ending": "stuck",
    }
    found = _statistics(trials("", *[{}] * 9, stuck))
    assert found["success_rate"].value == 90
    assert found["success_rate"].note == "seated, of 10 trials; 1: stuck"
    # Clopper and Pearson for 9 of 10.
    assert found["success_rate.low"].value == pytest.approx(55.50, abs=0.01)
    assert found["success_rate.high"].value == pytest.approx(99.75, abs=0.01)
    assert found["said_wrongly"].value == 0
    wrong = _statistics(trials("", {"seated": 0.0, "said_seated": 1.0}, {}))
    assert wrong["said_wrongly"].value == 1


def test_forces_are_quantiles() -> None:
    found = _statistics(trials("", *({"force.contact": float(k)} for k in range(21))))
    assert found["force.contact.median"].value == 10
    assert found["force.contact.p95"].value == 19
    assert found["force.contact.max"].value == 20
    assert found["force.soft"].value == pytest.approx(100 * 5 / 21)


def test_what_is_saved_is_of_pairs_that_are_both_seated() -> None:
    early = trials("", *({"time_to_seated": one} for one in (4.0, 4.5, None, 5.0)))
    late = trials("wait", *({"time_to_seated": one} for one in (6.0, 6.0, 6.0, None)))
    found = _saved(early, late)
    assert found["saved.time.mean"].value == pytest.approx(1.75)
    assert found["saved.time.mean"].note.startswith("2 pairs of one start, 1.5 to 2 s")
    none = _saved(trials("", {"time_to_seated": None}), late)
    assert none["saved.time.mean"].value is None


def test_settling_is_before_and_after() -> None:
    row: dict[str, Any] = {
        "frozen.lateral_error": 1e-4,
        "settled.lateral_error": 3e-4,
        "frozen.rotational_error": None,
        "settled.rotational_error": None,
    }
    found = _settled_statistics(trials("settling", row, row | {"settled.lateral_error": 5e-4}))
    assert found["settling.settled.lateral_error.mean"].value == pytest.approx(4e-4)
    assert found["settling.settled.lateral_error.max"].value == 5e-4
    assert found["settling.frozen.rotational_error.mean"].value is None


def test_ways_change_what_they_say_and_no_more() -> None:
    scenario = resolve_insertion_trials(InsertionTrialsScenario())
    assert in_a_way(scenario, "") == scenario
    waits = in_a_way(scenario, "wait")
    assert waits == replace(scenario, decide=replace(scenario.decide, kind="wait"))
    frozen = in_a_way(scenario, "frozen")
    assert (frozen.insert.compensation, frozen.decide.kind) == ("frozen", "margin")
    both = in_a_way(scenario, "frozen_wait")
    assert (both.insert.compensation, both.decide.kind) == ("frozen", "wait")
    assert in_a_way(scenario, "settling").insert.pause == 1.5
    late = replace(scenario, insert=replace(scenario.insert, freeze_depth=-0.003))
    assert in_a_way(late, "frozen").insert.freeze_depth is None


def test_refused() -> None:
    with pytest.raises(ParameterError, match=r"beside is \('wait', 'wait'\), allowed: some of"):
        InsertionTrialsScenario(beside=("wait", "wait"))
