"""The appearance of the parts, from one picture and a box around each of them."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares

from chamfer.analysis.command.output_folder import require_writable
from chamfer.analysis.report.atomic_write import write_text
from chamfer.analysis.report.console import say
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import unstructure
from chamfer.analysis.scenario.scenario_yaml import block
from chamfer.analysis.track.detection_overlay import (
    HOLE_COLOUR,
    PEG_COLOUR,
    REASONS,
    Caption,
    SeenParts,
    draw,
)
from chamfer.analysis.track.frame_source import open_recording
from chamfer.analysis.track.track_files import FOLDER, write_picture
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG, Appearance
from chamfer.systems.vision.part_detection import detect, detect_parts
from chamfer.systems.vision.soft_edges import contrast

Array = NDArray[np.float64]

_LEAST: Final = 0.4  # ratio of the end's radius to the sides'
_WHOLE: Final = 0.98  # ratio from which there is no chamfer to speak of
_BETTER: Final = 0.5  # of the squares that a chamfer has to leave, at most
_BEFORE: Final = 4  # pixels before the end that are compared
_BEHIND: Final = 1.0  # of the sides' radii behind the end, likewise
_FINE: Final = 0.25  # pixels, from one point of an outline to the next
_ROUND: Final = 24  # points of a quarter of an ellipse


def end_shape(
    share: Array, point: tuple[float, float], angle: float, front: int
) -> tuple[float, float | None]:
    """Return the radius of a part's end face relative to that of its sides, and its chamfer.

    The chamfer is its angle from the end face, rad; None: there is none.

    Args:
        share: How much of each pixel shows the part, 0 to 1, shape (height, width).
        point: Of the part's axis, u and v, pixels, where the part has its full width.
        angle: Of the axis, rad, from u to v.
        front: 1 if the end is on the right, -1 if it is on the left.
    """
    widths = _widths(share, point, angle, front)
    radius = float(np.median(widths[widths > widths.max() / 2]))
    end = int(np.flatnonzero(widths > radius / 2)[-1])
    at = np.arange(-_BEFORE, round(_BEHIND * radius) + 1)
    columns = end - at
    inside = (columns >= 0) & (columns < len(widths))
    at, measured = at[inside].astype(float), widths[columns[inside]] / radius

    def misfit(x: Array) -> Array:
        shift, blur, turn, size, taper, *chamfer = x
        ratio, height = chamfer or (1.0, 0.0)
        seen = _seen(at + shift, radius, blur, ratio, turn, height)
        return np.asarray(seen * (size + taper * at / radius) - measured)

    plain = _fitted(misfit, [[0.0, 1.0, turn, 1.0, 0.0] for turn in _TURNS])
    ends = [[0.0, 1.0, turn, 1.0, 0.0, ratio, 0.2] for turn in _TURNS for ratio in (0.6, 0.85)]
    square, found = _fitted(misfit, ends)
    ratio, height = found[5:].tolist()
    if ratio > _WHOLE or not square < _BETTER * plain[0]:
        return 1.0, None
    return ratio, math.atan2(height, 1 - ratio)


_ENOUGH: Final = 1e-3  # relative change of a fit that is not worth another step
_STEP: Final = 1e-3  # relative, of the fits' differences: outlines have corners
_TURNS: Final = (0.03, 0.3)  # rad, from which the fits start
_LOW: Final = (-2.0, 0.4, 0.0, 0.9, -0.1, _LEAST, 0.02)
_HIGH: Final = (2.0, 4.0, 0.6, 1.1, 0.1, 1.0, 0.8)
# of shift and blur, pixels, turn, rad, width and its growth along the axis, ratio and height


def _fitted(misfit: Callable[[Array], Array], starts: list[list[float]]) -> tuple[float, Array]:
    """Return the least square of all starts and where it is."""
    count = len(starts[0])
    bounds = (_LOW[:count], _HIGH[:count])
    steps = [_STEP] * count
    found = [
        least_squares(misfit, start, bounds=bounds, diff_step=steps, ftol=_ENOUGH, xtol=_ENOUGH)
        for start in starts
    ]
    best = min(found, key=lambda one: float(one.cost))
    return float(best.cost), best.x


def _widths(share: Array, point: tuple[float, float], angle: float, front: int) -> Array:
    """Return half the width in each pixel along the axis, from a point to beyond the end."""
    height, width = share.shape
    reach = math.ceil(math.hypot(height, width))
    cos, sin = front * math.cos(angle), front * math.sin(angle)
    # From (along the axis, across it) to the image, with the axis in the middle row.
    to_image = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])
    to_image[:, 2] = np.array(point) - to_image[:, 1] * reach
    turned = cv2.warpAffine(
        share.astype(np.float32),
        to_image,
        (reach, 2 * reach),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderValue=0.0,
    )
    return np.asarray(turned.sum(axis=0), float) / 2


def _seen(
    at: Array, radius: float, blur: float, ratio: float, turn: float, height: float
) -> Array:
    """Return half widths over the radius as a blurred picture shows them behind the first point.

    Radius and blur, a standard deviation, are in pixels; the ratio is of the end's radius to the
    sides', the turn out of the image plane, rad, the height that of the chamfer, over the radius.
    """
    reach = math.ceil(4 * blur / _FINE)
    fine = np.arange(at.min() / _FINE - reach, at.max() / _FINE + reach + 1) * _FINE
    exact = np.interp(fine, *_outline(radius, ratio, turn, height), left=0.0)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * _FINE / blur) ** 2)
    seen = np.convolve(exact, kernel / kernel.sum(), mode="same")
    return np.interp(at, fine, seen)


def _outline(radius: float, ratio: float, turn: float, height: float) -> tuple[Array, Array]:
    """Return points of an outline: pixels from its foremost point, half widths over the radius."""
    theta = np.linspace(0.0, math.pi / 2, _ROUND)
    sin, cos = math.sin(turn), math.cos(turn)
    end = np.column_stack([-ratio * sin * np.cos(theta), ratio * np.sin(theta)])
    sides = np.column_stack([height * cos - sin * np.cos(theta), np.sin(theta)])
    corners = np.array([[10.0, 1.0], [10.0, -1.0], [end[0, 0], -ratio]])
    points = np.concatenate([end, sides, corners]).astype(np.float32)
    hull = cv2.convexHull(points)[:, 0, :].astype(float)
    upper = hull[hull[:, 1] >= 0]
    upper = upper[np.lexsort((upper[:, 1], upper[:, 0]))]
    # Short of the foremost point nothing is seen: two points there make the jump.
    return (upper[:, 0] - upper[0, 0]) * radius, upper[:, 1]


Mask = NDArray[np.bool_]

_LEAST_BOX: Final = 12  # pixels, of a box's sides
_COLOURED: Final = 25  # of 255, of saturation and of value, from which a pixel has a hue
_SMOOTH: Final = 3.0  # of 256 hues, standard deviation of what is one colour
_NEAR: Final = 24  # of 256 hues, from the most frequent one
_LEAST_WIDTH: Final = 10  # of 256 hues, of what is looked for to either side
_DIM: Final = 0.5  # of a part's least saturation and value, that is still taken for it
_AREA: Final = 0.3  # of the part in the picture, which may be seen less of
_SLACK: Final = 0.12  # of the ratio of length to width, of a mask that may be seen aslant
_FEW: Final = 0.05  # share of a box that has to be the part
_EVEN: Final = 12.0  # grey levels, rms, of what is beside a part if it is one background
_MARGIN: Final = 4  # pixels, by which a tip may be outside its box


class Box(NamedTuple):
    """A rectangle of pixels."""

    x: int  # of its left column
    y: int  # of its upper row
    width: int
    height: int

    def cut(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the image in the box."""
        return image[self.y : self.y + self.height, self.x : self.x + self.width]

    def around(self, margin: int) -> "Box":
        """Return a box that is larger on all sides, cut at the image's borders."""
        x, y = max(self.x - margin, 0), max(self.y - margin, 0)
        right, below = self.x + self.width + margin, self.y + self.height + margin
        return Box(x, y, right - x, below - y)


