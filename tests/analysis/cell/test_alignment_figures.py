from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.cell.alignment import (
    picture,
    plot_alignment,
    plot_pictures,
    plot_repeatability,
    take_pictures,
)
from chamfer.analysis.cell.alignment_runs import RepeatabilityScenario
from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts

LOOKS = appearances(ColouredParts(), 0.0005)

Array = NDArray[np.float64]

SCENARIO = AlignmentScenario()
MANY = RepeatabilityScenario(trials=3)
TIME = np.arange(321) / 80


def traces() -> dict[str, Array]:
    """From 10 mm and 0.06 rad to 0.1 mm and 0.003 rad; the peg's command moves by 4 mm."""
    share = np.clip((TIME - 1.5) / 1.5, 0.0, 1.0)
    made = {
        "time": TIME,
        "lateral_error": 0.01 * 0.01**share,
        "rotational_error": 0.06 * 0.05**share,
    }
    for arm, sign, x in (("peg", 1.0, -SCENARIO.gap), ("hole", -1.0, 0.0)):
        start = Rotation.from_euler("xyz", [0.0, 0.05, -0.06])
        turned = Rotation.from_rotvec(np.outer(share, [0.0, -0.02 * sign, 0.04 * sign])) * start
        for i, name in enumerate(("qw", "qx", "qy", "qz")):
            made[f"{arm}_{name}"] = -turned.as_quat(scalar_first=True)[:, i]  # either sign
        made[f"{arm}_x"] = np.full_like(TIME, x)
        made[f"{arm}_y"] = 0.006 - 0.003 * sign * share
        made[f"{arm}_z"] = 0.158 + 0.004 * sign * share
        for name, values in (("qw", 1.0), ("qx", 0.0), ("qy", 0.0), ("qz", 0.0), ("x", x)):
            made[f"{arm}_true_{name}"] = np.full_like(TIME, values)
        made[f"{arm}_true_y"] = np.zeros_like(TIME)
        made[f"{arm}_true_z"] = np.full_like(TIME, 0.158)
    made["peg_true_z"] = 0.158 - 0.01 * (1 - share)
    return made


def runs(count: int) -> Outcome:
    scale = np.arange(1, count + 1)
    share = np.clip((TIME - 1.5) / 1.5, 0.0, 1.0)
    table = {
        "trial": np.repeat(np.arange(count), len(TIME)),
        "time": np.tile(TIME, count),
        "lateral_error": np.concatenate([0.003 * k * 0.01**share for k in scale]),
        "rotational_error": np.concatenate([0.02 * k * 0.1**share for k in scale]),
    }
    ends = {"lateral_error": 3e-5 * scale, "rotational_error": 2e-3 * scale}
    metrics = {}
    for name, values in ends.items():
        mean = float(values.mean())
        half = float("nan") if count == 1 else mean / 2
        for of, value in (("mean_low", mean - half), ("mean_high", mean + half)):
            metrics[f"{name}.{of}"] = Metric(value=value, unit="")
    return Outcome(metrics=metrics, traces=ends, simulated_seconds=0.0, tables={"errors": table})


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    found = traces()
    return Outcome(
        metrics={},
        traces=found,
        simulated_seconds=4.0,
        tables={"pictures": take_pictures(SCENARIO, found, 0)},
    )


@pytest.fixture(scope="module")
def compensation(outcome: Outcome) -> Figure:
    return drawn(plot_alignment(SCENARIO, outcome))


@pytest.fixture(scope="module")
def repeated() -> Figure:
    return drawn(plot_repeatability(MANY, runs(3)))


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    return figure


