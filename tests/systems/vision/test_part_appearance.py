"""What follows from the parts' sizes for their looks in an image."""

from typing import Any

import pytest

from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.vision.part_appearance import PEG, Appearance, appearances

PARTS = ColouredParts()


def test_sizes_follow_from_the_parts_and_the_size_of_a_pixel() -> None:
    for pixel_size in (0.0005, 0.001):
        for look, radius, length in zip(
            appearances(PARTS, pixel_size), (9.779, 14.0), (60.0, 40.0), strict=True
        ):
            assert look.half_width is not None
            assert look.aspect is not None
            low, high = look.half_width
            # A focal length that is wrong by 1.3, of a part a tenth nearer or farther.
            assert low < radius / 1000 / pixel_size / (1.3 * 1.1)
            assert high > radius / 1000 / pixel_size * (1.3 * 1.1)
            assert sum(look.aspect) / 2 == pytest.approx(length / (2 * radius))


def test_of_parts_of_unknown_size_no_size_is_asked() -> None:
    for look in appearances(PARTS):
        assert look.half_width is look.aspect is None
    assert appearances(PARTS)[0] == PEG
    learnt = PEG.sized(10.0)
    assert learnt.half_width is not None
    assert learnt.aspect is None


@pytest.mark.parametrize("name", ["half_width", "aspect"])
@pytest.mark.parametrize("limits", [(0.0, 1.0), (2.0, 1.0), (1.0, float("inf"))])
def test_limits_that_are_none(name: str, limits: tuple[float, float]) -> None:
    changes: dict[str, Any] = {name: limits}
    with pytest.raises(ParameterError, match=f"^{name} is .*the least one first, or null"):
        Appearance(hue=0, front=1, **changes)


@pytest.mark.parametrize(("sizes", "name"), [((0.0, 9.0), "half_width"), ((9.0, -1.0), "length")])
def test_sizes_are_positive(sizes: tuple[float, float], name: str) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is "):
        PEG.sized(*sizes)
