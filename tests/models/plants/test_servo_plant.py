from typing import Any

import control
import numpy as np
import pytest

from chamfer.models.plants.measured_step import IdentifiedPlant
from chamfer.models.plants.servo_plant import (
    Form,
    ServoPlantParams,
    SpringMassDamperParams,
    TransferFunction,
    state_space,
    transfer_function,
)
from chamfer.models.validation import ParameterError


def at(plant: TransferFunction, s: complex) -> complex:
    delay = np.exp(-s * plant.dead_time)
    return complex(delay * np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s))


def test_three_ways_to_tell_one_plant() -> None:
    s = 3 + 7j
    expected = 600 / (3 * s**2 + 70 * s + 600)
    assert at(transfer_function(ServoPlantParams()), s) == pytest.approx(expected)
    given = ServoPlantParams(numerator=(200.0,), denominator=(1.0, 70 / 3, 200.0))
    assert at(transfer_function(given), s) == pytest.approx(expected)
    lag = 70 / 600
    identified = IdentifiedPlant(
        gain=1.0, lag=lag, ratio=3 / 600 / lag**2, dead_time=0.0, covariance=(0.0,) * 16
    )
    found = transfer_function(ServoPlantParams(identified=identified))
    assert at(found, s) == pytest.approx(expected)


def test_a_scaled_plant_is_slower_and_stronger() -> None:
    plant = transfer_function(
        ServoPlantParams(numerator=(0.5, 2.0), denominator=(1.0, 3.0, 5.0), dead_time=0.1)
    )
    s = 1 - 2j
    assert at(plant.scaled(gain=1.3, time=0.7), s) == pytest.approx(1.3 * at(plant, 0.7 * s))
    A, B, C, D = plant.state_space()
    response = (C @ np.linalg.solve(s * np.eye(2) - A, B) + D)[0, 0]
    assert response * np.exp(-0.1 * s) == pytest.approx(at(plant, s))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"numerator": (1.0,)}, r"^denominator is None, allowed: numbers, as the other"),
        ({"denominator": (1.0, 1.0)}, r"^numerator is None"),
        (
            {"numerator": (1.0, 2.0), "denominator": (1.0, 1.0)},
            r"^denominator is \(1\.0, 1\.0\), allowed: more than 2 numbers",
        ),
        ({"numerator": (0.0, 1.0), "denominator": (1.0, 1.0, 1.0)}, r"^numerator is .*first of"),
        (
            {"numerator": (1.0,), "denominator": (1.0, 1.0), "mass": 2.0},
            r"^plant\.mass is 2\.0, allowed: 3\.0, nothing reads it",
        ),
        ({"measured": "a.csv", "dead_time": 0.1}, r"^plant\.dead_time is 0\.1, allowed: 0\.0"),
    ],
)
def test_what_nothing_would_read_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        ServoPlantParams(**settings)


@pytest.mark.parametrize(
    ("form", "numerator"), [("velocity", [1.0, 0.0]), ("position", [50.0]), ("compliance", [1.0])]
)
def test_has_the_transfer_function(form: Form, numerator: list[float]) -> None:
    params = SpringMassDamperParams(mass=2.0, damping=3.0, stiffness=50.0)
    frequencies = np.geomspace(1e-2, 1e4, 60)
    np.testing.assert_allclose(
        control.ss(*state_space(params, form))(1j * frequencies),
        control.tf(numerator, [2.0, 3.0, 50.0])(1j * frequencies),
        rtol=1e-9,
    )
