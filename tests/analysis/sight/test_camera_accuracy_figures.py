import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.analysis.sight.camera_accuracy import plot_accuracy
from chamfer.analysis.sight.detection_trials import UNITS

CASES = {"first": "far away", "second": "nearby"}
KINDS = ("clean", "noisy", "sampled")
TIPS = [(100.25, 50.0), (130.0, 52.0), (101.0, 60.5), (131.0, 61.0)]  # peg and hole, two views


def outcome(lost: bool = False) -> Outcome:
    """Row k has an rms of 10^(-3 + k/3) in the metric's unit, and thrice that at most."""
    metrics = {}
    for i, case in enumerate(CASES):
        for j, kind in enumerate(KINDS):
            rms = 10 ** (-3 + (3 * i + j) / 3)
            for name, unit in UNITS.items():
                given = None if lost and "peg" in name else rms
                most = None if given is None else 3 * given
                metrics[f"{case}.{kind}.{name}.rms"] = Metric(value=given, unit=unit)
                metrics[f"{case}.{kind}.{name}.max"] = Metric(value=most, unit=unit)
    v, u = np.mgrid[40:70, 90:150]
    frames = {
        "view": np.repeat([0, 1], u.size),
        "u": np.tile(u.ravel(), 2),
        "v": np.tile(v.ravel(), 2),
        "red": np.tile((u.ravel() < 100) * 255, 2),
        "green": np.repeat([0, 255], u.size),
        "blue": np.tile(v.ravel(), 2),
    }
    tips = np.array(TIPS)
    if lost:
        tips[::2] = np.nan
    inside = np.where(np.arange(4) % 2 == 0, -20.0, 20.0)  # pixels, from the tip into the part
    marks = {
        "view": np.array([0, 0, 1, 1]),
        "part": np.array([0, 1, 0, 1]),
        "tip_u": tips[:, 0],
        "tip_v": tips[:, 1],
        "point_u": tips[:, 0] + inside,
        "point_v": tips[:, 1] + 0.1 * inside,
        "angle": np.full(4, np.arctan(0.1)),
    }
    return Outcome(
        metrics=metrics,
        traces={"trial": np.array([0.0, 1.0, 2.0, 0.0])},
        simulated_seconds=0.0,
        tables={"frames": frames, "frame_detections": marks},
    )


@pytest.fixture(scope="module")
def figure() -> Figure:
    return plot_accuracy(outcome(), cases=CASES, kinds=KINDS, pixel_size=0.0005)


def panels(figure: Figure) -> dict[str, Axes]:
    return {axes.get_title(loc="left"): axes for axes in figure.axes}


def test_marks_are_the_metrics_in_the_panels_unit(figure: Figure) -> None:
    rms = 10 ** (-3 + np.arange(6) / 3)
    # The error signal is in metres, of which 0.5 mm are a pixel.
    for title, label, factor in (
        ("Across the axis", "peg, X-Z", 1.0),
        ("Along the axis", "hole, X-Y", 1.0),
        ("Across the axis", "error signal, not calibrated, X-Z", 2000.0),
        ("Angle of the axis", "peg, X-Y", 1e3),
        ("Angle of the axis", "error signal, not calibrated, X-Y", 1e3),
        ("Tips in space, by stereo", "peg to hole, in space", 1e3),
    ):
        axes = panels(figure)[title]
        (line,) = [line for line in axes.get_lines() if line.get_label() == label]
        np.testing.assert_allclose(line.get_xdata(), factor * rms)
        rows = np.asarray(line.get_ydata())
        assert (np.diff(rows) > 0).all()
        assert rows[3] - rows[2] == pytest.approx(2)  # a heading between the cases


def test_the_published_millimetre_is_two_pixels(figure: Figure) -> None:
    for title, at in (
        ("Across the axis", 2.0),
        ("Along the axis", 2.0),
        ("Tips in space, by stereo", 1.0),
    ):
        lines = [line.get_xdata() for line in panels(figure)[title].get_lines()]
        assert any(np.array_equal(np.asarray(line), [at, at]) for line in lines)


def test_pixels_are_where_they_are_and_the_tips_on_them(figure: Figure) -> None:
    for view, title in enumerate(("X-Z, seen along Y", "X-Y, seen from above")):
        axes = panels(figure)[title]
        (picture,) = axes.get_images()
        assert picture.get_extent() == [89.5, 149.5, 69.5, 39.5]
        pixels = np.asarray(picture.get_array())
        assert pixels.shape == (30, 60, 3)
        np.testing.assert_allclose(pixels[5, 9], [1.0, view, 45 / 255])
        np.testing.assert_allclose(pixels[5, 10], [0.0, view, 45 / 255])
        points = [line.get_xydata()[0] for line in axes.get_lines() if line.get_marker() == "+"]
        np.testing.assert_array_equal(points, TIPS[2 * view : 2 * view + 2])
        axis = next(line for line in axes.get_lines() if line.get_marker() != "+")
        (u0, v0), (u1, v1) = np.asarray(axis.get_xydata())
        assert (v1 - v0) / (u1 - u0) == pytest.approx(0.1)
        assert u0 < TIPS[2 * view][0] < u1
    tip = [axes for axes in figure.axes if axes.get_title(loc="left") == "the peg's tip"]
    for view, axes in enumerate(tip):
        assert np.mean(axes.get_xlim()) == pytest.approx(TIPS[2 * view][0])
        assert np.mean(axes.get_ylim()) == pytest.approx(TIPS[2 * view][1])
        assert axes.yaxis_inverted()


@pytest.mark.slow
def test_it_is_drawn_also_without_a_peg() -> None:
    figure = plot_accuracy(outcome(lost=True), cases=CASES, kinds=KINDS, pixel_size=0.0005)
    FigureCanvasAgg(figure).draw()


@pytest.mark.parametrize("kinds", [KINDS, KINDS[:2]])  # VTK has no sampled images
def test_rows_are_named_and_poses_counted(kinds: tuple[str, ...]) -> None:
    figure = plot_accuracy(outcome(), cases=CASES, kinds=kinds, pixel_size=0.0005)
    axes = panels(figure)["Across the axis"]
    assert [text.get_text() for text in axes.get_yticklabels()] == [*kinds, *kinds]
    assert [text.get_text() for text in axes.texts] == list(CASES.values())
    title = figure.subfigs[1].get_suptitle()
    assert "3 poses" in title
    assert ("sampled" in title) == ("sampled" in kinds)
