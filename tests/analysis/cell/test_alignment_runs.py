"""What is measured of an alignment, and many of them."""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.campaign.trial_metrics import bootstrap_interval
from chamfer.analysis.cell.alignment_runs import (
    ALIGNMENT,
    LATE,
    SETTLED,
    STOPPED,
    RepeatabilityScenario,
    Spread,
    alignment_charts,
    alignment_metrics,
    detected_metric,
    drawn,
    margins,
    resolve_repeatability,
    settling_metrics,
    statistics,
    stopped_metrics,
    true_errors,
    warn_of_stops,
)
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, ControllerChoice
from chamfer.diagrams.cell.work_cell import ARMS, resolve_arms, wedging_support
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import OpenSupport, Support
from chamfer.models.peg_theory.wedging import box_margin, least_margin, rotation_margin, wedges
from chamfer.models.validation import ParameterError
from chamfer.systems.vision.cell_error import AXES

Array = NDArray[np.float64]

X = np.array([1.0, 0.0, 0.0])
SCENARIO = resolve(AlignmentScenario())  # begins at 1.5 s and lasts for 4 s

turns = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)
places = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
poses = st.tuples(turns, places)


def vector(turn: Any, place: Any) -> Array:
    return np.concatenate([Rotation.from_rotvec(turn).as_quat(scalar_first=True), place])


def angle(a: Array, b: Array) -> float:
    """Kahan's angle between unit vectors, good at every angle."""
    return 2 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))


@given(peg=poses, hole=poses)
def test_true_errors_of_any_two_poses(peg: Any, hole: Any) -> None:
    found = true_errors(vector(*peg)[np.newaxis], vector(*hole)[np.newaxis])
    tip, mouth = np.array(peg[1]), np.array(hole[1])
    R_WT, R_WM = Rotation.from_rotvec(peg[0]), Rotation.from_rotvec(hole[0])
    p_MT = R_WM.inv().apply(tip - mouth)
    assert found.gap[0] == pytest.approx(-p_MT[0], abs=1e-12)
    assert found.lateral[0] == pytest.approx(math.hypot(p_MT[1], p_MT[2]), abs=1e-12)
    # The way ends on the hole's axis and is at right angles to it.
    on_axis = R_WM.inv().apply(tip + found.way[0] - mouth)
    np.testing.assert_allclose(on_axis[1:], 0.0, atol=1e-12)
    assert found.way[0] @ R_WM.apply(X) == pytest.approx(0.0, abs=1e-12)
    between = angle(R_WT.apply(X), R_WM.apply(X))
    assert found.rotational[0] == pytest.approx(between, abs=1e-12)
    turned = (Rotation.from_rotvec(found.turn[0]) * R_WT).apply(X)
    if between < math.pi - 1e-6:  # opposite axes leave the turn open
        np.testing.assert_allclose(turned, R_WM.apply(X), atol=1e-9)


def test_opposite_axes_are_no_nan() -> None:
    for quaternion in ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0)):
        found = true_errors(
            np.array([[*quaternion, 0.0, 0.0, 0.0]]), np.array([[1.0, 0, 0, 0, 0.1, 0.2, 0.0]])
        )
        for values in (found.gap, found.way, found.turn):
            assert np.isfinite(values).all()


def traces(count: int = 321, **given: Any) -> dict[str, Array]:
    """A run in which nothing happens but what is given; a function is one of time."""
    time = np.arange(count) / 80
    names = ["lateral_error", "rotational_error", "peg_saturated", "hole_saturated"]
    names += ["blind", "diverged", *(f"{arm}_q{i}" for arm in ARMS for i in range(1, 8))]
    names += [f"{kind}_{axis}" for kind in ("error", "compensation") for axis in AXES]
    names += [f"true_{axis}" for axis in ("y", "z", "pitch", "yaw")]
    made = {"time": time, **{name: np.zeros(count) for name in names}}
    made |= {"gap": np.full(count, SCENARIO.gap), "valid": np.ones(count)}
    assert set(given) <= set(made)
    for name, value in given.items():
        values = value(time) if callable(value) else value
        made[name] = np.broadcast_to(np.asarray(values, dtype=float), time.shape).copy()
    return made


