"""Conditions that make parts hard to see, each at three severities.

Some change what is there (backgrounds, shadows, things beside the parts and before them), some how
it is seen (blur, exposure, colours), some the pictures themselves (a colour filter's pattern,
compression). The places of the parts, and so what is true, stay as they are.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from typing import Any, Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.sight.detection_trials import Poses, true_detection
from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.peg_and_hole import Colour, ColouredParts
from chamfer.models.validation import require_between, require_not_negative
from chamfer.systems.cameras.camera_image import FrameGrabberParams, Image
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Detection


@dataclass(frozen=True, kw_only=True)
class PictureQuality:
    """Noise and blur of the software camera's pictures."""

    noise: float = FrameGrabberParams.noise  # grey levels, standard deviation
    blur: float = SceneStyle.blur  # pixels, standard deviation

    def __post_init__(self) -> None:
        require_not_negative(self, "blur")
        require_between(self, 0, 60, "noise")


# In colour, of scenes, and in the package itself: nothing is downloaded.
NAMES: Final = ("astronaut", "chelsea", "coffee", "rocket", "stereo_motorcycle")


def installed() -> bool:
    """Return whether photographs are installed."""
    return find_spec("skimage") is not None


def require_photographs() -> None:
    """Raise :class:`UserError` unless photographs are installed."""
    if not installed():
        raise UserError(
            "scikit-image's photographs are not installed: pip install 'chamfer[photographs]'"
        )


@cache
def _read(name: str) -> Image:
    from skimage import data

    read: Callable[[], Any] = getattr(data, name)
    picture = read()[0] if name == "stereo_motorcycle" else read()
    return np.ascontiguousarray(picture[..., :3], np.uint8)


def photograph(width: int, height: int, random: np.random.Generator) -> Image:
    """Return a part of a photograph, drawn at random, shape (height, width, 3)."""
    whole = _read(NAMES[random.integers(len(NAMES))])
    rows, columns = whole.shape[:2]
    # As large as has the picture's sides, or down to half of it.
    share = random.uniform(0.5, 1.0) * min(columns / width, rows / height)
    w, h = int(share * width), int(share * height)
    left, top = random.integers(columns - w + 1), random.integers(rows - h + 1)
    cut = whole[top : top + h, left : left + w]
    size = cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA)
    return size.astype(np.uint8)


Array = NDArray[np.float64]
Light = NDArray[np.floating[Any]]  # red, green and blue, 0 to 255, shape (height, width, 3)
Share = NDArray[np.floating[Any]]  # of each pixel, shape (height, width)

