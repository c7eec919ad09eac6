"""Arms under impedance control: dynamics, stability, dry friction and desired motion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from chamfer.diagrams.cell.work_cell import ARMS, PEG_ARM, WorkCellScenario
from chamfer.models.arms import wam
from chamfer.models.validation import ParameterError
from chamfer.systems.force.impedance_controller import (
    ImpedanceController,
    ImpedanceControllerParams,
)

Array = np.ndarray

GRAVITY = 9.81
STIFFNESS = np.array([5.0] * 3 + [400.0] * 3)  # the default, N m/rad and N/m
SMOOTH = (0.0,) * 7  # no dry friction
# Of the vertical tracking (Fig. 11), without the cameras.
VERTICAL = WorkCellScenario(
    impedance=ImpedanceControllerParams(stiffness=(700.0, 700.0, 700.0)), gap=0.1
)
BELOW = (0.0, 0.0, -0.03)  # m, where the peg starts
PERFECT = replace(PEG_ARM, payload_error=0.0, joint_friction=SMOOTH)


# Dynamics


def response(controller: ImpedanceController, wrench: Array, time: float) -> Array:
    """Way of the second-order system with inertia, damping and stiffness at a step, (6,)."""
    inverse = np.linalg.inv(controller.inertia)
    A = np.zeros((13, 13))
    A[:6, 6:12] = np.eye(6)
    A[6:12, :6], A[6:12, 6:12] = -inverse * STIFFNESS, -inverse @ controller.damping
    A[6:12, 12] = inverse @ wrench
    return np.asarray(expm(A * time)[:6, 12])


@pytest.mark.parametrize("axis", range(6))
def test_step_response_is_that_of_the_effective_inertia(
    make_cell: Any, still: Any, axis: int
) -> None:
    cell = make_cell(still(period=0.001))
    wrench = np.zeros(6)
    wrench[axis] = 0.02 if axis < 3 else 1.0
    cell.push(wrench)
    found, continuous, stepped = [], [], []
    x, v = np.zeros(6), np.zeros(6)
    inverse = np.linalg.inv(cell.controller.inertia)
    for k in range(1, 801):
        v = v + 0.001 * inverse @ (wrench - STIFFNESS * x - cell.controller.damping @ v)
        x = x + 0.001 * v
        if k in (5, 10, 20, 50, 100, 200, 400, 800):
            cell.run(0.001 * k - 0.0002)
            found.append(cell.error())
            continuous.append(response(cell.controller, wrench, 0.001 * k))
            stepped.append(x)
    group = slice(0, 3) if axis < 3 else slice(3, 6)
    scale = np.abs(continuous)[:, group].max()
    close = 0.06 if axis == 0 else 0.03  # the turn about the peg's axis takes few periods
    np.testing.assert_allclose(
        np.array(found)[:, group], np.array(continuous)[:, group], rtol=0, atol=close * scale
    )
    np.testing.assert_allclose(
        np.array(found)[:, group], np.array(stepped)[:, group], rtol=0, atol=0.01 * scale
    )


def energy(cell: Any) -> float:
    """Kinetic energy and what is in the tool's springs, J."""
    v = cell.v()
    mass = cell.plant.CalcMassMatrix(cell.plant_context)
    return float(v @ mass @ v + STIFFNESS @ cell.error() ** 2) / 2


@pytest.mark.parametrize("seed", range(2))
def test_energy_only_falls(make_cell: Any, still: Any, seed: int) -> None:
    # Without the pull on the elbow, which stores nothing that could be written down.
    cell = make_cell(still(null_stiffness=0.0, period=0.001, torque_limits=(1e3,) * 7))
    rng = np.random.default_rng(seed)
    cell.plant.SetPositions(cell.plant_context, cell.q() + rng.uniform(-0.05, 0.05, 7))
    cell.plant.SetVelocities(cell.plant_context, rng.uniform(-0.5, 0.5, 7))
    levels = [energy(cell)]
    for k in range(1, 201):
        cell.run(0.01 * k)
        levels.append(energy(cell))
    assert np.diff(levels).max() < 1e-3 * levels[0]
    assert levels[-1] < 0.5 * levels[0]


