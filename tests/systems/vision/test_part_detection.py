"""What is found in images: how exactly, and when nothing is to be found."""

import dataclasses
import math
from typing import Any

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import add_noise
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG, appearances
from chamfer.systems.vision.part_detection import Detection, Status, detect, detect_parts

PARTS = ColouredParts()
LOOKS = appearances(PARTS)

Array = np.ndarray
VIEWS: Any = ("xz", "xy")
POSES = 100


def pose(x: float, y: float, z: float, pitch: float = 0.0, yaw: float = 0.0) -> RigidTransform:
    """Return a pose from mm and rad."""
    return RigidTransform(RollPitchYaw(0.3, pitch, yaw), np.array([x, y, z]) / 1000)


def random_pose(generator: np.random.Generator, x: float) -> RigidTransform:
    return RigidTransform(
        RollPitchYaw(generator.uniform(-0.1, 0.1, 3)),
        np.array([x, 0, 0]) + generator.uniform(-0.01, 0.01, 3),
    )


def truth(camera: Camera, X_WP: RigidTransform) -> tuple[Array, float]:
    """Return the pixel of a part's origin and the angle of its x axis in the image."""
    origin = X_WP.translation()
    near = camera.project(origin)
    far = camera.project(origin + 1e-6 * X_WP.rotation().matrix()[:, 0])
    du, dv = far - near
    return near, math.atan2(dv, du)


def errors(detection: Detection, camera: Camera, X_WP: RigidTransform) -> list[float]:
    """Return along and across, pixels, and the angle, mrad; found minus true."""
    assert detection.status == Status.VALID
    origin, angle = truth(camera, X_WP)
    cos, sin = math.cos(angle), math.sin(angle)
    du, dv = detection.tip - origin
    return [cos * du + sin * dv, cos * dv - sin * du, (detection.angle - angle) * 1e3]


def measured(view: Any, noise: float, blur: float, roll: float = 0.1) -> Array:
    """Return the errors of the peg and the hole part, shape (2, n, 3)."""
    camera = CameraPlacement(view=view, roll=roll).camera
    generator = np.random.default_rng(7)
    found = []
    for _ in range(POSES):
        parts = random_pose(generator, -0.017), random_pose(generator, 0.017)
        image = render(PARTS, camera, *parts, style=SceneStyle(blur=blur))
        if noise:
            image = add_noise(image, noise, generator)
        found.append(
            [
                errors(detection, camera, X_WP)
                for detection, X_WP in zip(detect_parts(image, *LOOKS), parts, strict=True)
            ]
        )
    return np.moveaxis(np.array(found), 1, 0)


def rms(values: Array) -> Array:
    return np.sqrt((values**2).mean(axis=-2))


@pytest.mark.parametrize("view", VIEWS)
def test_accuracy_without_noise(view: Any) -> None:
    peg, hole = measured(view, noise=0.0, blur=0.7)
    assert (rms(peg) < [0.04, 0.008, 0.02]).all()
    # Of a wide part the middle between the edges is not quite the axis, in perspective.
    assert (rms(hole) < [0.07, 0.016, 0.06]).all()
    assert (np.abs(peg).max(axis=0) < [0.1, 0.02, 0.08]).all()
    assert (np.abs(hole).max(axis=0) < [0.15, 0.04, 0.2]).all()


@pytest.mark.parametrize("view", VIEWS)
def test_accuracy_with_noise(view: Any) -> None:
    peg, hole = measured(view, noise=4.0, blur=0.7)
    assert (rms(peg) < [0.08, 0.02, 0.15]).all()
    assert (rms(hole) < [0.1, 0.02, 0.3]).all()
    # No bias beyond three standard errors and what there is without noise.
    for part, bias in ((peg, [0.04, 0.006, 0.02]), (hole, [0.07, 0.012, 0.06])):
        allowed = 3 * part.std(axis=0) / math.sqrt(POSES) + bias
        assert (np.abs(part.mean(axis=0)) < allowed).all()


def test_accuracy_without_blur() -> None:
    peg, hole = measured("xz", noise=0.0, blur=0.0)
    assert (rms(peg) < [0.06, 0.008, 0.02]).all()
    assert (rms(hole) < [0.07, 0.016, 0.06]).all()