def line(axes: Axes, label: str) -> tuple[Array, Array]:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def test_before_and_after_of_both_cameras(outcome: Outcome) -> None:
    figure = drawn(plot_pictures(SCENARIO, outcome))
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "X-Z plane, from the side: before",
        "X-Z plane, from the side: after 2.5 s",
        "X-Y plane, from above: before",
        "X-Y plane, from above: after 2.5 s",
    ]
    assert {axes.get_xlabel() for axes in figure.axes} == {"u / pixels"}
    assert {axes.get_ylabel() for axes in figure.axes} == {"v / pixels"}
    order = [("xz", "before"), ("xz", "after"), ("xy", "before"), ("xy", "after")]
    for axes, (view, moment) in zip(figure.axes, order, strict=True):
        image = picture(SCENARIO, outcome.tables["pictures"], view, moment)
        (shown,) = axes.get_images()
        np.testing.assert_array_equal(np.asarray(shown.get_array()), image)
        assert axes.get_xlim() == (-0.5, image.shape[1] - 0.5)
        assert axes.yaxis_inverted()
        marks = [one.get_xydata()[0] for one in axes.get_lines() if one.get_marker() == "+"]
        np.testing.assert_allclose(marks, [part.tip for part in detect_parts(image, *LOOKS)])
        for part, axis in zip(
            detect_parts(image, *LOOKS),
            [one for one in axes.get_lines() if one.get_marker() != "+"],
            strict=True,
        ):
            (u0, v0), (u1, v1) = axis.get_xydata()
            assert (v1 - v0) / (u1 - u0) == pytest.approx(np.tan(part.angle))
            on_axis = v0 + (part.point[0] - u0) * np.tan(part.angle)
            assert on_axis == pytest.approx(part.point[1])


def test_errors_in_millimetres_and_milliradians(compensation: Figure, outcome: Outcome) -> None:
    for axes, name, published, settled in (
        (compensation.axes[0], "lateral", 2.5, 1.0),
        (compensation.axes[1], "rotational", 22.0, 10.0),
    ):
        curve = axes.get_lines()[0]
        np.testing.assert_allclose(curve.get_ydata(), 1e3 * outcome.traces[f"{name}_error"])
        _, mean = line(axes, "published mean of ten runs")
        np.testing.assert_allclose(mean, published)
        assert axes.get_yscale() == "log"
        (band,) = (one for one in axes.patches if one.get_label() == "counted as settled")
        assert band.get_extents().y1 == pytest.approx(axes.transData.transform((0.0, settled))[1])
        assert axes.get_xlim() == (0.0, 4.0)


def test_compensation_is_what_was_added_since_the_start(compensation: Figure) -> None:
    for row, sign in ((2, 1.0), (4, -1.0)):
        shift, turn = compensation.axes[row : row + 2]
        for label, end in (("X", 0.0), ("Y", -3.0 * sign), ("Z", 4.0 * sign)):
            x, y = line(shift, label)
            assert (x[0], y[0]) == (0.0, 0.0)
            assert (x[-1], y[-1]) == (4.0, pytest.approx(end, abs=1e-9))
        vector = np.array([0.0, -0.02 * sign, 0.04 * sign])
        quaternion = Rotation.from_rotvec(vector).as_quat(scalar_first=True)
        for label, element in zip(
            ("w - 1", "x", "y", "z"), quaternion - [1.0, 0.0, 0.0, 0.0], strict=True
        ):
            _, y = line(turn, label)
            assert y[0] == pytest.approx(0.0, abs=1e-12)
            assert y[-1] == pytest.approx(element, abs=1e-12)


def test_every_run_over_time_and_at_its_end(repeated: Figure) -> None:
    lateral, rotational, ends = repeated.axes
    for axes, first in ((lateral, 3.0), (rotational, 20.0)):
        found = [one for one in axes.get_lines() if one.get_label().startswith("_")]
        assert len(found) == 3
        for k, one in enumerate(found, start=1):
            x, y = np.asarray(one.get_xdata()), np.asarray(one.get_ydata())
            assert x[0] == -1.5
            assert y[0] == pytest.approx(first * k)
        assert axes.get_xlim() == (-0.25, 2.5)
    x, y = line(ends, "ends of the trials")
    np.testing.assert_allclose(x, [0.03, 0.06, 0.09])
    np.testing.assert_allclose(y, [2.0, 4.0, 6.0])
    assert [one.item() for one in line(ends, "published mean of ten runs")] == [2.5, 22.0]
    assert [one.item() for one in line(ends, "published largest of ten runs")] == [3.2, 40.0]
    x, y = line(ends, "exact side")
    np.testing.assert_allclose(y, 1e3 * rotation_bounds(MANY.parts, MANY.held(), x / 1e3)[1])
    x, y = line(ends, "simple side")
    np.testing.assert_allclose(
        y, 1e3 * rotation_bounds(MANY.parts, MANY.held(), x / 1e3, "simple")[1]
    )
    (box,) = (one for one in ends.patches if one.get_label() == "95 % intervals of the means")
    got: Any = box.get_bbox()
    np.testing.assert_allclose(got.extents, [0.03, 2.0, 0.09, 6.0])
