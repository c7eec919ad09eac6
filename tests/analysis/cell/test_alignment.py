"""The experiments alignment, repeatability and vertical tracking: metrics, pictures, replays."""

import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from scipy.spatial.transform import Rotation

from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell import alignment as alignment_module
from chamfer.analysis.cell.alignment import (
    picture,
    pictures_at,
    plot_alignment,
    plot_moments,
    replay_alignment,
)
from chamfer.analysis.cell.alignment_runs import ALIGNMENT, RepeatabilityScenario, drawn
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.published.fsm_work_cell import MEAN_ERROR, WORST_ERROR
from chamfer.analysis.report.checks import check
from chamfer.analysis.report.replay import open_meshcat
from chamfer.analysis.scenario.experiment import Outcome, load, quiet, select
from chamfer.diagrams.cell.alignment_scenario import VERTICAL_TRACKING, AlignmentScenario
from chamfer.diagrams.cell.work_cell import ARMS, HOLE_ARM
from chamfer.models.arms import wam
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.force.arm_model import ArmModel, Placement
from chamfer.systems.vision.cell_error import AXES
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts

ALIGN, REPEATABILITY, TRACKING = map(
    load, select(CATALOGUE.entries, ["alignment", "repeatability", "vertical-tracking"])
)

SHORT: dict[str, Any] = {"begin": 0.1, "compensation_time": 0.3}
MANY = RepeatabilityScenario(**SHORT, trials=2)


@pytest.fixture(scope="module")
def many() -> Outcome:
    with pytest.warns(UserWarning, match="^in 1 of 2 trials the true error is larger"):
        return REPEATABILITY.run(REPEATABILITY.resolve(MANY), 0, quiet)


def test_metrics_of_one_run(value: Any) -> None:
    one = ALIGN.run(ALIGN.resolve(AlignmentScenario(**SHORT)), 0, quiet)
    undefined = [name for name, metric in one.metrics.items() if metric.value is None]
    assert undefined == ["settling_time"]  # in so short a time
    assert value(one, "detected") == 100
    assert value(one, "blind") == value(one, "saturated") == 0
    assert value(one, "compensation.lateral") > 1e-3
    assert value(one, "lateral_error") < value(one, "uncompensated.lateral_error")
    assert one.simulated_seconds == pytest.approx(0.4)


def test_metrics_of_many_runs(many: Outcome, value: Any) -> None:
    errors = many.traces["lateral_error"]
    assert value(many, "lateral_error.mean") == pytest.approx(errors.mean())
    assert value(many, "lateral_error.max") == errors.max()
    for name in ("uncompensated.lateral_error", "compensation.late_rotational"):
        assert value(many, name) == pytest.approx(many.traces[name].mean())
    assert many.metrics["settling_time"].value is None
    assert value(many, "settled") == 0
    assert many.simulated_seconds == pytest.approx(0.8)


def test_rows_are_the_trials(many: Outcome) -> None:
    rows = many.traces
    assert set(ALIGNMENT) < set(rows)
    np.testing.assert_array_equal(rows["trial"], [0, 1])
    for k in range(2):
        trial = drawn(MANY, MANY.spread, 0, k)
        for i, axis in ((1, "y"), (2, "z"), (4, "pitch"), (5, "yaw")):
            assert rows[f"initial_{axis}"][k] == trial.initial_error[i]
        for arm in ("peg", "hole"):
            settings = getattr(trial, arm)
            assert rows[f"{arm}_payload_error"][k] == settings.payload_error
            assert rows[f"{arm}_mass_scale"][k] == settings.mass_scale
            assert rows[f"{arm}_joint_friction"][k] == max(settings.joint_friction)
    table = many.tables["errors"]
    for k in range(2):
        of = table["trial"] == k
        np.testing.assert_allclose(table["time"][of], np.arange(33) / 80)
        assert table["lateral_error"][of][-1] == rows["lateral_error"][k]
        assert table["rotational_error"][of][-1] == rows["rotational_error"][k]


