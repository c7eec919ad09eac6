"""Photographs without parts in them: scikit-image's, of the extra ``photographs``."""

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any, Final

import cv2
import numpy as np

from chamfer.analysis.scenario.errors import UserError
from chamfer.systems.cameras.camera_image import Image

# In colour, of scenes, and in the package itself: nothing is downloaded.
NAMES: Final = ("astronaut", "chelsea", "coffee", "rocket", "stereo_motorcycle")


def installed() -> bool:
    """Return whether there are photographs."""
    return find_spec("skimage") is not None


def require_photographs() -> None:
    """Raise :class:`UserError` unless there are photographs."""
    if not installed():
        raise UserError(
            "scikit-image's photographs are not installed: pip install 'chamfer[photographs]'"
        )


@cache
def _read(name: str) -> Image:
    require_photographs()
    from skimage import data

    read: Callable[[], Any] = getattr(data, name)
    picture = read()[0] if name == "stereo_motorcycle" else read()
    return np.ascontiguousarray(picture[..., :3], np.uint8)


def photograph(width: int, height: int, random: np.random.Generator) -> Image:
    """Return a part of a photograph, drawn at random, shape (height, width, 3).

    Raises:
        UserError: If scikit-image is not installed.
    """
    whole = _read(NAMES[random.integers(len(NAMES))])
    rows, columns = whole.shape[:2]
    # As large a part as has the picture's sides, or down to half of it.
    share = random.uniform(0.5, 1.0) * min(columns / width, rows / height)
    w, h = int(share * width), int(share * height)
    left, top = random.integers(columns - w + 1), random.integers(rows - h + 1)
    cut = whole[top : top + h, left : left + w]
    size = cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA)
    return size.astype(np.uint8)