def measure(**given: Any) -> dict[str, float | None]:
    found = alignment_metrics(traces(**given), SCENARIO)
    assert set(found) == set(ALIGNMENT)
    return found


def test_errors_at_the_end_and_before_the_compensation() -> None:
    found = measure(
        lateral_error=lambda t: np.where(t < 1.5 - 1e-9, 0.008 + 0.001 * t, 0.02 - 0.004 * t),
        rotational_error=lambda t: np.where(t < 1.5 - 1e-9, 0.06, 0.1 - 0.02 * t),
        gap=lambda t: 0.03 + 0.0005 * t,
    )
    assert found["lateral_error"] == pytest.approx(0.004)
    assert found["rotational_error"] == pytest.approx(0.02)
    assert found["uncompensated.lateral_error"] == pytest.approx(0.008 + 0.001 * (1.5 - 1 / 80))
    assert found["uncompensated.rotational_error"] == pytest.approx(0.06)
    assert found["gap_error"] == pytest.approx(0.002)


@pytest.mark.parametrize(
    ("name", "limit"), [("lateral_error", SETTLED[0]), ("rotational_error", SETTLED[1])]
)
def test_it_settles_when_it_stays(name: str, limit: float) -> None:
    def leaves_once(time: Array) -> Array:
        values = np.where(time < 2.0, 5 * limit, 0.5 * limit)
        values[np.abs(time - 3.0) < 0.1] = 1.1 * limit
        return values

    found = measure(**{name: leaves_once})
    assert found["settling_time"] == pytest.approx(1.6, abs=1.5 / 80)
    at_the_end = measure(**{name: lambda t: np.where(t == t[-1], 1.1 * limit, 0.0)})
    assert at_the_end["settling_time"] is None
    assert measure(**{name: 2 * limit})["settling_time"] is None
    assert measure(**{name: limit})["settling_time"] == 0.0
    before = measure(**{name: lambda t: np.where(t < 1.0, 2 * limit, 0.0)})
    assert before["settling_time"] == 0.0


def test_overshoot_is_against_the_first_direction() -> None:
    # From (3, 4) mm through the middle, 2 mm beyond it, and 9 mm to the side, which is none.
    def along(t: Array) -> Array:
        return np.interp(t, [1.5, 2.0, 2.5, 3.0], [0.005, -0.002, 0.0, 0.0])

    def aside(t: Array) -> Array:
        return np.interp(t, [2.5, 3.0, 3.5], [0.0, 0.009, 0.0])

    found = measure(
        true_y=lambda t: 0.6 * along(t) + 0.8 * aside(t),
        true_z=lambda t: 0.8 * along(t) - 0.6 * aside(t),
        true_pitch=lambda t: np.interp(t, [1.5, 2.0, 2.5, 4.0], [-0.05, 0.007, 0.001, 0.001]),
    )
    assert found["lateral_overshoot"] == pytest.approx(0.002)
    assert found["rotational_overshoot"] == pytest.approx(0.007)
    # What happens before the compensation is not its overshoot.
    found = measure(true_y=lambda t: np.where(t < 1.0, -0.01, 0.01 * np.exp(-t)))
    assert found["lateral_overshoot"] == found["rotational_overshoot"] == 0.0


def test_late_changes_are_those_of_the_last_half_second() -> None:
    found = measure(
        compensation_x=lambda t: np.where(t < 3.4, 0.0, 0.001),  # before
        compensation_y=lambda t: np.where(np.abs(t - 3.7) < 0.05, 0.0032, 0.003),  # and back
        compensation_z=-0.004,
        compensation_roll=0.0,
        compensation_pitch=lambda t: np.where(t < 3.5 - 1e-9, 1.0, 0.02),
        compensation_yaw=lambda t: np.where(t > 3.9, -0.05, -0.04),
    )
    assert LATE == 0.5
    assert found["compensation.lateral"] == pytest.approx(0.004)
    assert found["compensation.rotational"] == pytest.approx(0.05)
    assert found["compensation.late_lateral"] == pytest.approx(0.0002)
    assert found["compensation.late_rotational"] == pytest.approx(0.01)
    assert measure(compensation_z=0.01)["compensation.late_lateral"] == 0.0