@pytest.mark.slow
def test_two_whole_runs_are_better_than_the_paper_s(value: Any) -> None:
    with parallel(2):
        outcome = REPEATABILITY.run(
            REPEATABILITY.resolve(RepeatabilityScenario(trials=2)), 3, quiet
        )
    assert value(outcome, "lateral_error.mean") < MEAN_ERROR[0] / 5
    assert value(outcome, "lateral_error.max") < WORST_ERROR[0] / 5
    assert value(outcome, "rotational_error.mean") < MEAN_ERROR[1]
    assert value(outcome, "rotational_error.max") < WORST_ERROR[1]
    assert value(outcome, "vision.lateral_error") < 1e-4
    assert value(outcome, "wedging") == value(outcome, "blind") == 0


LOOKS = appearances(ColouredParts(), 0.0005)

Array = NDArray[np.float64]

SCENARIO = AlignmentScenario()
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
    made["peg_true_y"] = 0.006 * (1 - share)
    made["peg_true_z"] = 0.158 - 0.008 * (1 - share)
    return made


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    found = traces()
    return Outcome(
        metrics={},
        traces=found,
        simulated_seconds=4.0,
        tables={"pictures": pictures_at(SCENARIO, found, {"before": 119, "after": -1}, 0)},
    )


def line(axes: Axes, label: str) -> tuple[Array, Array]:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def test_before_and_after_of_both_cameras(outcome: Outcome) -> None:
    moments = {"before": "before", "after": "after"}
    figure = plot_moments(SCENARIO, outcome.tables["pictures"], moments)
    order = [("xz", "before"), ("xz", "after"), ("xy", "before"), ("xy", "after")]
    for axes, (view, moment) in zip(figure.axes, order, strict=True):
        image = picture(SCENARIO, outcome.tables["pictures"], view, moment)
        (shown,) = axes.get_images()
        np.testing.assert_array_equal(np.asarray(shown.get_array()), image)
        marks = [one.get_xydata()[0] for one in axes.get_lines() if one.get_marker() == "+"]
        np.testing.assert_allclose(marks, [part.tip for part in detect_parts(image, *LOOKS)])
        # Down in the pictures is -Z and -Y: the tip is too low by 16 pixels and too far up by 12.
        peg, hole = detect_parts(image, *LOOKS)
        roll = Rotation.from_rotvec([0.0, 0.0, SCENARIO.cameras.roll]).as_matrix()[:2, :2]
        way = roll @ np.subtract(hole.tip, peg.tip)
        off = {("xz", "before"): -16.0, ("xy", "before"): 12.0}.get((view, moment), 0.0)
        assert way == pytest.approx([60.0, off], abs=1.5)


def test_compensation_is_what_was_added_since_the_start(outcome: Outcome) -> None:
    compensation = plot_alignment(SCENARIO, outcome)
    for axes, name in zip(compensation.axes, ("lateral", "rotational"), strict=False):
        curve = axes.get_lines()[0]
        np.testing.assert_allclose(curve.get_ydata(), 1e3 * outcome.traces[f"{name}_error"])
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


def pose(meshcat: Meshcat, path: str) -> Any:
    """Return the pose of what is shown before the animation, as a matrix, shape (4, 4)."""
    packed = meshcat._GetPackedTransform(path)[-16 * 9 :]
    return np.array([one[0] for one in struct.iter_unpack(">xd", packed)]).reshape(4, 4).T


def test_tools_are_where_the_traces_say() -> None:
    error = Placement(position=(0.0, 0.0, -0.05), rpy=(0.1, 0.0, 0.0))
    scenario = AlignmentScenario(hole=replace(HOLE_ARM, base_error=error))
    generator = np.random.default_rng(1)
    joints = {arm: generator.uniform(wam.LOWER_LIMITS, wam.UPPER_LIMITS, (2, 7)) for arm in ARMS}
    traces = {f"{arm}_q{i + 1}": q for arm, rows in joints.items() for i, q in enumerate(rows.T)}
    traces["time"] = np.array([0.0, 0.1])
    meshcat = open_meshcat(0)
    run = Outcome(metrics={}, traces=traces, simulated_seconds=0.1)
    replay_alignment(scenario, run, meshcat)
    for arm in ARMS:
        settings = getattr(scenario, arm)
        X_WB = settings.base.transform @ settings.base_error.transform
        expected = ArmModel(X_WB, settings.tool).evaluate(joints[arm][0]).X_WT
        found = pose(meshcat, f"/drake/cell/{arm}_arm/wam/tool")
        np.testing.assert_allclose(found, expected.GetAsMatrix4(), rtol=0, atol=1e-12)