@pytest.mark.parametrize("face", [0.5, 0.85, 1.0])
def test_shade_of_the_end_face_does_not_move_the_tip(face: float) -> None:
    camera = CameraPlacement().camera
    for yaw in (-0.2, 0.2):
        X_WT, X_WM = pose(-15, 0, 0, 0, yaw), pose(15, 0, 0, 0, yaw)
        image = render(PARTS, camera, X_WT, X_WM, style=SceneStyle(face=face))
        for detection, X_WP in zip(detect_parts(image, *LOOKS), (X_WT, X_WM), strict=True):
            along, across, _ = errors(detection, camera, X_WP)
            assert abs(along) < 0.2
            assert abs(across) < 0.03


def unfiltered(roll: float) -> Array:
    """Return errors of the peg's angle, mrad, where a pixel is all peg or all background.

    As of a camera that samples a point of each pixel, for tilts of up to 5 mrad in the image.
    """
    camera = CameraPlacement(roll=roll).camera
    generator = np.random.default_rng(3)
    found = []
    for _ in range(40):
        X_WT = pose(*generator.uniform(-5, 5, 3), pitch=generator.uniform(-0.005, 0.005))
        image = render(PARTS, camera, X_WT, None, style=SceneStyle(blur=0.0, face=1.0))
        image[...] = np.where(image[..., 1:2] < 120, (205, 40, 40), (200, 200, 200))
        found.append(errors(detect(image, PEG), camera, X_WT)[2])
    return np.array(found)


def test_roll_keeps_edges_of_aligned_parts_from_aliasing() -> None:
    rolled, straight = unfiltered(0.1), unfiltered(0.0)
    assert rms(rolled[:, np.newaxis])[0] < 0.6
    assert rms(straight[:, np.newaxis])[0] > 1.5


def test_point_is_on_the_axis_within_what_is_seen() -> None:
    camera = CameraPlacement().camera
    X_WT = pose(-15, 2, 3, 0.1, 0.05)
    detection = detect(render(PARTS, camera, X_WT, None), PEG)
    du, dv = np.subtract(detection.point, detection.tip)
    assert math.atan2(-dv, -du) == pytest.approx(detection.angle, abs=1e-9)
    assert 40 < math.hypot(du, dv) < 80  # pixels, of about 120


# Occluded


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize(
    ("tip", "X_WM"),
    [
        (10, pose(15, 0, 0)),
        (1, pose(-15, 0, 0)),
        (10, pose(0, 0, 0, -0.2, 0.3)),
        (25, pose(0, 0, 0, 0.3, -0.2)),
    ],
)
def test_peg_in_the_hole_is_occluded_and_its_axis_is_not(
    view: Any, tip: float, X_WM: RigidTransform
) -> None:
    camera = CameraPlacement(view=view).camera
    X_WT = X_WM @ RigidTransform([tip / 1000, 0, 0])
    image = add_noise(render(PARTS, camera, X_WT, X_WM), 4.0, np.random.default_rng(0))
    peg, hole = detect_parts(image, *LOOKS)
    assert peg.status == Status.OCCLUDED
    assert not peg.status.lost
    assert np.isnan(peg.tip).all()
    origin, angle = truth(camera, X_WT)
    assert peg.angle == pytest.approx(angle, abs=1.5e-3)
    du, dv = peg.point - origin
    assert math.cos(angle) * dv - math.sin(angle) * du == pytest.approx(0, abs=0.1)
    # The mouth is seen beside the peg.
    along, across, turned = errors(hole, camera, X_WM)
    assert abs(along) < 1.0
    assert abs(across) < 0.1
    assert abs(turned) < 1.5


def test_peg_behind_the_hole_part_is_occluded() -> None:
    X_WT, X_WM = pose(0, 30, 3), pose(-5, 0, 0)
    behind, beside = (
        detect_parts(render(PARTS, CameraPlacement(view=view).camera, X_WT, X_WM), *LOOKS)
        for view in VIEWS
    )
    assert behind[0].status == Status.OCCLUDED
    assert beside[0].status == Status.VALID


def test_gap_between_tip_and_mouth() -> None:
    camera = CameraPlacement().camera
    gaps = {
        gap: detect_parts(render(PARTS, camera, pose(-gap / 2, 0, 0), pose(gap / 2, 0, 0)), *LOOKS)
        for gap in (0.5, 1.0, 3.0, 4.0, 6.0, 30.0)
    }
    for gap, (peg, hole) in gaps.items():
        if gap >= 3:
            assert peg.status == hole.status == Status.VALID
            assert math.dist(peg.tip, hole.tip) == pytest.approx(gap / 0.5, abs=0.1)
        else:
            assert peg.status == Status.OCCLUDED