@pytest.mark.parametrize("seed", range(2))
def test_motion_dies_out(make_cell: Any, still: Any, seed: int) -> None:
    cell = make_cell(still())
    start = cell.q()
    rng = np.random.default_rng(seed)
    cell.plant.SetPositions(cell.plant_context, start + rng.uniform(-0.2, 0.2, 7))
    cell.plant.SetVelocities(cell.plant_context, rng.uniform(-1, 1, 7))
    cell.run(5.0)
    np.testing.assert_allclose(cell.v(), 0, rtol=0, atol=2e-4)
    np.testing.assert_allclose(cell.q(), start, rtol=0, atol=2e-3)


def test_elbow_goes_back_and_leaves_the_tool_alone(make_cell: Any, still: Any) -> None:
    cell = make_cell(still(null_stiffness=20.0))
    start = cell.q()
    _, free = cell.tool_state()
    cell.plant.SetVelocities(cell.plant_context, 2 * free)
    largest, tool = 0.0, 0.0
    for k in range(1, 61):
        cell.run(0.1 * k)
        largest = max(largest, float(np.abs(cell.q() - start).max()))
        tool = max(tool, float(np.linalg.norm(cell.error()[3:])))
    assert largest > 0.04
    assert tool < 2e-3
    np.testing.assert_allclose(cell.q(), start, rtol=0, atol=1e-3)


def test_posture_stays_though_gravity_is_wrong(make_cell: Any, still: Any) -> None:
    cell = make_cell(still(replace(PERFECT, mass_scale=0.97, payload_error=0.1)))
    start = cell.q()
    cell.plant.SetPositions(cell.plant_context, start + 1e-3)
    cell.run(5.0)
    settled = cell.q()
    cell.run(7.0)
    np.testing.assert_allclose(cell.q(), settled, rtol=0, atol=1e-4)
    assert np.abs(settled - start).max() < 0.1


@pytest.mark.parametrize("period", [0.001, 0.002])
def test_both_sides_of_the_stability_bound(make_cell: Any, still: Any, period: float) -> None:
    # From the 2 by 2 map of a mode, not from the block: d = 2 Lambda/period less the stiffness.
    fastest = float(make_cell(still()).controller.frequencies[-1])
    n = round(period / 0.001)
    bound = (2 - (fastest * period) ** 2 / (2 * n)) / (2 * fastest * period)
    beyond = still(damping_ratio=1.03 * bound, period=period)
    with pytest.raises(ParameterError, match="damping below 2 Lambda/period"):
        make_cell(beyond)
    fastest_seen = []
    for factor in (0.97, 1.03):
        cell = make_cell(still(damping_ratio=factor * bound, period=period, allow_unstable=True))
        cell.plant.SetVelocities(cell.plant_context, np.full(7, 1e-4))
        speeds = []
        for k in range(1, 81):
            cell.run(0.01 * k)
            speeds.append(float(np.abs(cell.v()).max()))
        fastest_seen.append(max(speeds[20:]))
    assert fastest_seen[0] < 1e-4
    assert fastest_seen[1] > 0.05


def test_torque_is_limited_and_the_arm_comes_to_its_goal_nevertheless(make_cell: Any) -> None:
    limits = (3.0, 22.0, 3.0, 6.0, 1.0, 1.0, 0.5)
    scenario = replace(
        VERTICAL, peg=PERFECT, impedance=ImpedanceControllerParams(torque_limits=limits)
    )
    cell = make_cell(scenario, start_offset=(0.0, 0.12, -0.05), motion_time=0.05)
    saturated = np.zeros(7)
    for k in range(1, 301):
        cell.run(0.01 * k)
        torque = cell.read("peg.torque")
        assert np.all(np.abs(torque) <= limits)
        saturated = np.maximum(saturated, np.abs(cell.read("peg.saturated")))
    assert saturated.sum() >= 2
    cell.run(8.0)
    assert np.abs(cell.error()).max() < 1e-3


