"""The study of accuracy: poses, rows, metrics, what can make them wrong, and its figure."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import Outcome, load, quiet, select
from chamfer.analysis.sight import camera_accuracy, detection_trials
from chamfer.analysis.sight.camera_accuracy import CASES, AccuracyCameras, AccuracyScenario, run
from chamfer.analysis.sight.detection_trials import STATUSES, UNITS, PoseSpread, Reach, draw_poses
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import VIEWS, camera_placement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.vtk_camera import missing_graphics
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_appearance import Appearance, appearances

CAMERA_ACCURACY = load(select(CATALOGUE.entries, ["camera-accuracy"])[0])

LOOKS = appearances(ColouredParts(), 0.0005)

POSES = 12
KINDS = ("clean", "noisy", "sampled")
SCENARIO = AccuracyScenario(poses=POSES)


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


def test_a_row_a_case_pose_and_kind_of_image(outcome: Outcome) -> None:
    traces = outcome.traces
    assert list(traces) == ["case", "images", "trial", *STATUSES, *UNITS]
    keys = np.column_stack([traces[name] for name in ("case", "trial", "images")])
    np.testing.assert_array_equal(keys, list(np.ndindex(len(CASES), POSES, 3)))
    assert all(np.isfinite(values).all() for values in traces.values())
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


@pytest.mark.parametrize("case", CASES)
def test_accuracy(outcome: Outcome, case: str) -> None:
    for kind, lateral, angle in (("clean", 0.008, 0.05e-3), ("noisy", 0.019, 0.25e-3)):
        assert rms(outcome, case, kind, "lateral") < lateral
        assert rms(outcome, case, kind, "angle") < angle
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
    def seen(case: str, seed: int = 0, trial: int = 3) -> tuple[np.ndarray, np.ndarray]:
        poses, images = camera_accuracy._trial(SCENARIO, seed, CASES[case], trial)
        noise = images["xz"]["noisy"].astype(int) - images["xz"]["clean"]
        return np.array([X.GetAsMatrix4() for X in poses]), noise[:20]  # of the background

    poses, noise = seen("near")
    for found, expected in zip(seen("near_straight"), (poses, noise), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert (seen("wide")[1] != noise).any()
    for other, _ in (seen("wide"), seen("near", trial=4), seen("near", seed=1)):
        assert (other != poses).any()


def with_detection(
    monkeypatch: pytest.MonkeyPatch, change: Callable[[Detection], Detection]
) -> Outcome:
    found = detection_trials.detect_parts

    def wrong(image: np.ndarray, *looks: Appearance) -> tuple[Detection, Detection]:
        peg, hole = found(image, *looks)
        return change(peg), hole

    monkeypatch.setattr(detection_trials, "detect_parts", wrong)
    return run(replace(SCENARIO, poses=3), 0, quiet)


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
        found = detection_trials.detect_parts(images[view]["noisy"], *LOOKS)
        expected = [(index, k, *one.tip, *one.point, one.angle) for k, one in enumerate(found)]
        rows = np.column_stack(list(marks.values()))[2 * index : 2 * index + 2]
        np.testing.assert_array_equal(rows, expected)


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


def test_the_cameras_are_those_of_the_work_cell() -> None:
    cell = AlignmentScenario()
    for view in VIEWS:
        there = camera_placement(cell.cameras, cell, view)
        assert SCENARIO.cameras.placement(view, there.target) == there
    assert SCENARIO.gap == cell.gap
    assert SCENARIO.cameras.noise == cell.cameras.frames.noise
