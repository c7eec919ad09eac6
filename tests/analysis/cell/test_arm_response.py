import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.systems.primitives import LinearSystem

from analysis.cell.alignment_runs import run_alignment
from analysis.cell.arm_response import (
    LATERAL,
    MEASUREMENT_ERROR,
    ROTATIONAL,
    Increments,
    Responses,
    arm_responses,
    dead_samples,
    design,
    design_compensator,
    design_pid,
)
from diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    SixAxisPid,
    VerticalTrackingScenario,
)
from diagrams.cell.cell_cameras import CameraSettings
from diagrams.cell.work_cell import ArmSettings
from models.arms.wam import NUM_JOINTS
from systems.servo.compensator import AxisParams
from systems.servo.sampled_pid import tuned_gains
from systems.servo.settling import SettlingPlant, allowed_increment, guarantee, sample_plant
from systems.vision.camera_image import FrameGrabberParams
from systems.vision.image_plane_error import AXES

Array = NDArray[np.float64]

SCENARIO = AlignmentScenario()
PERIOD = SCENARIO.cameras.frames.period
SEEN = (*LATERAL, *ROTATIONAL)


@pytest.fixture(scope="module")
def responses() -> Responses:
    return arm_responses(SCENARIO)


def kind(axis: str) -> str:
    return "lateral" if axis in LATERAL else "rotational"


def element(scenario: AlignmentScenario, axis: str) -> AxisParams:
    found: AxisParams = getattr(scenario.compensator, kind(axis))
    return found


def test_responses_are_those_of_an_arm_that_follows(responses: Responses) -> None:
    assert tuple(responses) == SEEN
    for axis, plant in responses.items():
        # At rest the arm is where it should be, so that a pixel is half a millimetre.
        expected = 2000.0 if axis in LATERAL else 1.0
        assert plant.gain == pytest.approx(expected, rel=0.01)
        assert plant.undelivered[-1] == 0.0
        assert np.abs(plant.undelivered[-40:]).max() < 1e-3  # it has come to rest
        np.testing.assert_array_equal(plant.undelivered[:2], 1.0)
        assert 0 < plant.undelivered[2] < 1  # an arm moves by the next sample, but not far


def test_an_image_that_takes_longer_is_older() -> None:
    assert dead_samples(SCENARIO) == 2
    late = CameraSettings(frames=FrameGrabberParams(latency=3))
    assert dead_samples(replace(SCENARIO, cameras=late)) == 4


@pytest.mark.parametrize("axis", SEEN)
def test_the_alignment_s_elements_settle(responses: Responses, axis: str) -> None:
    found = guarantee(element(SCENARIO, axis), responses[axis], MEASUREMENT_ERROR[kind(axis)])
    assert found.everywhere
    assert found.small_share < 0.95


def test_the_vertical_tracking_s_elements_settle() -> None:
    scenario = VerticalTrackingScenario()
    failed = {}
    for axis, plant in arm_responses(scenario).items():
        found = guarantee(element(scenario, axis), plant, MEASUREMENT_ERROR[kind(axis)])
        if not found.everywhere:
            failed[axis] = found.small_share
    assert not failed


def test_the_elements_are_the_design_s(responses: Responses) -> None:
    given = SCENARIO.compensator
    increments = Increments(
        lateral=given.lateral.small_increment, rotational=given.rotational.small_increment
    )
    designed = design_compensator(SCENARIO, responses, increments)
    for name in ("lateral", "rotational"):
        wanted, found = getattr(designed, name), getattr(given, name)
        assert found.increment == pytest.approx(wanted.increment)
        assert found.dead_zone == pytest.approx(wanted.dead_zone, rel=0.02)
        assert found.large_error == pytest.approx(wanted.large_error, rel=0.02)
        assert (found.divider, found.limit) == (wanted.divider, wanted.limit)


def test_an_axis_of_its_own_kind_decides(responses: Responses) -> None:
    increments = Increments(lateral=3e-5, rotational=5e-4)
    designed = design_compensator(SCENARIO, responses, increments)
    worst = {"lateral": "x", "rotational": "pitch"}
    for name, axis in worst.items():
        alone = design(
            [responses[axis]],
            getattr(increments, name),
            measurement_error=MEASUREMENT_ERROR[name],
            limit=1.0,
        )
        assert getattr(designed, name).dead_zone == pytest.approx(alone.dead_zone)