def test_what_vision_is_off() -> None:
    # 5 px are 2.5 mm; it saw 0.3 mm too much along Y and 0.4 mm too little along Z.
    found = measure(
        error_x=99.0,
        error_y=5.0,
        error_z=-3.0,
        error_pitch=0.011,
        error_yaw=-0.02,
        true_y=0.0022,
        true_z=-0.0011,
        true_pitch=0.008,
        true_yaw=-0.016,
    )
    assert found["vision.lateral_error"] == pytest.approx(0.0005)
    assert found["vision.rotational_error"] == pytest.approx(0.005)
    unseen = measure(valid=lambda t: np.where(t == t[-1], 0.0, 1.0), error_y=1.0)
    assert unseen["vision.lateral_error"] is unseen["vision.rotational_error"] is None


def test_saturated_and_blind() -> None:
    found = measure(
        peg_saturated=lambda t: np.where(t < 1.0, 2.0, 0.0),
        hole_saturated=lambda t: np.where((t >= 0.5) & (t < 2.0), 1.0, 0.0),
        blind=lambda t: np.where(t > 3.0, 1.0, 0.0),
    )
    assert found["saturated"] == pytest.approx(100 * 160 / 321)
    assert found["blind"] == 1.0
    assert measure()["blind"] == 0.0
    assert found["joints.margin"] == pytest.approx(0.9)  # of joint 4, which goes from -0.9 rad
    turned = measure(hole_q4=lambda t: np.where(t == 2.0, -1.0, 0.5))
    assert turned["joints.margin"] == pytest.approx(-0.1)
    # Of the 201 frames from the begin on.
    seen = measure(valid=lambda t: np.where((t < 1.5 - 1e-9) | (t > 3.97), 0.0, 1.0))
    assert seen["detected"] == pytest.approx(100 * (1 - 3 / 201))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, ()),
        ({"diverged": lambda t: np.where(t > 2.0, 1.0, 0.0)}, ("diverged",)),
        ({"compensation_x": lambda t: np.where(t > 2.0, -0.03, 0.0)}, ("limited",)),
        ({"compensation_yaw": lambda t: np.where(t == t[-1], 0.3, 0.0)}, ("limited",)),
        ({"compensation_yaw": 0.299, "compensation_x": 0.0299}, ()),
        ({"lateral_error": lambda t: 0.01 + 0.001 * t}, ("growing",)),
        ({"rotational_error": lambda t: 0.001 + 0.01 * t}, ("growing",)),
        # Larger than at the begin, but no longer growing; and smaller than what is settled.
        ({"lateral_error": lambda t: np.where(t < 1.6, 0.01, 0.02)}, ()),
        ({"rotational_error": lambda t: 0.001 + 0.001 * t}, ()),
    ],
)
def test_what_went_wrong(given: dict[str, Any], expected: tuple[str, ...]) -> None:
    found = measure(**given)
    assert tuple(name for name in STOPPED if found[name]) == expected


def test_what_went_wrong_is_said() -> None:
    rows = {"blind": [0, 1, 0], "diverged": [1, 0, 1], "limited": [0, 0, 1], "growing": [0, 1, 1]}
    with pytest.warns(UserWarning, match=" trials ") as said:
        metrics = stopped_metrics({name: np.array(row, float) for name, row in rows.items()})
    texts = [str(one.message) for one in said]
    assert texts[0] == "in 1 of 3 trials the cameras lost the parts"
    assert texts[1].startswith("in 2 of 3 trials it diverged")
    assert texts[2] == "in 1 of 3 trials the compensation reached a limit"
    assert texts[3].startswith("in 2 of 3 trials the true error is larger at the end")
    assert len(texts) == 4
    assert [round(metrics[name].value or 0) for name in STOPPED] == [33, 67, 33, 67]
    with pytest.warns(UserWarning, match="^it diverged: "):
        warn_of_stops({name: np.array([name == "diverged"], float) for name in STOPPED})


