"""An arm that touches in several points, holds a load, changes scenes, or has a gripper."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.arms.gripper import GripperCompliance, Tensor
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError
from chamfer.systems.contact import sliding_contact
from chamfer.systems.contact.arm_dynamics import (
    GRAVITY,
    ArmDynamics,
    base_wrench,
    bias,
    point_jacobian,
    pose,
)
from chamfer.systems.contact.arm_in_contact import (
    ArmInContact,
    ArmInContactParams,
    ContactParams,
    ContactPoint,
    Load,
    Scene,
    with_load,
)

PUMA_Q = PUMA_250.joint_positions(np.array([0.4, 0.0, 0.22]), "negative")
POSE = np.array([0.5, 0.15, 0.45, 0.4, 0.1, -0.2, 0.3])
WRIST_Q = ADEPT_WRIST.joint_positions(POSE, "positive")
NOWHERE = RippledPlane(point=(0.0, 0.0, -100.0))
INERTIA = np.array([[4e-5, 1e-5, 0.0], [1e-5, 3e-5, 0.0], [0.0, 0.0, 2e-5]])
NUGGET = Load(0.185, (0.01, 0.02, -0.03), INERTIA)


def params(n: int, viscous: float = 0.0, **changes: Any) -> ArmInContactParams:
    friction = JointFrictionParams(coulomb=(0.0,) * n, viscous=(viscous,) * n)
    return ArmInContactParams(joint_friction=friction, **changes)


def touches(
    surface: Surface = NOWHERE,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    stiffness: float = 1e4,
    damping: float = 20.0,
    mu: float = 0.0,
) -> ContactPoint:
    friction = SurfaceFriction(coefficient=mu)
    contact = ContactParams(stiffness=stiffness, damping=damping, friction=friction)
    return ContactPoint(offset, surface, contact)


def test_the_sensor_reads_weight_and_inertia_of_the_load(run: Any) -> None:
    scene = Scene((touches(),), NUGGET)
    block = ArmInContact(ADEPT_WRIST, [scene], params(7, 0.1, held=1), WRIST_Q)
    dynamics = ArmDynamics(ADEPT_WRIST, contact_offset=NUGGET.centre)
    R_WE = dynamics.orientation(WRIST_Q)
    context = block.CreateDefaultContext()
    hanging = NUGGET.mass * np.array([0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(
        R_WE @ block.GetOutputPort("tool_force").Eval(context), hanging, rtol=0, atol=1e-12
    )
    found = run(block, 0.02, period=1e-4, torque=[3.0, -2.0, 0.0, 0.4, 0.3, -0.2, 0.1])
    states = [dynamics.evaluate(q, v) for q, v in zip(found.q, found.v, strict=True)]
    speeds = np.array([state.J_v_WC @ v for state, v in zip(states, found.v, strict=True)])
    pulled = hanging - NUGGET.mass * np.diff(speeds, axis=0) / 1e-4
    read = [state.R_WE @ force for state, force in zip(states, found.tool_force, strict=True)]
    assert np.ptp(pulled) > 0.4
    np.testing.assert_allclose(read[1:], pulled, rtol=0, atol=1e-9)


def test_the_base_carries_all_that_moves_and_touches(run: Any) -> None:
    # What the base gives, less weight, and what the table gives make the whole momentum change.
    surface = RippledPlane(point=(0.0, 0.0, 0.38))
    scene = Scene((touches(surface, (0.0, 0.0, -0.06), 1e3, mu=0.3), touches()), NUGGET)
    block = ArmInContact(ADEPT_WRIST, [scene], params(7, 0.1, held=1), WRIST_Q)
    blow = np.array([1.0, -2.0, 0.5])
    found = run(block, 0.15, period=1e-4, disturbance=blow, torque=[2.0, -1.0, 0, 0.2, 0, 0, 0.1])
    chain = with_load(ArmDynamics(ADEPT_WRIST).chain, NUGGET)
    weightless = chain._replace(gravity=np.zeros(3))
    still = np.zeros(7)
    momenta = np.array(
        [
            base_wrench(weightless, pose(weightless, q), still, v)
            for q, v in zip(found.q, found.v, strict=True)
        ]
    )
    held = np.array([base_wrench(chain, pose(chain, q), still, still) for q in found.q])
    force = found.contact_force[1:, :3] + blow
    pushes = np.hstack([np.cross(found.tip[1:, :3], force), force])
    expected = np.diff(momenta, axis=0) / 1e-4 + (held[1:] + held[:-1]) / 2 - pushes
    touched = found.contact_force[1:, 2] > 1.0
    assert np.sum(touched) > 100
    assert found.contact_force[1:][touched, :2].any()
    scale = np.max(np.abs(expected - held[1:]), axis=0)
    error = np.abs(found.base_wrench[1:] - expected)
    assert np.all(error < 5e-3 * np.max(scale))


def test_energy_where_a_corner_holds_the_tip_redundantly(run: Any) -> None:
    # Set down between wall and layer by an arm with dry friction, until joints and points stick.
    x, y, z = POSE[:3]
    wall = RippledPlane(
        point=(x + 0.001, y, z), normal=(-1.0, 0.0, 0.0), along=(0.0, 1.0, 0.0), tilt=0.02
    )
    layer = RippledPlane(point=(x, y, z - 0.031))
    points = (
        touches(wall, damping=200.0, mu=0.3),
        touches(layer, (0.0, 0.0, -0.03), damping=200.0, mu=0.3),
    )
    gripper = GripperCompliance(stiffness=1000.0, damping=10.0)
    dry = JointFrictionParams(coulomb=(1.0, 0.5, 5.0, 0.5, 0.5, 0.5, 0.5), viscous=(0.1,) * 7)
    settings = ArmInContactParams(joint_friction=dry, gripper=gripper)
    scene = Scene(points, NUGGET)
    at = pose(with_load(ArmDynamics(ADEPT_WRIST).chain, NUGGET), WRIST_Q)
    push = point_jacobian(at, at.p_WE).T @ np.array([4.0, 0.5, -8.0])
    weight = bias(with_load(ArmDynamics(ADEPT_WRIST).chain, NUGGET), at, np.zeros(7))
    block = ArmInContact(ADEPT_WRIST, [scene], settings, WRIST_Q)
    found = run(block, 0.6, period=1e-3, torque=weight + push)
    assert np.all(found.contact[-1, ::6] < 0.0)
    assert np.max(np.abs(found.v[-1])) == 0.0
    assert np.max(np.abs(found.drift())) < 1e-5 * found.turned_over()
    assert np.all(np.diff(found.signal("dissipated")) >= -1e-9)
    # What is at rest and open, how both share the friction along the corner, stays.
    held = found.contact_force[-50:]
    np.testing.assert_allclose(held, held[:1].repeat(50, axis=0), rtol=0, atol=1e-6)


def test_taking_and_leaving_a_load_is_booked() -> None:
    gripper = GripperCompliance(stiffness=1000.0, damping=5.0)
    floor = RippledPlane(point=(0.0, 0.0, 0.40))
    scenes = (
        Scene((touches(floor),)),
        Scene((touches(floor, (0.0, 0.0, -0.04)), touches(floor, (0.02, 0.0, -0.04))), NUGGET),
    )
    block = ArmInContact(ADEPT_WRIST, scenes, params(7, 0.5, gripper=gripper), WRIST_Q)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    holding = ArmDynamics(ADEPT_WRIST).gravity_torque(WRIST_Q)
    block.GetInputPort("torque").FixValue(context, holding + np.eye(7)[0] + 10.0 * np.eye(7)[2])
    rows, heights = [], []
    for k in range(120):
        block.GetInputPort("scene").FixValue(context, float(40 <= k < 80))
        simulator.AdvanceTo((k + 1) * 1e-3)
        rows.append(block.GetOutputPort("energy").Eval(context).copy())
        contact = block.GetOutputPort("contact").Eval(context).reshape(2, 6)
        assert (contact[1, 0] == 1e3) == (not 40 <= k < 80)
        n = block.GetOutputPort("encoders").Eval(context)
        heights.append(ADEPT_WRIST.endpoint(n[:7])[2])
    energy = np.array(rows)
    balance = energy[:, :4].sum(axis=1) - energy[:, 4]
    turned = np.sum(np.ptp(energy[:, :3], axis=0))
    assert np.ptp(balance) < 1e-5 * turned
    # Potential energy jumps by that of the nugget, its centre in the endpoint's axes.
    jump = energy[40, 1] - energy[39, 1] - (energy[39, 1] - energy[38, 1])
    R_WE = ArmDynamics(ADEPT_WRIST).orientation(WRIST_Q)
    centre = heights[40] + R_WE[2] @ np.array(NUGGET.centre)
    assert jump == pytest.approx(NUGGET.mass * GRAVITY * centre, rel=0.01)


def test_peaks_end_with_their_scene() -> None:
    x, y, z = ArmDynamics(PUMA_250).evaluate(PUMA_Q, np.zeros(3)).p_WC
    pressed = Scene((touches(RippledPlane(point=(x, y, z + 1e-3))),))
    block = ArmInContact(PUMA_250, (pressed, Scene((touches(),))), params(3, window=5), PUMA_Q)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    holding = ArmDynamics(PUMA_250).gravity_torque(PUMA_Q)
    block.GetInputPort("torque").FixValue(context, holding)
    peaks = []
    for k in range(4):  # updates of one window
        block.GetInputPort("scene").FixValue(context, float(k > 1))
        simulator.AdvanceTo((k + 1) * 1e-3)
        peaks.append(float(block.GetOutputPort("contact").Eval(context)[3]))
    assert min(peaks[:2]) > 5.0
    assert peaks[2:] == [0.0, 0.0]


@pytest.mark.parametrize("index", [-1.0, 2.0, 0.5, math.nan])
def test_a_scene_that_is_not_there(index: float) -> None:
    block = ArmInContact(PUMA_250, [Scene((touches(),))] * 2, params(3), PUMA_Q)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("torque").FixValue(context, np.zeros(3))
    block.GetInputPort("scene").FixValue(context, index)
    with pytest.raises(ParameterError, match=f"^scene is {index}, allowed: 0 to 1$"):
        simulator.AdvanceTo(0.01)


OBLIQUE = ((300.0, 60.0, 0.0), (60.0, 200.0, 0.0), (0.0, 0.0, 150.0))


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
    gripper = GripperCompliance(stiffness=stiffness)
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