@pytest.mark.parametrize("colour", [(0, 0, 0), (60, 160, 60), (90, 90, 90)])
@pytest.mark.parametrize("reach", [0.5, 1.0])
def test_something_else_before_the_tip(colour: tuple[int, int, int], reach: float) -> None:
    camera = CameraPlacement(roll=0.0).camera
    X_WT = pose(0, 0, 0)
    image = render(PARTS, camera, X_WT, None)
    (u, v), _ = truth(camera, X_WT)
    top = round(v) + round(25 * (1 - 2 * reach))
    cv2.rectangle(image, (round(u) - 15, top), (round(u) + 10, round(v) + 25), colour, -1)
    detection = detect(image, PEG)
    assert detection.status == Status.OCCLUDED
    assert detection.angle == pytest.approx(0, abs=1e-3)
    assert np.isnan(detection.tip).all()


# Lost


def assert_nothing(detection: Detection, status: Status) -> None:
    assert detection.status == status
    assert status.lost
    assert np.isnan([*detection.tip, detection.angle, *detection.point]).all()


def test_blank_images() -> None:
    for level in (0, 128, 200, 255):
        for detection in detect_parts(np.full((240, 320, 3), level, np.uint8), *LOOKS):
            assert_nothing(detection, Status.NO_COLOUR)


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone(seed: int) -> None:
    generator = np.random.default_rng(seed)
    grey = add_noise(np.full((240, 320, 3), 200, np.uint8), 4.0, generator)
    strong = generator.integers(0, 256, (240, 320, 3), dtype=np.uint8)
    for image in (grey, strong):
        for detection in detect_parts(image, *LOOKS):
            assert_nothing(detection, Status.NO_COLOUR)


def test_one_part_without_the_other() -> None:
    camera = CameraPlacement().camera
    peg, hole = detect_parts(render(PARTS, camera, pose(-15, 0, 0), None), *LOOKS)
    assert peg.status == Status.VALID
    assert_nothing(hole, Status.NO_COLOUR)
    peg, hole = detect_parts(render(PARTS, camera, None, pose(15, 0, 0)), *LOOKS)
    assert_nothing(peg, Status.NO_COLOUR)
    assert hole.status == Status.VALID


@pytest.mark.parametrize("colour", [(40, 205, 40), (205, 205, 40), (205, 40, 205), (99, 90, 90)])
def test_other_colours(colour: tuple[int, int, int]) -> None:
    parts = ColouredParts(peg_colour=colour, hole_colour=colour)
    image = render(parts, CameraPlacement().camera, pose(-15, 0, 0), pose(15, 0, 0))
    for detection in detect_parts(image, *LOOKS):
        assert_nothing(detection, Status.NO_COLOUR)


def test_swapped_colours_are_not_found_as_if_nothing_had_happened() -> None:
    parts = ColouredParts(peg_colour=(40, 70, 205), hole_colour=(205, 40, 40))
    image = render(parts, CameraPlacement().camera, pose(-15, 0, 0), pose(15, 0, 0))
    peg, hole = detect_parts(image, *LOOKS)
    # Red is on the right now: its right end is taken for the tip.
    assert peg.tip[0] > 159.5 > hole.tip[0]


@pytest.mark.parametrize(
    ("X_WT", "status"),
    [
        (pose(150, 0, 0), Status.NO_COLOUR),  # all of it outside
        (pose(85, 0, 0), Status.AT_BORDER),  # the tip on the right
        (pose(0, 0, 58), Status.AT_BORDER),  # the upper side
        (pose(0, 0, -58), Status.AT_BORDER),
        (pose(-50, 0, 0), Status.VALID),  # the far end only
        (pose(-75, 0, 0), Status.NOT_STRAIGHT),  # nearly all of it
        (pose(0, 0, -30, 1.4), Status.NOT_STRAIGHT),  # upright
        (pose(20, 0, -10, 0.5), Status.VALID),
    ],
)
def test_peg_at_the_border(X_WT: RigidTransform, status: Status) -> None:
    camera = CameraPlacement(roll=0.0).camera
    detection = detect(render(PARTS, camera, X_WT, None), PEG)
    if status.lost:
        assert_nothing(detection, status)
    else:
        assert (np.abs(errors(detection, camera, X_WT)) < [0.1, 0.03, 0.2]).all()


