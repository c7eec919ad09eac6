"""The command ``chamfer track``: what it prints, and every mistake in one line."""

import csv
import json
import os
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest

from chamfer.analysis.cli import main
from chamfer.analysis.track import tracking
from chamfer.analysis.track.frame_source import open_recording


def test_track(frames: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", str(frames), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines() == [
        "11 frames, 320 x 240 pixels, 80 frames/s, both parts valid in 9",
        "  peg         9  valid",
        "  peg         1  occluded: no background beyond its end",
        "  peg         1  lost: too few pixels of its colour",
        "  hole part  10  valid",
        "  hole part   1  lost: too few pixels of its colour",
        f"{out}/track/detections.csv",
        f"{out}/track/detections.parquet",
        f"{out}/track/overlay.webm",
    ]
    assert printed.err == ""


def test_track_as_json(frames: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["track", str(frames), "--out", str(out), "--json", "--rate", "40", "--no-video"]
    assert main([*arguments, "--set", "hole.hue=85"]) == 0
    document = json.loads(capsys.readouterr().out)
    scenario = document.pop("scenario")
    assert (scenario["peg"]["hue"], scenario["hole"]["hue"], scenario["rate"]) == (0, 85, 40.0)
    assert document == {
        "frames": 11,
        "announced_frames": None,
        "unpaired_frames": 0,
        "missed_frames": 0,
        "interrupted": False,
        "fault": None,
        "width": 320,
        "height": 240,
        "rate": 40.0,
        "both_valid": 0,
        "statuses": {
            "peg": {"VALID": 9, "OCCLUDED": 1, "NO_COLOUR": 1},
            "hole": {"NO_COLOUR": 11},
        },
        "files": [f"{out}/track/detections.csv", f"{out}/track/detections.parquet"],
    }


def test_names_that_are_no_text_or_could_be_formulas(
    frames: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = (frames / "frame0.png").read_bytes()
    names = (b"=1+1.png", b"@sum.png", b'a, "b".png', b"a\xff.png")
    for name in names:
        Path(os.fsdecode(os.fsencode(frames.parent) + b"/" + name)).write_bytes(picture)
    files = [os.fsdecode(os.fsencode(frames.parent) + b"/" + name) for name in names]
    assert main(["track", *files, "--out", str(out)]) == 0
    assert capsys.readouterr().err == ""
    with (out / "track" / "detections.csv").open(newline="", encoding="utf-8") as text:
        assert [row["file"] for row in csv.DictReader(text)] == [
            "'=1+1.png",
            "'@sum.png",
            'a, "b".png',
            "a\\xff.png",
        ]
    assert main(["track", *files, "--out", str(out), "--no-video"]) == 0
    assert capsys.readouterr().err == f"chamfer: files in {out}/track are replaced\n"


@pytest.mark.parametrize(
    ("options", "status"),
    [
        (["--rate", "80"], "JUMPED"),
        (["--rate", "10"], "VALID"),  # it may have got there
        (["--rate", "80", "--set", "continuity.speed=1e4"], "VALID"),
        ([], "VALID"),  # images may be of any time
    ],
)
def test_a_part_that_jumps_is_refused_where_times_are_known(
    tmp_path: Path,
    out: Path,
    picture: Callable[[Path, float], None],
    options: list[str],
    status: str,
) -> None:
    folder = tmp_path / "jumping"
    folder.mkdir()
    for k, gap in enumerate((0.02, 0.02, 0.06, 0.02)):
        picture(folder / f"{k}.png", gap)
    assert main(["track", str(folder), *options, "--out", str(out), "--no-video"]) == 0
    with (out / "track" / "detections.csv").open(newline="") as text:
        rows = list(csv.DictReader(text))
    assert [row["peg_status"] for row in rows] == ["VALID", "VALID", status, "VALID"]
    assert {row["hole_status"] for row in rows} == {"VALID"}
    jumped = rows[2]["peg_reason"]
    assert jumped == ("" if status == "VALID" else "lost: too far from its last place")


def test_one_frame_and_a_video_that_was_cut_off(
    film: Callable[..., Path], frames: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", str(frames / "frame0.png"), "--out", str(out)]) == 0
    assert capsys.readouterr().out.startswith("1 frame, 320 x 240 pixels")

    pictures = [frame.image for frame in open_recording([frames]).frames()][:10]
    path = film(frames / "cut.avi", pictures)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert main(["track", str(path), "--out", str(out)]) == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert " frames, 320 x 240 pixels, 30 frames/s, both parts valid in " in first
    assert second == "  the video announces 10 frames, the others can't be decoded"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "nothing to look at, allowed: FILES or --device"),
        (["frames", "--device", "0"], "FILES and --device are given, allowed: one of them"),
        (["frames", "--peg-box", "1,2,3,4"], "boxes are given without --learn"),
        (["frames", "--save-frames"], "--save-frames is given without --device"),
        (
            ["--device", "0", "--rate", "9"],
            "rate is 9, allowed: null with --device, whose frames have times",
        ),
        (
            ["frames", "--frames", "0"],
            "--frames is '0', allowed: a whole number from 1 to 999999999",
        ),
        (
            ["frames", "--rate", "0"],
            "rate is 0.0, allowed: a number from 0.0001 to 1e+06, or null",
        ),
        (["frames", "--rate", "9", "--set", "rate=8"], "rate is set twice"),
        (
            ["frames", "--set", "peg.front=0"],
            "peg.front is 0, allowed: 1, -1",
        ),
    ],
)
def test_mistakes_end_in_one_line_before_anything_is_made(
    frames: Path,
    out: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(frames.parent)
    assert main(["track", *arguments, "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == f"chamfer: {message}\n"
    assert not out.exists()


def test_a_frame_that_cannot_be_read_ends_it_and_keeps_what_was_found(
    frames: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = frames / "frame5.png"
    path.write_text("no image")
    assert main(["track", str(frames), "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert printed.out.startswith("5 frames")
    assert printed.err == (
        f"chamfer: {path} can't be decoded, allowed: an image that is whole, what was found in 5 "
        "frames is kept\n"
    )
    with (out / "track" / "detections.csv").open(newline="") as text:
        assert len(list(csv.DictReader(text))) == 5


def test_what_was_found_until_ctrl_c_is_kept(
    frames: Path, out: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = iter(range(99))
    monkeypatch.setattr(tracking, "stop_request", lambda: nullcontext(lambda: next(asked) >= 3))
    assert main(["track", str(frames), "--out", str(out), "--no-video"]) == 130
    printed = capsys.readouterr()
    assert printed.out.startswith("3 frames")
    assert printed.err.startswith("chamfer: interrupted, what was found in 3 frames")


def test_a_folder_that_cannot_be_written(
    frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.touch()
    assert main(["track", str(frames), "--out", str(file)]) == 2
    assert "which can't be written (Not a directory)" in capsys.readouterr().err
    (tmp_path / "out" / "track" / "overlay.webm").mkdir(parents=True)  # in the way of the video
    assert main(["track", str(frames), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"chamfer: {tmp_path / 'out'} can't be written: ")
    assert said.count("\n") == 1