def read_box(text: str, name: str) -> Box:
    """Return the box that ``x,y,w,h`` stands for.

    Raises:
        UserError: If it is something else.
    """
    numbers = re.fullmatch("([0-9]{1,6}),([0-9]{1,6}),([0-9]{1,6}),([0-9]{1,6})", text)
    if numbers is None:
        raise UserError(
            f"{name} is {text!r}, allowed: x,y,w,h in pixels, its upper left corner and size"
        )
    box = Box(*map(int, numbers.groups()))
    if min(box.width, box.height) < _LEAST_BOX:
        least = f"{_LEAST_BOX} x {_LEAST_BOX}"
        raise UserError(f"{name} is {text!r}, allowed: at least {least} pixels")
    return box


class Learned(NamedTuple):
    """The appearance of the parts, and their detections in the picture."""

    looks: tuple[Appearance, Appearance]
    found: tuple[Detection, Detection]


def learn(image: Image, boxes: tuple[Box, Box]) -> Learned:
    """Return the appearance of peg and hole part that distinguishes them in the picture.

    A part is what has the colour that is more frequent in its box than around it. Hue,
    saturation, value and sizes are its own with margins; the tips face each other.

    Raises:
        UserError: If they can't be told from what is around them, or from each other.
    """
    _require_apart(image, boxes)
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV_FULL).astype(np.uint8, copy=False)
    hues = [_hue(hsv, box, name) for box, name in zip(boxes, _NAMES, strict=True)]
    gap = abs(_turn(hues[1] - hues[0]))
    widest = math.ceil(gap / 2) - 1
    if widest < _LEAST_WIDTH:
        raise UserError(
            f"peg and hole part have nearly the same hue, {hues[0]} and {hues[1]} of 256, "
            f"allowed: {2 * _LEAST_WIDTH + 2} apart"
        )
    front = 1 if boxes[1].x > boxes[0].x else -1
    looks = []
    for which, side in enumerate((front, -front)):
        part, own = _appearance(hsv, boxes, which, hues[which], widest, side)
        looks.append(_with_end(image, boxes[which], part, own))
    return _checked(image, boxes, (looks[0], looks[1]))