def test_the_share_of_the_theorem_s_bound() -> None:
    usual = settling_metrics(SCENARIO)["settling.small_share"]
    assert 0.85 < (usual.value or 0) <= 0.9
    pid = replace(SCENARIO, controller=ControllerChoice(kind="pid"))
    assert settling_metrics(pid) == {}
    fsm = SCENARIO.compensator
    wild = replace(fsm, rotational=replace(fsm.rotational, increment=8e-3))
    with pytest.warns(UserWarning, match=r"^the rotational increm.* 1\.8 times .* 0\.0005 rad"):
        found = settling_metrics(replace(SCENARIO, compensator=wild))["settling.small_share"]
    assert found.value == pytest.approx(1.8, rel=0.02)
    narrow = replace(fsm, lateral=replace(fsm.lateral, dead_zone=0.05))
    with pytest.warns(UserWarning, match="the lateral increments are inf times"):
        found = settling_metrics(replace(SCENARIO, compensator=narrow))["settling.small_share"]
    assert found.value is None
    assert found.note.endswith("the dead zone is within it")


def test_charts_are_those_of_the_state_machine() -> None:
    names = [chart.name for chart in alignment_charts(SCENARIO)]
    assert names == ["trajectory compensator", "compensation of one axis"]
    assert alignment_charts(AlignmentScenario(controller=ControllerChoice(kind="pid"))) == ()


def test_trials_that_never_see_are_counted() -> None:
    with pytest.warns(UserWarning, match=r"^in 2 of 3 trials the cameras never saw both parts, n"):
        metric = detected_metric(np.array([0.0, 60.0, 0.0]))
    assert (metric.value, metric.unit) == (20.0, "%")
    assert ", mean of 3 trials, 0 to 60; in 2 of 3 trials" in metric.note


ARMS_KNOWN = resolve_arms(AlignmentScenario(initial_error=(0.0,) * 6))
PARTS, SUPPORT = PegHoleGeometry(), Support()
seeds = st.integers(0, 2**63 - 1)


def finished(**measured: Any) -> Trials[int]:
    """Trials with these values, one list a metric."""
    rows = [dict(zip(measured, row, strict=True)) for row in zip(*measured.values(), strict=True)]
    return Trials(tasks=tuple(range(len(rows))), rows=tuple(rows))


@given(seed=seeds, trial=st.integers(0, 10_000_000))
def test_a_trial_is_its_seed_and_its_number(seed: int, trial: int) -> None:
    first = drawn(ARMS_KNOWN, Spread(), seed, trial)
    assert drawn(ARMS_KNOWN, Spread(), seed, trial) == first
    for other in (
        drawn(ARMS_KNOWN, Spread(), seed, trial + 1),
        drawn(ARMS_KNOWN, Spread(), seed + 1, trial),
    ):
        assert other.initial_error != first.initial_error
        assert other.peg.payload_error != first.peg.payload_error
        assert other.hole.joint_friction != first.hole.joint_friction
    # The two arms are not wrong in the same way.
    assert first.peg.mass_scale != first.hole.mass_scale


