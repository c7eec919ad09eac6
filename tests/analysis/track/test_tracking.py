"""From recorded frames to a table: as good as the detection, and the same every time."""

import csv
import math
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from analysis.run.scenario_io import make_scenario
from analysis.run.traces import read_table
from analysis.track.recorded_frames import Recording, open_recording
from analysis.track.tracking import Track, TrackScenario, csv_lines, track, write_track
from models.camera import CameraPlacement
from models.peg_and_hole import ColouredParts
from models.validation import ParameterError
from systems.vision.camera_image import add_noise
from systems.vision.part_detection import Status
from systems.vision.software_camera import render

PARTS = ColouredParts()

Array = np.ndarray
CAMERA = CameraPlacement().camera
FRAMES = 12


def no_progress(fraction: float, doing: str = "") -> None:
    pass


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


def video_of(path: Path, pictures: list[Array], rate: float, code: str) -> Recording:
    size = (pictures[0].shape[1], pictures[0].shape[0])
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), rate, size)
    assert writer.isOpened()
    for rgb in pictures:
        writer.write(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    writer.release()
    return open_recording([path])


def rows(lines: Iterable[str]) -> list[dict[str, str]]:
    return list(csv.DictReader(lines))


def tips(found: Track, part: str) -> Array:
    return np.column_stack([found.table[f"{part}_tip_u"], found.table[f"{part}_tip_v"]])


# The table


def test_csv_has_the_tips_where_they_are(folder: Path) -> None:
    found = track(open_recording([folder]), TrackScenario(), progress=no_progress)
    table = rows(csv_lines(found))
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


def test_what_is_not_found_is_empty_and_says_why(folder: Path) -> None:
    found = track(open_recording([folder]), TrackScenario(), progress=no_progress)
    *_, blank, alone = rows(csv_lines(found))
    for name, text in blank.items():
        if name.endswith("_status"):
            assert text == "NO_COLOUR"
        else:
            assert (text == "") == (name not in ("frame", "file", "time"))
    assert (alone["peg_status"], alone["hole_status"]) == ("VALID", "NO_COLOUR")
    assert "" not in (alone["peg_tip_u"], alone["peg_angle"])
    assert alone["hole_tip_u"] == alone["error_along"] == alone["error_angle"] == ""
    assert found.counts() == {
        "peg": {"VALID": FRAMES + 1, "NO_COLOUR": 1},
        "hole": {"VALID": FRAMES, "NO_COLOUR": 2},
    }


def test_names_with_commas_stay_in_their_cell(tmp_path: Path) -> None:
    save(tmp_path / 'a, "b".png', picture(0))
    found = track(open_recording([tmp_path]), TrackScenario(), progress=no_progress)
    (row,) = rows(csv_lines(found))
    assert row["file"] == 'a, "b".png'
    assert row["peg_status"] == "VALID"


# A video of 320 x 240 pixels has half the resolution in its colours, which costs some accuracy.
@pytest.mark.parametrize(("code", "allowed"), [("FFV1", 0.3), ("MJPG", 0.5), ("mp4v", 0.8)])
def test_video_gives_the_same_but_for_what_it_loses(
    tmp_path: Path, code: str, allowed: float
) -> None:
    recording = video_of(tmp_path / "a.avi", [picture(k) for k in range(FRAMES)], 50.0, code)
    found = track(recording, TrackScenario(), progress=no_progress)
    np.testing.assert_allclose(found.table["time"], np.arange(FRAMES) / 50)
    for i, part in enumerate(("peg", "hole")):
        assert set(found.statuses(part)) == {Status.VALID}
        true = [tip(poses(k)[i]) for k in range(FRAMES)]
        assert np.linalg.norm(tips(found, part) - true, axis=1).max() < allowed


# What to look for


def test_other_colours_and_the_other_side(tmp_path: Path) -> None:
    parts = ColouredParts(peg_colour=(40, 205, 40), hole_colour=(205, 40, 205))
    for k in range(3):
        save(tmp_path / f"{k}.png", picture(k, parts)[:, ::-1])
    recording = open_recording([tmp_path])
    lost = track(recording, TrackScenario(), progress=no_progress)
    assert lost.counts()["peg"] == {"NO_COLOUR": 3}
    settings = ["peg.hue=85", "peg.front=-1", "hole.hue=213", "hole.front=1"]
    scenario = make_scenario(TrackScenario(), settings=settings)
    found = track(recording, scenario, progress=no_progress)
    assert found.counts() == {"peg": {"VALID": 3}, "hole": {"VALID": 3}}
    for i, part in enumerate(("peg", "hole")):
        true = np.array([tip(poses(k)[i]) for k in range(3)])
        true[:, 0] = 319 - true[:, 0]
        assert np.linalg.norm(tips(found, part) - true, axis=1).max() < 0.15


@pytest.mark.parametrize(
    ("video", "own", "given", "rate"),
    [
        (False, None, None, 80.0),
        (False, None, 30.0, 30.0),
        (True, 25.0, None, 25.0),
        (True, 25.0, 1000.0, 1000.0),
        (True, None, None, math.nan),
    ],
)
def test_rate(video: bool, own: float | None, given: float | None, rate: float) -> None:
    recording = Recording(files=(Path("a"),), video=video, rate=own)
    assert TrackScenario(rate=given).rate_of(recording) == pytest.approx(rate, nan_ok=True)


def test_a_video_without_a_rate_has_no_times(tmp_path: Path) -> None:
    recording = video_of(tmp_path / "a.avi", [picture(0)] * 2, 50.0, "MJPG")
    unknown = Recording(files=recording.files, video=True)
    found = track(unknown, TrackScenario(), overlay=tmp_path / "o.mp4", progress=no_progress)
    assert [row["time"] for row in rows(csv_lines(found))] == ["", ""]
    assert open_recording([tmp_path / "o.mp4"]).announced == 2


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan, math.inf])
def test_rates_that_are_none(rate: float) -> None:
    with pytest.raises(ParameterError, match="rate is"):
        TrackScenario(rate=rate)