_NAMES: Final = ("peg", "hole part")
_WHAT: Final = "allowed: a coloured part with something else above, below and before its tip"


def _require_apart(image: Image, boxes: tuple[Box, Box]) -> None:
    height, width = image.shape[:2]
    for box, name in zip(boxes, _NAMES, strict=True):
        if box.x + box.width > width or box.y + box.height > height:
            raise UserError(
                f"the {name}'s box {','.join(map(str, box))} is not within the picture of "
                f"{width} x {height} pixels"
            )
    first, second = sorted(boxes)
    if first.x + first.width > second.x:
        raise UserError(
            "the boxes have columns in common, allowed: one part beside the other, as their tips "
            "face each other along the rows"
        )


def _turn(hue: Any) -> Any:
    """Return a difference of hues, -128 to 127."""
    return (hue + 128) % 256 - 128


def _frequent(hsv: NDArray[np.uint8]) -> Array:
    """Return how much of each hue there is, weighted by saturation, shape (256,)."""
    hue, saturation, value = hsv.reshape(-1, 3).T
    coloured = (saturation >= _COLOURED) & (value >= _COLOURED)
    weights = np.where(coloured, saturation, 0).astype(float)
    counts = np.bincount(hue, weights=weights, minlength=256)
    return np.asarray(gaussian_filter1d(counts, _SMOOTH, mode="wrap"), float)


