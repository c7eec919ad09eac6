"""The arm in free motion against its equations of motion, solved with scipy, and energy."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.arm_in_contact import ArmInContactParams

GRAVITY = 9.81
NOWHERE = RippledPlane(point=(0.0, 0.0, -100.0))
PLANAR_Q = np.array([0.4, -1.1])
PUMA_Q = PUMA_250.joint_positions(np.array([0.4, 0.0, 0.22]), "negative")
ADEPT_Q = ADEPT_ONE.joint_positions(np.array([0.5, 0.3, 0.22, 0.0]), "positive")


def smooth(n: int) -> JointFrictionParams:
    return JointFrictionParams(coulomb=(0.0,) * n, viscous=(0.0,) * n)


def params(n: int, friction: JointFrictionParams | None = None, **changes: object):
    return ArmInContactParams(joint_friction=friction or smooth(n), **changes)  # type: ignore[arg-type]


def planar_motion(q: np.ndarray, v: np.ndarray, torque: np.ndarray, duration: float) -> np.ndarray:
    """Solve the two-link arm's equations of motion; uniform rods of 1 m, 2 kg and 1 kg."""
    a1, a2, a3 = 2 / 3 + 1 / 12 + 5 / 4, 1 / 2, 1 / 3

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        c2, h = math.cos(y[1]), a2 * math.sin(y[1])
        mass = [[a1 + 2 * a2 * c2, a3 + a2 * c2], [a3 + a2 * c2, a3]]
        coriolis = [-h * (2 * y[2] * y[3] + y[3] ** 2), h * y[2] ** 2]
        return np.concatenate([y[2:], np.linalg.solve(mass, torque - coriolis)])

    start = np.concatenate([q, v])
    return solve_ivp(rate, (0.0, duration), start, rtol=1e-11, atol=1e-12).y[:, -1]


def test_driven_planar_arm_converges_with_its_step(simulate: Any) -> None:
    torque = np.array([1.5, -0.7])
    exact = planar_motion(PLANAR_Q, np.zeros(2), torque, 1.0)
    errors = []
    for step in (8e-4, 4e-4, 2e-4):
        settings = params(2, step=step, held=25)
        found = simulate(PLANAR_TWO_LINK, PLANAR_Q, settings, 1.0, torque=torque)
        errors.append(float(np.linalg.norm(found.encoders[-1] - exact)))
        assert np.max(np.abs(found.drift())) < 20 * step**2
    assert errors[-1] < 1e-6 * np.linalg.norm(exact)
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 4.0, atol=0.3)


@pytest.mark.parametrize("held", [10, 50])
@pytest.mark.parametrize(
    ("arm", "q", "v"),
    [
        (PLANAR_TWO_LINK, PLANAR_Q, [1.0, -2.0]),
        (PLANAR_TWO_LINK, PLANAR_Q, [10.0, -5.0]),
        (PUMA_250, PUMA_Q, [5.0, 3.0, 4.0]),
        (ADEPT_ONE, ADEPT_Q, [5.0, 5.0, -2.0, 4.0]),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_spinning_arm_keeps_its_energy(
    simulate: Any, energies: Any, arm: Arm, q: np.ndarray, v: list[float], held: int
) -> None:
    found = simulate(arm, q, params(arm.num_joints, held=held), 0.5, velocity=np.array(v))
    energy = energies(arm, NOWHERE, 1e4, found)
    kinetic = found.stored("kinetic").max()
    assert np.max(np.abs(energy - energy[0])) < 1e-6 * kinetic
    np.testing.assert_allclose(found.drift(), energy[1:] - energy[1], rtol=0, atol=1e-9)
    assert np.all(found.signal("dissipated") == 0.0)


def test_coasting_planar_arm_follows_its_equations_of_motion(simulate: Any) -> None:
    v = np.array([1.0, -2.0])
    exact = planar_motion(PLANAR_Q, v, np.zeros(2), 1.0)
    found = simulate(PLANAR_TWO_LINK, PLANAR_Q, params(2), 1.0, velocity=v)
    np.testing.assert_allclose(found.encoders[-1], exact, rtol=0, atol=1e-7)


def test_quill_falls_freely(simulate: Any) -> None:
    found = simulate(ADEPT_ONE, ADEPT_Q, params(4), 0.2)
    time = 1e-3 * np.arange(len(found.q))
    fallen = GRAVITY * time**2 / 2
    np.testing.assert_allclose(found.q[:, 2] - ADEPT_Q[2], fallen, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.v[:, 2], GRAVITY * time, rtol=1e-9)
    np.testing.assert_allclose(found.q[:, [0, 1, 3]] - ADEPT_Q[[0, 1, 3]], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.signal("gap"), found.signal("gap")[0] - fallen, atol=1e-9)
    np.testing.assert_allclose(found.signal("approach_speed")[1:], found.v[1:, 2], rtol=1e-9)


def test_without_gravity_nothing_falls(simulate: Any) -> None:
    found = simulate(ADEPT_ONE, ADEPT_Q, params(4, gravity=False), 0.2)
    np.testing.assert_allclose(found.q, np.broadcast_to(ADEPT_Q, found.q.shape), atol=1e-12)


def test_disturbance_accelerates_the_tip(simulate: Any) -> None:
    force = np.array([3.0, -2.0, 1.0])
    settings = params(3, gravity=False, contact_offset=(0.02, 0.01, -0.03))
    found = simulate(PUMA_250, PUMA_Q, settings, 0.005, disturbance=force)
    dynamics = ArmDynamics(PUMA_250, gravity=False, contact_offset=(0.02, 0.01, -0.03))
    state = dynamics.evaluate(PUMA_Q, np.zeros(3))
    expected = 1e-3 * np.linalg.solve(state.mass, state.J_v_WC.T @ force)
    np.testing.assert_allclose(found.v[1], expected, rtol=1e-4)
