"""The image port that all cameras share, and the frame grabber behind a camera.

An image is a pydrake ``ImageRgba8U``: red, green, blue, and 255 as the fourth channel. Where the
fourth channel is 0 there is no image: none has arrived yet, or the frame was dropped.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State
from pydrake.systems.primitives import RandomSource
from pydrake.systems.sensors import ImageRgba8U
from scipy.special import ndtri

from chamfer.models.validation import ParameterError, require_between, require_not_negative
from chamfer.systems.compiled import compiled

# On images this small threads cost more than they bring, and they fight a software renderer's.
cv2.setNumThreads(1)

Image = NDArray[np.uint8]
Levels = NDArray[np.int16]


def write_image(output: Any, rgb: Image) -> None:
    """Copy an image, shape (height, width, 3), to the value of an image port."""
    image = output.get_mutable_value()
    height, width = rgb.shape[:2]
    if image.shape != (height, width, 4):
        image.resize(width, height)
    cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA, dst=image.mutable_data)


def read_image(image: ImageRgba8U) -> Image | None:
    """Return red, green and blue of an image port's value, shape (height, width, 3).

    A copy, which stays as it is; None where there is no image.
    """
    rgba = image.data
    if rgba[0, 0, 3] == 0:
        return None
    rgb: Image = cv2.cvtColor(np.asarray(rgba), cv2.COLOR_RGBA2RGB).astype(np.uint8, copy=False)
    return rgb


def add_noise(rgb: Image, noise: float, generator: np.random.Generator) -> Image:
    """Return an image with normally distributed noise on every channel of every pixel.

    Its standard deviation is in grey levels, at most 60; as much is drawn for every image.
    """
    draw = generator.bit_generator.random_raw(rgb.size // 4 + 1).view(np.uint16)
    noisy = np.empty_like(rgb)
    _add_levels(rgb.ravel(), _levels(noise), draw, noisy.ravel())
    return noisy


@lru_cache(maxsize=8)
def _levels(noise: float) -> Levels:
    """Return the normal distribution as 65,536 equally likely whole grey levels."""
    quantiles = ndtri((np.arange(65536) + 0.5) / 65536)
    return np.rint(noise * quantiles).astype(np.int16)


@compiled
def _add_levels(image: Image, levels: Levels, draw: NDArray[np.uint16], noisy: Image) -> None:
    more = np.empty(len(image), np.int16)
    for k in range(len(image)):
        more[k] = levels[draw[k]]
    for k in range(len(image)):  # by itself: of many pixels at once
        noisy[k] = max(0, min(255, np.int16(image[k]) + more[k]))


_PERIODS: Final = (1e-4, 1.0)  # s, the least one of high-speed cameras; more may be in Hz


@dataclass(frozen=True, kw_only=True)
class FrameGrabberParams:
    """Parameters of :class:`FrameGrabber`; the paper gives only the rate."""

    period: float = 1 / 80  # s, between exposures, section 4
    offset: float = 0.0  # s, of the first exposure
    latency: int = 1  # of an image, in periods from the exposure to its arrival
    noise: float = 4.0  # grey levels, standard deviation; if not 0, connect the port random
    miss: float = 0.0  # probability that a frame is dropped; if not 0, connect the port random

    def __post_init__(self) -> None:
        require_between(self, *_PERIODS, "period", unit="s, not Hz")
        require_not_negative(self, "offset")
        if not (isinstance(self.latency, int) and 0 <= self.latency <= 100):
            raise ParameterError("latency", self.latency, "a whole number from 0 to 100")
        require_between(self, 0, 60, "noise")
        require_between(self, 0, 1, "miss")


class _Frames(tuple[Image | None, ...]):
    """Frames on their way, which nobody changes: copies of a Context share them."""

    __slots__ = ()

    def __deepcopy__(self, memo: object) -> "_Frames":
        return self


class FrameGrabber(LeafSystem):
    """Takes images at a fixed rate and delivers them late, noisy, and sometimes not at all.

    .. pydrake_system::

        name: FrameGrabber
        input_ports:
        - image
        - random (optional)
        - trigger (optional)
        output_ports:
        - image

    The exposure is at ``offset + k period``. It samples the input before anything else is
    updated at that instant. With a plant that steps at the same instants rounding decides
    whether it has stepped: an offset of half a step keeps them apart. The output shows the frame
    from ``latency`` periods later until the next one arrives. A block with a discrete update at
    that same instant already reads it. There is no image (fourth channel 0) before the first one
    arrives, and for a whole period where a frame was dropped.

    ``trigger``, size 1: while it is 0 the block exposes nothing, and no image arrives.

    ``random``, shape (2,), uniform from 0 to 1 (Drake's ``RandomSource`` with the same period):
    the seed of the frame's noise, and whether it is dropped.

    Abstract state: the images on their way, oldest first.

    Raises:
        ValueError: If ``random`` is needed and not connected.
    """

    def __init__(self, params: FrameGrabberParams, width: int = 320, height: int = 240) -> None:
        super().__init__()
        self._params = params
        self._blank = ImageRgba8U(width, height, 0)
        model = Value(self._blank)
        self._image = self.DeclareAbstractInputPort("image", model)
        self._random = self.DeclareVectorInputPort("random", 2)
        self._trigger = self.DeclareVectorInputPort("trigger", 1)
        frames = self.DeclareAbstractState(Value(_Frames([None] * (params.latency + 1))))
        self._frames = int(frames)
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, params.offset, self._grab)
        self.DeclareAbstractOutputPort(
            "image", model.Clone, self._calc_image, {self.abstract_state_ticket(frames)}
        )

    def _grab(self, context: Context, state: State) -> None:
        frames: Sequence[Image | None] = context.get_abstract_state(self._frames).get_value()
        newer = _Frames((*frames[1:], self._expose(context)))
        state.get_mutable_abstract_state(self._frames).set_value(newer)

    def _expose(self, context: Context) -> Image | None:
        params = self._params
        if self._trigger.HasValue(context) and self._trigger.Eval(context)[0] < 0.5:
            return None
        if params.noise or params.miss:
            if not self._random.HasValue(context):
                raise ValueError(
                    f"{self.get_name()}: random is not connected, but noise or miss need it"
                )
            seed, drop = self._random.Eval(context).tolist()
            if drop < params.miss:
                return None
        rgb = read_image(self._image.Eval(context))
        if params.noise and rgb is not None:
            rgb = add_noise(rgb, params.noise, np.random.default_rng(int(math.ldexp(seed, 53))))
        return rgb

    def _calc_image(self, context: Context, output: Any) -> None:
        frame = context.get_abstract_state(self._frames).get_value()[0]
        if frame is None:
            output.set_value(self._blank)
        else:
            write_image(output, frame)


def add_frame_grabber(
    builder: DiagramBuilder,
    params: FrameGrabberParams,
    name: str,
    width: int = 320,
    height: int = 240,
) -> FrameGrabber:
    """Add a frame grabber and, if it is noisy or drops frames, the source of its randomness."""
    grabber: FrameGrabber = builder.AddNamedSystem(name, FrameGrabber(params, width, height))
    if params.noise or params.miss:
        source = RandomSource(RandomDistribution.kUniform, 2, params.period)
        random = builder.AddNamedSystem(f"{name} random", source)
        builder.Connect(random.get_output_port(), grabber.GetInputPort("random"))
    return grabber


Gains = NDArray[np.float32]

NEUTRAL: Final = (1.0, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class SensorParams:
    """A camera's shutter, the light that its lens loses, and the colours that it sees."""

    exposure: float = 0.0  # s, time that the shutter is open, until the frame's instant
    vignetting: float = 0.0  # share of the light that is lost in the image's corners
    white_balance: tuple[float, float, float] = NEUTRAL  # gains of red, green and blue

    def __post_init__(self) -> None:
        require_not_negative(self, "exposure")
        require_between(self, 0, 1, "vignetting")
        gains = self.white_balance
        if len(gains) != 3 or not all(math.isfinite(gain) and gain > 0 for gain in gains):
            raise ParameterError("white_balance", gains, "three finite numbers > 0")

    @property
    def shades(self) -> bool:
        """Whether it changes the image of resting parts."""
        return self.vignetting > 0 or self.white_balance != NEUTRAL


def shaded(image: Image, vignetting: float, white_balance: tuple[float, float, float]) -> Image:
    """Return an image with other colours, up to white, and less light towards the corners.

    The share that is lost grows with the square of the distance from the image's middle.
    """
    height, width = image.shape[:2]
    gains = _gains(width, height, vignetting, white_balance)
    return cv2.multiply(image, gains, dtype=cv2.CV_8U).astype(np.uint8, copy=False)


@lru_cache(maxsize=8)
def _gains(
    width: int, height: int, vignetting: float, white_balance: tuple[float, float, float]
) -> Gains:
    v, u = np.mgrid[:height, :width]
    across, down = 2.0 * u - (width - 1), 2.0 * v - (height - 1)
    corner = max((width - 1) ** 2 + (height - 1) ** 2, 1)
    light = 1.0 - vignetting * (across**2 + down**2) / corner
    gains: Gains = (light[..., np.newaxis] * np.array(white_balance)).astype(np.float32)
    return gains
