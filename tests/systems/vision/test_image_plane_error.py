import math

import numpy as np
import pytest

from chamfer.systems.vision.cell_error import ImagePlaneError

NOTHING = [math.nan] * 3


def six(xz: list[float], xy: list[float]) -> np.ndarray:
    block = ImagePlaneError()
    context = block.CreateDefaultContext()
    block.GetInputPort("xz_error").FixValue(context, xz)
    block.GetInputPort("xy_error").FixValue(context, xy)
    return np.array(block.GetOutputPort("alignment_error").Eval(context))


def test_down_in_the_images_is_down_and_to_the_right_of_the_way() -> None:
    error = six([70.0, 4.0, 0.02], [69.0, 3.0, 0.05])
    np.testing.assert_array_equal(error, [70.0, -3.0, -4.0, 0.0, 0.02, -0.05])


def test_what_is_not_measured_is_nan() -> None:
    hidden = six([math.nan, 4.0, 0.02], [69.0, 3.0, 0.05])
    np.testing.assert_array_equal(hidden, [math.nan, -3.0, -4.0, 0.0, 0.02, -0.05])
    one_view = six([70.0, 4.0, 0.02], NOTHING)
    np.testing.assert_array_equal(one_view, [70.0, math.nan, -4.0, 0.0, 0.02, math.nan])
    assert np.isnan(six(NOTHING, [69.0, 3.0, 0.05])).tolist() == [1, 0, 1, 1, 1, 0]
    assert np.isnan(six(NOTHING, NOTHING)).all()


@pytest.mark.parametrize("view", ["xz", "xy"])
def test_the_error_follows_both_images_at_once(view: str) -> None:
    block = ImagePlaneError()
    assert block.HasDirectFeedthrough(int(block.GetInputPort(f"{view}_error").get_index()), 0)
