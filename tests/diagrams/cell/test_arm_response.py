"""An arm's answer to a step of its commanded pose against the impedance it should have."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell.controller_design import make_response_diagram, step_responses
from chamfer.diagrams.cell.work_cell import ARMS, HOLE_ARM, PEG_ARM, ArmName, WorkCellScenario
from chamfer.systems.force.impedance_controller import ImpedanceController
from chamfer.systems.vision.image_plane_error import AXES

Array = np.ndarray

PERIOD = 1 / 80
BEGIN, LONG = 0.1, 1.5  # s
KNOWN = {"payload_error": 0.0, "joint_friction": (0.0,) * 7}
CELL = WorkCellScenario(peg=replace(PEG_ARM, **KNOWN), hole=replace(HOLE_ARM, **KNOWN))
STIFFNESS = np.diag([5.0] * 3 + [400.0] * 3)  # N m/rad and N/m
SEEN = ["x", "y", "z", "pitch", "yaw"]


def angular_first(axis: str) -> int:
    """Where an axis of AXES is in a spatial vector."""
    return (AXES.index(axis) + 3) % 6


def step_of(axis: str) -> float:
    return 1e-3 if axis in "xyz" else 1e-2  # m, rad


@lru_cache
def answer(arm: ArmName, axis: str, scenario: WorkCellScenario = CELL) -> Array:
    """How far the tool has moved and turned, shape (n, 6), angular first, a row a period."""
    diagram = make_response_diagram(
        scenario, arm, axis, amplitude=step_of(axis), begin=round(BEGIN / PERIOD) * PERIOD
    )
    pose = simulate(diagram, duration=BEGIN + LONG, step=PERIOD).outputs["true_pose"]
    turned = Rotation.from_quat(pose[:, :4], scalar_first=True)
    return np.column_stack([(turned * turned[0].inv()).as_rotvec(), pose[:, 4:] - pose[0, 4:]])


@lru_cache
def impedance(arm: ArmName) -> tuple[Array, Array]:
    """Inertia and damping that the controller designed for, in the world's axes."""
    diagram = make_response_diagram(CELL, arm, "x", amplitude=0.0, begin=BEGIN)
    controller = diagram.GetSubsystemByName(f"{arm} impedance control")
    assert isinstance(controller, ImpedanceController)
    return controller.inertia, controller.damping


def expected(arm: ArmName, axis: str, count: int) -> Array:
    """The answer of ``Lambda x'' + D x' + K (x - x_d) = 0``, shape (count, 6)."""
    inertia, damping = impedance(arm)
    motion = np.zeros((12, 12))
    motion[:6, 6:] = np.eye(6)
    motion[6:] = -np.linalg.solve(inertia, np.hstack([STIFFNESS, damping]))
    rest = np.zeros(12)
    rest[angular_first(axis)] = step_of(axis)
    return np.array([(rest - expm(motion * PERIOD * k) @ rest)[:6] for k in range(count)])


@pytest.mark.parametrize(
    ("arm", "axis"), [*(("peg", axis) for axis in SEEN), ("hole", "z"), ("hole", "pitch")]
)
def test_is_the_mass_on_springs_and_dampers_of_the_design(arm: ArmName, axis: str) -> None:
    first = round(BEGIN / PERIOD)
    found = answer(arm, axis)
    assert np.abs(found[: first + 1]).max() < 1e-6 * step_of(axis)  # nothing before the step
    found = found[first:]
    linear = expected(arm, axis, len(found))
    k = angular_first(axis)
    # 500 Hz delay the torque by a millisecond on the average, and the arm moves on in a step.
    np.testing.assert_allclose(found[:, k], linear[:, k], rtol=0, atol=0.03 * step_of(axis))
    assert found[-1, k] == pytest.approx(step_of(axis), rel=0.005)
    # What the other axes do meanwhile.
    bound = 0.05 * np.abs(linear).max(axis=0) + 0.005 * step_of(axis)
    assert (np.abs(found - linear) < bound).all()


@pytest.mark.parametrize(("arm", "axis"), [*(("peg", axis) for axis in SEEN), ("hole", "yaw")])
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


def test_a_linear_response_lasts_until_the_arm_rests() -> None:
    for arm in ARMS:
        left = step_responses(CELL, arm).undelivered
        assert np.abs(left[:, -1]).max() < 1e-4
        np.testing.assert_allclose(left[:, 0], 1.0, atol=1e-6)


def test_the_comparison_tells_modes_apart() -> None:
    # A response twice as quick, or as slow, would not have passed.
    first = round(BEGIN / PERIOD)
    found = answer("peg", "z")[first:, 5]
    for scale in (0.5, 2.0):
        linear = expected("peg", "z", len(found))[:, 5]
        moved = np.interp(scale * np.arange(len(found)), np.arange(len(found)), linear)
        assert np.abs(found - moved).max() > 0.1 * step_of("z")


def test_axes_are_the_worlds_and_the_amplitude_has_its_sign() -> None:
    back = make_response_diagram(CELL, "peg", "yaw", amplitude=-0.02, begin=BEGIN)
    pose = simulate(back, duration=1.0, step=PERIOD).outputs["true_pose"][-1]
    turned = Rotation.from_quat(pose[:4], scalar_first=True).as_rotvec()
    np.testing.assert_allclose(turned, [0, 0, -0.02], rtol=0, atol=5e-4)


@pytest.mark.parametrize("arm", ARMS)
def test_one_arm_alone_that_exports_its_true_pose(arm: ArmName) -> None:
    diagram = make_response_diagram(CELL, arm, "x", amplitude=1e-3, begin=0.1)
    assert diagram.num_input_ports() == 0
    assert diagram.num_output_ports() == 1
    assert diagram.get_output_port(0).get_name() == "true_pose"
    names = {system.get_name() for system in diagram.GetSystems()}
    other = ARMS[1 - ARMS.index(arm)]
    assert not [name for name in names if name.startswith(other)]


def test_an_axis_that_there_is_not() -> None:
    with pytest.raises(ValueError, match="tuple"):
        make_response_diagram(CELL, "peg", "w", amplitude=1e-3, begin=0.1)
