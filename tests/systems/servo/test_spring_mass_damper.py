"""The spring-mass-damper block against the analytic second-order step responses."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from pydrake.systems.primitives import LinearSystem

from chamfer.models.plants.spring_mass_damper import Form, SpringMassDamperParams
from chamfer.systems.servo.spring_mass_damper import make_spring_mass_damper

Respond = Callable[..., np.ndarray]
UNDER = SpringMassDamperParams(mass=2.0, damping=4.0, stiffness=50.0)  # damping ratio 0.2
CRITICAL = SpringMassDamperParams(mass=2.0, damping=20.0, stiffness=50.0)
OVER = SpringMassDamperParams(mass=2.0, damping=50.0, stiffness=50.0)  # damping ratio 2.5
PLANTS = pytest.mark.parametrize(
    "params",
    [UNDER, CRITICAL, OVER, SpringMassDamperParams()],
    ids=["under", "critical", "over", "identified"],
)
FORMS = pytest.mark.parametrize("form", ["velocity", "position", "compliance"])


def analytic_step_response(
    params: SpringMassDamperParams, form: Form, t: np.ndarray
) -> np.ndarray:
    w = math.sqrt(params.stiffness / params.mass)
    ratio = params.damping / (2 * math.sqrt(params.stiffness * params.mass))
    if math.isclose(ratio, 1.0):
        position = 1 - (1 + w * t) * np.exp(-w * t)
        velocity = t * np.exp(-w * t) / params.mass
    elif ratio < 1:
        wd, decay = w * math.sqrt(1 - ratio**2), np.exp(-ratio * w * t)
        position = 1 - decay * (np.cos(wd * t) + ratio * w / wd * np.sin(wd * t))
        velocity = decay * np.sin(wd * t) / (params.mass * wd)
    else:
        slow = w * (-ratio + math.sqrt(ratio**2 - 1))
        fast = w * (-ratio - math.sqrt(ratio**2 - 1))
        position = 1 - (slow * np.exp(fast * t) - fast * np.exp(slow * t)) / (slow - fast)
        velocity = (np.exp(slow * t) - np.exp(fast * t)) / (params.mass * (slow - fast))
    return {
        "position": position,
        "velocity": velocity,
        "compliance": position / params.stiffness,
    }[form]


@PLANTS
@FORMS
def test_answers_a_step_in_closed_form(
    respond: Respond, params: SpringMassDamperParams, form: Form
) -> None:
    times = np.linspace(0.0, 2.0, 41)
    response = respond(make_spring_mass_damper(params, form), 1.0, 0.0, times)
    expected = analytic_step_response(params, form, times)
    np.testing.assert_allclose(response, expected, atol=1e-7 * np.abs(expected).max())


@PLANTS
@FORMS
def test_comes_to_rest_at_the__dc_gain(
    respond: Respond, params: SpringMassDamperParams, form: Form
) -> None:
    slowest = np.linalg.eigvals(make_spring_mass_damper(params, form).A()).real.max()
    times = np.array([0.0, 25.0 / -slowest])
    resting = respond(make_spring_mass_damper(params, form), 3.0, 0.0, times)[-1]
    assert resting == pytest.approx(3.0 * _dc_gain(params, form), abs=1e-7)


@FORMS
def test_is_one_linear_block_at_rest(form: Form) -> None:
    block = make_spring_mass_damper(UNDER, form)
    context = block.CreateDefaultContext()
    assert isinstance(block, LinearSystem)
    assert block.get_name() == "plant"
    assert block.time_period() == 0.0
    assert not block.HasAnyDirectFeedthrough()
    assert context.get_continuous_state_vector().CopyToVector().tolist() == [0.0, 0.0]
    assert block.get_output_port().Eval(context)[0] == 0.0


def test_state_is_position_and_velocity() -> None:
    state = [0.3, -0.7]
    for form, expected in (("position", 0.3), ("compliance", 0.3), ("velocity", -0.7)):
        block = make_spring_mass_damper(UNDER, form)
        context = block.CreateDefaultContext()
        context.SetContinuousState(state)
        assert block.get_output_port().Eval(context)[0] == expected


def _dc_gain(params: SpringMassDamperParams, form: Form) -> float:
    return {"velocity": 0.0, "position": 1.0, "compliance": 1.0 / params.stiffness}[form]