def test_hole_part_at_the_border() -> None:
    camera = CameraPlacement().camera
    assert_nothing(
        detect(render(PARTS, camera, None, pose(-85, 0, 0)), HOLE_PART), Status.AT_BORDER
    )
    X_WM = pose(55, 0, 0)
    detection = detect(render(PARTS, camera, None, X_WM), HOLE_PART)
    assert (np.abs(errors(detection, camera, X_WM)) < [0.2, 0.03, 0.2]).all()


@pytest.mark.parametrize("shape", ["ball", "square upright", "triangle"])
def test_other_shapes_are_not_straight(shape: str) -> None:
    image = np.full((240, 320, 3), 200, np.uint8)
    corners = {
        "square upright": [[160, 80], [200, 120], [160, 160], [120, 120]],
        "triangle": [[100, 90], [200, 120], [100, 150]],
    }
    if shape == "ball":
        cv2.circle(image, (160, 120), 30, (205, 40, 40), -1, cv2.LINE_AA)
    else:
        cv2.fillPoly(image, [np.array(corners[shape])], (205, 40, 40), cv2.LINE_AA)
    assert_nothing(detect(image, PEG), Status.NOT_STRAIGHT)


def test_part_that_is_too_small() -> None:
    camera = CameraPlacement(distance=1.8, pixel_size=0.0018).camera
    image = render(PARTS, camera, pose(0, 0, 0), None)
    assert (image[..., 1] < 100).sum() > 100
    assert_nothing(detect(image, PEG), Status.NO_COLOUR)
    small = dataclasses.replace(PEG, area=30, length=5)
    assert (np.abs(errors(detect(image, small), camera, pose(0, 0, 0))) < [1, 0.1, 5]).all()


def test_background_without_contrast() -> None:
    style = SceneStyle(background=(20, 20, 20))
    image = render(PARTS, CameraPlacement().camera, pose(-15, 0, 0), None, style=style)
    assert_nothing(detect(image, PEG), Status.NO_CONTRAST)


@pytest.mark.parametrize("background", [(120, 120, 120), (255, 255, 255), (200, 210, 190)])
@pytest.mark.parametrize("light", [0.5, 1.0, 1.2])
def test_other_light(background: tuple[int, int, int], light: float) -> None:
    camera = CameraPlacement().camera
    X_WT = pose(-15, 2, 3, 0.05, 0.02)
    style = SceneStyle(background=background)
    image = render(PARTS, camera, X_WT, pose(15, 0, 0), style=style)
    image = np.clip(np.rint(image * light), 0, 255).astype(np.uint8)
    allowed = [0.2, 0.03, 0.2] if light <= 1 else [0.5, 0.1, 1.0]
    assert (np.abs(errors(detect(image, PEG), camera, X_WT)) < allowed).all()


def test_specks_of_the_colour_do_not_matter() -> None:
    camera = CameraPlacement().camera
    X_WT = pose(-15, 2, 3, 0.05, 0.02)
    clean = render(PARTS, camera, X_WT, pose(15, 0, 0))
    image = clean.copy()
    generator = np.random.default_rng(0)
    for u, v in generator.integers(10, [310, 50], (20, 2)):
        image[v : v + 3, u : u + 3] = (205, 40, 40)
    assert detect(image, PEG) == detect(clean, PEG)


def test_image_is_left_as_it_was_and_detection_repeats() -> None:
    image = render(PARTS, CameraPlacement().camera, pose(-15, 0, 0), pose(15, 0, 0))
    image = add_noise(image, 4.0, np.random.default_rng(0))
    before = image.copy()
    first = detect_parts(image, *LOOKS)
    np.testing.assert_array_equal(image, before)
    assert detect_parts(image, *LOOKS) == first
    assert (detect(image, PEG), detect(image, HOLE_PART)) == first
    assert detect_parts(np.dstack([image, image])[..., :3], *LOOKS) == first  # not contiguous


# Other parts and other cameras


