"""What the report's figure shows of a calibration."""

from collections.abc import Callable

import numpy as np
from matplotlib.quiver import Quiver

from chamfer.analysis.calibration.calibration import calibrate
from chamfer.analysis.calibration.calibration_figures import plot_residuals
from chamfer.analysis.calibration.camera_fit import Seen
from chamfer.analysis.calibration.drawn_boards import BoardPoses
from chamfer.models.cameras.camera import Camera

SIZE = (640, 480)

Place = Callable[..., list[Camera]]
Look = Callable[..., list[Seen]]


def test_each_corner_has_an_arrow_and_each_picture_a_bar(place: Place, look: Look) -> None:
    seen = [*look(place(5)), Seen(name="a$b.png", reason="the board is not found")]
    found = calibrate([seen], [SIZE])
    residuals, coverage, errors, _ = plot_residuals(found).axes
    (arrows,) = (one for one in residuals.collections if isinstance(one, Quiver))
    (pictures,) = found.pictures
    expected = np.concatenate([one.residuals for one in pictures if one.residuals is not None])
    np.testing.assert_array_equal(np.column_stack([arrows.U, arrows.V]), expected)
    assert residuals.get_ylim() == (479.5, -0.5)  # v down, as in the picture
    assert [bar.get_width() for bar in errors.patches] == [one.error or 0.0 for one in pictures]
    assert [text.get_text() for text in errors.texts] == [" left out"]
    assert errors.get_yticklabels()[-1].get_text() == r"a\$b.png"
    (mesh,) = coverage.collections
    counts = np.ma.filled(mesh.get_array(), 0.0)
    assert np.nansum(counts) == 5 * 54


def test_two_cameras_have_a_row_each_and_many_pictures_no_names(
    camera: Camera, place: Place, look: Look
) -> None:
    places = place(41, poses=BoardPoses(extent=(0.3, 0.5)))
    beside = [one.placed(one.R_WC, one.p_WC + one.R_WC @ [0.05, 0.0, 0.0]) for one in places]
    found = calibrate([look(places, 1), look(beside, 2)], [SIZE, SIZE])
    figure = plot_residuals(found)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert [title.split(":")[0] for title in titles if "camera" in title] == [
        "Left camera",
        "Right camera",
    ]
    assert [axes.get_ylabel() for axes in figure.axes].count("picture / number") == 2
