"""What is found in images: how exactly, and what is refused with which reason."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import Image, add_noise
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG, appearances
from chamfer.systems.vision.part_detection import detect, detect_parts

PARTS = ColouredParts()
LOOKS = appearances(PARTS)
CAMERA = CameraPlacement().camera
GREY = (200, 200, 200)
RED = PARTS.peg_colour

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


@pytest.mark.parametrize(("view", "blur"), [("xz", 0.7), ("xy", 0.7), ("xz", 0.0)])
def test_accuracy_without_noise(view: Any, blur: float) -> None:
    peg, hole = measured(view, noise=0.0, blur=blur)
    assert (rms(peg) < [0.04 if blur else 0.06, 0.008, 0.02]).all()
    # Of a wide part the middle between the edges is not quite the axis, in perspective.
    assert (rms(hole) < [0.07, 0.016, 0.06]).all()
    assert (np.abs(peg).max(axis=0) < [0.15, 0.02, 0.08]).all()
    assert (np.abs(hole).max(axis=0) < [0.2, 0.04, 0.2]).all()


@pytest.mark.parametrize("view", VIEWS)
def test_accuracy_with_noise(view: Any) -> None:
    peg, hole = measured(view, noise=4.0, blur=0.7)
    assert (rms(peg) < [0.08, 0.02, 0.15]).all()
    assert (rms(hole) < [0.1, 0.02, 0.3]).all()
    # No bias beyond three standard errors and what there is without noise.
    for part, bias in ((peg, [0.04, 0.006, 0.02]), (hole, [0.07, 0.012, 0.06])):
        allowed = 3 * part.std(axis=0) / math.sqrt(POSES) + bias
        assert (np.abs(part.mean(axis=0)) < allowed).all()


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
    gaps = {
        gap: detect_parts(render(PARTS, CAMERA, pose(-gap / 2, 0, 0), pose(gap / 2, 0, 0)), *LOOKS)
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


def assert_nothing(detection: Detection, status: Status) -> None:
    assert detection.status == status
    assert status.lost
    assert np.isnan([*detection.tip, detection.angle, *detection.point]).all()


def noisy(level: int, noise: float) -> Image:
    return add_noise(np.full((240, 320, 3), level, np.uint8), noise, np.random.default_rng(level))


def in_colour(*colour: int) -> Image:
    parts = ColouredParts(peg_colour=colour, hole_colour=colour)  # type: ignore[arg-type]
    return render(parts, CAMERA, pose(-15, 0, 0), pose(15, 0, 0))


@pytest.mark.parametrize(
    "image",
    [
        *(noisy(level, 0.0) for level in (0, 128, 200, 255)),
        *(noisy(200, 4.0), noisy(128, 100.0)),
        *(in_colour(40, 205, 40), in_colour(205, 205, 40), in_colour(205, 40, 205)),
        in_colour(99, 90, 90),
    ],
)
def test_nothing_is_seen_of_nothing_and_of_other_colours(image: Image) -> None:
    for detection in detect_parts(image, *LOOKS):
        assert_nothing(detection, Status.NO_COLOUR)


def test_one_part_without_the_other() -> None:
    peg, hole = detect_parts(render(PARTS, CAMERA, pose(-15, 0, 0), None), *LOOKS)
    assert peg.status == Status.VALID
    assert_nothing(hole, Status.NO_COLOUR)
    peg, hole = detect_parts(render(PARTS, CAMERA, None, pose(15, 0, 0)), *LOOKS)
    assert_nothing(peg, Status.NO_COLOUR)
    assert hole.status == Status.VALID


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


def test_image_is_left_as_it_was_and_detection_repeats() -> None:
    image = render(PARTS, CameraPlacement().camera, pose(-15, 0, 0), pose(15, 0, 0))
    image = add_noise(image, 4.0, np.random.default_rng(0))
    before = image.copy()
    first = detect_parts(image, *LOOKS)
    np.testing.assert_array_equal(image, before)
    assert detect_parts(image, *LOOKS) == first
    assert (detect(image, PEG), detect(image, HOLE_PART)) == first
    assert detect_parts(np.dstack([image, image])[..., :3], *LOOKS) == first  # not contiguous


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
    poses = pose(-15, 2, 3, 0.05, 0.02), pose(15, 0, 0)
    image = render(parts, CAMERA, *poses)
    for detection, X_WP in zip(detect_parts(image, green, magenta), poses, strict=True):
        assert (np.abs(errors(detection, CAMERA, X_WP)) < [0.15, 0.04, 0.2]).all()


@pytest.mark.parametrize("colour", [(205, 40, 60), (205, 60, 40)])  # on either side of red
@pytest.mark.parametrize("hue", [245, 0, 10])
def test_hues_go_around(colour: tuple[int, int, int], hue: int) -> None:
    parts = ColouredParts(peg_colour=colour)
    image = render(parts, CameraPlacement().camera, pose(0, 0, 0), None)
    found = detect(image, dataclasses.replace(PEG, hue=hue))
    assert found.status == Status.VALID
    assert found.tip == pytest.approx(detect(image, PEG).tip, abs=0.05)


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


SIZED = appearances(PARTS, 0.0005)  # as parts whose size is known look
PAIR = pose(-17, 2, 3, 0.04, 0.03), pose(16, 0, -2, -0.02, 0.05)


def off(found: Detection, X_WP: RigidTransform) -> list[float]:
    """Return how far off a tip is, pixels, and an axis, mrad."""
    along, across, angle = errors(found, CAMERA, X_WP)
    return [math.hypot(along, across), abs(angle)]


def beside(image: Image, part: int) -> tuple[Array, Array]:
    """Return how far each pixel is before a part's tip and aside of its axis, pixels."""
    found = detect_parts(image, *SIZED)[part]
    front = -1.0 if part else 1.0
    cos, sin = front * math.cos(found.angle), front * math.sin(found.angle)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]] - np.reshape(found.tip[::-1], (2, 1, 1))
    return cos * u + sin * v, cos * v - sin * u