# Dry friction


def test_joints_stick_up_to_their_friction(make_cell: Any, still: Any) -> None:
    cell = make_cell(still(replace(PEG_ARM, payload_error=0.0)))
    start = cell.q()
    cell.push(np.array([0, 0, 0, 0, 0, -0.1]))  # less than 0.1 N m about any joint
    cell.run(2.0)
    np.testing.assert_allclose(cell.q(), start, rtol=0, atol=1e-4)
    cell.push(np.array([0, 0, 0, 0, 0, -3.0]))
    cell.run(5.0)
    assert cell.error()[5] < -0.004


def test_friction_holds_what_the_springs_lack(make_cell: Any) -> None:
    cell = make_cell(VERTICAL, start_offset=BELOW)
    cell.run(4.0)
    q = cell.q()
    model = cell.controller._model.evaluate(q)
    payload = 0.0865 * GRAVITY
    lever = Rotation.from_rotvec(cell.error()[:3]).apply(PEG_ARM.payload_position)
    wrench = np.concatenate([np.cross(lever, [0, 0, -payload]), [0, 0, -payload]])
    rest = cell.read("peg.torque") - model.gravity + model.J_V_WT.T @ wrench
    assert np.all(np.abs(rest) <= np.array(wam.DRY_FRICTION) + 1e-4)
    assert np.abs(rest).max() > 0.05


def test_droop_of_the_vertical_tracking(make_cell: Any) -> None:
    # Calibrated: the payload that the controller does not know, with the friction on.
    cell = make_cell(VERTICAL, start_offset=BELOW)
    cell.run(4.0)
    assert cell.error()[5] == pytest.approx(-0.0015, abs=2e-5)
    assert PEG_ARM.payload_error < 0.107
    assert max(PEG_ARM.arm.dry_friction) <= 0.1


# The desired motion


def test_peg_follows_its_trajectory(make_cell: Any) -> None:
    # Stiff and known: the way and its velocity have to fit each other.
    cell = make_cell(replace(VERTICAL, peg=PERFECT), start_offset=(0.0, 0.03, -0.05))
    np.testing.assert_allclose(cell.read("peg.desired_pose")[4:], [-0.1, 0.03, 0.108], atol=1e-12)
    np.testing.assert_allclose(cell.error(), 0, rtol=0, atol=1e-9)
    cell.simulator.Initialize()
    np.testing.assert_allclose(cell.read("peg.tool_pose"), cell.read("peg.true_pose"), atol=1e-9)
    lag = 0.0
    for k in range(1, 41):
        cell.run(0.05 * k)
        lag = max(lag, float(np.abs(cell.error()[3:]).max()))
    assert lag < 4e-4
    np.testing.assert_allclose(cell.read("peg.desired_pose")[4:], [-0.1, 0.0, 0.158], atol=1e-12)
    cell.run(4.0)
    np.testing.assert_allclose(cell.error(), 0, rtol=0, atol=1e-4)


def test_same_bytes(make_cell: Any) -> None:
    def run() -> bytes:
        cell = make_cell(VERTICAL, ARMS, start_offset=BELOW)
        cell.run(0.1, 0.2)
        ports = range(cell.diagram.num_output_ports())
        return b"".join(
            cell.diagram.get_output_port(i).Eval(cell.context).tobytes() for i in ports
        )

    assert run() == run()


def test_arms_do_not_disturb_each_other(make_cell: Any) -> None:
    together, alone = (make_cell(VERTICAL, arms, start_offset=BELOW) for arms in (ARMS, ("peg",)))
    together.run(0.5)
    alone.run(0.5)
    np.testing.assert_allclose(together.q()[:7], alone.q(), rtol=0, atol=1e-7)
