"""What detection refuses with which reason, and what it finds all the same."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import Image, add_noise
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG, appearances
from chamfer.systems.vision.part_detection import Detection, Status, detect, detect_parts

PARTS = ColouredParts()
CAMERA = CameraPlacement().camera
LOOKS = appearances(PARTS, 0.0005)
GREY = (200, 200, 200)
RED = PARTS.peg_colour


def pose(x: float, y: float, z: float, pitch: float = 0.0, yaw: float = 0.0) -> RigidTransform:
    """Return a pose from mm and rad."""
    return RigidTransform(RollPitchYaw(0.3, pitch, yaw), np.array([x, y, z]) / 1000)


POSES = pose(-17, 2, 3, 0.04, 0.03), pose(16, 0, -2, -0.02, 0.05)


def drawn(style: SceneStyle = SceneStyle()) -> Image:  # noqa: B008
    image = render(PARTS, CAMERA, *POSES, style=style)
    return add_noise(image, 4.0, np.random.default_rng(0))


def off(found: Detection, X_WP: RigidTransform) -> list[float]:
    """Return how far off a tip is, pixels, and an axis, mrad."""
    assert found.status == Status.VALID
    origin = X_WP.translation()
    near, far = CAMERA.project(np.array([origin, origin + 1e-3 * X_WP.rotation().matrix()[:, 0]]))
    du, dv = far - near
    return [math.dist(found.tip, near), 1e3 * abs(found.angle - math.atan2(dv, du))]


def covered(image: Image, part: int, *, along: float = 0.0, across: float = 0.0) -> Image:
    """Return an image with so much, pixels, of an end or of a side covered like background."""
    true = [CAMERA.project(X.translation()) for X in POSES][part]
    found = detect_parts(image, *LOOKS)[part]
    front = -1.0 if part else 1.0
    cos, sin = front * math.cos(found.angle), front * math.sin(found.angle)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    ahead = cos * (u - true[0]) + sin * (v - true[1])
    aside = cos * (v - true[1]) - sin * (u - true[0])
    half = (19.6, 28.0)[part]
    hidden = (ahead > -along) & (ahead < 8) if along else (aside > half - across) & (ahead < 8)
    result = image.copy()
    result[hidden & (np.abs(aside) < 1.5 * half)] = GREY
    return result


def test_pictures_are_found_to_begin_with() -> None:
    for found, X_WP in zip(detect_parts(drawn(), *LOOKS), POSES, strict=True):
        assert (np.array(off(found, X_WP)) < [0.3, 0.6]).all()


# Valid and wrong, before


@pytest.mark.parametrize("length", [5.0, 10.7, 20.0])
def test_a_cover_over_the_tip_is_not_the_tip(length: float) -> None:
    assert detect(covered(drawn(), 0, along=length), LOOKS[0]).status == Status.WRONG_SHAPE


@pytest.mark.parametrize("length", [5.0, 10.0, 20.0])
def test_a_cover_over_the_mouth_shows_in_the_length(length: float) -> None:
    image = covered(drawn(), 1, along=length)
    assert detect(image, LOOKS[1]).status == Status.WRONG_SHAPE
    # Nobody can tell of a part whose length is not known.
    unknown = dataclasses.replace(LOOKS[1], aspect=None)
    assert detect(image, unknown).status == Status.VALID


@pytest.mark.parametrize("width", [4.0, 8.0])
def test_a_cover_along_a_side_takes_a_chamfer(width: float) -> None:
    assert detect(covered(drawn(), 0, across=width), LOOKS[0]).status == Status.WRONG_SHAPE


@pytest.mark.parametrize("size", [1.2, 1.6, 2.0])
def test_a_larger_box_is_not_the_peg(size: float) -> None:
    image = drawn()
    image[2 : 2 + round(39 * size), 60 : 60 + round(120 * size)] = RED
    assert np.array_equal(detect(image, LOOKS[0]).tip, detect(drawn(), LOOKS[0]).tip)
    alone = np.full_like(image, 200)
    alone[20 : 20 + round(39 * size), 60 : 60 + round(120 * size)] = RED
    assert detect(alone, LOOKS[0]).status in (Status.WRONG_SIZE, Status.WRONG_SHAPE)


def test_equal_hues_are_told_apart_by_size_or_refused() -> None:
    image = drawn()
    same = dataclasses.replace(HOLE_PART, hue=PEG.hue)
    assert [one.status for one in detect_parts(image, PEG, same)] == [Status.SHARED] * 2
    red = dataclasses.replace(PARTS, hole_colour=RED)
    image = render(red, CAMERA, *POSES)
    hole = dataclasses.replace(LOOKS[1], hue=LOOKS[0].hue)
    for found, X_WP in zip(detect_parts(image, LOOKS[0], hole), POSES, strict=True):
        assert off(found, X_WP)[0] < 0.3


# Refusals


def test_two_pegs_are_ambiguous() -> None:
    image = render(PARTS, CAMERA, pose(-15, 0, 28), None)
    other = render(PARTS, CAMERA, pose(-15, 0, -28), None)
    both = np.minimum(image, other)
    assert detect(image, LOOKS[0]).status == Status.VALID
    assert detect(both, LOOKS[0]).status == Status.AMBIGUOUS


@pytest.mark.parametrize(("factor", "found"), [(1.3, True), (1 / 1.3, True), (1.7, False)])
def test_sizes_are_believed_as_far_as_cameras_are(factor: float, found: bool) -> None:
    for look in appearances(PARTS, 0.0005 * factor):
        status = detect(drawn(), look).status
        assert status == (Status.VALID if found else Status.WRONG_SIZE)


def oblong(factor: float, X_WT: RigidTransform = POSES[0]) -> Image:
    """Return the parts in pixels that are narrower than they are high, believed to be square."""
    camera = dataclasses.replace(CAMERA, focal=(1000.0 * factor, 1000.0))
    return add_noise(render(PARTS, camera, X_WT, POSES[1]), 4.0, np.random.default_rng(0))


@pytest.mark.parametrize("factor", [1 / 1.3, 1 / 1.1, 1 / 1.06, 1.06])
def test_two_parts_tell_of_pixels_that_are_not_square(factor: float) -> None:
    image = oblong(factor)
    assert detect(image, LOOKS[1]).status == Status.WRONG_SHAPE  # alone it might be covered
    for found, X_WP in zip(detect_parts(image, *LOOKS), POSES, strict=True):
        u, v = CAMERA.project(X_WP.translation())
        u = CAMERA.centre[0] + factor * (u - CAMERA.centre[0])
        assert found.status == Status.VALID
        assert math.dist(found.tip, (u, v)) < 0.4
    squared = [dataclasses.replace(look, squareness=1.0) for look in LOOKS]
    assert Status.WRONG_SHAPE in {one.status for one in detect_parts(image, *squared)}


@pytest.mark.parametrize("factor", [1 / 1.3, 1 / 1.2, 1 / 1.05, 1.0])
@pytest.mark.parametrize("part", [0, 1])
@pytest.mark.parametrize("length", [6.0, 20.0])
def test_pixels_are_no_excuse_for_a_cover(factor: float, part: int, length: float) -> None:
    image = oblong(factor)
    found = detect_parts(image, *LOOKS)[part]
    front = -1.0 if part else 1.0
    cos, sin = front * math.cos(found.angle), front * math.sin(found.angle)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    ahead = cos * (u - found.tip[0]) + sin * (v - found.tip[1])
    aside = cos * (v - found.tip[1]) - sin * (u - found.tip[0])
    image[(ahead > -length) & (ahead < 8) & (np.abs(aside) < 40)] = GREY
    assert detect_parts(image, *LOOKS)[part].status == Status.WRONG_SHAPE


def test_beside_a_part_that_is_cut_off_the_other_may_be_longer_but_not_narrower() -> None:
    image = oblong(1.25)
    peg, hole = detect_parts(image, *LOOKS)
    assert peg.status == hole.status == Status.VALID
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    cos, sin = math.cos(hole.angle), math.sin(hole.angle)
    aside = cos * (v - hole.tip[1]) - sin * (u - hole.tip[0])
    image[(aside > 23) & (u > hole.tip[0] - 8)] = GREY
    assert detect_parts(image, *LOOKS)[1].status == Status.WRONG_SHAPE
    # Shorter is what a cover makes it.
    cut = oblong(1 / 1.2, pose(-45, 0, 2))
    peg, hole = detect_parts(cut, *LOOKS)
    assert (peg.status, hole.status) == (Status.VALID, Status.WRONG_SHAPE)


def test_more_blur_than_the_window_holds_is_said() -> None:
    image = cv2.GaussianBlur(drawn(), (0, 0), 2.5).astype(np.uint8)
    narrow = dataclasses.replace(LOOKS[0], window=(3, 5))
    assert detect(image, LOOKS[0]).status == Status.VALID
    assert detect(image, narrow).status == Status.BLURRED


def test_too_little_light_is_too_little_contrast() -> None:
    dark = np.rint(0.2 * drawn()).astype(np.uint8)
    assert detect(dark, LOOKS[0]).status == Status.NO_CONTRAST


def test_bent_edges_are_refused() -> None:
    image = drawn()
    v, u = np.mgrid[:240, :320].astype(np.float32)
    bent = v + 3.0 * np.cos((u - 80) / 40)
    image = cv2.remap(image, u, bent.astype(np.float32), cv2.INTER_LINEAR).astype(np.uint8)
    assert detect(image, LOOKS[0]).status == Status.NOT_STRAIGHT
    allowed = dataclasses.replace(LOOKS[0], straight=20.0, aspect=None, end_angle=None)
    assert detect(image, allowed).status != Status.NOT_STRAIGHT


# Found all the same


def shaded(image: Image) -> Image:
    beside = (image.astype(int).min(axis=2) > 150)[..., np.newaxis]
    ramp = np.linspace(0.6, 1.0, 320)[np.newaxis, :, np.newaxis]
    return np.where(beside, ramp * image, image).astype(np.uint8)


def tinted(image: Image) -> Image:
    return np.clip(image * np.array([0.7, 1.0, 1.3]), 0, 255).astype(np.uint8)


def striped(image: Image) -> Image:
    result = image.copy()
    halves = np.arange(160), np.arange(160, 320)
    for u, found in zip(halves, detect_parts(image, *LOOKS), strict=True):
        v = found.point[1] + math.tan(found.angle) * (u - found.point[0])
        for shift in range(-3, 4):
            rows = np.rint(v + shift).astype(int)
            coloured = np.ptp(image[rows, u].astype(int), axis=1) > 60
            result[rows[coloured], u[coloured]] = 255
    return result


CHANGES: dict[str, Callable[[Image], Image]] = {
    "shade beside": shaded,
    "cold light": tinted,
    "highlight": striped,
    "blur": lambda image: cv2.GaussianBlur(image, (0, 0), 2.5).astype(np.uint8),
    "motion": lambda image: cv2.blur(image, (9, 1)).astype(np.uint8),
}


@pytest.mark.parametrize("change", CHANGES)
def test_light_and_blur_are_borne(change: str) -> None:
    image = CHANGES[change](drawn())
    for found, X_WP in zip(detect_parts(image, *LOOKS), POSES, strict=True):
        assert (np.array(off(found, X_WP)) < [0.6, 2.0]).all(), change


@pytest.mark.parametrize("background", [(181, 135, 85), (224, 172, 140), (60, 90, 60)])
def test_backgrounds_of_another_colour(background: Any) -> None:
    image = drawn(SceneStyle(background=background))
    for found, X_WP in zip(detect_parts(image, *LOOKS), POSES, strict=True):
        assert (np.array(off(found, X_WP)) < [0.6, 2.0]).all()


# Properties


def test_whole_pixels_shift_what_is_found() -> None:
    image = np.full((260, 340, 3), GREY, np.uint8)
    image[:240, :320] = render(PARTS, CAMERA, *POSES)
    moved = np.roll(image, (7, 12), axis=(0, 1))
    for one, other in zip(detect_parts(image, *LOOKS), detect_parts(moved, *LOOKS), strict=True):
        assert np.subtract(other.tip, one.tip) == pytest.approx([12, 7], abs=1e-6)
        assert other.angle == pytest.approx(one.angle, abs=1e-9)


@pytest.mark.parametrize("upright", [False, True])
def test_mirrors_show_the_same(upright: bool) -> None:
    image = render(PARTS, CAMERA, *POSES)
    before = detect_parts(image, *LOOKS)
    size = image.shape[0 if upright else 1] - 1
    mirrored = np.ascontiguousarray(image[::-1] if upright else image[:, ::-1])
    turned = LOOKS
    if not upright:
        turned = tuple(dataclasses.replace(look, front=-look.front) for look in LOOKS)
    for one, other in zip(before, detect_parts(mirrored, *turned), strict=True):
        u, v = other.tip
        tip = (u, size - v) if upright else (size - u, v)
        assert tip == pytest.approx(one.tip, abs=0.02)
        assert other.angle == pytest.approx(-one.angle, abs=1e-4)


@pytest.mark.parametrize("brightness", [0.5, 0.8])
def test_brightness_does_not_matter(brightness: float) -> None:
    image = render(PARTS, CAMERA, *POSES)
    darker = np.rint(brightness * image).astype(np.uint8)
    for one, other in zip(detect_parts(image, *LOOKS), detect_parts(darker, *LOOKS), strict=True):
        assert other.tip == pytest.approx(one.tip, abs=0.03)
        assert other.angle == pytest.approx(one.angle, abs=2e-4)


def test_colours_change_places_with_their_channels() -> None:
    image = render(PARTS, CAMERA, *POSES)
    around = np.ascontiguousarray(image[..., [2, 0, 1]])  # red becomes green, green blue
    looks = [dataclasses.replace(look, hue=(look.hue + 85) % 256) for look in LOOKS]
    for one, other in zip(
        detect_parts(image, *LOOKS), detect_parts(around, looks[0], looks[1]), strict=True
    ):
        assert other.tip == pytest.approx(one.tip, abs=1e-6)
