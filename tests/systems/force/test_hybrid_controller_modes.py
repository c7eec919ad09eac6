"""The hybrid controller's switches without a jump, its creep, and integrators that are held."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.systems.contact.arm_in_contact import ArmInContact, ArmInContactParams
from chamfer.systems.force.hybrid_controller import HybridController, HybridControllerParams, Law

Array = np.ndarray

LAWS: tuple[Law, ...] = ("inverse", "transpose", "projected")
APPROACH, CONTACT, LOST = 0, 1, 2
EXACT = 1e-12
DOWN = np.array([0.0, -1.0])
ALONG = np.diag([1.0, 0.0])  # P in contact
FREE = np.eye(2)


# Switches without a jump


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("before", "after"),
    [(APPROACH, CONTACT), (CONTACT, APPROACH), (LOST, CONTACT), (LOST, APPROACH)],
)
def test_torque_does_not_jump(drive: Any, contact: Any, law: Law, before: int, after: int) -> None:
    driven = drive(law)
    selection = {APPROACH: FREE, CONTACT: ALONG, LOST: ALONG}
    driven.tick(**contact(selection=FREE, mode=APPROACH))
    for _ in range(3):
        torque = driven.tick(selection=selection[before], mode=before)
    found = driven.tick(selection=selection[after], mode=after)
    np.testing.assert_allclose(found, torque, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", LAWS)
def test_offset_stays_as_it_is_within_a_mode(drive: Any, contact: Any, law: Law) -> None:
    # From tick to tick the torque changes by what the law without an offset changes.
    smooth, plain = drive(law), drive(law, bumpless=False)
    rng = np.random.default_rng(5)
    found, expected = [], []
    for mode in [APPROACH] * 2 + [CONTACT] * 6 + [APPROACH] * 3 + [CONTACT] * 3:
        inputs = contact(
            encoders=np.concatenate([contact.q + 0.1 * rng.normal(size=2), rng.normal(size=2)]),
            desired_position=contact.x + 0.1 * rng.normal(size=2),
            measured_force=rng.normal(size=2),
            selection=ALONG if mode else FREE,
            mode=mode,
        )
        found.append(smooth.tick(**inputs))
        expected.append(plain.tick(**inputs))
    change, wanted = np.diff(found, axis=0), np.diff(expected, axis=0)
    for switch in (1, 7, 10):
        np.testing.assert_allclose(change[switch], [0, 0], rtol=0, atol=EXACT)
        assert np.abs(wanted[switch]).max() > 10  # N m
        wanted[switch] = 0
    np.testing.assert_allclose(change, wanted, rtol=0, atol=1e-11)


def test_first_tick_in_contact_starts_from_the_torque_at_rest(drive: Any, contact: Any) -> None:
    driven = drive(feedforward_torque=(2.0, -1.0))
    np.testing.assert_array_equal(driven.read("torque"), [2.0, -1.0])
    np.testing.assert_allclose(driven.tick(**contact()), [2.0, -1.0], rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", LAWS)
def test_known_torque_is_added(drive: Any, contact: Any, law: Law) -> None:
    known = np.array([2.0, -1.0])
    plain = drive(law)
    fed = drive(law, feedforward_torque=tuple(known))
    for mode in (APPROACH, CONTACT, CONTACT, LOST, LOST, CONTACT, APPROACH):
        inputs = contact(mode=mode, selection=ALONG if mode else FREE)
        expected = plain.tick(**inputs) + known
        np.testing.assert_allclose(fed.tick(**inputs), expected, rtol=0, atol=1e-10)


# Loss of contact


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("away", [0.0, 0.3])  # m/s
def test_push_is_let_go_and_a_bounce_is_damped(
    drive: Any, contact: Any, law: Law, away: float
) -> None:
    known = np.array([5.0, -3.0])
    driven = drive(law, creep_damping=70.0, feedforward_torque=tuple(known))
    for _ in range(4):
        torque = driven.tick(**contact())
    before = contact.tip_force(torque - known)
    assert abs(before[1]) > 1
    # Moving along the surface as well, at 0.2 m/s; what acts along it stays.
    moving = np.concatenate([contact.q, np.linalg.solve(contact.J, [0.2, away])])
    after = contact.tip_force(driven.tick(mode=LOST, encoders=moving) - known)
    np.testing.assert_allclose(after, [before[0], -70.0 * away], rtol=0, atol=1e-11)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("force", [15.0, 4.0, -15.0])
def test_push_grows_with_the_ramp_at_rest(
    drive: Any, contact: Any, law: Law, force: float
) -> None:
    # Towards where the desired force points, whatever its size.
    driven = drive(law, integral=(0.0, 0.0), creep_ramp=40.0, period=0.125)
    driven.tick(**contact(desired_force=force * DOWN))
    start = contact.tip_force(driven.tick(mode=LOST))
    for k in range(1, 6):
        grown = contact.tip_force(driven.tick()) - start
        expected = math.copysign(40.0 * 0.125 * k, force) * DOWN
        np.testing.assert_allclose(grown, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("speed", "share"),  # m/s towards the surface; of the ramp
    [(-9.0, 1.0), (-0.01, 1.0), (0.0, 1.0), (0.02, 0.5), (0.04, 0.0), (0.08, -1.0), (9.0, -1.0)],
)
def test_push_grows_by_what_is_missing_to_the_creep_speed(
    drive: Any, contact: Any, speed: float, share: float
) -> None:
    driven = drive("projected", integral=(0.0, 0.0), creep_speed=0.04, creep_ramp=40.0)
    moving = np.concatenate([contact.q, np.linalg.solve(contact.J, speed * DOWN)])
    driven.tick(**contact(encoders=moving))
    torques = [driven.tick(mode=LOST) for _ in range(4)]
    growth = contact.tip_force(np.diff(torques, axis=0).T).T
    np.testing.assert_allclose(growth, [40.0 * 0.25 * share * DOWN] * 3, rtol=0, atol=1e-10)


def test_every_loss_starts_anew(drive: Any, contact: Any) -> None:
    driven = drive(integral=(0.0, 0.0))
    first = []
    for _ in range(2):
        driven.tick(**contact())
        first.append(contact.tip_force(driven.tick(mode=LOST)))
        for _ in range(5):
            driven.tick()
    assert [force[1] for force in first] == pytest.approx([0.0, 0.0], abs=1e-11)


def test_force_integral_waits_for_contact(drive: Any, contact: Any) -> None:
    driven = drive(bumpless=False)
    driven.feed(**contact(desired_position=contact.x))
    driven.tick()
    for _ in range(9):
        driven.tick(mode=LOST, measured_force=[0.0, 0.0])
    # Two periods in contact, and nothing of the nine between.
    expected = contact.J.T @ (DOWN * (15.0 + 2 * 3.0 * 4.0 * 0.25))
    found = driven.tick(mode=CONTACT, measured_force=11 * DOWN)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_without_a_desired_force_nothing_is_sought(drive: Any, contact: Any) -> None:
    driven = drive(integral=(0.0, 0.0))
    driven.tick(**contact(desired_force=[7.0, 0.0]))  # along the surface only
    torques = [driven.tick(mode=LOST) for _ in range(4)]
    np.testing.assert_allclose(torques, [torques[0]] * 4, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", LAWS)
def test_loss_may_be_ignored(drive: Any, contact: Any, law: Law) -> None:
    # As if it were contact.
    ignoring, touching = drive(law, loss_mode=False), drive(law)
    rng = np.random.default_rng(2)
    for mode in (APPROACH, CONTACT, CONTACT, LOST, LOST, CONTACT, LOST, APPROACH, LOST):
        inputs = contact(
            encoders=np.concatenate([contact.q, rng.normal(size=2)]),
            measured_force=rng.normal(size=2),
            selection=ALONG if mode else FREE,
        )
        found = ignoring.tick(**{**inputs, "mode": mode})
        expected = touching.tick(**{**inputs, "mode": min(mode, CONTACT)})
        np.testing.assert_array_equal(found, expected)


def closed_loop(
    q: Array, params: HybridControllerParams, inputs: dict[str, Any], duration: float
) -> Array:
    """Simulate the planar arm from rest without friction, far from a surface.

    Args:
        q: Its joint positions, rad.
        params: The controller's.
        inputs: Its constant inputs, all but the encoders.
        duration: s.

    Returns:
        The tip's positions and velocities at the ticks, shape (ticks, 4).
    """
    builder = DiagramBuilder()
    floor = RippledPlane(point=(0.0, 0.0, -9.0))
    free = JointFrictionParams(coulomb=(0.0, 0.0), viscous=(0.0, 0.0))
    plant = builder.AddSystem(
        ArmInContact(
            PLANAR_TWO_LINK,
            floor,
            ArmInContactParams(joint_friction=free, gravity=False),
            q,
        )
    )
    block = builder.AddSystem(HybridController(PLANAR_TWO_LINK, params))
    for name, value in inputs.items():
        source = builder.AddSystem(ConstantVectorSource(np.asarray(value, dtype=float).ravel()))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    builder.Connect(plant.GetOutputPort("encoders"), block.GetInputPort("encoders"))
    builder.Connect(block.GetOutputPort("torque"), plant.GetInputPort("torque"))
    logger = LogVectorOutput(plant.GetOutputPort("encoders"), builder, params.period)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(duration)
    data = logger.FindLog(simulator.get_context()).data().T
    return np.array(
        [
            [*PLANAR_TWO_LINK.endpoint(row[:2]), *(PLANAR_TWO_LINK.jacobian(row[:2]) @ row[2:])]
            for row in data
        ]
    )


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("creep_speed", [0.02, 0.05])
def test_lost_contact_is_sought_with_the_creep_speed(
    contact: Any, law: Law, creep_speed: float
) -> None:
    params = HybridControllerParams(
        law=law,
        stiffness=400.0,
        integral=400.0,
        damping=60.0,
        force_integral=3.0,
        feedforward_torque=(),
        creep_speed=creep_speed,
    )
    path = closed_loop(
        contact.q,
        params,
        {
            "desired_position": contact.x,
            "desired_force": 15 * DOWN,
            "measured_force": np.zeros(2),
            "selection": ALONG,
            "mode": np.array([LOST]),
        },
        1.5,
    )
    towards = path[:, 2:] @ DOWN
    assert towards[-1] == pytest.approx(creep_speed, rel=0.02)
    assert towards[:3] == pytest.approx([0, 0, 0], abs=2e-3)  # no push to begin with
    assert towards.max() < 1.3 * creep_speed
    assert np.abs(path[:, 0] - 1.0).max() < 1e-3  # and not along the surface


# Integrators that are held


@pytest.mark.parametrize("law", LAWS)
def test_held_integrators_wait_in_contact_only(drive: Any, contact: Any, law: Law) -> None:
    driven = drive(
        law,
        stiffness=(0.0, 0.0),
        damping=(0.0, 0.0),
        force_integral=0.0,
        held_integrators=(0,),
        bumpless=False,
    )
    driven.feed(**contact(selection=ALONG, mode=APPROACH, desired_force=[0.0, 0.0]))
    e = np.array([0.02, -0.1])
    P = np.reshape(ALONG, (2, 2))
    error = {
        "transpose": P @ e,
        "inverse": np.linalg.solve(contact.J, P @ e),
        "projected": np.linalg.pinv(P @ contact.J) @ P @ e,
    }[law]
    growth = np.array([200.0, 100.0]) * 0.25 * error

    def integral(torque: Array) -> Array:
        return contact.tip_force(torque) if law == "transpose" else torque

    first, second = integral(driven.tick()), integral(driven.tick())
    np.testing.assert_allclose([first, second], [growth, 2 * growth], rtol=1e-12, atol=1e-12)
    # The same selection, so that nothing but the mode differs.
    touching = integral(driven.tick(mode=CONTACT))
    np.testing.assert_allclose(touching, growth * [2, 3], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        integral(driven.tick(mode=LOST)), growth * [2, 4], rtol=1e-12, atol=1e-12
    )
    back = integral(driven.tick(mode=APPROACH))
    np.testing.assert_allclose(back, growth * [3, 5], rtol=1e-12, atol=1e-12)
