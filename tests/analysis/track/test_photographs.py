"""Photographs with no parts in them: nothing in them is ever taken for one."""

import json
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform

from chamfer.analysis.cli import main
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import Colour, ColouredParts
from chamfer.systems.cameras.software_camera import render

Array = np.ndarray
SPEC = find_spec("skimage")
DATA = Path(SPEC.origin or "").parent / "data" if SPEC is not None else Path()
pytestmark = pytest.mark.skipif(SPEC is None, reason="needs the extra photographs")

# In which there is much of a part's colour, or there are long straight edges.
TELLING = (
    *("astronaut.png", "brick.png", "cell.png", "chelsea.png", "coffee.png", "color.png"),
    *("ihc.png", "motorcycle_left.png", "page.png", "retina.jpg", "rocket.jpg"),
)
COLOURS: tuple[Colour, Colour] = ((205, 40, 40), (40, 70, 205))


def learned(folder: Path, colours: tuple[Colour, Colour]) -> list[str]:
    """Return the options for what parts of some colours look like, as learned from a picture."""
    parts = ColouredParts(peg_colour=colours[0], hole_colour=colours[1])
    pair = RigidTransform([-0.015, 0, 0.003]), RigidTransform([0.015, 0, 0])
    image = render(parts, CameraPlacement().camera, *pair)
    assert cv2.imwrite(str(folder / "parts.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    boxes = ["--peg-box", "2,80,135,80", "--hole-box", "180,60,120,115"]
    arguments = ["track", "--learn", str(folder / "parts.png"), *boxes, "--out", str(folder)]
    assert main(arguments) == 0
    return ["--scenario", str(folder / "track" / "parts.yaml")]


def believed(frames: Path, looks: list[str], capsys: pytest.CaptureFixture[str]) -> int:
    """Return how many parts are believed to be seen in the frames of a folder."""
    capsys.readouterr()
    arguments = ["track", str(frames), *looks, "--no-video", "--json"]
    assert main([*arguments, "--out", str(frames / "out")]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["frames"] == len(list(frames.glob("*.png")))
    return sum(
        count
        for counts in document["statuses"].values()
        for status, count in counts.items()
        if status in ("VALID", "OCCLUDED")
    )


def write(folder: Path) -> Path:
    """Write the photographs as frames, each upright and turned by a quarter."""
    folder.mkdir()
    for name in TELLING:
        image = cv2.imread(str(DATA / name), cv2.IMREAD_COLOR)
        assert image is not None
        for turned in (False, True):
            frame = np.ascontiguousarray(np.rot90(image)) if turned else image
            smaller = frame.shape[1] > 320
            frame = cv2.resize(
                frame, (320, 240), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
            )
            assert cv2.imwrite(str(folder / f"{name}{'-turned' * turned}.png"), frame)
    return folder


@pytest.mark.parametrize("colours", [None, COLOURS])
def test_nothing_is_believed_in_telling_photographs(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    colours: tuple[Colour, Colour] | None,
) -> None:
    looks = [] if colours is None else learned(tmp_path, colours)
    assert believed(write(tmp_path / "frames"), looks, capsys) == 0
