"""Frames from folders, files and videos, and the one line where there are none."""

import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.frame_source import IMAGE_ENDINGS, open_recording

Array = np.ndarray
Film = Callable[..., Path]
FORMS = "an image folder, image files or one video file"


def plain(level: int, width: int = 32, height: int = 24) -> Array:
    return np.full((height, width, 3), level, np.uint8)


def write(path: Path, bgr: Array | None = None) -> Path:
    assert cv2.imwrite(str(path), plain(100) if bgr is None else bgr)
    return path


def mistake(*paths: Path) -> str:
    """Return what is said where the frames are opened or read."""
    with pytest.raises(UserError) as raised:
        list(open_recording(paths).frames())
    message = str(raised.value)
    assert "\n" not in message
    return message


def test_folder_in_natural_order_without_other_files(tmp_path: Path) -> None:
    for name in ("frame10.png", "frame2.png", "frame1.PNG", "Frame3.jpg", "frame02.bmp"):
        write(tmp_path / name)
    for name in ("notes.txt", "movie.mp4", ".hidden.png", "._frame1.png"):
        (tmp_path / name).write_text("no image")
    (tmp_path / "frame5.png").mkdir()
    recording = open_recording([tmp_path])
    names = ["frame1.PNG", "frame02.bmp", "frame2.png", "Frame3.jpg", "frame10.png"]
    assert [frame.name for frame in recording.frames()] == names
    assert open_recording(recording.files[::-1]) == recording


def test_channels_are_red_green_blue(film: Film, tmp_path: Path) -> None:
    rgb = np.full((24, 32, 3), (200, 20, 10), np.uint8)
    picture = write(tmp_path / "a.png", rgb[..., ::-1])
    for path in (picture, film(tmp_path / "a.mp4", [rgb], code="mp4v")):
        (frame,) = open_recording([path]).frames()
        assert frame.image.shape == (24, 32, 3)
        assert frame.image.dtype == np.uint8
        np.testing.assert_allclose(frame.image[12, 16].astype(int), (200, 20, 10), atol=4)


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_other_depths_and_channels(tmp_path: Path, ending: str) -> None:
    bgr = np.full((24, 32, 3), (10, 20, 200), np.uint8)
    path = tmp_path / f"image.{ending}"
    for pixels, rgb in (
        (bgr.astype(np.uint16) * 257, (200, 20, 10)),
        (np.dstack([bgr, np.full((24, 32), 128, np.uint8)]), (200, 20, 10)),
        (np.full((24, 32), 77, np.uint8), (77, 77, 77)),
        (np.full((24, 32), 77 * 257, np.uint16), (77, 77, 77)),
    ):
        write(path, pixels)
        (frame,) = open_recording([path]).frames()
        assert frame.image.dtype == np.uint8
        assert frame.image[3, 4].tolist() == list(rgb)


@pytest.mark.parametrize(("ending", "code"), [("mp4", "mp4v"), ("avi", "MJPG"), ("mkv", "FFV1")])
def test_video(film: Film, tmp_path: Path, ending: str, code: str) -> None:
    levels = [40, 90, 140, 190]
    recording = open_recording([film(tmp_path / f"a: b.{ending}", map(plain, levels), 80.0, code)])
    assert recording.video
    assert recording.rate == pytest.approx(80)
    assert recording.announced == 4
    for _ in range(2):  # frames can be read again
        found = [frame.image[12, 16, 1] for frame in recording.frames()]
        assert found == pytest.approx(levels, abs=4)


def test_a_path_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "no.png"
    assert mistake(path) == f"{path}: No such file or directory, allowed: {FORMS}"
    assert "File name too long" in mistake(tmp_path / ("x" * 300))


def test_a_folder_without_images(tmp_path: Path) -> None:
    (tmp_path / "movie.mp4").touch()
    endings = ", ".join(sorted(IMAGE_ENDINGS))
    assert mistake(tmp_path) == f"{tmp_path} holds no images, allowed: files that end in {endings}"


@pytest.mark.parametrize("ending", ["mp4", ""])
def test_neither_image_nor_video(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"file.{ending}"
    for content in (b"", b"hello " * 100):
        path.write_bytes(content)
        said = mistake(path)
        assert said == f"{path} can't be read as an image or as a video, allowed: {FORMS}"


def test_several_folders_or_videos(film: Film, tmp_path: Path) -> None:
    image = write(tmp_path / "a.png")
    video = film(tmp_path / "a.avi", [plain(1)])
    for paths in ([image, video], [video, image], [video, video]):
        said = f"{video} is one of several files and no image, allowed: {FORMS}"
        assert mistake(*paths) == said
    assert mistake(image, tmp_path).startswith(f"{tmp_path} is one of several")


@pytest.mark.parametrize("ending", ["png", "jpg", "tif"])
@pytest.mark.parametrize("share", [0.0, 0.9])
def test_images_that_are_not_whole(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], ending: str, share: float
) -> None:
    path = tmp_path / f"image.{ending}"
    write(path, np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert mistake(path) == f"{path} can't be decoded, allowed: an image that is whole"
    assert capfd.readouterr().err == ""


def test_nothing_of_the_decoders_reaches_the_terminal(
    film: Film, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = film(tmp_path / "a.mp4", [plain(1)] * 5, code="mp4v")
    path.write_bytes(path.read_bytes()[:400])
    capfd.readouterr()
    assert "can't be read" in mistake(path)
    os.mkfifo(tmp_path / "pipe")  # is not waited for
    assert "can't be read as an image or as a video" in mistake(tmp_path / "pipe")
    os.write(2, b"still there")
    assert capfd.readouterr().err == "still there"


def test_frames_of_different_sizes(tmp_path: Path) -> None:
    write(tmp_path / "1.png")
    write(tmp_path / "2.png", plain(1, width=40))
    assert mistake(tmp_path) == (
        "2.png is 40 x 24 pixels, allowed: 32 x 24 as the first one (1.png)"
    )
    small = write(tmp_path / "0.png", plain(1, height=15))
    assert mistake(small) == "0.png is 32 x 15 pixels, allowed: at least 16 x 16"