def covered(image: Image, part: int, length: float) -> Image:
    """Return an image with so much, pixels, of an end covered like background."""
    ahead, aside = beside(image, part)
    result = image.copy()
    result[(ahead > -length) & (ahead < 8) & (np.abs(aside) < (29.4, 42.0)[part])] = GREY
    return result


def drawn(style: SceneStyle = SceneStyle()) -> Image:  # noqa: B008
    image = render(PARTS, CAMERA, *PAIR, style=style)
    return add_noise(image, 4.0, np.random.default_rng(0))


def test_a_cover_does_not_show_in_a_part_of_unknown_length() -> None:
    image = covered(drawn(), 1, 10.0)
    assert detect(image, SIZED[1]).status == Status.WRONG_SHAPE
    unknown = dataclasses.replace(SIZED[1], aspect=None)
    assert detect(image, unknown).status == Status.VALID


@pytest.mark.parametrize("size", [1.2, 1.6, 2.0])
def test_a_larger_box_is_not_the_peg(size: float) -> None:
    image = drawn()
    image[2 : 2 + round(39 * size), 60 : 60 + round(120 * size)] = RED
    assert np.array_equal(detect(image, SIZED[0]).tip, detect(drawn(), SIZED[0]).tip)
    alone = np.full_like(image, 200)
    alone[20 : 20 + round(39 * size), 60 : 60 + round(120 * size)] = RED
    assert detect(alone, SIZED[0]).status in (Status.WRONG_SIZE, Status.WRONG_SHAPE)


def test_equal_hues_are_told_apart_by_size_or_refused() -> None:
    image = drawn()
    same = dataclasses.replace(HOLE_PART, hue=PEG.hue)
    assert [one.status for one in detect_parts(image, PEG, same)] == [Status.SHARED] * 2
    red = dataclasses.replace(PARTS, hole_colour=RED)
    image = render(red, CAMERA, *PAIR)
    hole = dataclasses.replace(SIZED[1], hue=SIZED[0].hue)
    for found, X_WP in zip(detect_parts(image, SIZED[0], hole), PAIR, strict=True):
        assert off(found, X_WP)[0] < 0.3


def test_two_pegs_are_ambiguous() -> None:
    image = render(PARTS, CAMERA, pose(-15, 0, 28), None)
    other = render(PARTS, CAMERA, pose(-15, 0, -28), None)
    both = np.minimum(image, other)
    assert detect(image, SIZED[0]).status == Status.VALID
    assert detect(both, SIZED[0]).status == Status.AMBIGUOUS


@pytest.mark.parametrize(("factor", "found"), [(1.3, True), (1 / 1.3, True), (1.7, False)])
def test_sizes_are_believed_as_far_as_cameras_are(factor: float, found: bool) -> None:
    for look in appearances(PARTS, 0.0005 * factor):
        status = detect(drawn(), look).status
        assert status == (Status.VALID if found else Status.WRONG_SIZE)


