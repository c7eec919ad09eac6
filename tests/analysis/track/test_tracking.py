"""From recorded frames to a table: as good as the detection, and the same every time."""

import math
import signal
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.report.traces import read_table
from chamfer.analysis.scenario.experiment import Progress, quiet
from chamfer.analysis.track.frame_source import Recording, open_recording
from chamfer.analysis.track.part_finder import PartFinder
from chamfer.analysis.track.tracking import (
    SynchronisedFrames,
    Track,
    TrackScenario,
    stop_request,
    write_track,
)
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import add_noise
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Status

PARTS = ColouredParts()

Array = np.ndarray
CAMERA = CameraPlacement().camera
FRAMES = 12

Film = Callable[..., Path]
Rows = Callable[[Path], list[dict[str, str]]]


def poses(k: int) -> tuple[RigidTransform, RigidTransform]:
    """Return the poses in frame k: the peg comes closer and turns, the hole part sinks."""
    peg = RigidTransform(RollPitchYaw(0.3, 0.05 - 0.004 * k, 0.02), [-0.03 + 0.001 * k, 0, 0.002])
    hole = RigidTransform(RollPitchYaw(0, -0.03, 0.01), [0.02, 0.001, 0.003 - 0.0004 * k])
    return peg, hole


def picture(k: int, parts: ColouredParts = PARTS) -> Array:
    """Return frame k, red, green, blue."""
    return add_noise(render(parts, CAMERA, *poses(k)), 2.0, np.random.default_rng(k))


def tip(pose: RigidTransform) -> Array:
    return CAMERA.project(pose.translation())


