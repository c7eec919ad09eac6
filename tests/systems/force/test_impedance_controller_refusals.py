"""What the impedance controller refuses, and both sides of its stability bound."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ArmModel, Placement, ToolParams
from chamfer.systems.force.impedance_controller import (
    ImpedanceController,
    ImpedanceControllerParams,
    stable_damping_ratios,
)
from chamfer.systems.pose import pose_vector

Array = np.ndarray

TOOL = ToolParams(
    mass=0.3,
    centre_of_mass=(-0.06, 0.01, 0.0),
    inertia=(1e-4, 3e-4, 3e-4),
    frame=Placement(position=(0.0, 0.01, 0.1), rpy=(0.2, -1.3, 0.1)),
)
MODEL = ArmModel(Placement(position=(-0.8, 0.1, 0.0), rpy=(0.0, 0.0, 0.3)).transform, TOOL)
BENT = np.array([0.2, 0.7, -0.3, 1.7, 0.2, -0.9, 0.4])
PORTS = {"encoders": 14, "desired_pose": 7, "desired_velocity": 6}


def inputs_at_rest() -> dict[str, Array]:
    return {
        "encoders": np.concatenate([BENT, np.zeros(7)]),
        "desired_pose": pose_vector(MODEL.evaluate(BENT).X_WT),
        "desired_velocity": np.zeros(6),
    }


def run(inputs: dict[str, Array]) -> None:
    controller = ImpedanceController(MODEL, BENT, ImpedanceControllerParams())
    simulator = Simulator(controller)
    for name, value in inputs.items():
        controller.GetInputPort(name).FixValue(simulator.get_mutable_context(), value)
    simulator.AdvanceTo(0.001)


def test_nothing_is_refused_at_rest() -> None:
    run(inputs_at_rest())


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("port", PORTS)
def test_inputs_have_to_be_finite(port: str, bad: float) -> None:
    for index in range(PORTS[port]):
        inputs = inputs_at_rest()
        inputs[port][index] = bad
        with pytest.raises(ParameterError, match=rf"^{port} is \[.*, allowed: finite numbers$"):
            run(inputs)


def test_non_finite_input_in_a_run() -> None:
    inputs = inputs_at_rest()
    controller = ImpedanceController(MODEL, BENT, ImpedanceControllerParams())
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    for name, value in inputs.items():
        controller.GetInputPort(name).FixValue(context, value)
    simulator.AdvanceTo(0.005)
    controller.GetInputPort("encoders").FixValue(context, np.full(14, math.nan))
    with pytest.raises(ParameterError, match=r"^encoders is \[nan, "):
        simulator.AdvanceTo(0.01)


def test_torque_that_is_too_large_for_a_number() -> None:
    inputs = inputs_at_rest()
    inputs["desired_pose"][4:] = [1.7e308, -1.7e308, 1.7e308]
    with pytest.raises(ParameterError, match=r"^torque is \[.*, allowed: finite numbers$"):
        run(inputs)


@pytest.mark.parametrize("quaternion", [0.0, 1e-200])
def test_desired_quaternion_must_not_be_zero(quaternion: float) -> None:
    inputs = inputs_at_rest()
    inputs["desired_pose"][:4] = quaternion
    message = r"^desired_pose is \[.*, allowed: a quaternion that is not zero$"
    with pytest.raises(ParameterError, match=message):
        run(inputs)


def at_bound(side: int, factor: float, period: float) -> Callable[[], ImpedanceController]:
    params = ImpedanceControllerParams(period=period)
    fastest = ImpedanceController(MODEL, BENT, params).frequencies[-1]
    ratio = factor * stable_damping_ratios(float(fastest), period)[side]
    return lambda: ImpedanceController(
        MODEL, BENT, ImpedanceControllerParams(period=period, damping_ratio=ratio)
    )


@pytest.mark.parametrize("period", [0.001, 0.002, 0.01])
def test_damping_has_to_be_stable(period: float) -> None:
    at_bound(1, 0.999, period)()
    at_bound(0, 1.001, period)()
    for side, factor in ((1, 1.001), (0, 0.999)):
        with pytest.raises(ParameterError) as caught:
            at_bound(side, factor, period)()
        assert re.match(
            r"^damping_ratio is [\d.]+, allowed: more than [\d.]+ and less than [\d.]+ for a mode "
            rf"of \d+ rad/s and a period of {period:g} s \(damping below 2 Lambda/period\)$",
            str(caught.value),
        )


def test_bound_is_on_the_eigenvalues_of_damping_over_inertia() -> None:
    controller = at_bound(1, 0.999, 0.001)()
    rates = np.linalg.eigvals(np.linalg.solve(controller.inertia, controller.damping)).real
    assert 1.98 < rates.max() * 0.001 < 2.0


def test_stiffness_has_to_be_slow_enough_for_the_period() -> None:
    with pytest.raises(ParameterError, match=r"^period is 0.02, allowed: less than 0.01\d* s for"):
        ImpedanceController(MODEL, BENT, ImpedanceControllerParams(period=0.02))


def test_null_space_has_to_be_stable() -> None:
    params = ImpedanceControllerParams(null_damping_ratio=300.0)
    with pytest.raises(ParameterError, match=r"^null_damping_ratio is 300.0, allowed: more than"):
        ImpedanceController(MODEL, BENT, params)


def test_unstable_if_asked_for() -> None:
    params = ImpedanceControllerParams(damping_ratio=50.0, period=0.05, allow_unstable=True)
    assert ImpedanceController(MODEL, BENT, params).damping.max() > 0


@pytest.mark.parametrize(
    "straight", [[0] * 7, [1, 1, 1, 0, 1, 1, 1], [1, 0, 1, 1, 1, 0, 1]], ids=str
)
def test_rest_posture_must_not_be_singular(straight: list[int]) -> None:
    message = r"^rest posture is \(.*\), allowed: joint positions at which the .* is 0.05 or more$"
    with pytest.raises(ParameterError, match=message):
        ImpedanceController(MODEL, BENT * straight, ImpedanceControllerParams())


@pytest.mark.parametrize("q", [BENT + 3, BENT * np.nan, BENT[:6]])
def test_rest_posture_has_to_be_within_the_ranges(q: Array) -> None:
    with pytest.raises(ParameterError, match=r"^rest posture is \(.*\), allowed: between \(-2.6"):
        ImpedanceController(MODEL, q, ImpedanceControllerParams())


def test_torque_limits_are_those_of_as_many_joints() -> None:
    params = ImpedanceControllerParams(torque_limits=(1.0,) * 6)
    with pytest.raises(ParameterError, match=r"^torque_limits is .*, allowed: 7 finite numbers"):
        ImpedanceController(MODEL, BENT, params)


@pytest.mark.parametrize(
    ("change", "allowed"),
    [
        ({"stiffness": (1.0, 0.0, 1.0)}, "3 finite numbers > 0"),
        ({"stiffness": (1.0, 1.0)}, "3 finite numbers > 0"),
        ({"rotational_stiffness": (1.0, math.inf, 1.0)}, "3 finite numbers > 0"),
        ({"torque_limits": (1.0,) * 6 + (0.0,)}, "7 finite numbers > 0"),
        ({"damping_ratio": 0.0}, "a finite number > 0"),
        ({"null_damping_ratio": math.nan}, "a finite number > 0"),
        ({"null_stiffness": -1.0}, "a finite number >= 0"),
        ({"smallest_singular_value": math.inf}, "a finite number >= 0"),
        ({"period": 0.0}, "a finite number > 0"),
    ],
)
def test_parameters(change: dict[str, Any], allowed: str) -> None:
    ((name, value),) = change.items()
    with pytest.raises(ParameterError) as caught:
        ImpedanceControllerParams(**change)
    assert str(caught.value) == f"{name} is {value!r}, allowed: {allowed}"
