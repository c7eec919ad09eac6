"""The plant's matrices against its transfer functions in python-control."""

import dataclasses

import control
import numpy as np
import pytest

from chamfer.models.plants.spring_mass_damper import Form, SpringMassDamperParams, state_space

PARAMS = SpringMassDamperParams(mass=2.0, damping=3.0, stiffness=50.0)
FORMS: tuple[Form, ...] = ("velocity", "position", "compliance")


def transfer_function(params: SpringMassDamperParams, form: Form) -> control.TransferFunction:
    denominator = [params.mass, params.damping, params.stiffness]
    numerator = {"velocity": [1.0, 0.0], "position": [params.stiffness], "compliance": [1.0]}
    return control.tf(numerator[form], denominator)


@pytest.mark.parametrize("params", [PARAMS, SpringMassDamperParams()], ids=["plain", "identified"])
@pytest.mark.parametrize("form", FORMS)
def test_has_the_transfer_function(params: SpringMassDamperParams, form: Form) -> None:
    frequencies = np.geomspace(1e-2, 1e4, 60)
    np.testing.assert_allclose(
        control.ss(*state_space(params, form))(1j * frequencies),
        transfer_function(params, form)(1j * frequencies),
        rtol=1e-9,
    )


@pytest.mark.parametrize("form", FORMS)
def test_forms_share_their_state(form: Form) -> None:
    plant = state_space(PARAMS, form)
    np.testing.assert_array_equal(plant.A, state_space(PARAMS, "position").A)
    assert [matrix.shape for matrix in plant] == [(2, 2), (2, 1), (1, 2), (1, 1)]


@pytest.mark.parametrize("field", ["mass", "damping", "stiffness"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_parameters_have_to_be_positive(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"^{field} is {value}, allowed: a finite number > 0$"):
        SpringMassDamperParams(**{field: value})


def test_parameters_are_frozen_and_by_keyword() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        PARAMS.mass = 1.0  # type: ignore[misc]
    with pytest.raises(TypeError):
        SpringMassDamperParams(1.0, 1.0, 1.0)  # type: ignore[misc]


def test_stiffness_is_the_papers() -> None:
    assert SpringMassDamperParams().stiffness == 700.0