def closed_loop(
    plant: SettlingPlant, axis: AxisParams, initial: float, noise: Array
) -> tuple[Array, Array]:
    """Actions and true errors of one axis by convolution, the law written out again."""
    ticks = len(noise)
    arrived = np.append(1.0 - plant.undelivered, np.ones(ticks))[:ticks]
    actions, errors = np.zeros(ticks), np.full(ticks + 1, initial)
    for k in range(ticks):
        seen = errors[k] + noise[k]
        if abs(seen) >= axis.dead_zone:
            step = axis.increment if abs(seen) >= axis.large_error else axis.small_increment
            actions[k] = math.copysign(step, seen)
            errors[k + 1 :] -= plant.gain * actions[k] * arrived[: ticks - k]
    return actions, errors[:-1]


def reversals(actions: Array) -> int:
    signs = np.sign(actions[np.abs(actions) > 1e-12])
    return int(np.count_nonzero(np.diff(signs)))


@pytest.mark.parametrize("axis", SEEN)
@settings(max_examples=25, deadline=None)
@given(
    share=st.floats(-1.0, 1.0),
    adversary=st.sampled_from(["random", "for", "against", "alternating"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_start_and_no_noise_makes_the_measured_response_turn_back(
    responses: Responses, axis: str, share: float, adversary: str, seed: int
) -> None:
    plant, params, nu = responses[axis], element(SCENARIO, axis), MEASUREMENT_ERROR[kind(axis)]
    initial = share * (25.0 if axis in LATERAL else 0.3)  # pixels, rad
    ticks = 700
    sign = math.copysign(1.0, initial)
    noise = (
        nu
        * {
            "random": np.random.default_rng(seed).choice([-1.0, 1.0], ticks),
            "for": np.full(ticks, sign),
            "against": np.full(ticks, -sign),
            "alternating": np.where(np.arange(ticks) % 2, 1.0, -1.0),
        }[adversary]
    )
    actions, errors = closed_loop(plant, params, initial, noise)
    assert np.all(sign * actions >= 0)
    assert not actions[-200:].any()
    assert abs(errors[-1]) < params.dead_zone + nu


@pytest.mark.parametrize(("axis", "beyond"), [("x", 3), ("y", 10), ("z", 10), ("yaw", 6)])
def test_beyond_the_bound_the_measured_response_goes_to_and_fro(
    responses: Responses, axis: str, beyond: float
) -> None:
    params = element(SCENARIO, axis)
    wild = replace(params, increment=beyond * params.increment)
    assert not guarantee(wild, responses[axis], MEASUREMENT_ERROR[kind(axis)]).small_band
    initial = 16.0 if axis in LATERAL else 0.06
    actions, _ = closed_loop(responses[axis], wild, initial, np.zeros(480))
    assert reversals(actions) >= 8
    assert actions[-80:].any()


@pytest.mark.parametrize("axis", SEEN)
def test_the_first_turn_back_is_not_far_beyond_the_bound(responses: Responses, axis: str) -> None:
    """The bound is no more careful than by a factor of 2.5 on any axis."""
    plant, params, nu = responses[axis], element(SCENARIO, axis), MEASUREMENT_ERROR[kind(axis)]
    least = 2.5 / guarantee(params, plant, nu).small_share
    wild = replace(params, increment=least * params.increment)
    starts = np.linspace(0.3, 1.0, 8) * (20.0 if axis in LATERAL else 0.1)
    turned = [reversals(closed_loop(plant, wild, one, np.zeros(400))[0]) for one in starts]
    assert max(turned) >= 1


def run_with_one_error(axis: str, factor: float) -> dict[str, Array]:
    """Run the cell without friction and droop, so that the axis is alone."""

    def free(arm: ArmSettings) -> ArmSettings:
        return replace(arm, joint_friction=(0.0,) * NUM_JOINTS, payload_error=0.0)

    initial = np.zeros(len(AXES))
    initial[AXES.index(axis)] = 0.008 if axis in LATERAL else 0.06
    params = element(SCENARIO, axis)
    changed: Any = {kind(axis): replace(params, increment=factor * params.increment)}
    return run_alignment(
        replace(
            SCENARIO,
            peg=free(SCENARIO.peg),
            hole=free(SCENARIO.hole),
            initial_error=tuple(initial.tolist()),
            compensator=replace(SCENARIO.compensator, **changed),
            begin=1.2,
            compensation_time=2.8,
        ),
        0,
    )


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["z", "yaw"])
def test_within_the_bound_the_cell_settles_without_turning_back(
    responses: Responses, axis: str
) -> None:
    traces = run_with_one_error(axis, 1.0)
    actions = np.diff(traces[f"compensation_{axis}"])
    assert np.count_nonzero(actions) > 50
    assert reversals(actions) == 0
    assert not actions[-40:].any()
    assert np.abs(traces[f"error_{axis}"][-40:]).max() < element(SCENARIO, axis).dead_zone
    # What the design takes the cell to be is what it is: dead time, gain and response.
    begin = round(1.2 / PERIOD)
    plant = responses[axis]
    arrived = np.concatenate([[0.0], 1 - plant.undelivered, np.ones(len(actions))])
    expected = (
        traces[f"error_{axis}"][begin]
        - plant.gain * np.convolve(actions[begin:], arrived)[: len(actions) - begin]
    )
    off = np.abs(expected - traces[f"error_{axis}"][begin:-1]).max()
    assert off < (0.5 if axis in LATERAL else 0.003)


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "factor"), [("z", 10.0), ("yaw", 6.0)])
def test_beyond_the_bound_the_cell_goes_to_and_fro(axis: str, factor: float) -> None:
    traces = run_with_one_error(axis, factor)
    actions = np.diff(traces[f"compensation_{axis}"])
    assert reversals(actions) >= 6
    assert np.count_nonzero(actions[-40:]) > 5  # half a second, and no end