# The files


def written(folder: Path, out: Path, *, video: bool = True) -> list[Path]:
    out.mkdir(exist_ok=True)
    _, paths = write_track(
        out, open_recording([folder]), TrackScenario(), video=video, progress=no_progress
    )
    return paths


def test_files_and_the_same_bytes_again(folder: Path, tmp_path: Path) -> None:
    names = ["detections.csv", "detections.parquet", "overlay.mp4"]
    first, second = written(folder, tmp_path / "a"), written(folder, tmp_path / "b")
    assert first == [tmp_path / "a" / "track" / name for name in names]
    for one, other in zip(first[:2], second[:2], strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert sorted(path.name for path in (tmp_path / "a").rglob("*")) == [*names, "track"]


def test_parquet_holds_numbers(folder: Path, tmp_path: Path) -> None:
    table = read_table(written(folder, tmp_path)[1])
    assert table["peg_status"].tolist() == [0] * FRAMES + [Status.NO_COLOUR, Status.VALID]
    assert np.isnan(table["hole_angle"][FRAMES:]).all()
    text = rows((tmp_path / "track" / "detections.csv").read_text().splitlines())
    assert list(text[0]) == ["frame", "file", *list(table)[1:]]
    for name in ("time", "peg_tip_u", "hole_point_v", "error_across"):
        expected = [float(row[name] or "nan") for row in text]
        np.testing.assert_allclose(table[name], expected, atol=5.1e-5)


def test_overlay_has_every_frame_and_marks_the_tips(folder: Path, tmp_path: Path) -> None:
    overlay = written(folder, tmp_path)[2]
    table = read_table(tmp_path / "track" / "detections.parquet")
    recording = open_recording([overlay])
    assert recording.rate == pytest.approx(80)
    frames = [frame.image.astype(int) for frame in recording.frames()]
    assert len(frames) == FRAMES + 2
    for k, image in enumerate(frames[:FRAMES]):
        for part in ("peg", "hole"):
            u = round(2 * table[f"{part}_tip_u"][k] + 0.5)
            v = round(2 * table[f"{part}_tip_v"][k] + 0.5)
            red, green, blue = image[v - 2 : v + 3, u - 2 : u + 3].reshape(-1, 3).mean(axis=0)
            if part == "peg":  # yellow
                assert min(red, green) > blue + 40
            else:  # cyan
                assert min(green, blue) > red + 40
    assert np.abs(frames[FRAMES][:470] - 200).max() < 30  # nothing in the blank one


def test_without_a_video_no_older_one_stays(folder: Path, tmp_path: Path) -> None:
    assert written(folder, tmp_path)[2].exists()
    names = ["detections.csv", "detections.parquet"]
    assert [path.name for path in written(folder, tmp_path, video=False)] == names
    assert sorted(path.name for path in (tmp_path / "track").iterdir()) == names


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_what_ends_early_leaves_everything_as_it_was(
    folder: Path, tmp_path: Path, error: type[BaseException]
) -> None:
    def stop(fraction: float, doing: str = "") -> None:
        if fraction > 0.5:
            raise error

    def files() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def attempt() -> None:
        recording = open_recording([folder])
        with pytest.raises(error):
            write_track(tmp_path, recording, TrackScenario(), video=True, progress=stop)

    attempt()
    assert list(tmp_path.iterdir()) == []
    written(folder, tmp_path)
    before = files()
    attempt()
    assert files() == before


def test_progress_says_how_far_it_is(folder: Path) -> None:
    told: list[float] = []

    def note(fraction: float, doing: str = "") -> None:
        told.append(fraction)

    track(open_recording([folder]), TrackScenario(), progress=note)
    np.testing.assert_allclose(told, np.arange(1, FRAMES + 3) / (FRAMES + 2))