def save(path: Path, rgb: Array) -> None:
    assert cv2.imwrite(str(path), cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames of both parts; the last but one is blank, the last one has no hole part."""
    folder = tmp_path_factory.mktemp("frames")
    for k in range(FRAMES):
        save(folder / f"frame{k}.png", picture(k))
    save(folder / f"frame{FRAMES}.png", np.full((240, 320, 3), 200, np.uint8))
    save(folder / f"frame{FRAMES + 1}.png", render(PARTS, CAMERA, poses(0)[0], None))
    return folder


def run(
    out: Path,
    recording: Recording,
    *,
    video: bool = False,
    limit: int | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress = quiet,
) -> tuple[Track, list[Path]]:
    out.mkdir(exist_ok=True)
    scenario = TrackScenario()
    return write_track(
        out,
        SynchronisedFrames([recording], scenario.rate_of(recording), limit),
        PartFinder(scenario.peg, scenario.hole),
        video=video,
        stopped=stopped,
        progress=progress,
    )


def tips(found: Track, part: str) -> Array:
    return np.column_stack([found.table[f"{part}_tip_u"], found.table[f"{part}_tip_v"]])


def test_csv_has_the_tips_where_they_are(rows: Rows, folder: Path, tmp_path: Path) -> None:
    run(tmp_path, open_recording([folder]))
    table = rows(tmp_path)
    assert [row["file"] for row in table] == [f"frame{k}.png" for k in range(FRAMES + 2)]
    assert [int(row["frame"]) for row in table] == list(range(FRAMES + 2))
    assert [float(row["time"]) for row in table] == [k / 80 for k in range(FRAMES + 2)]
    for k, row in enumerate(table[:FRAMES]):
        for part, X_WP in zip(("peg", "hole"), poses(k), strict=True):
            assert row[f"{part}_status"] == "VALID"
            at = [float(row[f"{part}_tip_u"]), float(row[f"{part}_tip_v"])]
            assert math.dist(at, tip(X_WP)) < 0.1
            du, dv = CAMERA.project((X_WP @ RigidTransform([1e-6, 0, 0])).translation()) - tip(
                X_WP
            )
            assert float(row[f"{part}_angle"]) == pytest.approx(math.atan2(dv, du), abs=5e-4)
        # The error is that of the parts, along and across the hole's axis.
        gap, angle = tip(poses(k)[1]) - tip(poses(k)[0]), float(row["hole_angle"])
        way = np.array([math.cos(angle), math.sin(angle)])
        assert float(row["error_along"]) == pytest.approx(gap @ way, abs=0.15)
        assert float(row["error_across"]) == pytest.approx(gap @ [-way[1], way[0]], abs=0.1)
        turned = angle - float(row["peg_angle"])
        assert float(row["error_angle"]) == pytest.approx(turned, abs=2e-6)


def test_what_is_not_found_is_empty_and_says_why(rows: Rows, folder: Path, tmp_path: Path) -> None:
    found, _ = run(tmp_path, open_recording([folder]))
    *_, blank, alone = rows(tmp_path)
    for name, text in blank.items():
        if name.endswith("_status"):
            assert text == "NO_COLOUR"
        elif name.endswith("_reason"):
            assert text == "lost: too few pixels of its colour"
        else:
            assert (text == "") == (name not in ("frame", "file", "time"))
    assert (alone["peg_status"], alone["hole_status"]) == ("VALID", "NO_COLOUR")
    assert (alone["peg_reason"], alone["hole_reason"]) == (
        "",
        "lost: too few pixels of its colour",
    )
    assert "" not in (alone["peg_tip_u"], alone["peg_angle"])
    assert alone["hole_tip_u"] == alone["error_along"] == alone["error_angle"] == ""
    assert found.counts() == {
        "peg": {"VALID": FRAMES + 1, "NO_COLOUR": 1},
        "hole": {"VALID": FRAMES, "NO_COLOUR": 2},
    }
    assert (found.frames, found.both_valid) == (FRAMES + 2, FRAMES)


def test_a_video_without_a_rate_has_no_times(rows: Rows, film: Film, tmp_path: Path) -> None:
    unknown = Recording(files=(film(tmp_path / "a.avi", [picture(0)] * 2),), video=True)
    _, paths = run(tmp_path, unknown, video=True)
    assert [row["time"] for row in rows(tmp_path)] == ["", ""]
    assert open_recording([paths[2]]).announced == 2


def written(folder: Path, out: Path, *, video: bool = True) -> list[Path]:
    return run(out, open_recording([folder]), video=video)[1]


def test_parquet_holds_numbers(rows: Rows, folder: Path, tmp_path: Path) -> None:
    table = read_table(written(folder, tmp_path)[1])
    assert table["peg_status"].tolist() == [0] * FRAMES + [Status.NO_COLOUR, Status.VALID]
    assert np.isnan(table["hole_angle"][FRAMES:]).all()
    text = rows(tmp_path)
    words = {"file", "peg_reason", "hole_reason"}
    assert [name for name in text[0] if name not in words] == list(table)
    assert words < text[0].keys()
    for name in ("time", "peg_tip_u", "hole_point_v", "error_across"):
        expected = [float(row[name] or "nan") for row in text]
        np.testing.assert_allclose(table[name], expected, atol=5.1e-5)


def test_without_a_video_no_older_one_stays(folder: Path, tmp_path: Path) -> None:
    assert written(folder, tmp_path)[2].exists()
    names = ["detections.csv", "detections.parquet"]
    assert [path.name for path in written(folder, tmp_path, video=False)] == names
    assert sorted(path.name for path in (tmp_path / "track").iterdir()) == names


def after(number: int) -> Callable[[], bool]:
    """Return what stops a run after so many frames."""
    asked = iter(range(10**6))
    return lambda: next(asked) >= number


def test_what_was_found_until_a_stop_is_whole(rows: Rows, folder: Path, tmp_path: Path) -> None:
    recording = open_recording([folder])
    found, paths = run(tmp_path, recording, video=True, stopped=after(5))
    assert (found.frames, found.interrupted) == (5, True)
    whole, _ = run(tmp_path / "whole", recording, video=True)
    assert rows(tmp_path) == rows(tmp_path / "whole")[:5]
    table = read_table(paths[1])
    assert all(table[name][:5].tolist() == table[name].tolist() for name in table)
    assert len(list(open_recording([paths[2]]).frames())) == 5
    assert not whole.interrupted


def test_what_ends_at_once_leaves_everything_as_it_was(folder: Path, tmp_path: Path) -> None:
    def stop(fraction: float, doing: str = "") -> None:
        if fraction > 0.5:
            raise KeyboardInterrupt

    def files() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def attempt() -> None:
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path, open_recording([folder]), progress=stop)

    attempt()
    assert list(tmp_path.iterdir()) == []
    written(folder, tmp_path, video=False)
    before = files()
    attempt()
    assert files() == before


def test_frames_can_be_limited_and_progress_says_how_far_it_is(
    folder: Path, tmp_path: Path
) -> None:
    told: list[tuple[float, str]] = []
    found, _ = run(
        tmp_path, open_recording([folder]), limit=4, progress=lambda *one: told.append(one)
    )
    assert (found.frames, found.interrupted, found.fault) == (4, False, None)
    assert [fraction for fraction, _ in told] == [0.25, 0.5, 0.75, 1.0]
    assert told[0][1] == "frame 1, peg valid, hole part valid"
    told.clear()
    run(tmp_path, open_recording([folder]), limit=99, progress=lambda *one: told.append(one))
    assert told[-1][0] == 1.0
    assert told[-1][1].endswith("peg valid, hole part lost: too few pixels of its colour")


def test_two_recordings_end_with_the_shorter_one(folder: Path) -> None:
    longer = open_recording([folder])
    shorter = replace(longer, files=longer.files[:3])
    source = SynchronisedFrames([longer, shorter], 80.0)
    assert (source.number, source.unpaired) == (3, FRAMES - 1)
    assert [[one.name for one in frames] for frames in source.moments(lambda: False)] == [
        [f"frame{k}.png"] * 2 for k in range(3)
    ]


def test_a_disk_that_is_full_keeps_what_was_found(
    rows: Rows, folder: Path, tmp_path: Path
) -> None:
    def fail(fraction: float, doing: str = "") -> None:
        if fraction > 0.5:
            raise OSError(28, "No space left on device")

    found, paths = run(tmp_path, open_recording([folder]), progress=fail)
    assert isinstance(found.fault, OSError)
    assert len(rows(tmp_path)) == len(read_table(paths[1])["frame"]) == found.frames == 8


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_and_the_second_interrupts(sent: signal.Signals) -> None:
    # A parent that ignores interrupts, as nohup does, hands that on.
    before = signal.signal(sent, signal.default_int_handler)
    try:
        with stop_request() as stopped:
            assert not stopped()
            signal.raise_signal(sent)
            assert stopped()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(sent)
        assert signal.getsignal(sent) is signal.default_int_handler
        signal.signal(sent, signal.SIG_IGN)  # what is ignored stays ignored
        with stop_request() as stopped:
            signal.raise_signal(sent)
            assert not stopped()
    finally:
        signal.signal(sent, before)


def test_two_runs_into_one_folder_leave_the_files_of_one(
    rows: Rows, folder: Path, tmp_path: Path
) -> None:
    short = tmp_path / "short"
    short.mkdir()
    for k in range(3):
        (short / f"{k}.png").symlink_to(folder / f"frame{k}.png")
    runs = [threading.Thread(target=written, args=(one, tmp_path)) for one in (folder, short)]
    for one in runs:
        one.start()
    for one in runs:
        one.join()
    table = read_table(tmp_path / "track" / "detections.parquet")
    (video,) = (tmp_path / "track").glob("*.webm")
    assert len(rows(tmp_path)) == len(table["frame"]) == open_recording([video]).announced
    assert sorted(one.name for one in tmp_path.iterdir()) == ["short", "track"]
