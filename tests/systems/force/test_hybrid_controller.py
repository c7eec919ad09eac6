"""The hybrid controller's block: ports, ticks, and what it refuses."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import AffineSystem, ConstantVectorSource

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.hybrid_controller import HybridController, Law

Array = np.ndarray

LAWS: tuple[Law, ...] = ("inverse", "transpose", "projected")
APPROACH, CONTACT, LOST = 0, 1, 2
DOWN = np.array([0.0, -1.0])
ALONG = np.diag([1.0, 0.0])  # P in contact
FREE = np.eye(2)


def test_ports(make_params: Any) -> None:
    ones = dict.fromkeys(("stiffness", "integral", "damping"), (1.0,) * 4)
    block = HybridController(ADEPT_ONE, make_params(**ones))
    sizes = {
        block.get_input_port(i).get_name(): block.get_input_port(i).size()
        for i in range(block.num_input_ports())
    }
    assert sizes == {
        "encoders": 8,
        "desired_position": 4,
        "desired_force": 4,
        "measured_force": 4,
        "selection": 16,
        "mode": 1,
        "desired_velocity": 4,
    }
    outputs = [block.get_output_port(i).get_name() for i in range(block.num_output_ports())]
    assert outputs == ["torque", "position_error", "force_error"]
    assert not block.HasAnyDirectFeedthrough()


def test_errors_are_told_before_the_selection(drive: Any, contact: Any) -> None:
    driven = drive()
    driven.tick(**contact())
    np.testing.assert_allclose(driven.read("position_error"), [0.02, -0.1], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(driven.read("force_error"), [-4.0, -4.0])


def test_torque_is_held_between_ticks(drive: Any, contact: Any) -> None:
    driven = drive()
    torque = driven.tick(**contact())
    driven.feed(**contact(desired_position=contact.x + 1.0, desired_force=-30 * DOWN))
    for time in (0.001, 0.1, 0.249):
        driven.simulator.AdvanceTo(time)
        np.testing.assert_array_equal(driven.read("torque"), torque)
    driven.simulator.AdvanceTo(0.251)
    assert not np.allclose(driven.read("torque"), torque)


@pytest.mark.parametrize("period", [0.005, 0.125])
def test_ticks_at_its_period(drive: Any, contact: Any, period: float) -> None:
    # The integral of a constant error counts them.
    driven = drive("transpose", stiffness=(0.0, 0.0), period=period)
    driven.feed(**contact(selection=FREE, mode=APPROACH))
    driven.simulator.AdvanceTo(10.5 * period)
    expected = 11 * period * np.array([200.0, 100.0]) * [0.02, -0.1]
    np.testing.assert_allclose(contact.tip_force(driven.read("torque")), expected, rtol=1e-12)


def test_plant_of_the_same_instant_sees_the_new_torque(make_params: Any, contact: Any) -> None:
    builder = DiagramBuilder()
    params = make_params()
    block = builder.AddSystem(HybridController(PLANAR_TWO_LINK, params))
    for name, value in contact(selection=FREE, mode=[APPROACH]).items():
        source = builder.AddSystem(ConstantVectorSource(np.asarray(value, dtype=float).ravel()))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    keep = builder.AddSystem(
        AffineSystem(
            A=np.zeros((2, 2)),
            B=np.eye(2),
            f0=np.zeros(2),
            C=np.eye(2),
            D=np.zeros((2, 2)),
            y0=np.zeros(2),
            time_period=params.period,
        )
    )
    builder.Connect(block.GetOutputPort("torque"), keep.get_input_port())
    simulator = Simulator(builder.Build())
    for ticks in range(3):
        simulator.AdvanceTo(ticks * params.period)
        simulator.AdvancePendingEvents()
        seen = keep.get_output_port().Eval(keep.GetMyContextFromRoot(simulator.get_context()))
        torque = block.GetOutputPort("torque").Eval(
            block.GetMyContextFromRoot(simulator.get_context())
        )
        assert np.abs(torque).max() > 1
        np.testing.assert_array_equal(seen, torque)


def test_contexts_are_apart(drive: Any, contact: Any) -> None:
    driven = drive()
    driven.tick(**contact(selection=FREE, mode=APPROACH))
    first = driven.tick()
    again = drive()
    fresh = Simulator(driven.block)
    for port in range(6):
        value = driven.block.get_input_port(port).Eval(driven.context)
        driven.block.get_input_port(port).FixValue(fresh.get_mutable_context(), value)
    fresh.AdvanceTo(0.25)
    fresh.AdvancePendingEvents()
    found = driven.block.GetOutputPort("torque").Eval(fresh.get_context())
    np.testing.assert_array_equal(found, first)
    assert not np.any(again.read("torque"))


# What is refused

PORTS = {
    "encoders": 4,
    "desired_position": 2,
    "desired_force": 2,
    "measured_force": 2,
    "selection": 4,
    "mode": 1,
    "desired_velocity": 2,
}


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("mode", [APPROACH, CONTACT, LOST])
@pytest.mark.parametrize("bad", [math.nan, -math.inf])
@pytest.mark.parametrize("port", PORTS)
def test_inputs_have_to_be_finite(
    drive: Any, contact: Any, port: str, bad: float, mode: int
) -> None:
    for index in range(PORTS[port]):
        driven = drive()
        driven.feed(desired_velocity=[0.1, 0.0])
        driven.tick(**contact(selection=ALONG if mode else FREE, mode=CONTACT if mode else 0))
        value = driven.block.GetInputPort(port).Eval(driven.context).copy()
        value[index] = bad
        driven.feed(mode=mode)
        with pytest.raises(ParameterError) as caught:
            driven.tick(**{port: value})
        message = str(caught.value)
        assert message == f"{port} is {value.tolist()}, allowed: finite numbers"
        # What was there is kept.
        assert np.all(np.isfinite(driven.read("torque")))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "selection", [[[0.5, 0.0], [0.0, 0.0]], [[1.0, 1.0], [0.0, 0.0]], [[2.0, 0.0], [0.0, 1.0]]]
)
def test_selection_has_to_be_a_projection(
    drive: Any, contact: Any, law: Law, selection: list[list[float]]
) -> None:
    driven = drive(law)
    driven.tick(**contact())
    with pytest.raises(ParameterError) as caught:
        driven.tick(selection=selection)
    allowed = "a symmetric projection, P P = P = P^T"
    assert str(caught.value) == f"selection is {selection}, allowed: {allowed}"


@pytest.mark.parametrize("law", LAWS)
def test_selection_in_contact_leaves_the_force_a_direction(
    drive: Any, contact: Any, law: Law
) -> None:
    driven = drive(law)
    driven.tick(**contact(selection=FREE, mode=0))
    with pytest.raises(ParameterError) as caught:
        driven.tick(mode=CONTACT)
    allowed = "a rank below 2 in contact, to leave the force a direction"
    assert str(caught.value) == f"selection is [[1.0, 0.0], [0.0, 1.0]], allowed: {allowed}"


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("arm", "q", "printed"),
    [
        (PLANAR_TWO_LINK, (0.5, 0.0), "[0.5, 0.0]"),
        (PLANAR_TWO_LINK, (0.5, 1e-7), "[0.5, 1e-07]"),
        (PUMA_250, (0.1, 0.2, 0.0), "[0.1, 0.2, 0.0]"),
        (ADEPT_ONE, (0.1, 0.0, 0.2, 0.3), "[0.1, 0.0, 0.2, 0.3]"),
    ],
)
def test_singular_pose(
    make_params: Any, drive_arm: Any, law: Law, arm: Arm, q: tuple[float, ...], printed: str
) -> None:
    n = arm.num_joints
    gains = dict.fromkeys(("stiffness", "integral", "damping"), (9.0,) * n)
    driven = drive_arm(arm, make_params(law, **gains))
    driven.tick()
    with pytest.raises(ParameterError) as caught:
        driven.tick(encoders=[*q, *np.zeros(n)])
    allowed = "one in which the Jacobian is regular"
    assert str(caught.value) == f"the pose of the {arm.name} is {printed}, allowed: {allowed}"


def test_nearly_singular_pose_is_fine(drive: Any) -> None:
    driven = drive()
    q = np.array([0.5, 1e-4])
    torque = driven.tick(encoders=[*q, 0, 0], desired_position=PLANAR_TWO_LINK.endpoint(q))
    np.testing.assert_allclose(torque, [0, 0], rtol=0, atol=1e-6)


def test_gains_have_to_fit_the_arm(make_params: Any) -> None:
    message = r"^stiffness is \(400.0, 300.0\), allowed: 3 numbers, or one for all$"
    with pytest.raises(ParameterError, match=message):
        HybridController(PUMA_250, make_params())


def test_one_gain_for_all_joints(drive: Any, contact: Any) -> None:
    even = {"stiffness": 90.0, "integral": 20.0, "damping": 7.0}
    one = drive(**even)
    each = drive(**{name: (value, value) for name, value in even.items()})
    inputs = contact(selection=ALONG, mode=CONTACT)
    np.testing.assert_array_equal(one.tick(**inputs), each.tick(**inputs))


def test_full_dynamics_go_with_a_model(make_params: Any) -> None:
    full = make_params(full_dynamics=True, inertia=(1.0, 1.0))
    with pytest.raises(ParameterError, match=r"^full_dynamics is True, allowed: true with a mod"):
        HybridController(PLANAR_TWO_LINK, full)
    dynamics = ArmDynamics(PLANAR_TWO_LINK)
    with pytest.raises(ParameterError, match=r"^full_dynamics is False, allowed: true with a mod"):
        HybridController(PLANAR_TWO_LINK, make_params(), dynamics=dynamics)


def test_what_a_scenario_leaves_open_is_refused(make_params: Any) -> None:
    with pytest.raises(ParameterError, match=r"^feedforward_torque is None, allowed: a value"):
        HybridController(PLANAR_TWO_LINK, make_params(feedforward_torque=None))
    full = make_params(full_dynamics=True)
    with pytest.raises(ParameterError, match=r"^inertia is None, allowed: a value"):
        HybridController(PLANAR_TWO_LINK, full, dynamics=ArmDynamics(PLANAR_TWO_LINK))


FULL = {"full_dynamics": True}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"law": "pinv"}, "law is 'pinv', allowed: inverse, transpose, projected"),
        ({"creep_speed": 0.0}, "creep_speed is 0.0, allowed: a finite number > 0"),
        ({"creep_damping": -1.0}, "creep_damping is -1.0, allowed: a finite number > 0"),
        ({"creep_ramp": math.nan}, "creep_ramp is nan, allowed: a finite number > 0"),
        ({"period": math.inf}, "period is inf, allowed: a finite number > 0"),
        ({"force_integral": -1.0}, "force_integral is -1.0, allowed: a finite number >= 0"),
        ({"force_damping": -1.0}, "force_damping is -1.0, allowed: a finite number >= 0"),
        ({"integral": (1.0,)}, "integral is (1.0,), allowed: 2 numbers, or one for all"),
        ({"integral": -1.0}, "integral is -1.0, allowed: finite numbers >= 0"),
        ({"damping": (1.0, -1.0)}, "damping is (1.0, -1.0), allowed: finite numbers >= 0"),
        ({"stiffness": (1.0, math.nan)}, "stiffness is (1.0, nan), allowed: finite numbers >= 0"),
        ({"held_integrators": (0, 2)}, "held_integrators is (0, 2), allowed: indices below 2"),
        ({"held_integrators": (-1,)}, "held_integrators is (-1,), allowed: indices below 2"),
        ({**FULL, "inertia": (1.0,)}, "inertia is (1.0,), allowed: 2 numbers"),
        ({**FULL, "inertia": (1.0, 0.0)}, "inertia is (1.0, 0.0), allowed: finite numbers > 0"),
        ({"inertia": (1.0, 1.0)}, "inertia is (1.0, 1.0), allowed: None without full dynamics"),
        (
            {**FULL, "law": "transpose"},
            "law is 'transpose', allowed: inverse or projected with full dynamics",
        ),
        (
            {"feedforward_torque": (1.0,)},
            "feedforward_torque is (1.0,), allowed: 2 numbers, or none",
        ),
        (
            {"feedforward_torque": (1.0, math.nan)},
            "feedforward_torque is (1.0, nan), allowed: finite numbers",
        ),
    ],
)
def test_parameters(make_params: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        make_params(**changes).for_joints(2)
    assert str(caught.value) == message