def oblong(factor: float, X_WT: RigidTransform = PAIR[0]) -> Image:
    """Return the parts in pixels that are narrower than they are high, believed to be square."""
    camera = dataclasses.replace(CAMERA, focal=(1000.0 * factor, 1000.0))
    return add_noise(render(PARTS, camera, X_WT, PAIR[1]), 4.0, np.random.default_rng(0))


@pytest.mark.parametrize("factor", [1 / 1.3, 1 / 1.1, 1 / 1.06, 1.06])
def test_two_parts_tell_of_pixels_that_are_not_square(factor: float) -> None:
    image = oblong(factor)
    assert detect(image, SIZED[1]).status == Status.WRONG_SHAPE  # alone it might be covered
    for found, X_WP in zip(detect_parts(image, *SIZED), PAIR, strict=True):
        u, v = CAMERA.project(X_WP.translation())
        u = CAMERA.centre[0] + factor * (u - CAMERA.centre[0])
        assert found.status == Status.VALID
        assert math.dist(found.tip, (u, v)) < 0.4
    squared = [dataclasses.replace(look, squareness=1.0) for look in SIZED]
    assert Status.WRONG_SHAPE in {one.status for one in detect_parts(image, *squared)}


@pytest.mark.parametrize("factor", [1 / 1.3, 1 / 1.2, 1 / 1.05, 1.0])
@pytest.mark.parametrize("part", [0, 1])
@pytest.mark.parametrize("length", [6.0, 20.0])
def test_pixels_are_no_excuse_for_a_cover(factor: float, part: int, length: float) -> None:
    image = oblong(factor)
    image = covered(image, part, length)
    assert detect_parts(image, *SIZED)[part].status == Status.WRONG_SHAPE


def test_beside_a_part_that_is_cut_off_the_other_may_be_longer_but_not_narrower() -> None:
    image = oblong(1.25)
    peg, hole = detect_parts(image, *SIZED)
    assert peg.status == hole.status == Status.VALID
    ahead, aside = beside(image, 1)
    image[(aside < -23) & (ahead < 8)] = GREY
    assert detect_parts(image, *SIZED)[1].status == Status.WRONG_SHAPE
    # Shorter is what a cover makes it.
    cut = oblong(1 / 1.2, pose(-45, 0, 2))
    peg, hole = detect_parts(cut, *SIZED)
    assert (peg.status, hole.status) == (Status.VALID, Status.WRONG_SHAPE)


@pytest.mark.parametrize(
    ("change", "look", "status"),
    [
        (lambda image: blurred(image, 2.5), {}, Status.VALID),
        (lambda image: blurred(image, 2.5), {"window": (3, 5)}, Status.BLURRED),
        (lambda image: np.rint(0.2 * image).astype(np.uint8), {}, Status.NO_CONTRAST),
    ],
)
def test_blur_and_light(
    change: Callable[[Image], Image], look: dict[str, Any], status: Status
) -> None:
    seen = dataclasses.replace(SIZED[0], **look)
    assert detect(change(drawn()), seen).status == status


def test_bent_edges_are_refused() -> None:
    image = drawn()
    v, u = np.mgrid[:240, :320].astype(np.float32)
    bent = v + 3.0 * np.cos((u - 80) / 40)
    image = cv2.remap(image, u, bent.astype(np.float32), cv2.INTER_LINEAR).astype(np.uint8)
    assert detect(image, SIZED[0]).status == Status.NOT_STRAIGHT
    allowed = dataclasses.replace(SIZED[0], straight=20.0, aspect=None, end_angle=None)
    assert detect(image, allowed).status != Status.NOT_STRAIGHT


def blurred(image: Image, deviation: float) -> Image:
    return cv2.GaussianBlur(image, (0, 0), deviation).astype(np.uint8)


@pytest.mark.parametrize("upright", [False, True])
def test_mirrors_show_the_same(upright: bool) -> None:
    image = render(PARTS, CAMERA, *PAIR)
    before = detect_parts(image, *SIZED)
    size = image.shape[0 if upright else 1] - 1
    mirrored = np.ascontiguousarray(image[::-1] if upright else image[:, ::-1])
    turned = SIZED
    if not upright:
        turned = tuple(dataclasses.replace(look, front=-look.front) for look in SIZED)
    for one, other in zip(before, detect_parts(mirrored, *turned), strict=True):
        u, v = other.tip
        tip = (u, size - v) if upright else (size - u, v)
        assert tip == pytest.approx(one.tip, abs=0.02)
        assert other.angle == pytest.approx(-one.angle, abs=1e-4)