def _hue(hsv: NDArray[np.uint8], box: Box, name: str) -> int:
    """Return the hue that is more frequent in a box than around it."""
    inside, outer = box.cut(hsv), box.around(max(box.width, box.height) // 4).cut(hsv)
    beside = outer.size - inside.size
    own = _frequent(inside)
    if beside > 0:
        own = own - (_frequent(outer) - own) * (inside.size / beside)
    hue = int(own.argmax())
    if not own[hue] * _SMOOTH * 2.5 > _FEW * _COLOURED * inside.size / 3:
        raise UserError(f"the {name}'s box holds no colour that is not around it as well, {_WHAT}")
    return hue


def _appearance(
    hsv: NDArray[np.uint8], boxes: tuple[Box, Box], which: int, hue: int, widest: int, front: int
) -> tuple[Appearance, Mask]:
    """Return what a part looks like, its end but for its shape, and where it is in its box."""
    box, name = boxes[which], _NAMES[which]
    part = replace((PEG, HOLE_PART)[which], hue=hue, front=front, end_ratio=1.0)
    own = _component(hsv, box, hue, min(widest, _NEAR))
    x, y, width, height = cv2.boundingRect(own.astype(np.uint8))
    if own.sum() < _FEW * own.size or min(width, height) < _LEAST_BOX:
        raise UserError(f"the {name}'s box holds too little of one colour, {_WHAT}")
    tip, far = (box.width - x - width, x)[::front]
    if y == 0 or y + height == box.height or tip == 0:
        raise UserError(f"the {name}'s colour reaches to the edge of its box, {_WHAT}")
    hues, saturation, value = box.cut(hsv)[own].T
    turns = _turn(hues.astype(int) - hue)
    middle = round(float(np.median(turns)))
    spread = float(np.percentile(np.abs(turns - middle), 98))
    others = _others(hsv, boxes, hue, widest)
    least = _threshold(saturation, others[:, 1], Appearance.saturation)
    others = others[others[:, 1] >= least]
    half_width, length = _size(own)
    sized = part.sized(half_width, length if far > 1 else None, slack=_SLACK)
    found = replace(
        sized,
        half_width=_rounded(sized.half_width, 1),
        aspect=_rounded(sized.aspect, 2),
        hue=(hue + middle) % 256,
        hue_width=min(max(Appearance.hue_width, round(1.5 * spread) + 4), widest),
        saturation=least,
        value=max(_threshold(value, others[:, 2], Appearance.value), 1),
        area=max(round(_AREA * float(own.sum())), 2),
        length=max(min(Appearance.length, round(length / 3)), 2),
    )
    return found, own


def _component(hsv: NDArray[np.uint8], box: Box, hue: int, width: int) -> Mask:
    """Return the largest connected part of a box that has a hue, shape (height, width)."""
    inside = box.cut(hsv)
    turns = _turn(inside[:, :, 0].astype(int) - hue)
    near: Mask = (np.abs(turns) <= width) & (inside[:, :, 1:].min(axis=2) >= _COLOURED)
    if near.any():  # of a background of the same hue there may be more
        near &= inside[:, :, 1] > _DIM * float(np.percentile(inside[near][:, 1], 80))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8))
    if len(stats) == 1:
        return near
    return np.array(labels == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()), np.bool_)


def _others(hsv: NDArray[np.uint8], boxes: tuple[Box, Box], hue: int, width: int) -> Array:
    """Return the pixels outside the boxes that have a hue, shape (n, 3)."""
    outside = np.ones(hsv.shape[:2], np.bool_)
    for box in boxes:
        box.around(_MARGIN).cut(outside)[:] = False
    pixels = hsv[outside].astype(float)
    return np.asarray(pixels[np.abs(_turn(pixels[:, 0] - hue)) <= width])


def _threshold(own: NDArray[np.uint8], others: Array, usual: int) -> int:
    """Return what most of a part is above, and what else is there is not, if that can be."""
    low = float(np.percentile(own, 5))
    threshold = min(usual, _DIM * low)
    above = others[others > threshold]
    if len(above):
        high = float(np.percentile(above, 99))
        if high < low:
            threshold = max(threshold, (high + low) / 2)
    return round(threshold)


def _size(own: Mask) -> tuple[float, float]:
    """Return half the width and the length of what lies along the rows, pixels."""
    points = np.argwhere(own)[:, ::-1].astype(np.float32)
    _, sides, angle = cv2.minAreaRect(points)
    along = abs(math.cos(math.radians(angle))) > math.sqrt(0.5)
    length, width = sides if along else sides[::-1]
    return (width + 1) / 2, length + 1  # from middles of pixels to their borders


def _rounded(limits: Any, digits: int) -> Any:
    return limits and tuple(round(one, digits) for one in limits)


