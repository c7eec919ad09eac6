"""The study of camera errors: what each error is, what is measured of it, and what is said."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell import camera_errors
from chamfer.analysis.cell.camera_error_runs import (
    BY_NAME,
    DRAWN,
    DRAWN_ERRORS,
    ERRORS,
    LEFT,
    MOMENTS,
    NONE,
    AssumedCameraError,
    ErrorAtRest,
    ErrorRun,
    at_rest,
    left,
    reached,
    with_drawn_errors,
    with_error,
)
from chamfer.analysis.cell.camera_errors import CameraErrorsScenario, resolve
from chamfer.analysis.scenario.experiment import Outcome, load, quiet, select
from chamfer.diagrams.cell.cell_vision import VIEWS, CameraSettings
from chamfer.models.validation import ParameterError

CAMERA_ERRORS = load(select(CATALOGUE.entries, ["camera-errors"])[0])

SCENARIO = resolve(
    CameraErrorsScenario(
        trials=2,
        points=2,
        errors=("distortion_off_axis", "roll", "latency"),
        controllers=("fsm", "pid"),
        measurements=("image", "metric"),
    )
)
CHANGING = [error for error in ERRORS if error.change is not None]


@pytest.mark.parametrize("error", CHANGING, ids=lambda error: error.name)
def test_an_error_of_no_size_is_none_and_one_of_some_size_is_one(
    error: AssumedCameraError,
) -> None:
    zero = with_error(SCENARIO, error, 0.0, 0.0)
    assert zero.cameras == SCENARIO.cameras
    some = with_error(SCENARIO, error, error.most, 0.0)
    for view in VIEWS:
        changed = some.cameras.view(view) != SCENARIO.cameras.view(view)
        assert changed == (view in error.views)
        same = some.cameras.view(view).believed == SCENARIO.cameras.view(view).believed
        assert same == (error.name != "pixel_size")  # nobody believes in an error
    # The controllers, and all else, know nothing of it.
    assert replace(some, cameras=SCENARIO.cameras) == SCENARIO


def test_a_camera_that_is_tilted_with_the_aim_kept_looks_at_the_same_point() -> None:
    turned = with_error(SCENARIO, BY_NAME["tilt_aimed"], 0.3, 0.0)
    gap = np.array([SCENARIO.mouth]) - [[SCENARIO.gap / 2, 0.0, 0.0]]
    for view in VIEWS:
        before, after = SCENARIO.camera(view), turned.camera(view)
        np.testing.assert_allclose(after.project(gap), before.project(gap), atol=1e-9)
        cosine = before.R_WC[:, 2] @ after.R_WC[:, 2]
        assert cosine == pytest.approx(math.cos(0.3))


def test_parts_off_the_axis_are_where_that_is_known() -> None:
    bent = with_error(SCENARIO, BY_NAME["distortion_off_axis"], -1.0, 0.02)
    for view in VIEWS:
        of = bent.cameras.view(view)
        assert of.true.position == of.believed.position == (0.0, 0.02, 0.0)
        assert of.true.distortion == (-1.0, 0.0, 0.0, 0.0, 0.0)
        assert of.believed.distortion == (0.0,) * 5


def test_drawn_errors_are_bounded_and_those_of_the_trial() -> None:
    first, again, other = (
        with_drawn_errors(SCENARIO, 3, trial, 0.5, SCENARIO.off_axis) for trial in (0, 0, 1)
    )
    assert first.cameras == again.cameras != other.cameras
    for view in VIEWS:
        of = first.cameras.view(view)
        fu, fv = of.true.focal_length or (0.0, 0.0)
        assert abs(fu / fv - 1) < 0.06
        assert abs((of.true.distortion or (9.0,))[0]) <= 2 * 0.5 * 1.25
        assert 0 <= (of.frames.latency or 0) - 1 <= 6
        assert abs((of.believed.position or (0, 9, 0))[1]) <= 0.01
    assert first.cameras.xz.true != first.cameras.xy.true
    assert {error.name for error in ERRORS} - {error.name for error in DRAWN_ERRORS} == {"shading"}
    none = with_drawn_errors(SCENARIO, 3, 0, 0.0, SCENARIO.off_axis)
    assert none.cameras == SCENARIO.cameras


def test_what_is_left_behind_the_tip_is_what_the_angle_makes_of_it() -> None:
    mouth = np.array([[1.0, 0, 0, 0, 0, 0, 0]])
    angle = 0.02
    tip = np.array([[math.cos(angle / 2), 0, 0, math.sin(angle / 2), -0.03, 0.001, 0.0]])
    found = left(SCENARIO, tip, mouth)  # turned about z: the axis behind the tip is lower in y
    assert found["lateral_error"][0] == pytest.approx(0.001)
    assert found["rotational_error"][0] == pytest.approx(angle)
    assert found["behind_error"][0] == pytest.approx(0.1 * math.sin(angle) - 0.001, rel=1e-6)


@pytest.mark.parametrize(
    ("left_at", "wanted", "expected"),
    [
        ([1.0, 2.0, 4.0], 3.0, 0.25),
        ([1.0, 2.0, 4.0], 0.5, 0.05),  # from nothing to the first
        ([1.0, 2.0, 4.0], 4.0, 0.3),
        ([1.0, 2.0, 4.0], 4.1, None),
        ([], 1.0, None),
    ],
)
def test_the_size_at_which_an_error_is_reached(
    left_at: list[float], wanted: float, expected: float | None
) -> None:
    size = np.array([0.1, 0.2, 0.3])[: len(left_at)]
    found = reached(size, np.array(left_at), wanted)
    assert found == (None if expected is None else pytest.approx(expected))


def test_at_rest_distortion_turns_and_a_lost_part_is_nowhere() -> None:
    row = at_rest(SCENARIO, ErrorAtRest("distortion_off_axis", (-0.5, -1.0), "image"))
    np.testing.assert_allclose(row["rotational_error"], [0.0094, 0.0188], rtol=0.1)
    np.testing.assert_allclose(row["behind_error"], 0.1 * row["rotational_error"], rtol=0.2)
    lost = at_rest(SCENARIO, ErrorAtRest("tilt_in_place", (0.5,), "metric"))
    assert np.isnan(lost["rotational_error"]).all()


class Loop:
    """Takes the place of runs: an error leaves its place in the list, in mm and mrad."""

    def __init__(self) -> None:
        self.asked: list[ErrorRun] = []

    def __call__(self, study: CameraErrorsScenario, seed: int, task: ErrorRun) -> Row:
        self.asked.append(task)
        place = (
            1
            + [NONE, *SCENARIO.errors, DRAWN, "position_down"].index(task.error)
            + (task.size > 0) * 0.5
        )
        rank = {"soon": place, "late": 1.0 if task.error == "latency" else place}
        values = {
            f"{moment}.{name}": 1e-3 * rank[moment]
            for moment in MOMENTS
            for name in (*LEFT, "vision.lateral_error", "vision.rotational_error")
        }
        return {"seen": float(task.error != "roll"), "diverged": 0.0, **values}


@pytest.fixture(scope="module")
def studied() -> tuple[Outcome, Loop]:
    loop = Loop()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(camera_errors, "run_once", loop)
        return CAMERA_ERRORS.run(SCENARIO, 5, quiet), loop


def test_what_is_run(studied: tuple[Outcome, Loop]) -> None:
    outcome, loop = studied
    alone = [task for task in loop.asked if task.trial is None]
    assert len(alone) == 4 * (1 + 2 + 1 + 1)  # none, distortion of both signs, roll, latency
    drawn = [task for task in loop.asked if task.trial is not None]
    assert {(task.error, task.size) for task in drawn} == {(NONE, 0.0), (DRAWN, 0.5)}
    assert len(drawn) == 2 * 4 * 2
    assert outcome.simulated_seconds == len(loop.asked) * SCENARIO.duration
    still = outcome.tables["still"]
    assert len(still["size"]) == 2 * 2 * 2  # not of the latency
    assert set(still["error"]) == {"distortion_off_axis", "roll"}


def test_metrics(studied: tuple[Outcome, Loop], value: Any) -> None:
    outcome, _ = studied
    assert value(outcome, "latency.pid.metric.soon.rotational_error") == pytest.approx(4.5e-3)
    assert value(outcome, "latency.fsm.image.late.rotational_error") == pytest.approx(1e-3)
    # Of both signs the worse one.
    assert value(outcome, "distortion_off_axis.fsm.image.late.behind_error") == 2.5e-3
    assert value(outcome, "roll.fsm.image.blind") == 1
    assert "blind" in outcome.metrics["roll.fsm.image.late.lateral_error"].note
    reach = value(outcome, "distortion_off_axis.image.rest.rotational_error.published_at")
    assert reach == pytest.approx(1.17, rel=0.06)
    assert outcome.metrics["roll.image.rest.rotational_error.published_at"].value is None
    assert outcome.metrics["roll.image.rest.rotational_error.per_unit"].unit == ""
    assert outcome.metrics["roll.image.rest.lateral_error.per_unit"].unit == "m/rad"
    assert value(outcome, "drawn.errors.fsm.image.soon.lateral_error.mean") == pytest.approx(
        5.5e-3
    )
    notes = {
        name: outcome.metrics[f"drawn.{name}.fsm.image.soon.lateral_error.mean"].note
        for name in ("errors", "none")
    }
    assert notes["errors"].endswith(", without light from one side")
    assert notes["none"].endswith("seen")
    assert value(outcome, "drawn.none.fsm.image.blind") == 0


def test_the_answer_is_made_of_the_numbers(studied: tuple[Outcome, Loop]) -> None:
    outcome, _ = studied
    said = outcome.metrics["answer"]
    assert said.value == 1
    assert "biased by distortion k1 of parts off the axis of -1.25 (23" in said.note
    assert "does not care about roll" in said.note
    assert "lost by roll" in said.note
    assert "from one side, they leave 5.5 mm at the tip, 5.5 mrad" in said.note


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"errors": ("rol",)}, "errors is 'rol', allowed: focal_length, "),
        ({"soon": 7.0}, "soon is 7.0, allowed: at most compensation_time, 6 s"),
        ({"controllers": ()}, "controllers is"),
        ({"cameras": CameraSettings(measured="metric")}, "cameras.measured is"),
        ({"compensated": "none"}, "compensated is"),
        ({"start_offset": (-0.02, 0.0, 0.0)}, "start_offset is"),
    ],
)
def test_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{message}"):
        resolve(CameraErrorsScenario(**changed))


def test_parts_that_are_lost_at_every_size_are_never_said_harmless(
    monkeypatch: pytest.MonkeyPatch, value: Any
) -> None:
    def rest(_: CameraErrorsScenario, task: ErrorAtRest) -> Row:
        sizes = (0.1, 0.2)  # of 0.02 m at most
        return at_rest(SCENARIO, ErrorAtRest("position_down", sizes, task.measured))

    monkeypatch.setattr(camera_errors, "run_once", Loop())
    monkeypatch.setattr(camera_errors, "at_rest", rest)
    scenario = replace(SCENARIO, errors=("position_down",), measurements=("image",))
    outcome = CAMERA_ERRORS.run(scenario, 0, quiet)
    said = outcome.metrics["answer"].note
    assert "Parts get lost by a place further down" in said
    assert "does not care" not in said
    for kind in LEFT:
        for of in ("", ".per_unit", ".published_at"):
            assert outcome.metrics[f"position_down.image.rest.{kind}{of}"].value is None
    assert value(outcome, "position_down.image.rest.lost_at") == 0.1
    CAMERA_ERRORS.plot(scenario, outcome)
