"""The arm at rest, in free motion and in contact against its equations of motion; its ports."""

import dataclasses
import math
import re
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from scipy.integrate import solve_ivp

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.surfaces.surface import Surface, locate
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.arm_in_contact import ArmInContact, ArmInContactParams, ContactParams
from chamfer.systems.contact.arm_motion import update

NOWHERE = RippledPlane(point=(0.0, 0.0, -100.0))
TABLE = RippledPlane(point=(0.4, 0.0, 0.2), tilt=0.02, along=(0.0, 1.0, 0.0))
PLANAR_Q = np.array([0.4, -1.1])
# The Puma's tip 2 cm above the table, in front of it.
PUMA_Q = PUMA_250.joint_positions(np.array([0.4, 0.0, 0.22]), "negative")
ADEPT_Q = ADEPT_ONE.joint_positions(np.array([0.5, 0.3, 0.22, 0.0]), "positive")
CONTACT_PORTS = ("encoders", "contact_force", "tool_force", "base_torque", "contact")


def smooth(n: int) -> JointFrictionParams:
    return JointFrictionParams(coulomb=(0.0,) * n, viscous=(0.0,) * n)


def params(n: int, friction: JointFrictionParams | None = None, **changes: object):
    return ArmInContactParams(joint_friction=friction or smooth(n), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("torque", [(1.49, -0.74), (-1.49, -0.74), (0.0, 0.0)])
def test_below_breakaway_stays_exactly_at_rest(simulate: Any, torque: tuple[float, float]) -> None:
    friction = JointFrictionParams(coulomb=(1.0, 0.5), breakaway=1.5, viscous=(0.1, 0.1))
    found = simulate(PLANAR_TWO_LINK, PLANAR_Q, params(2, friction), 1.0, torque=torque)
    np.testing.assert_array_equal(found.q, np.broadcast_to(PLANAR_Q, found.q.shape))
    np.testing.assert_array_equal(found.v, np.zeros_like(found.v))
    # Nothing reaches the links.
    np.testing.assert_allclose(found.base_torque, 0.0, atol=1e-10)
    assert np.all(found.signal("dissipated") == 0.0)


def test_starts_at_rest_at_the_gap_of_the_surface() -> None:
    block = ArmInContact(PUMA_250, TABLE, params(3), PUMA_Q)
    context = block.CreateDefaultContext()
    values = {name: block.GetOutputPort(name).Eval(context) for name in CONTACT_PORTS}
    np.testing.assert_array_equal(values["encoders"], [*PUMA_Q, 0, 0, 0])
    gap = locate(TABLE, PUMA_250.endpoint(PUMA_Q)).gap
    np.testing.assert_allclose(values["contact"], [gap, 0, 0, 0, 0, 0], rtol=0, atol=1e-15)
    for name in ("contact_force", "tool_force"):
        np.testing.assert_array_equal(values[name], np.zeros(3))
    # What holds the links at rest.
    held = ArmDynamics(PUMA_250).gravity_torque(PUMA_Q)
    np.testing.assert_allclose(values["base_torque"], held, rtol=1e-12)


@pytest.mark.parametrize(
    ("arm", "q", "surface", "torque"),
    [
        (PLANAR_TWO_LINK, PLANAR_TWO_LINK.joint_positions(np.array([1.0, -1.499]), "negative"),
         Crucible(), (-5.5, 1.6)),
        (PUMA_250, PUMA_Q, dataclasses.replace(TABLE, point=(0.4, 0.0, 0.218)), (0.1, 0.5, 0.2)),
        (ADEPT_ONE, ADEPT_Q, dataclasses.replace(TABLE, point=(0.5, 0.3, 0.218)),
         (2.0, -1.0, 5.0, 0.1)),
    ],
    ids=["planar", "puma", "adept"],
)  # fmt: skip
def test_each_update_satisfies_the_equations_of_motion(
    simulate: Any, arm: Arm, q: np.ndarray, surface: Surface, torque: tuple[float, ...]
) -> None:
    # One step an update, so that nothing is held for longer.
    n = arm.num_joints
    friction = JointFrictionParams(coulomb=(0.3,) * n, breakaway=1.5, viscous=(0.4,) * n)
    contact = ContactParams(friction=SurfaceFriction(coefficient=0.3))
    settings = params(n, friction, contact=contact, held=1)
    found = simulate(arm, q, settings, 0.06, surface, torque=torque)
    dynamics = ArmDynamics(arm)
    h = settings.step
    assert found.contact_force.any()
    moved = 0
    for k in range(len(found.q) - 1):
        v, mean = found.v[k + 1], (found.v[k] + found.v[k + 1]) / 2
        state = dynamics.evaluate((found.q[k] + found.q[k + 1]) / 2, mean)
        force, gap = found.contact_force[k + 1], found.signal("gap")[k + 1]
        np.testing.assert_allclose(found.q[k + 1], found.q[k] + h * mean, rtol=0, atol=1e-12)
        if gap > 0 > found.signal("gap")[k]:
            continue  # the force left off in the step
        expected = state.mass @ (v - found.v[k]) / h + state.bias - state.J_v_WC.T @ force
        np.testing.assert_allclose(found.base_torque[k + 1], expected, rtol=0, atol=2e-3)
        rubbed = np.array(torque) - found.base_torque[k + 1] - 0.4 * mean
        assert np.all(np.abs(rubbed) <= 0.45 + 1e-9)
        assert np.all(rubbed * v >= -1e-9)
        moved += np.count_nonzero(v)
        after = dynamics.evaluate(found.q[k + 1], v)
        np.testing.assert_allclose(
            found.tool_force[k + 1], after.R_WE.T @ force, rtol=0, atol=1e-10
        )
        # The contact's law and the signals.
        true_gap, normal = locate(surface, after.p_WC)
        assert gap == pytest.approx(true_gap, abs=1e-8)
        middle = (gap + found.signal("gap")[k]) / 2
        rate = (gap - found.signal("gap")[k]) / h
        if max(gap, found.signal("gap")[k]) < 0:
            push = max(0.0, -1e4 * middle - 20.0 * rate)
            assert normal @ force == pytest.approx(push, abs=1e-2)
        sideways = force - (normal @ force) * normal
        assert np.linalg.norm(sideways) <= 0.3 * (normal @ force) + 1e-4
        assert (normal @ force > 0) <= (gap <= 0)
        assert found.signal("approach_speed")[k + 1] == pytest.approx(
            -normal @ after.J_v_WC @ v, abs=1e-4
        )
        np.testing.assert_allclose(
            found.tip[k + 1], [*after.p_WC, *(after.J_v_WC @ v)], rtol=0, atol=1e-12
        )
    assert moved > 100


FALLS = [
    pytest.param(
        PUMA_250,
        PUMA_Q,
        TABLE,
        JointFrictionParams(coulomb=(0.05, 0.05, 0.05), viscous=(0.02,) * 3),
        id="puma",
    ),
    pytest.param(
        ADEPT_ONE,
        ADEPT_Q,
        dataclasses.replace(TABLE, point=(0.5, 0.3, 0.2)),
        JointFrictionParams(coulomb=(0.5, 0.2, 5.0, 0.05), viscous=(0.1, 0.1, 2.0, 0.01)),
        id="adept",
    ),
]


@pytest.mark.parametrize(("arm", "q", "surface", "friction"), FALLS)
def test_fall_on_the_table_only_loses_energy(
    simulate: Any, arm: Arm, q: np.ndarray, surface: Surface, friction: JointFrictionParams
) -> None:
    contact = ContactParams(stiffness=1e4, damping=50.0, friction=SurfaceFriction(coefficient=0.2))
    settings = params(arm.num_joints, friction, contact=contact)
    found = simulate(arm, q, settings, 0.5, surface)
    assert found.signal("peak_force").max() > 30
    assert 0.2 < found.signal("impact_speed").max() < 0.7
    energy = found.energy[:, :3].sum(axis=1)
    lost = energy[0] - energy
    assert lost[-1] > 0.1
    assert np.max(np.diff(energy)) <= 1e-6 * lost[-1]
    dissipated = found.signal("dissipated")
    assert np.all(np.diff(dissipated) >= -1e-9)
    np.testing.assert_allclose(dissipated, lost, rtol=0, atol=1e-6 * lost[-1])
    np.testing.assert_allclose(found.drift(), 0.0, rtol=0, atol=1e-6 * lost[-1])


def test_window_holds_peaks_until_the_next(simulate: Any) -> None:
    settings = params(3, contact=ContactParams(damping=20.0), step=1e-4, held=10)
    single = simulate(PUMA_250, PUMA_Q, settings, 0.1, TABLE)
    wide = simulate(PUMA_250, PUMA_Q, dataclasses.replace(settings, window=5), 0.1, TABLE)
    for name in ("peak_force", "impact_speed"):
        each = single.signal(name)[1:].reshape(-1, 5)
        np.testing.assert_array_equal(
            wide.signal(name)[1:].reshape(-1, 5), np.maximum.accumulate(each, axis=1)
        )
    np.testing.assert_array_equal(single.encoders, wide.encoders)


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


class OwnPlane(RippledPlane):
    """A table of a class that machine code does not know."""

    def level(self, p: np.ndarray) -> float:
        return super().level(p)


def test_a_surface_of_ones_own_acts_as_a_known_one(simulate: Any) -> None:
    given = params(3, contact=ContactParams(friction=SurfaceFriction(coefficient=0.3)))
    falls = [
        simulate(PUMA_250, PUMA_Q, given, 0.2, kind(**dataclasses.asdict(TABLE)))
        for kind in (RippledPlane, OwnPlane)
    ]
    assert np.max(falls[0].signal("peak_force")) > 1.0
    np.testing.assert_allclose(falls[1].contact_force, falls[0].contact_force, atol=1e-9)


PUMA_START = np.array([0.4, 0.6, -1.1])


def run_puma(duration: float, **inputs: object) -> None:
    block = ArmInContact(PUMA_250, NOWHERE, params(3), PUMA_START)
    simulator = Simulator(block)
    for name, value in ({"torque": [0.0, 0.0, 0.0]} | inputs).items():
        block.GetInputPort(name).FixValue(simulator.get_mutable_context(), np.array(value))
    simulator.AdvanceTo(duration)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"torque": [0.0, math.nan, 0.0]}, "torque is [0.0, nan, 0.0]"),
        ({"torque": [math.inf, 0.0, 0.0]}, "torque is [inf, 0.0, 0.0]"),
        ({"disturbance": [0.0, 0.0, math.nan]}, "disturbance is [0.0, 0.0, nan]"),
    ],
)
def test_inputs_have_to_be_finite(inputs: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}, allowed: finite numbers$"):
        run_puma(0.01, **inputs)


def test_a_step_that_is_not_solved_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def unsolved(*arguments: Any) -> tuple[float, int]:
        update(*arguments)
        return 1e-3, 1

    monkeypatch.setattr("chamfer.systems.contact.arm_in_contact.update", unsolved)
    message = (
        "^the error of the Puma 250's contact at t = 0 s is 0.001, "
        "allowed: less, which a shorter step may reach$"
    )
    with pytest.raises(ParameterError, match=message):
        run_puma(0.01)