def test_parts_of_other_colours_and_sizes_are_found_by_what_they_look_like() -> None:
    parts = ColouredParts(
        peg_colour=(40, 205, 40),
        hole_colour=(205, 40, 205),
        peg_radius=0.006,
        hole_radius=0.0062,
        peg_chamfer_share=0.75,
    )
    green, magenta = appearances(parts)
    assert (green.hue, magenta.hue) == (85, 213)
    assert green.end_ratio == pytest.approx(0.5)  # 3 of 6 mm
    camera = CameraPlacement().camera
    poses = pose(-15, 2, 3, 0.05, 0.02), pose(15, 0, 0)
    image = render(parts, camera, *poses)
    for detection, X_WP in zip(detect_parts(image, green, magenta), poses, strict=True):
        assert (np.abs(errors(detection, camera, X_WP)) < [0.15, 0.04, 0.2]).all()


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"peg_colour": (205, 140, 140)}, "brighter than 40 of 255, with more than 90 of 255 sat"),
        ({"hole_colour": (5, 5, 35)}, "brighter than 40 of 255, with more than 90 of 255 sat"),
        ({"hole_colour": (205, 90, 40)}, r"a hue that differs more from the peg's, \(205, 40, 40"),
        ({"hole_colour": (205, 40, 90)}, r"a hue that differs more from the peg's, \(205, 40, 40"),
    ],
)
def test_colours_that_no_filter_tells_apart(changes: dict[str, Any], allowed: str) -> None:
    ((name, _),) = changes.items()
    with pytest.raises(ParameterError, match=f"^{name} is .*, allowed: {allowed}"):
        appearances(ColouredParts(**changes))


@pytest.mark.parametrize("colour", [(205, 40, 60), (205, 60, 40)])  # on either side of red
@pytest.mark.parametrize("hue", [245, 0, 10])
def test_hues_go_around(colour: tuple[int, int, int], hue: int) -> None:
    parts = ColouredParts(peg_colour=colour)
    image = render(parts, CameraPlacement().camera, pose(0, 0, 0), None)
    found = detect(image, dataclasses.replace(PEG, hue=hue))
    assert found.status == Status.VALID
    assert found.tip == pytest.approx(detect(image, PEG).tip, abs=0.05)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("front", (0, 2)),
        ("hue", (-1, 256)),
        ("hue_width", (-1, 128)),
        ("saturation", (-1, 256)),
        ("value", (0, 256)),
        ("end_ratio", (0.0, 1.1, math.nan)),
        ("band", (0.0, 1.1)),
        ("seen", (0.0, 1.1)),
        ("area", (1,)),
        ("length", (1,)),
    ],
)
def test_appearances_that_are_none(name: str, values: tuple[float, ...]) -> None:
    for value in values:
        with pytest.raises(ParameterError, match=f"{name} is {value}, allowed: "):
            dataclasses.replace(PEG, **{name: value})


def test_large_noisy_image_has_more_components_than_16_bits_count() -> None:
    image = np.full((1600, 2000, 3), 200, np.uint8)
    image[2:-2:3, 2:-2:3] = (205, 40, 40)
    image[::3, ::3][np.random.default_rng(0).random((534, 667)) < 0.5] = 180
    assert cv2.connectedComponents((image[..., 1] == 40).astype(np.uint8))[0] > 65535
    assert_nothing(detect(image, PEG), Status.NO_COLOUR)
    cv2.rectangle(image, (600, 400), (1200, 600), (200, 200, 200), -1)
    cv2.rectangle(image, (700, 450), (1100, 550), (205, 40, 40), -1)
    assert detect(image, dataclasses.replace(PEG, end_ratio=1.0)).tip == pytest.approx(
        (1100.5, 500), abs=0.1
    )


def test_part_that_is_shorter_than_its_ends() -> None:
    image = np.full((240, 320, 3), 200, np.uint8)
    corners = cv2.boxPoints(((160, 120), (24, 90), math.degrees(0.3)))
    cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], (205, 40, 40))
    assert_nothing(detect(image, PEG), Status.NOT_STRAIGHT)


def test_part_between_the_pixels_that_are_sampled() -> None:
    image = np.full((240, 320, 3), 200, np.uint8)
    image[100:140, 161:280:2] = (205, 40, 40)
    image[101:140:4, 160:280] = (205, 40, 40)
    detection = detect(image, PEG)
    assert_nothing(detection, Status.NOT_STRAIGHT)  # its sides are seen in half of the columns
