"""Photographs with no parts in them: nothing in them is ever taken for one."""

from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform

from chamfer.analysis.track.learning import Box, learn
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG
from chamfer.systems.vision.part_detection import detect_parts

SPEC = find_spec("skimage")
DATA = Path(SPEC.origin or "").parent / "data" if SPEC is not None else Path()
pytestmark = pytest.mark.skipif(SPEC is None, reason="needs the extra photographs")

# In which there is much of a part's colour, or there are long straight edges.
TELLING = (
    *("astronaut.png", "brick.png", "cell.png", "chelsea.png", "coffee.png", "color.png"),
    *("ihc.png", "motorcycle_left.png", "page.png", "retina.jpg", "rocket.jpg"),
)


@pytest.mark.parametrize("learned", [False, True])
def test_nothing_is_believed_in_telling_photographs(learned: bool) -> None:
    looks = PEG, HOLE_PART
    if learned:
        pair = RigidTransform([-0.015, 0, 0.003]), RigidTransform([0.015, 0, 0])
        parts = ColouredParts(peg_colour=(205, 40, 40), hole_colour=(40, 70, 205))
        image = render(parts, CameraPlacement().camera, *pair)
        looks = learn(image, (Box(2, 80, 135, 80), Box(180, 60, 120, 115))).looks
    for name in TELLING:
        photograph = cv2.imread(str(DATA / name), cv2.IMREAD_COLOR)
        assert photograph is not None
        rgb = cv2.cvtColor(photograph, cv2.COLOR_BGR2RGB)
        for upright in (rgb, np.ascontiguousarray(np.rot90(rgb))):
            area = cv2.INTER_AREA if upright.shape[1] > 320 else cv2.INTER_LINEAR
            frame = cv2.resize(upright, (320, 240), interpolation=area).astype(np.uint8)
            assert all(one.status.lost for one in detect_parts(frame, *looks)), name