def _with_end(image: Image, box: Box, part: Appearance, own: Mask) -> Appearance:
    """Return what to look for with the shape of the part's end."""
    seen = detect(image, part)
    if seen.status.lost:
        return part
    share = _share(box.cut(image), own)
    point = (seen.point[0] - box.x, seen.point[1] - box.y)
    ratio, angle = end_shape(share, point, seen.angle, part.front)
    if angle is None:
        return part
    blunt = replace(part, end_ratio=round(ratio, 2))
    shaped = replace(blunt, end_angle=round(angle, 2))
    # In a small picture the angle may be too uncertain to be asked for.
    return shaped if detect(image, shaped).status == Status.VALID else blunt


def _share(inside: Image, own: Mask) -> Array:
    """Return how much of each pixel of a box shows the part: all or nothing before clutter."""
    near = cv2.dilate(own.astype(np.uint8), np.ones((9, 9), np.uint8)).view(np.bool_)
    beside = inside[~near].astype(float)
    if len(beside):
        background = np.median(beside, axis=0)
        *normal, square = contrast(np.median(inside[own], axis=0), background)
        if square and float(np.sqrt(np.mean((beside - background) ** 2))) < _EVEN:
            shares = np.clip(1 - inside @ np.array(normal) / square, 0.0, 1.0)
            return np.where(near, shares, 0.0)
    return own.astype(float)


def _checked(
    image: Image, boxes: tuple[Box, Box], looks: tuple[Appearance, Appearance]
) -> Learned:
    """Return what was learned if it finds both parts where they are."""
    found = detect_parts(image, *looks)
    for box, part, seen, name in zip(boxes, looks, found, _NAMES, strict=True):
        colour = (
            f"hue {part.hue} within {part.hue_width}, saturation at least {part.saturation} and "
            f"value at least {part.value}"
        )
        if seen.status != Status.VALID:
            raise UserError(f"the {name} is not found again by {colour}: {REASONS[seen.status]}")
        x, y, width, height = box.around(_MARGIN)
        u, v = seen.tip
        if not (x <= u < x + width and y <= v < y + height):
            raise UserError(
                f"the {name} is found outside its box by {colour}, at ({u:.0f}, {v:.0f})"
            )
    return Learned(looks, found)


PARTS, PICTURE = "parts.yaml", "parts.png"

_HEADER: Final = """\
# What the peg and the hole part look like, learned from {picture!r}.
# chamfer track --scenario {name} FILES
"""


def learn_parts(picture: Path, peg_box: str, hole_box: str, *, out: Path) -> dict[str, Any]:
    """Learn the parts in two boxes of a picture, and write them and a picture of them.

    Of a recording the first frame is taken; a box is ``x,y,w,h``, pixels; ``out`` is the folder
    of all results. Returned is, for JSON, what was learned, and the files.

    Raises:
        UserError: If the picture can't be read, the parts can't be learned from it, or what was
            learned can't be written.
    """
    boxes = read_box(peg_box, "--peg-box"), read_box(hole_box, "--hole-box")
    frame = next(open_recording([picture]).frames())
    learned = learn(frame.image, boxes)
    looks = dict(zip(("peg", "hole"), map(unstructure, learned.looks), strict=True))
    require_writable(out, [FOLDER])
    folder = out / FOLDER
    paths = [folder / PARTS, folder / PICTURE]
    if paths[0].exists():
        say(f"{paths[0]} is replaced")
    image = frame.image.copy()
    for (x, y, width, height), colour in zip(boxes, (PEG_COLOUR, HOLE_COLOUR), strict=True):
        cv2.rectangle(image, (x, y), (x + width - 1, y + height - 1), colour)
    sheet = draw(SeenParts(image, *learned.found), Caption(0, math.nan, frame.name))
    try:
        folder.mkdir(exist_ok=True)
        write_text(paths[0], _HEADER.format(picture=frame.name, name=PARTS) + block(looks))
        write_picture(paths[1], sheet)
    except OSError as error:
        raise UserError(f"{folder} can't be written: {error.strerror or error}") from error
    return {**looks, "files": [str(path) for path in paths]}