_GREY: Final = np.array(SceneStyle.background, np.float32)
_WOOD: Final = (181, 135, 85)
_SKIN: Final = (224, 172, 140)
_DARK: Final = (45, 45, 45)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The parts before a camera, and where their axes are in its image."""

    parts: ColouredParts
    camera: Camera
    pixel_size: float  # m, that a pixel covers at the parts
    pixel: float  # pixels, for one of a camera as it is in the other conditions
    poses: Poses
    blur: float  # pixels, standard deviation, of the lens
    random: np.random.Generator

    @property
    def truths(self) -> tuple[Detection, ...]:
        """Where the peg and the hole part are in the image."""
        return tuple(true_detection(self.camera, X_WP) for X_WP in self.poses)

    def lengths(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return half width and length of both parts, pixels, as if at the nominal distance."""
        metre = 1 / self.pixel_size
        peg, hole = self.parts.peg, self.parts.hole
        return (
            (metre * peg.radius, metre * peg.length),
            (metre * hole.outer_radius, metre * hole.depth),
        )

    def layer(self, parts: ColouredParts | None = None) -> tuple[Light, Share]:
        """Return the light of the parts alone, and how much of each pixel they cover."""
        black, white = (
            render(
                parts or self.parts,
                self.camera,
                *self.poses,
                style=SceneStyle(background=colour, blur=self.blur),
            ).astype(np.float32)
            for colour in ((0, 0, 0), (255, 255, 255))
        )
        return black, 1 - (white - black).mean(axis=2) / 255

    def flat(self, colour: Colour | Light = SceneStyle.background) -> Light:
        """Return a picture of one colour."""
        shape = (self.camera.height, self.camera.width, 3)
        return np.broadcast_to(np.asarray(colour, np.float32), shape).copy()

    def over(self, background: Light, parts: ColouredParts | None = None) -> Light:
        """Return the parts in front of a background."""
        return _before(background, *self.layer(parts))

    def along(self, part: int) -> tuple[Share, Share]:
        """Return how far pixels are ahead of a part's end, and aside of its axis, pixels."""
        true = self.truths[part]
        forward = -1.0 if part else 1.0  # out of the part
        cos, sin = forward * math.cos(true.angle), forward * math.sin(true.angle)
        v, u = np.mgrid[: self.camera.height, : self.camera.width].astype(np.float32)
        u, v = u - true.tip[0], v - true.tip[1]
        return cos * u + sin * v, cos * v - sin * u

    def field(self) -> NDArray[Any]:
        """Return rows and columns from -1 to 1, shape (2, height, width)."""
        return np.mgrid[-1 : 1 : self.camera.height * 1j, -1 : 1 : self.camera.width * 1j]

    def texture(self, along: float, across: float) -> Share:
        """Return noise of standard deviation 1, with grains of so many pixels."""
        noise = self.random.standard_normal((self.camera.height, self.camera.width))
        grains = cv2.GaussianBlur(
            noise.astype(np.float32), (0, 0), along * self.pixel, sigmaY=across * self.pixel
        )
        return np.asarray(grains / grains.std(), np.float32)


def _plain(scene: Scene, level: float = 0.0) -> Light:
    return scene.over(scene.flat())


def _soft(distance: Share, width: float = 1.0) -> Share:
    """Return 1 inside of an edge, distance < 0, and 0 outside, of a soft edge's width."""
    return np.asarray(np.clip(0.5 - distance / width, 0, 1))


def _dimmed(light: Light, share: Share) -> Light:
    return np.asarray(light * share[..., np.newaxis])


def _before(background: Light, light: Light, share: Share) -> Light:
    """Return the light of what covers a share of each pixel, in front of a background."""
    return light + (1 - share[..., np.newaxis]) * background


def _mixed(under: Light, over: Light | Colour, share: Share) -> Light:
    of = share[..., np.newaxis]
    return np.asarray((1 - of) * under + of * np.asarray(over, np.float32))


# What is behind the parts


def _coloured(colour: Colour, grain: float) -> "Draw":
    def draw(scene: Scene, level: float) -> Light:
        tone = _GREY + level * (np.asarray(colour, np.float32) - _GREY)
        shade = 1 + grain * scene.texture(along=40.0, across=1.5)
        return scene.over(np.clip(_dimmed(scene.flat(tone), shade), 0, 255))

    return draw


def _gradient(scene: Scene, level: float) -> Light:
    angle = scene.random.uniform(0, 2 * math.pi)
    v, u = scene.field()
    return _dimmed(_plain(scene), 1 + level / 2 * (math.cos(angle) * u + math.sin(angle) * v))


def _clutter(scene: Scene, level: float) -> Light:
    picture = photograph(scene.camera.width, scene.camera.height, scene.random)
    return scene.over(_GREY + level * (picture.astype(np.float32) - _GREY))


def _shadow(scene: Scene, level: float) -> Light:
    light, share = scene.layer()
    du, dv = scene.pixel * np.array([6.0, 9.0])
    move = np.array([[1.0, 0.0, du], [0.0, 1.0, dv]])
    shadow = cv2.warpAffine(share, move, share.shape[::-1])
    shadow = cv2.GaussianBlur(shadow, (0, 0), 3.0 * scene.pixel)
    behind = _dimmed(scene.flat(), 1 - level * shadow)
    return np.asarray(_before(behind, light, share), np.float32)


