"""Learned looks: what they find, what they tell apart, and why they are refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.cli import main
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.analysis.scenario.scenario_yaml import read_mapping
from chamfer.analysis.track.learning import Box, learn, read_box
from chamfer.analysis.track.tracking import TrackScenario
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import Colour, ColouredParts
from chamfer.systems.cameras.camera_image import add_noise
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_detection import detect_parts

Array = np.ndarray
CAMERA = CameraPlacement().camera
LARGE = CameraPlacement(width=640, height=480, pixel_size=0.00025).camera
PEG, HOLE = (
    RigidTransform(RollPitchYaw(0, 0.05, 0), [-0.015, 0, 0.003]),
    RigidTransform([0.015, 0, 0]),
)
PEG_BOX, HOLE_BOX = Box(2, 80, 135, 80), Box(180, 60, 120, 115)


def picture(
    peg: Colour = (205, 40, 40),
    hole: Colour = (40, 70, 205),
    *,
    background: Colour = (200, 200, 200),
    share: float = 0.5,
) -> Array:
    parts = ColouredParts(
        peg_colour=peg, hole_colour=hole, peg_chamfer_share=share, outer_radius=0.0145
    )
    image = render(parts, CAMERA, PEG, HOLE, style=SceneStyle(background=background))
    return add_noise(image, 2.0, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("peg", "hole", "background"),
    [
        ((205, 40, 40), (40, 70, 205), (200, 200, 200)),
        ((120, 60, 50), (60, 70, 120), (150, 150, 150)),
        ((220, 30, 50), (40, 70, 205), (205, 175, 130)),  # wood
    ],
)
def test_colours_are_learned(peg: Colour, hole: Colour, background: Colour) -> None:
    image = picture(peg, hole, background=background)
    learned = learn(image, (PEG_BOX, HOLE_BOX))
    true = [CAMERA.project(pose.translation()) for pose in (PEG, HOLE)]
    found = np.array([one.tip for one in learned.found])
    assert np.linalg.norm(found - true, axis=1).max() < 0.3
    for part, colour in zip(learned.looks, (peg, hole), strict=True):
        hue = int(cv2.cvtColor(np.array([[colour]], np.uint8), cv2.COLOR_RGB2HSV_FULL)[0, 0, 0])
        assert abs((part.hue - hue + 128) % 256 - 128) <= 3
    # Neither is found without the other one's place: nothing else looks like it.
    alone = image.copy()
    PEG_BOX.around(2).cut(alone)[:] = background
    assert detect_parts(alone, *learned.looks)[0].status == Status.NO_COLOUR


def test_a_mirrored_picture_turns_the_tips() -> None:
    image = np.ascontiguousarray(picture()[:, ::-1])
    boxes = [box._replace(x=320 - box.x - box.width) for box in (PEG_BOX, HOLE_BOX)]
    learned = learn(image, (boxes[0], boxes[1]))
    assert [part.front for part in learned.looks] == [-1, 1]


@pytest.mark.parametrize("share", [0.0, 0.25, 0.8])
def test_the_shape_of_the_end_is_learned(share: float) -> None:
    parts = ColouredParts(peg_chamfer_share=share, outer_radius=0.0145)
    image = add_noise(render(parts, LARGE, PEG, HOLE), 2.0, np.random.default_rng(1))
    doubled = [Box(*(2 * number for number in box)) for box in (PEG_BOX, HOLE_BOX)]
    peg, hole = learn(image, (doubled[0], doubled[1])).looks
    true = parts.peg
    assert peg.end_ratio == pytest.approx(1 - true.chamfer.width / true.radius, abs=0.03)
    assert (peg.end_angle is None) == (share == 0)
    assert peg.end_angle is None or peg.end_angle == pytest.approx(np.pi / 4, abs=0.06)
    assert (hole.end_ratio, hole.end_angle) == (1.0, None)


@pytest.mark.parametrize("cut", [3, 8, 20])
@pytest.mark.parametrize("slant", [-0.2, 0.0, 0.4])
def test_a_cover_over_the_tip_is_not_taken_for_the_tip(cut: int, slant: float) -> None:
    image = picture()
    learned = learn(image, (PEG_BOX, HOLE_BOX))
    u, v = np.meshgrid(np.arange(320), np.arange(240))
    tip = CAMERA.project(PEG.translation())
    covered = (u > tip[0] - cut + slant * (v - tip[1])) & (u < 160)
    image[covered] = (200, 200, 200)
    assert detect_parts(image, *learned.looks)[0].status != Status.VALID


def test_sizes_have_room_for_other_distances_and_no_more() -> None:
    peg, hole = learn(picture(), (PEG_BOX, HOLE_BOX)).looks
    radius = 0.009779 / 0.0005
    assert peg.half_width is not None
    assert peg.half_width == pytest.approx((radius / 1.5, radius * 1.5), rel=0.06)
    assert hole.aspect is not None
    assert hole.aspect[0] < 0.04 / 0.029 < hole.aspect[1]
    assert peg.aspect is not None
    assert peg.aspect[0] < 0.06 / 0.01956 < peg.aspect[1]
    cut = learn(picture()[:, 20:], (PEG_BOX._replace(x=0, width=117), HOLE_BOX._replace(x=160)))
    assert cut.looks[0].aspect is None  # it goes on beyond the picture
    near = CameraPlacement(pixel_size=0.00022).camera
    parts = ColouredParts(outer_radius=0.0145)
    found = detect_parts(render(parts, near, PEG, HOLE), peg, hole)
    assert {one.status for one in found} <= {Status.WRONG_SIZE, Status.AT_BORDER}


WHAT = "allowed: a coloured part with something else above, below and before its tip"


@pytest.mark.parametrize(
    ("peg", "hole", "said"),
    [
        (
            Box(2, 80, 135, 400),
            HOLE_BOX,
            "the peg's box 2,80,135,400 is not within the picture of",
        ),
        (HOLE_BOX, PEG_BOX, ""),
        (PEG_BOX, Box(100, 60, 200, 115), "the boxes have columns in common"),
        (Box(2, 2, 130, 60), HOLE_BOX, f"the peg's box holds no colour .* as well, {WHAT}"),
        (Box(2, 80, 60, 80), HOLE_BOX, f"the peg's colour reaches to the edge of its box, {WHAT}"),
        (PEG_BOX, Box(180, 100, 120, 50), "the hole part's colour reaches to the edge of its box"),
        (Box(2, 80, 60, 80), Box(70, 80, 67, 80), r"nearly the same hue, .* of 256, allowed: 22 "),
    ],
)
def test_boxes_that_are_refused(peg: Box, hole: Box, said: str) -> None:
    if not said:  # exchanged names are no mistake that can be seen
        assert learn(picture(), (peg, hole)).looks[0].hue > 100
        return
    with pytest.raises(UserError, match=said) as raised:
        learn(picture(), (peg, hole))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "text", ["", "1,2,3", "1,2,3,4,5", "-1,2,30,40", "a,b,c,d", "1.5,2,30,40"]
)
def test_texts_that_are_no_box(text: str) -> None:
    with pytest.raises(UserError, match=r"--peg-box is .*, allowed: x,y,w,h in pixels"):
        read_box(text, "--peg-box")
    with pytest.raises(UserError, match="allowed: at least 12 x 12 pixels"):
        read_box("0,0,11,12", "--peg-box")


@pytest.fixture
def learn_from(tmp_path: Path) -> list[str]:
    path = tmp_path / "a picture.png"
    assert cv2.imwrite(str(path), cv2.cvtColor(picture(), cv2.COLOR_RGB2BGR))
    boxes = [",".join(map(str, box)) for box in (PEG_BOX, HOLE_BOX)]
    return ["track", "--learn", str(path), "--peg-box", boxes[0], "--hole-box", boxes[1]]


@pytest.mark.slow
def test_what_is_written_is_a_scenario_of_track(
    learn_from: list[str], out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*learn_from, "--out", str(out)]) == 0
    written = [out / "track" / name for name in ("parts.yaml", "parts.png")]
    assert capsys.readouterr() == ("".join(f"{path}\n" for path in written), "")
    learned = learn(picture(), (PEG_BOX, HOLE_BOX))
    scenario = make_scenario(TrackScenario(), given=read_mapping(written[0]))
    assert (scenario.peg, scenario.hole) == learned.looks
    image = learn_from[2]
    assert main(["track", image, "--scenario", str(written[0]), "--out", str(out)]) == 0
    assert "both parts valid in 1" in capsys.readouterr().out
    assert written[0].exists()  # tracking does not take it away
    assert main([*learn_from, "--out", str(out)]) == 0
    assert capsys.readouterr().err == f"chamfer: {written[0]} is replaced\n"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (["frames"], "FILES and --learn are given, allowed: one of them"),
        (["--set", "peg.hue=3"], "--set and --learn are given, allowed: one of them"),
        (None, "--learn is given without --hole-box"),
    ],
)
def test_options_that_learning_does_not_take(
    learn_from: list[str],
    out: Path,
    capsys: pytest.CaptureFixture[str],
    change: list[str] | None,
    said: str,
) -> None:
    given = learn_from[:5] if change is None else [*learn_from, *change]
    assert main([*given, "--out", str(out)]) == 2
    assert capsys.readouterr() == ("", f"chamfer: {said}\n")
    assert not out.exists()


def test_what_is_not_found_again_is_refused_with_the_reason() -> None:
    image = picture()
    bar = image[150:210, 2:136]
    bar[:] = (205, 40, 40)  # more of the peg's colour elsewhere
    with pytest.raises(UserError, match=r"the peg is (not found again|found outside its box)"):
        learn(image, (Box(2, 80, 135, 66), HOLE_BOX))
