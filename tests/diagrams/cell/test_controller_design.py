"""Controllers designed for arms and cameras, and the responses that they are designed for."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from scipy.spatial.transform import Rotation

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import (
    KINDS,
    VERTICAL_TRACKING,
    AlignmentScenario,
    OpenAxis,
    OpenGains,
    SixAxisPid,
    SixAxisSettings,
)
from chamfer.diagrams.cell.cell_vision import CameraSettings, ViewFrames, ViewSettings
from chamfer.diagrams.cell.controller_design import (
    MEASUREMENT_ERROR,
    SEEN,
    Responses,
    arm_responses,
    dead_samples,
    design_pid,
    measurement_error,
    of_kind,
    small_share,
    step_responses,
)
from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    PEG_ARM,
    ArmName,
    WorkCellScenario,
    add_work_cell,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.force.tool_pose import compensate
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.sampled_pid import tuned_gains
from chamfer.systems.servo.settling import guarantee
from chamfer.systems.vision.cell_error import AXES

Array = NDArray[np.float64]

SCENARIO = resolve(AlignmentScenario(compensated="peg"))
PERIOD = SCENARIO.cameras.frames.period
LATERAL, ROTATIONAL = SEEN["lateral"], SEEN["rotational"]
ALL = (*LATERAL, *ROTATIONAL)


@pytest.fixture(scope="module")
def responses() -> Responses:
    (found,) = arm_responses(SCENARIO)
    return found


def seen_by(cameras: FrameGrabberParams, **changed: Any) -> AlignmentScenario:
    return AlignmentScenario(cameras=CameraSettings(frames=cameras, **changed))


def test_responses_are_those_of_an_arm_that_follows(responses: Responses) -> None:
    assert tuple(responses) == ALL
    for axis, plant in responses.items():
        # At rest the arm is where it should be, so that a pixel is half a millimetre.
        expected = 2000.0 if axis in LATERAL else 1.0
        assert plant.gain == pytest.approx(expected, rel=0.01)
        assert np.abs(plant.undelivered[-40:]).max() < 1e-3  # it has come to rest
        np.testing.assert_array_equal(plant.undelivered[:2], 1.0)
        assert 0 < plant.undelivered[2] < 1  # an arm moves by the next sample, but not far


@pytest.mark.parametrize(
    ("frames", "xy", "expected"),
    [
        ({}, {}, 2),
        ({"latency": 3}, {}, 4),
        ({}, {"latency": 6}, 7),  # the slower one counts
        ({"latency": 6}, {"latency": 0}, 7),
        ({}, {"period": 1 / 30}, 6),  # 66.7 ms of 12.5 ms
        ({"period": 1 / 30}, {"period": 1 / 80}, 2),
    ],
)
def test_an_image_that_takes_longer_is_older(
    frames: dict[str, Any], xy: dict[str, Any], expected: int
) -> None:
    cameras = CameraSettings(
        frames=FrameGrabberParams(**frames), xy=ViewSettings(frames=ViewFrames(**xy))
    )
    assert dead_samples(replace(SCENARIO, cameras=cameras)) == expected


@pytest.mark.parametrize(
    ("noise", "xy", "expected"),
    [(4.0, None, 1.0), (0.0, 2.0, 1.0), (12.0, None, 3.0), (4.0, 8.0, 2.0), (8.0, 4.0, 2.0)],
)
def test_what_detection_may_be_off_grows_with_the_noise_of_the_noisier_camera(
    noise: float, xy: float | None, expected: float
) -> None:
    cameras = CameraSettings(
        frames=FrameGrabberParams(noise=noise), xy=ViewSettings(frames=ViewFrames(noise=xy))
    )
    scenario = replace(SCENARIO, cameras=cameras)
    for name in KINDS:
        was = MEASUREMENT_ERROR[name]
        assert measurement_error(scenario, name) == pytest.approx(expected * was, rel=1e-12)


@pytest.mark.parametrize(
    "scenario",
    [
        AlignmentScenario(),
        AlignmentScenario(compensated="hole"),
        VERTICAL_TRACKING,
        seen_by(FrameGrabberParams(period=1 / 30)),
        seen_by(FrameGrabberParams(latency=7)),
        seen_by(FrameGrabberParams(period=1 / 500), pixel_size=0.001),
    ],
    ids=["both", "hole", "vertical", "30 Hz", "late", "coarse"],
)
def test_what_is_designed_settles_with_every_arm_and_camera(scenario: AlignmentScenario) -> None:
    designed = resolve(scenario)
    assert resolve(designed) == designed
    for name in KINDS:
        axis = getattr(designed.compensator, name).closed
        for plant in of_kind(arm_responses(designed), name):
            assert guarantee(axis, plant, MEASUREMENT_ERROR[name]).everywhere
        assert 0.8 < small_share(designed, name) <= 0.9  # no larger a dead zone than it needs


def test_the_default_cameras_get_what_was_found_to_be_best() -> None:
    """By the numbers that earlier versions had as constants."""
    designed = resolve(AlignmentScenario())
    for name, dead_zone, large_error, increment, limit, gains in (
        ("lateral", 0.4, 4.5, 1e-4, 0.03, (3.96e-4, 4.7e-3)),
        ("rotational", 0.008, 0.13, 4e-3, 0.3, (1.36, 10.9)),
    ):
        axis, law = getattr(designed.compensator, name), getattr(designed.pid, name)
        assert axis.increment == pytest.approx(increment)
        assert axis.dead_zone == pytest.approx(dead_zone, rel=0.04)
        assert axis.large_error == pytest.approx(large_error, rel=0.1)
        assert axis.limit == law.limit == limit
        assert (law.proportional, law.integral) == pytest.approx(gains, rel=0.12)


def test_what_is_given_stays() -> None:
    given = AlignmentScenario(
        compensator=SixAxisSettings(
            lateral=OpenAxis(increment=3e-4),
            rotational=OpenAxis(dead_zone=0.029, divider=4.0, limit=0.2),
        ),
        pid=SixAxisPid(
            lateral=OpenGains(proportional=2e-4),
            rotational=OpenGains(integral=5.0, derivative=0.1),
        ),
    )
    found, usual = resolve(given), resolve(AlignmentScenario())
    lateral, rotational = found.compensator.lateral.closed, found.compensator.rotational.closed
    assert lateral.increment == 3e-4
    assert lateral.dead_zone == pytest.approx(0.1 + 3 * 0.312, rel=0.01)
    assert (rotational.dead_zone, rotational.divider, rotational.limit) == (0.029, 4.0, 0.2)
    assert rotational.increment == usual.compensator.rotational.increment  # no faster than usual
    assert small_share(found, "rotational") < 0.5
    # Half the gain with the same integral time; a gain that is given leaves the other one.
    assert found.pid.lateral.proportional == 2e-4
    assert found.pid.lateral.integral == pytest.approx(
        2e-4 * usual.pid.axes[0].integral / usual.pid.axes[0].proportional, rel=0.2
    )
    assert found.pid.rotational.integral == 5.0
    assert found.pid.rotational.proportional == usual.pid.rotational.proportional


def test_a_narrow_dead_zone_slows_down_and_one_within_the_measurement_error_is_refused() -> None:
    def narrow(dead_zone: float) -> AlignmentScenario:
        axis = OpenAxis(dead_zone=dead_zone)
        return AlignmentScenario(compensator=SixAxisSettings(lateral=axis))

    found = resolve(narrow(0.2))
    assert found.compensator.axes[0].increment < 0.4e-4
    assert 0.8 < small_share(found, "lateral") <= 0.9
    with pytest.raises(ParameterError, match=r"compensator\.lateral\.dead_zone is 0\.05.*0\.1"):
        resolve(narrow(0.05))
    # Who gives all of it gets it, and is told.
    axis = OpenAxis(dead_zone=0.05, large_error=4.0, increment=1e-4)
    found = resolve(AlignmentScenario(compensator=SixAxisSettings(lateral=axis)))
    assert small_share(found, "lateral") == math.inf


def test_nothing_follows_from_arms_that_do_not_come_to_rest() -> None:
    wild = replace(AlignmentScenario().impedance, damping_ratio=5.0, allow_unstable=True)
    with pytest.raises(ParameterError, match=r"damping_ratio.*come to rest"):
        resolve(AlignmentScenario(impedance=wild))


def test_the_baseline_has_the_most_careful_gains(responses: Responses) -> None:
    found = design_pid(AlignmentScenario(), (responses,), 0.12)
    for name, law in zip(KINDS, (found.lateral, found.rotational), strict=True):
        each = [
            tuned_gains(responses[axis], closed_loop=0.12, period=PERIOD) for axis in SEEN[name]
        ]
        gains = law.closed
        assert gains.proportional == pytest.approx(min(one.proportional for one in each), rel=5e-3)
        assert gains.integral == pytest.approx(min(one.integral for one in each), rel=5e-3)
        assert gains.derivative == 0
    assert found.lateral.closed.proportional < found.rotational.closed.proportional / 1000


BEGIN, LONG = 0.1, 1.5  # s
KNOWN = {"payload_error": 0.0, "joint_friction": (0.0,) * 7}
CELL = WorkCellScenario(peg=replace(PEG_ARM, **KNOWN), hole=replace(HOLE_ARM, **KNOWN))


def angular_first(axis: str) -> int:
    """Where an axis of AXES is in a spatial vector."""
    return (AXES.index(axis) + 3) % 6


def step_of(axis: str) -> float:
    return 1e-3 if axis in "xyz" else 1e-2  # m, rad


@lru_cache
def answer(arm: ArmName, axis: str, scenario: WorkCellScenario = CELL) -> Array:
    """How far the tool has moved and turned, shape (n, 6), angular first, a row a period."""
    builder = DiagramBuilder()
    ports = add_work_cell(builder, scenario, arms=(arm,)).arms[arm]
    before = pose_vector(scenario.nominal_pose(arm))
    moved = np.reshape(step_of(axis) * np.eye(len(AXES))[AXES.index(axis)], (2, 3))
    after = compensate(before, (moved @ scenario.hole_axes.matrix().T).ravel())
    begin = round(BEGIN / PERIOD) * PERIOD
    poses = np.column_stack([before, after, after])
    step = PiecewisePolynomial.ZeroOrderHold([0.0, begin, 2 * begin], poses)
    command = builder.AddNamedSystem("command", TrajectorySource(step))
    builder.Connect(command.get_output_port(), ports.desired_pose)
    builder.ExportOutput(ports.true_pose, "true_pose")
    diagram = builder.Build()
    pose = simulate(diagram, duration=BEGIN + LONG, step=PERIOD).outputs["true_pose"]
    turned = Rotation.from_quat(pose[:, :4], scalar_first=True)
    return np.column_stack([(turned * turned[0].inv()).as_rotvec(), pose[:, 4:] - pose[0, 4:]])


@pytest.mark.parametrize(("arm", "axis"), [*(("peg", axis) for axis in ALL), ("hole", "yaw")])
def test_the_linear_response_is_the_simulated_one(arm: ArmName, axis: str) -> None:
    first, k = round(BEGIN / PERIOD), angular_first(axis)
    simulated = answer(arm, axis)[first + 1 :, k]
    linear = step_responses(CELL, arm)
    gain = linear.gain[AXES.index(axis)]
    assert gain == pytest.approx(1, abs=2e-3)
    expected = step_of(axis) * gain * (1 - linear.sampled(axis, PERIOD))
    count = min(len(expected), len(simulated))
    assert count > 80
    # Every fourth instant is one at which the arm steps, before or after it is looked at.
    sure = np.arange(1, count + 1) % 4 > 0
    off = np.abs(simulated[:count] - expected[:count])
    assert off[sure].max() < 3e-3 * step_of(axis)  # 1 mm and 10 mrad are not quite small
    assert off.max() < 5e-2 * step_of(axis)
    # By one period of the controller off it would be another one.
    assert np.abs(np.diff(linear.undelivered[AXES.index(axis)])).max() > 8e-3


def test_a_linear_response_is_of_the_arm_as_it_is_loaded() -> None:
    heavy = replace(CELL, peg=replace(CELL.peg, payload_error=0.5), hole=HOLE_ARM)
    usual, loaded = (step_responses(one, "peg").sampled("z", PERIOD) for one in (CELL, heavy))
    count = min(len(usual), len(loaded))
    assert np.abs(usual[:count] - loaded[:count]).max() > 0.02
    # What the other arm is, and dry friction, make no difference.
    assert step_responses(replace(CELL, hole=HOLE_ARM), "peg") is step_responses(CELL, "peg")
    rough = replace(CELL, peg=replace(CELL.peg, joint_friction=(0.1,) * 7))
    assert step_responses(rough, "peg") is step_responses(CELL, "peg")