def second_order(frequency: float, damping: float) -> SettlingPlant:
    system = LinearSystem(
        A=np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]]),
        B=np.array([[0.0], [frequency**2]]),
        C=np.array([[1.0, 0.0]]),
        D=np.zeros((1, 1)),
    )
    return sample_plant(system, PERIOD, delay_samples=2)


plants = st.lists(
    st.builds(second_order, st.floats(5.0, 60.0), st.floats(0.1, 2.0)), min_size=1, max_size=3
)


@settings(max_examples=40, deadline=None)
@given(plants=plants, small=st.floats(1e-5, 1e-2), nu=st.just(0.0) | st.floats(0.0, 0.5))
def test_a_design_settles_on_every_plant(
    plants: list[SettlingPlant], small: float, nu: float
) -> None:
    axis = design(plants, small, measurement_error=nu, limit=3.0)
    assert axis.small_increment == pytest.approx(small)
    assert axis.limit == 3.0
    for plant in plants:
        assert guarantee(axis, plant, nu).everywhere
    allowed = min(
        allowed_increment(plant, dead_zone=axis.dead_zone, measurement_error=nu)
        for plant in plants
    )
    assert allowed >= axis.increment * (1 - 1e-9)
    if nu == 0:
        assert allowed == pytest.approx(axis.increment)


def test_the_design_is_where_the_increment_is_just_allowed(responses: Responses) -> None:
    for axes, small in ((LATERAL, 2e-5), (ROTATIONAL, 8e-4)):
        of = [responses[axis] for axis in axes]
        nu = MEASUREMENT_ERROR[kind(axes[0])]
        axis = design(of, small, measurement_error=nu, limit=1.0)
        allowed = [
            allowed_increment(plant, dead_zone=axis.dead_zone, measurement_error=nu)
            for plant in of
        ]
        assert min(allowed) == pytest.approx(axis.increment)


def test_larger_increments_need_larger_zones(responses: Responses) -> None:
    of = [responses[axis] for axis in LATERAL]
    designs = [
        design(of, small, measurement_error=0.1, limit=1.0) for small in (1e-5, 2e-5, 5e-5, 1e-4)
    ]
    assert np.all(np.diff([one.dead_zone for one in designs]) > 0)
    assert np.all(np.diff([one.large_error for one in designs]) > 0)
    # What is beyond the measurement error grows with the increment.
    beyond = [one.dead_zone - 0.1 for one in designs]
    np.testing.assert_allclose(np.array(beyond) / beyond[0], [1, 2, 5, 10])


def test_the_baseline_has_the_most_careful_gains(responses: Responses) -> None:
    found = design_pid(SCENARIO, responses, 0.12)
    for name, axes in (("lateral", LATERAL), ("rotational", ROTATIONAL)):
        each = [tuned_gains(responses[axis], closed_loop=0.12, period=PERIOD) for axis in axes]
        gains, limit = getattr(found, name), getattr(SCENARIO.pid, name).limit
        assert gains.proportional == min(one.proportional for one in each)
        assert gains.integral == min(one.integral for one in each)
        assert gains.derivative == 0
        assert gains.limit == limit
    assert found.lateral.proportional < found.rotational.proportional / 1000  # m a pixel


def test_the_baseline_is_the_design_s(responses: Responses) -> None:
    found, designed = SixAxisPid(), design_pid(SCENARIO, responses, 0.05)
    for name in ("lateral", "rotational"):
        for gain in ("proportional", "integral"):
            wanted = getattr(getattr(designed, name), gain)
            assert getattr(getattr(found, name), gain) == pytest.approx(wanted, rel=0.05)