UP = replace(
    VERTICAL_TRACKING, motion_time=0.3, start_offset=(0.0, 0.0, -0.005), compensation_time=0.65
)


def test_traces_of_a_vertical_tracking() -> None:
    tracked = TRACKING.run(TRACKING.resolve(UP), 0, quiet)
    for name, values in tracked.traces.items():
        assert values.shape == (61,), name
        assert np.isfinite(values).all(), name
    desired = tracked.traces["desired_height"]
    assert desired[0] == pytest.approx(0.153)
    assert desired[-1] == pytest.approx(0.158)
    # Compensation lifts the peg, and the hole stays where it is.
    assert tracked.traces["compensation"][-1] > 5e-4
    higher = tracked.traces["compensated_height"] - tracked.traces["uncompensated_height"]
    assert higher[-1] > 2e-4
    np.testing.assert_allclose(tracked.traces["compensated_hole_height"], 0.158, atol=1e-4)


def test_errors_are_signed_means_of_the_end_and_rms_on_the_way(
    monkeypatch: pytest.MonkeyPatch, value: Any
) -> None:
    asked = []

    def fake(scenario: AlignmentScenario, seed: int) -> dict[str, NDArray[np.float64]]:
        asked.append((scenario.compensated, seed))
        time = np.arange(321) / 80
        low = 0.0015 if scenario.compensated == "none" else -0.0002
        height = np.interp(time, [0.0, 2.0], [0.128, 0.158]) - np.where(time < 2.0, 0.003, low)
        height[-1] += 0.004  # one of the 41 rows of the last half second
        names = ("peg_tool_z", "hole_true_z", "blind", "diverged", "lateral_error")
        names += ("rotational_error", *(f"compensation_{axis}" for axis in AXES))
        joints = ("saturated", *(f"q{i}" for i in range(1, 8)))
        names += tuple(f"{arm}_{name}" for arm in ARMS for name in joints)
        traces = dict.fromkeys(names, np.zeros(321))
        traces["valid"] = np.ones(321)
        desired = np.interp(time, [0.0, 2.0], [0.128, 0.158])
        return {"time": time, "peg_true_z": height, "peg_desired_z": desired, **traces}

    monkeypatch.setattr(alignment_module, "run_alignment", fake)
    scenario = TRACKING.resolve(VERTICAL_TRACKING)
    tracked = TRACKING.run(scenario, 6, quiet)
    assert asked == [("none", 6), ("peg", 6)]
    assert value(tracked, "uncompensated.height_error") == pytest.approx(-0.0015 + 0.004 / 41)
    assert value(tracked, "compensated.height_error") == pytest.approx(0.0002 + 0.004 / 41)
    assert value(tracked, "uncompensated.height_error_max") == pytest.approx(0.0025)
    rms = np.sqrt((160 * 0.003**2 + 0.0015**2) / 161)
    assert value(tracked, "uncompensated.tracking_rms") == pytest.approx(rms)


@pytest.mark.slow
def test_published_values(value: Any) -> None:
    scenario = TRACKING.resolve(VERTICAL_TRACKING)
    whole = TRACKING.run(scenario, 0, quiet)
    asked = [one for one in PUBLISHED if one.experiment == "vertical-tracking"]
    assert all(one.ok for one in check(asked, whole.metrics))
    # It moves on the way as with a wrong payload, and comes to rest.
    assert value(whole, "compensated.height_error_max") < 2.5e-4
    assert value(whole, "compensated.tracking_rms") < value(whole, "uncompensated.tracking_rms")