def _reflection(scene: Scene, level: float) -> Light:
    light, share = scene.layer()
    move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 50.0 * scene.pixel]])
    size = share.shape[::-1]
    image = cv2.warpAffine(light, move, size)
    weak = level * cv2.warpAffine(share, move, size)[..., np.newaxis]
    behind = (1 - weak) * scene.flat() + level * image
    return np.asarray(_before(behind, light, share), np.float32)


# On the parts


def _highlight(scene: Scene, level: float) -> Light:
    light, share = scene.layer()
    white = 255 * np.repeat(share[..., np.newaxis], 3, axis=2)
    for part, (half, _) in enumerate(scene.lengths()):
        ahead, aside = scene.along(part)
        stripe = _soft(np.abs(aside + 0.25 * half) - 0.2 * half, 2.0)
        light = _mixed(light, white, level * stripe * (ahead < 8 * scene.pixel))
    return _before(scene.flat(), light, share)


def _shading(scene: Scene, level: float) -> Light:
    light, share = scene.layer()
    for part, (half, _) in enumerate(scene.lengths()):
        ahead, aside = scene.along(part)
        dark = level * np.clip(0.5 + aside / (2 * half), 0, 1)
        light = _dimmed(light, 1 - dark * (ahead < 8 * scene.pixel))
    return _before(scene.flat(), light, share)


def _faded(scene: Scene, level: float) -> Light:
    light, share = scene.layer()
    light = (1 - level) * light + level * share[..., np.newaxis] * _GREY
    return _before(scene.flat(), light, share)


def _alike(scene: Scene, level: float) -> Light:
    return scene.over(scene.flat(), _recoloured(scene.parts, level))


def _recoloured(parts: ColouredParts, hue: float) -> ColouredParts:
    """Return the parts with a hole part whose hue differs by so much, of 256, from the peg's."""
    pixel = np.array([[parts.peg_colour]], np.uint8)
    hsv = cv2.cvtColor(pixel, cv2.COLOR_RGB2HSV_FULL).astype(int)
    hsv[..., 0] = (hsv[..., 0] + int(hue)) % 256
    red, green, blue = cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2RGB_FULL)[0, 0].tolist()
    return replace(parts, hole_colour=(red, green, blue))


# Beside the parts and before them


def _box(scene: Scene, level: float) -> Light:
    (half, length), _ = scene.lengths()
    wide, long = level * half, level * length / 2
    camera, random = scene.camera, scene.random
    angle, side = random.uniform(-0.15, 0.15), random.choice((-1.0, 1.0))
    # Clear of both parts: of their outermost pixels on that side.
    _, share = scene.layer()
    rows = np.nonzero(share.max(axis=1) > 0)[0]
    edge = rows.max() if side > 0 else rows.min()
    clear = wide + abs(math.sin(angle)) * long + 10 * scene.pixel
    middle = camera.width * random.uniform(0.3, 0.7), edge + side * clear
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float32)
    u, v = u - np.float32(middle[0]), v - np.float32(middle[1])
    along = np.abs(math.cos(angle) * u + math.sin(angle) * v) - long
    across = np.abs(math.cos(angle) * v - math.sin(angle) * u) - wide
    inside = _soft(np.maximum(along, across), 2.0)
    return scene.over(_mixed(scene.flat(), scene.parts.peg_colour, inside))


def _end_cover(part: int) -> "Draw":
    def draw(scene: Scene, level: float) -> Light:
        ahead, aside = scene.along(part)
        turn = scene.random.uniform(-0.03, 0.03)
        inside = _soft(-(ahead + turn * aside) - level * scene.pixel, 1.7)
        other, _ = scene.along(1 - part)
        return _mixed(_plain(scene), scene.flat(), inside * (other > 5))

    return draw


def _side_cover(scene: Scene, level: float) -> Light:
    ahead, aside = scene.along(0)
    (half, _), _ = scene.lengths()
    inside = _soft(half - level * scene.pixel - aside, 1.7) * (aside < 1.5 * half)
    return _mixed(_plain(scene), scene.flat(), inside * (ahead < 8 * scene.pixel))


