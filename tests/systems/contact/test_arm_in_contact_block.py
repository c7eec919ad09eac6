"""The arm in contact as a block: its ports, and what it refuses."""

import math
import re
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_in_contact import ArmInContact, ArmInContactParams, ContactParams
from chamfer.systems.contact.arm_motion import advance

NOWHERE = RippledPlane(point=(0.0, 0.0, -100.0))
PUMA_Q = np.array([0.4, 0.6, -1.1])


def smooth(n: int) -> JointFrictionParams:
    return JointFrictionParams(coulomb=(0.0,) * n, viscous=(0.0,) * n)


def params(n: int, friction: JointFrictionParams | None = None, **changes: object):
    return ArmInContactParams(joint_friction=friction or smooth(n), **changes)  # type: ignore[arg-type]


def run_puma(duration: float, **inputs: object) -> None:
    block = ArmInContact(PUMA_250, NOWHERE, params(3), PUMA_Q)
    simulator = Simulator(block)
    for name, value in ({"torque": [0.0, 0.0, 0.0]} | inputs).items():
        block.GetInputPort(name).FixValue(simulator.get_mutable_context(), np.array(value))
    simulator.AdvanceTo(duration)


def test_ports() -> None:
    block = ArmInContact(ADEPT_ONE, NOWHERE, params(4), np.zeros(4))
    inputs = [block.get_input_port(i) for i in range(block.num_input_ports())]
    outputs = [block.get_output_port(i) for i in range(block.num_output_ports())]
    assert [(port.get_name(), port.size()) for port in inputs] == [
        ("torque", 4),
        ("disturbance", 3),
        ("scene", 1),
    ]
    assert [(port.get_name(), port.size()) for port in outputs] == [
        ("encoders", 8),
        ("contact_force", 3),
        ("tool_force", 3),
        ("base_torque", 4),
        ("contact", 6),
        ("tip", 6),
        ("energy", 5),
        ("base_wrench", 6),
    ]
    assert not block.HasAnyDirectFeedthrough()


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


def test_divergence_is_one_line() -> None:
    message = (
        "^the Puma 250's velocity at t = 0.* s is .*, allowed: finite numbers, the run diverges$"
    )
    with pytest.raises(ParameterError, match=message):
        run_puma(1.0, torque=[1e307, 1e307, 0.0])


def test_a_step_that_is_not_solved_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def unsolved(*arguments: Any) -> tuple[Any, ...]:
        state, outputs, _, _ = advance(*arguments)
        return state, outputs, 1e-3, 1

    monkeypatch.setattr("chamfer.systems.contact.arm_in_contact.advance", unsolved)
    message = (
        "^the error of the Puma 250's contact at t = 0 s is 0.001, "
        "allowed: less, which a shorter step may reach$"
    )
    with pytest.raises(ParameterError, match=message):
        run_puma(0.01)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_friction_of_another_number_of_joints(count: int) -> None:
    friction = smooth(count)
    message = re.escape(f"joint_friction.coulomb is {friction.coulomb}, allowed: 3 numbers")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        ArmInContact(PUMA_250, NOWHERE, params(3, friction), PUMA_Q)


@pytest.mark.parametrize(
    "q", [[0.0, 1.0], [0.0, 1.0, 2.0, 3.0], [[0.0, 1.0, 2.0]], [0.0, math.nan, 0.0]]
)
def test_positions_of_another_shape(q: list[object]) -> None:
    message = re.escape(f"q is {q}, allowed: 3 finite numbers")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        ArmInContact(PUMA_250, NOWHERE, params(3), np.array(q))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"step": 0.0}, "step is 0.0, allowed: a finite number > 0"),
        ({"step": math.nan}, "step is nan, allowed: a finite number > 0"),
        ({"held": 0}, "held is 0, allowed: a whole number >= 1"),
        ({"window": 0}, "window is 0, allowed: a whole number >= 1"),
    ],
)
def test_params_errors(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        params(3, **changes)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("stiffness", 0.0, "a finite number > 0"),
        ("stiffness", math.inf, "a finite number > 0"),
        ("damping", -1.0, "a finite number >= 0"),
    ],
)
def test_contact_params_errors(name: str, value: float, allowed: str) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is {value}, allowed: {allowed}$"):
        ContactParams(**{name: value})