@given(
    seed=seeds,
    lateral=st.floats(0.0, 0.02),
    rotational=st.floats(0.0, 0.2),
    payload=st.floats(0.0, 0.9),
    link_mass=st.floats(0.0, 0.9),
    joint_friction=st.floats(0.0, 0.9),
)
def test_within_the_ranges(seed: int, **ranges: float) -> None:
    spread = Spread(**ranges)
    found = drawn(ARMS_KNOWN, spread, seed, 3)
    x, y, z, roll, pitch, yaw = found.initial_error
    assert x == roll == 0.0
    assert max(abs(y), abs(z)) <= spread.lateral
    assert max(abs(pitch), abs(yaw)) <= spread.rotational
    for name in ("peg", "hole"):
        was, now = getattr(ARMS_KNOWN, name), getattr(found, name)
        assert abs(now.payload_error / was.payload_error - 1) <= spread.payload * (1 + 1e-12)
        assert abs(now.mass_scale - 1) <= spread.link_mass * (1 + 1e-12)
        ratios = np.array(now.joint_friction) / np.array(was.joint_friction)
        assert np.ptp(ratios) < 1e-12  # one factor for all joints
        assert abs(ratios[0] - 1) <= spread.joint_friction * (1 + 1e-12)
        rest = {"payload_error", "mass_scale", "joint_friction"}
        for field in fields(was):
            if field.name not in rest:
                assert getattr(now, field.name) is getattr(was, field.name)


def test_statistics_are_mean_its_interval_and_the_largest() -> None:
    values = [0.001, 0.004, 0.002]
    found = statistics(finished(lateral_error=values), "lateral_error", "m")
    measured = [found[f"lateral_error.{of}"].value for of in ("mean_low", "mean_high")]
    assert tuple(measured) == bootstrap_interval(np.array(values))
    assert found["lateral_error.mean"].value == pytest.approx(np.mean(values))
    assert found["lateral_error.max"].value == 0.004


def test_margins_are_the_worst_run_s() -> None:
    lateral, rotational = [0.001, 0.003, 0.0002], [0.04, 0.005, 0.07]
    found = margins(finished(lateral_error=lateral, rotational_error=rotational), PARTS, SUPPORT)
    both = list(zip(lateral, rotational, strict=True))
    assert found["box_margin.lateral"].value == pytest.approx(100 * (1 - 0.003 / 0.019814))
    assert found["box_margin.rotation"].value == pytest.approx(
        100 * float(box_margin(PARTS, 0.0, 0.07).rotation)
    )
    guided = PARTS.chamfer_width + PARTS.hole_radius - PARTS.peg_radius
    assert found["chamfer_margin"].value == pytest.approx(100 * (1 - 0.003 / guided))
    assert found["parallelogram_margin"].value == pytest.approx(
        100 * min(least_margin(PARTS, SUPPORT, *one)[0] for one in both)
    )
    here = [rotation_margin(PARTS, SUPPORT, x, s * angle) for x, angle in both for s in (1, -1)]
    assert found["margin"].value == pytest.approx(100 * min(here))
    assert found["margin"].value > found["parallelogram_margin"].value
    wedged = [bool(wedges(PARTS, SUPPORT, *one)) for one in both]
    assert wedged == [False, False, True]
    assert found["wedging"].value == pytest.approx(100 / 3)
    # Of the signs the worse one counts.
    below = replace(SUPPORT, centre_distance=-0.05)  # errors of opposite signs add
    worse = float(rotation_margin(PARTS, below, 0.003, -0.056))
    assert worse < rotation_margin(PARTS, below, 0.003, 0.056)
    found = margins(finished(lateral_error=[0.003], rotational_error=[0.056]), PARTS, below)
    assert found["margin"].value == pytest.approx(100 * worse)
    assert found["wedging"].value == 100.0


def test_the_support_is_that_of_the_arms_unless_it_is_said() -> None:
    found = resolve_repeatability(RepeatabilityScenario())
    assert found.held() == wedging_support(found)
    assert found.support == OpenSupport(**vars(wedging_support(found)))
    assert resolve_repeatability(found) == found
    said = RepeatabilityScenario(support=OpenSupport(centre_distance=0.1))
    assert resolve_repeatability(said).held() == replace(found.held(), centre_distance=0.1)
    soft = RepeatabilityScenario(support=OpenSupport(angular_stiffness=0.005))
    with pytest.raises(ParameterError, match=r"^support\.angular_stiffness is 0\.005, allowed: >"):
        resolve_repeatability(soft)