def _wire(scene: Scene, level: float) -> Light:
    light = _plain(scene)
    for part, (half, length) in enumerate(scene.lengths()):
        ahead, aside = scene.along(part)
        lean = scene.random.uniform(-0.7, 0.7)
        place = -length * scene.random.uniform(0.25, 0.6)
        across = np.abs(ahead - place + math.tan(lean) * aside) * math.cos(lean)
        inside = _soft(across - level * scene.pixel / 2, 1.7)
        light = _mixed(light, _DARK, inside * (np.abs(aside) < 1.6 * half))
    return light


# How it is seen


def _blur(scene: Scene, level: float) -> Light:
    return np.asarray(cv2.GaussianBlur(_plain(scene), (0, 0), level * scene.pixel), np.float32)


def _motion(scene: Scene, level: float) -> Light:
    angle = scene.random.uniform(0, math.pi)
    length = level * scene.pixel
    size = 2 * math.ceil(length / 2) + 3
    v, u = np.mgrid[:size, :size].astype(np.float32) - np.float32(size // 2)
    along = math.cos(angle) * u + math.sin(angle) * v
    across = math.cos(angle) * v - math.sin(angle) * u
    kernel = np.clip(length / 2 + 0.5 - np.abs(along), 0, 1) * np.clip(1 - np.abs(across), 0, 1)
    blurred = cv2.filter2D(
        _plain(scene), -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(blurred, np.float32)


def _gains(red: float, blue: float) -> "Draw":
    def draw(scene: Scene, level: float) -> Light:
        gains = np.array([1 + red * level, 1, 1 + blue * level], np.float32)
        return _plain(scene) * gains

    return draw


def _vignetting(scene: Scene, level: float) -> Light:
    v, u = scene.field()
    return _dimmed(_plain(scene), 1 - level * (u * u + v * v) / 2)


def _veil(scene: Scene, level: float) -> Light:
    return (1 - level) * _plain(scene) + np.float32(255 * level)


def _exposure(scene: Scene, level: float) -> Light:
    return level * _plain(scene)


# In the picture


def _gamma(image: Image, level: float, random: np.random.Generator) -> Image:
    del random
    table = np.rint(255 * (np.arange(256) / 255) ** (1 / level)).astype(np.uint8)
    return table[image]


def _jpeg(image: Image, level: float, random: np.random.Generator) -> Image:
    del random
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(level)]
    _, data = cv2.imencode(".jpg", image[..., ::-1], quality)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert picture is not None
    return np.ascontiguousarray(picture[..., ::-1]).astype(np.uint8)


def _bayer(image: Image, level: float, random: np.random.Generator) -> Image:
    raw = image[..., 1].astype(np.float32)
    raw[::2, ::2], raw[1::2, 1::2] = image[::2, ::2, 0], image[1::2, 1::2, 2]
    raw += level * random.standard_normal(raw.shape).astype(np.float32)
    pattern = np.clip(np.rint(raw), 0, 255).astype(np.uint8)
    # OpenCV names a pattern by its second row's second and third pixels.
    return cv2.cvtColor(pattern, cv2.COLOR_BayerBG2RGB).astype(np.uint8)


def _dead(image: Image, level: float, random: np.random.Generator) -> Image:
    result = image.copy()
    height, width = image.shape[:2]
    count = round(level / 100 * height * width)
    rows, columns = random.integers(0, height, count), random.integers(0, width, count)
    result[rows, columns] = 255 * random.integers(0, 2, (count, 1))
    return result


Draw = Callable[[Scene, float], Light]
Change = Callable[[Image, float, np.random.Generator], Image]
Asked = Literal["found", "refused", "either"]


class Condition(NamedTuple):
    """Conditions that make the parts hard to see."""

    said: str  # in a few words, with the level as {}
    levels: tuple[float, float, float]
    draw: Draw = _plain  # what falls on the sensor
    change: Change | None = None  # what becomes of the sensor's picture
    noise: bool = False  # whether the level is the noise, grey levels
    width: bool = False  # whether the level is the image's width, pixels
    hue: bool = False  # whether the level is the hole part's hue beyond the peg's, of 256
    asked: Asked = "found"  # at the middle severity; refused: of at least one part


CONDITIONS: Final[Mapping[str, Condition]] = {
    "none": Condition("as the cell's cameras see it", (0, 0, 0)),
    "shadow": Condition("soft shadow, {:g} dark", (0.2, 0.4, 0.6), _shadow),
    "highlight": Condition("white stripe, {:g}", (0.6, 0.8, 1.0), _highlight),
    "shading": Condition("light from a side, {:g}", (0.2, 0.4, 0.6), _shading),
    "faded": Condition("faded colours, {:g} grey", (0.2, 0.35, 0.5), _faded),
    "blur": Condition("blur, {:g} px", (1.0, 2.5, 4.0), _blur),
    "motion": Condition("motion blur, {:g} px", (3.0, 9.0, 15.0), _motion),
    "wood": Condition("wood behind, {:g} of its colour", (0.5, 1.0, 1.5), _coloured(_WOOD, 0.04)),
    "skin": Condition("skin behind, {:g} of its colour", (0.5, 1.0, 1.5), _coloured(_SKIN, 0.01)),
    "clutter": Condition("photograph behind, {:g} of it", (0.25, 0.5, 1.0), _clutter),
    "cold": Condition("cold white balance, {:g}", (0.15, 0.3, 0.45), _gains(-1.0, 1.0)),
    "warm": Condition("warm white balance, {:g}", (0.15, 0.3, 0.45), _gains(1.0, -1.0)),
    "gradient": Condition("uneven light, {:g}", (0.3, 0.6, 0.9), _gradient),
    "vignetting": Condition("vignetting, {:g} at corners", (0.2, 0.4, 0.6), _vignetting),
    "veil": Condition("veiling glare, {:g}", (0.15, 0.3, 0.45), _veil),
    "reflection": Condition("reflection below, {:g}", (0.1, 0.2, 0.4), _reflection),
    "dark": Condition("underexposed, {:g}", (0.5, 0.35, 0.2), _exposure),
    "bright": Condition("overexposed, {:g}", (1.15, 1.3, 1.6), _exposure),
    "gamma": Condition("gamma, {:g}", (1.4, 1.8, 2.2), change=_gamma),
    "noise": Condition("noise, {:g} grey levels", (8.0, 12.0, 20.0), noise=True),
    "dead": Condition("dead pixels, {:g} %", (0.2, 1.0, 5.0), change=_dead),
    "bayer": Condition("Bayer pattern, noise +{:g}", (0.0, 4.0, 8.0), change=_bayer),
    "jpeg": Condition("JPEG quality, {:g}", (80.0, 50.0, 20.0), change=_jpeg),
    "coarse": Condition("fewer pixels, {:g} wide", (240.0, 160.0, 120.0), width=True),
    "fine": Condition("more pixels, {:g} wide", (480.0, 640.0, 1280.0), width=True),
    "box": Condition("red box beside, {:g}", (1.2, 1.6, 2.5), _box),
    "wire": Condition("wires across, {:g} px", (3.0, 6.0, 12.0), _wire),
    "tip": Condition("tip covered, {:g} px", (5.0, 10.0, 20.0), _end_cover(0), asked="refused"),
    "mouth": Condition(
        "mouth covered, {:g} px", (5.0, 10.0, 20.0), _end_cover(1), asked="refused"
    ),
    "side": Condition("side covered, {:g} px", (4.0, 8.0, 12.0), _side_cover, asked="refused"),
    "alike": Condition(
        "both hues alike, {:g} of 256", (20, 10, 0), _alike, hue=True, asked="either"
    ),
}
