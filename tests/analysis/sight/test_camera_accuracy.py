"""The experiment: poses, rows, metrics and what can make them wrong."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.sight import camera_accuracy, detection_trials
from chamfer.analysis.sight.camera_accuracy import CASES, AccuracyCameras, AccuracyScenario, run
from chamfer.analysis.sight.detection_trials import STATUSES, UNITS, PoseSpread, Reach, draw_poses
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import VIEWS, camera_placement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.vtk_camera import missing_graphics
from chamfer.systems.vision.part_appearance import Appearance, appearances
from chamfer.systems.vision.part_detection import Detection, Status

CAMERA_ACCURACY = load(select(CATALOGUE.entries, ["camera-accuracy"])[0])

LOOKS = appearances(ColouredParts(), 0.0005)

POSES = 12
KINDS = ("clean", "noisy", "sampled")
SCENARIO = AccuracyScenario(poses=POSES)
ASKED = [one for one in PUBLISHED if one.experiment == "camera-accuracy"]


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run(CAMERA_ACCURACY.resolve(SCENARIO), 0, quiet)


def value(outcome: Outcome, metric: str) -> float:
    found = outcome.metrics[metric].value
    assert found is not None
    return found


def rows(outcome: Outcome, case: str, kind: str) -> dict[str, np.ndarray]:
    of = outcome.traces["case"] == list(CASES).index(case)
    of &= outcome.traces["images"] == KINDS.index(kind)
    return {name: values[of] for name, values in outcome.traces.items()}


def test_published_values(outcome: Outcome) -> None:
    checks = check(ASKED, outcome.metrics)
    assert len(checks) == 4
    assert all(one.ok for one in checks)
    assert all(one.published.unit == outcome.metrics[one.published.metric].unit for one in checks)


def test_the_cameras_are_those_of_the_work_cell() -> None:
    cell = AlignmentScenario()
    for view in VIEWS:
        there = camera_placement(cell.cameras, cell, view)
        assert SCENARIO.cameras.placement(view, there.target) == there
    assert SCENARIO.gap == cell.gap
    assert SCENARIO.cameras.noise == cell.cameras.frames.noise


def test_a_row_a_case_pose_and_kind_of_image(outcome: Outcome) -> None:
    traces = outcome.traces
    assert list(traces) == ["case", "images", "trial", *STATUSES, *UNITS]
    keys = list(zip(*(traces[name].tolist() for name in ("case", "trial", "images")), strict=True))
    assert keys == [
        (case, trial, kind)
        for case in range(len(CASES))
        for trial in range(POSES)
        for kind in range(3)
    ]
    for values in traces.values():
        assert np.isfinite(values).all()
    assert len(set(traces["xz.peg.lateral"])) == len(keys)


def test_metrics_are_those_of_the_rows(outcome: Outcome) -> None:
    names = {f"{case}.{kind}" for case in CASES for kind in KINDS}
    assert set(outcome.metrics) == {f"{one}.valid" for one in names} | {
        f"{one}.{name}.{key}" for one in names for name in UNITS for key in ("rms", "max")
    }
    for case in CASES:
        for kind in KINDS:
            assert value(outcome, f"{case}.{kind}.valid") == 100
            of = rows(outcome, case, kind)
            for name, unit in UNITS.items():
                metric = f"{case}.{kind}.{name}"
                expected = math.sqrt(np.mean(of[name] ** 2))
                assert value(outcome, f"{metric}.rms") == pytest.approx(expected)
                assert value(outcome, f"{metric}.max") == np.abs(of[name]).max()
                assert outcome.metrics[f"{metric}.rms"].unit == unit
    note = outcome.metrics["wide.noisy.xz.peg.axial.rms"].note
    of = rows(outcome, "wide", "noisy")["xz.peg.axial"]
    rms = math.sqrt(np.mean(of**2))
    assert note == f"{0.5 * rms:.2g} mm at the parts, mean {of.mean():.2g} px"


def rms(outcome: Outcome, case: str, kind: str, quantity: str) -> float:
    """Return the mean of both parts and views."""
    targets = [f"{view}.{part}" for view in VIEWS for part in ("peg", "hole")]
    return float(
        np.mean([value(outcome, f"{case}.{kind}.{one}.{quantity}.rms") for one in targets])
    )


def test_accuracy(outcome: Outcome) -> None:
    for case in CASES:
        assert rms(outcome, case, "clean", "lateral") < 0.008
        assert rms(outcome, case, "clean", "angle") < 0.05e-3
        assert rms(outcome, case, "noisy", "lateral") < 0.019
        assert rms(outcome, case, "noisy", "angle") < 0.25e-3
        assert value(outcome, f"{case}.noisy.space.relative.tip.rms") < 5e-5
        assert value(outcome, f"{case}.noisy.space.relative.axis.rms") < 5e-4


def test_the_roll_matters_where_pixels_are_sampled_near_alignment(outcome: Outcome) -> None:
    assert rms(outcome, "near_straight", "sampled", "lateral") > 0.15
    assert rms(outcome, "near_straight", "sampled", "angle") > 1.5e-3
    assert rms(outcome, "near", "sampled", "lateral") < 0.05
    assert rms(outcome, "near", "sampled", "angle") < 0.8e-3
    for quantity in ("lateral", "angle"):
        straight = rms(outcome, "near_straight", "noisy", quantity)
        assert straight == pytest.approx(rms(outcome, "near", "noisy", quantity), rel=0.5)


def test_perspective_is_what_matters_without_calibration(outcome: Outcome) -> None:
    for view in VIEWS:
        wide = value(outcome, f"wide.noisy.{view}.scaled.lateral.rms")
        near = value(outcome, f"near.noisy.{view}.scaled.lateral.rms")
        assert wide > 3 * near
        assert wide == pytest.approx(
            value(outcome, f"wide.clean.{view}.scaled.lateral.rms"), rel=0.1
        )


# Poses.


def test_poses_are_within_their_reach_and_fill_it() -> None:
    spread = PoseSpread(
        peg=Reach(distance=0.01, angle=0.1), hole=Reach(distance=0.003, angle=0.03)
    )
    drawn = [draw_poses(SCENARIO.gap, spread, np.random.default_rng(k)) for k in range(300)]
    peg = [one.X_WM.inverse() @ one.X_WT for one in drawn]
    hole = [one.X_WM for one in drawn]
    for poses, middle, reach in ((peg, -0.03, spread.peg), (hole, 0.015, spread.hole)):
        places = np.array([X.translation() - [middle, 0, 0] for X in poses])
        turns = np.array([RollPitchYaw(X.rotation()).vector() for X in poses])
        for values, limit in ((places, reach.distance), (turns, reach.angle)):
            assert np.abs(values).max() <= limit + 1e-12
            assert (values.max(axis=0) > 0.95 * limit).all()
            assert (values.min(axis=0) < -0.95 * limit).all()
            np.testing.assert_allclose(values.std(axis=0), limit / math.sqrt(3), rtol=0.1)


def test_rolled_and_straight_cameras_see_the_same_poses() -> None:
    seen = {}
    for case in CASES:
        poses, images = camera_accuracy._trial(SCENARIO, 0, CASES[case], 3)
        seen[case] = [X.GetAsMatrix4() for X in poses]
        noise = images["xz"]["noisy"].astype(int) - images["xz"]["clean"]
        seen[case].append(noise[:20])  # background in both
    np.testing.assert_array_equal(seen["near"][0], seen["near_straight"][0])
    np.testing.assert_array_equal(seen["near"][1], seen["near_straight"][1])
    np.testing.assert_array_equal(seen["near"][2], seen["near_straight"][2])
    assert (seen["near"][0] != seen["wide"][0]).any()
    assert (seen["near"][2] != seen["wide"][2]).any()
    poses, _ = camera_accuracy._trial(SCENARIO, 0, CASES["near"], 4)
    other, _ = camera_accuracy._trial(SCENARIO, 1, CASES["near"], 3)
    for one in (poses, other):
        assert (one.X_WT.GetAsMatrix4() != seen["near"][0]).any()


def test_both_views_have_noise_of_their_own() -> None:
    _, images = camera_accuracy._trial(SCENARIO, 0, CASES["wide"], 0)
    noise = [images[v]["noisy"][:20].astype(int) - images[v]["clean"][:20] for v in VIEWS]
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.05


def test_a_trial_does_not_depend_on_those_before() -> None:
    def errors(seed: int, trial: int) -> bytes:
        task = camera_accuracy.Task("near", trial)
        found: bytes = camera_accuracy._detect(SCENARIO, seed, task)["errors"].tobytes()
        return found

    second = errors(0, 2)
    assert errors(0, 1) != second
    assert errors(0, 2) == second
    assert errors(1, 2) != second


@pytest.mark.slow
def test_the_number_of_workers_does_not_matter(outcome: Outcome) -> None:
    with parallel(2):
        again = run(SCENARIO, 0, quiet)
    for name, values in outcome.traces.items():
        np.testing.assert_array_equal(again.traces[name], values, strict=True)
    assert again.metrics == outcome.metrics
    for table, columns in outcome.tables.items():
        for name, values in columns.items():
            np.testing.assert_array_equal(again.tables[table][name], values, strict=True)


# What the metrics would say of a detection that is wrong.


def with_detection(
    monkeypatch: pytest.MonkeyPatch, change: Callable[[Detection], Detection]
) -> Outcome:
    found = detection_trials.detect_parts

    def wrong(image: np.ndarray, *looks: Appearance) -> tuple[Detection, Detection]:
        peg, hole = found(image, *looks)
        return change(peg), hole

    monkeypatch.setattr(detection_trials, "detect_parts", wrong)
    return run(replace(SCENARIO, poses=3), 0, quiet)


def test_half_a_pixel_too_low_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def lower(peg: Detection) -> Detection:
        (u, v), (pu, pv) = peg.tip, peg.point
        return replace(peg, tip=(u, v + 0.5), point=(pu, pv + 0.5))

    outcome = with_detection(monkeypatch, lower)
    for view in VIEWS:
        of = rows(outcome, "near_straight", "clean")
        np.testing.assert_allclose(of[f"{view}.peg.lateral"], 0.5, atol=0.02)
        np.testing.assert_allclose(of[f"{view}.error.lateral"], -0.5, atol=0.05)
        metric = outcome.metrics[f"near_straight.clean.{view}.peg.lateral.rms"]
        assert metric.value == pytest.approx(0.5, abs=0.02)
        assert "mean 0.5 px" in metric.note
        assert value(outcome, f"near_straight.clean.{view}.hole.lateral.rms") < 0.02
        scaled = value(outcome, f"near_straight.clean.{view}.scaled.lateral.rms")
        assert scaled == pytest.approx(0.25e-3, abs=0.03e-3)
    # A quarter of a millimetre too low in one view and as much aside in the other.
    tip = value(outcome, "near_straight.clean.space.peg.tip.rms")
    assert tip == pytest.approx(0.25e-3 * math.sqrt(2), rel=0.1)
    relative = value(outcome, "near_straight.clean.space.relative.tip.rms")
    assert relative == pytest.approx(0.25e-3 * math.sqrt(2), rel=0.2)


def test_parts_that_are_not_found_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = 0

    def sometimes(peg: Detection) -> Detection:
        nonlocal seen
        seen += 1
        return peg if seen % 18 != 1 else Detection(status=Status.AT_BORDER)

    # Of three poses, two views and three kinds of image the first of each case.
    outcome = with_detection(monkeypatch, sometimes)
    for case in CASES:
        assert value(outcome, f"{case}.clean.valid") == pytest.approx(100 * 2 / 3)
        assert value(outcome, f"{case}.noisy.valid") == 100
        missed = outcome.metrics[f"{case}.clean.xz.peg.lateral.rms"]
        assert missed.value is not None
        assert missed.note.endswith(", undefined in 1 of 3")
        assert "undefined" not in outcome.metrics[f"{case}.clean.xy.peg.lateral.rms"].note
        assert rows(outcome, case, "clean")["xz.peg.status"][0] == Status.AT_BORDER


def test_nothing_found_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = with_detection(monkeypatch, lambda _: Detection(status=Status.NO_COLOUR))
    assert value(outcome, "wide.noisy.valid") == 0
    metric = outcome.metrics["wide.noisy.xz.peg.angle.max"]
    assert (metric.value, metric.note) == (None, "undefined in 3 of 3")
    assert value(outcome, "wide.noisy.xz.hole.angle.max") > 0
    CAMERA_ACCURACY.plot(SCENARIO, outcome)


# The example and the figure.


def test_the_example_is_the_first_wide_pose(outcome: Outcome) -> None:
    frames, marks = outcome.tables["frames"], outcome.tables["frame_detections"]
    _, images = camera_accuracy._trial(SCENARIO, 0, CASES["wide"], 0)
    for index, view in enumerate(VIEWS):
        of = frames["view"] == index
        u, v = frames["u"][of], frames["v"][of]
        assert (u.min(), u.max(), v.min(), v.max()) == (56, 263, 72, 167)
        for channel, name in enumerate(("red", "green", "blue")):
            expected = images[view]["noisy"][v, u, channel]
            np.testing.assert_array_equal(frames[name][of], expected)
        detected = detection_trials.detect_parts(images[view]["noisy"], *LOOKS)
        for part in range(2):
            (row,) = np.nonzero((marks["view"] == index) & (marks["part"] == part))[0]
            assert (marks["tip_u"][row], marks["tip_v"][row]) == detected[part].tip
            assert (marks["point_u"][row], marks["point_v"][row]) == detected[part].point
            assert marks["angle"][row] == detected[part].angle


def test_the_figure(outcome: Outcome) -> None:
    figures = CAMERA_ACCURACY.plot(SCENARIO, outcome)
    assert set(figures) == {"camera-accuracy"}


# Mistakes.


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"poses": 0}, "poses is 0, allowed: 1 to 10000"),
        ({"poses": 10_001}, "poses is 10001, allowed: 1 to 10000"),
        ({"gap": -0.01}, "gap is -0.01, allowed: a finite number >= 0"),
    ],
)
def test_mistakes_are_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        AccuracyScenario(**values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"renderer": "gl"}, "renderer is 'gl', allowed: software, vtk"),
        ({"distance": 0.0}, "distance is 0.0, allowed: a finite number > 0"),
        ({"noise": 61.0}, "noise is 61.0, allowed: from 0 to 60"),
        ({"noise": -1.0}, "noise is -1.0, allowed: from 0 to 60"),
        ({"blur": math.inf}, "blur is inf, allowed: a finite number >= 0"),
    ],
)
def test_mistakes_in_the_cameras_are_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        AccuracyCameras(**values)


@pytest.mark.parametrize("name", ["distance", "angle"])
def test_a_reach_is_not_negative(name: str) -> None:
    given: dict[str, float] = {"distance": 0.0, "angle": 0.0} | {name: -0.5}
    with pytest.raises(ParameterError, match=rf"^{name} is -0.5, allowed: a finite number >= 0$"):
        Reach(**given)


def test_vtk_without_graphics_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    reason = "VTK can't draw here (no such thing); on Debian: apt-get install it"
    monkeypatch.setattr(camera_accuracy, "missing_graphics", lambda: reason)
    with pytest.raises(ParameterError) as caught:
        CAMERA_ACCURACY.resolve(replace(SCENARIO, cameras=AccuracyCameras(renderer="vtk")))
    assert str(caught.value) == f"cameras.renderer is 'vtk', allowed: software here: {reason}"
    assert CAMERA_ACCURACY.resolve(SCENARIO) == SCENARIO  # does not ask


@pytest.mark.slow
def test_vtk() -> None:
    reason = missing_graphics()
    if reason:
        pytest.skip(reason)
    scenario = CAMERA_ACCURACY.resolve(
        replace(SCENARIO, cameras=AccuracyCameras(renderer="vtk"), poses=5)
    )
    outcome = run(scenario, 0, quiet)
    assert set(outcome.traces["images"]) == {0.0, 1.0}
    assert value(outcome, "near.noisy.valid") == 100
    assert rms(outcome, "near", "noisy", "angle") < 1.2e-3
    assert rms(outcome, "near", "noisy", "lateral") < 0.06
    assert rms(outcome, "near_straight", "noisy", "angle") > 1.5e-3
    assert rms(outcome, "near_straight", "noisy", "lateral") > 0.1
    CAMERA_ACCURACY.plot(scenario, outcome)
