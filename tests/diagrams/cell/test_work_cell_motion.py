"""Arms under impedance control: dynamics, stability, dry friction and desired motion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from chamfer.diagrams.cell.work_cell import PEG_ARM, WorkCellScenario
from chamfer.models.arms import wam
from chamfer.models.validation import ParameterError
from chamfer.systems.force.impedance_controller import (
    ImpedanceController,
    ImpedanceControllerParams,
)

Array = np.ndarray

GRAVITY = 9.81
STIFFNESS = np.array([5.0] * 3 + [400.0] * 3)  # the default, N m/rad and N/m
# Of the vertical tracking (Fig. 11), without the cameras.
VERTICAL = WorkCellScenario(
    impedance=ImpedanceControllerParams(stiffness=(700.0, 700.0, 700.0)), gap=0.1
)
BELOW = (0.0, 0.0, -0.03)  # m, where the peg starts


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


# The desired motion
