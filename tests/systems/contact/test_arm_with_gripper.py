"""A compliant gripper on an arm: against a slow one's sliding contact, closed forms, energy."""

import math
from typing import Any

import numpy as np
import pytest

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.arms.gripper import GripperParams, Tensor
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.rounds import Crucible
from chamfer.systems.contact import sliding_contact
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.arm_in_contact import ArmInContactParams, ContactParams

GRAVITY = 9.81
PUMA_Q = PUMA_250.joint_positions(np.array([0.4, 0.0, 0.22]), "negative")
TABLE = RippledPlane(point=(0.4, 0.0, 0.2), tilt=0.02, along=(0.0, 1.0, 0.0))
OBLIQUE = ((300.0, 60.0, 0.0), (60.0, 200.0, 0.0), (0.0, 0.0, 150.0))


def params(n: int, viscous: float, **changes: Any) -> ArmInContactParams:
    friction = JointFrictionParams(coulomb=(0.0,) * n, viscous=(viscous,) * n)
    return ArmInContactParams(joint_friction=friction, **changes)


@pytest.mark.parametrize(
    ("stiffness", "friction"),
    [
        (100.0, SurfaceFriction(coefficient=0.5)),
        (OBLIQUE, SurfaceFriction(coefficient=0.2, jump=0.4, jump_at=1.05, jump_width=0.02)),
    ],
    ids=["isotropic", "oblique, friction jumps"],
)
def test_slow_arm_slides_as_the_contact_of_section_5_2_1(
    simulate: Any, stiffness: Tensor, friction: SurfaceFriction
) -> None:
    # Dragged slowly into the wall and along it, on a wall that hardly gives.
    gripper = GripperParams(stiffness=stiffness)
    contact = ContactParams(stiffness=3e5, damping=300.0, friction=friction)
    settings = params(2, 3e3, contact=contact, gripper=gripper)
    q = PLANAR_TWO_LINK.joint_positions(np.array([0.9, -1.46]), "negative")
    turning = np.linalg.solve(PLANAR_TWO_LINK.jacobian(q), [0.2, -0.15])
    wall = Crucible()
    found = simulate(PLANAR_TWO_LINK, q, settings, 1.0, wall, torque=3e3 * turning)
    dynamics, touch = ArmDynamics(PLANAR_TWO_LINK), None
    modes, errors = [], []
    for k in range(0, len(found.q), 4):
        state = dynamics.evaluate(found.q[k], found.v[k])
        spring = state.R_WE @ np.array(gripper.matrix(3)) @ state.R_WE.T
        spring = (spring + spring.T) / 2  # symmetric to the last bit
        touch = sliding_contact.advance(
            wall, friction, spring, touch, state.p_WC, state.J_v_WC @ found.v[k]
        )
        modes.append(touch.mode)
        errors.append(np.linalg.norm(found.contact_force[k] - touch.force))
        assert np.linalg.norm(found.tip[k, :3] - touch.point) < 1e-3
    assert {sliding_contact.FREE, sliding_contact.SLIP} <= set(modes)
    largest = np.max(np.linalg.norm(found.contact_force, axis=1))
    assert largest > 2.0
    assert np.max(errors) < 0.03 * largest


def test_two_springs_carry_the_same_force(simulate: Any) -> None:
    stiff, soft = 1e4, 2e3
    settings = params(3, 20.0, gripper=GripperParams(stiffness=soft, damping=5.0))
    surface = RippledPlane(point=(0.4, 0.0, 0.2199))
    dynamics = ArmDynamics(PUMA_250)
    start = dynamics.evaluate(PUMA_Q, np.zeros(3))
    torque = start.bias - start.J_v_WC.T @ np.array([0.0, 0.0, 8.0])
    found = simulate(PUMA_250, PUMA_Q, settings, 3.0, surface, torque=torque)
    push = found.contact_force[-1, 2]
    assert push == pytest.approx(8.0, rel=0.03)
    assert found.signal("gap")[-1] == pytest.approx(-push / stiff, rel=1e-3)
    endpoint = dynamics.evaluate(found.q[-1], np.zeros(3)).p_WC[2]
    assert found.tip[-1, 2] - endpoint == pytest.approx(push / soft, rel=1e-3)
    elastic = push**2 / 2 * (1 / stiff + 1 / soft)
    assert found.stored("elastic")[-1] == pytest.approx(elastic, rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 10.0])
def test_energy_with_a_gripper(simulate: Any, damping: float) -> None:
    # The arm falls on the table with its gripper, bounces and slides.
    gripper = GripperParams(stiffness=OBLIQUE, damping=damping)
    contact = ContactParams(damping=damping, friction=SurfaceFriction(coefficient=0.2))
    found = simulate(
        PUMA_250, PUMA_Q, params(3, 0.02, contact=contact, gripper=gripper), 0.5, TABLE
    )
    assert found.signal("peak_force").max() > 10
    assert np.max(np.abs(found.drift())) < 2e-5 * found.turned_over()
    assert np.all(np.diff(found.signal("dissipated")) >= -1e-9)


def test_undamped_gripper_bounces_back(simulate: Any) -> None:
    # The quill falls; without any friction nearly all comes back, and what does not is booked.
    stiff, soft = 1e4, 2e3
    settings = params(
        4, 0.0, contact=ContactParams(stiffness=stiff, damping=0.0),
        gripper=GripperParams(stiffness=soft),
    )  # fmt: skip
    q = ADEPT_ONE.joint_positions(np.array([0.5, 0.3, 0.22, 0.0]), "positive")
    table = RippledPlane(point=(0.5, 0.3, 0.215))
    found = simulate(ADEPT_ONE, q, settings, 0.3, table)
    peak = found.signal("peak_force").max()
    mass, series = 6.0, 1 / (1 / stiff + 1 / soft)
    # m v^2 / 2 + m g s = c s^2 / 2 at the deepest point, s below the touch
    fall = mass * GRAVITY * 5e-3
    deepest = (mass * GRAVITY + math.sqrt((mass * GRAVITY) ** 2 + 2 * series * fall)) / series
    assert peak == pytest.approx(series * deepest, rel=2e-3)
    assert found.signal("dissipated")[-1] < 0.03 * fall
    assert np.max(np.abs(found.drift())) < 1e-6 * fall


def test_stiff_gripper_is_as_good_as_none(simulate: Any) -> None:
    contact = ContactParams(friction=SurfaceFriction(coefficient=0.2))
    runs = [
        simulate(PUMA_250, PUMA_Q, params(3, 0.5, contact=contact, gripper=gripper), 0.13, TABLE)
        for gripper in (None, GripperParams(stiffness=1e8, damping=1e3))
    ]
    rigid, stiff = (run.contact_force for run in runs)
    assert np.max(rigid) > 30.0
    np.testing.assert_allclose(stiff, rigid, rtol=0, atol=0.03 * np.max(rigid))
