"""A six-axis sensor, read as the wrench on the tool's tip."""

from typing import Any

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_sensor import ForceSensor, WrenchSensorParams

NOTHING: dict[str, Any] = dict.fromkeys(
    ("noise", "bias", "drift", "bandwidth", "delay", "resolution", "full_scale", "tare"), 0.0
)
COUPLED = tuple(map(tuple, (np.eye(6) + 0.01 * np.arange(36).reshape(6, 6)).tolist()))
NONE = tuple(map(tuple, np.eye(6).tolist()))
WRENCH = np.array([0.1, -0.2, 0.3, 4.0, 5.0, -6.0])  # N m above N


def read(params: WrenchSensorParams, wrench: Any = WRENCH) -> Any:
    """What the computer makes of a wrench on the tip."""
    sensor = ForceSensor(params, params.gauges, step=0.001, period=0.01)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("tool_force").FixValue(context, wrench)
    return params.undoing @ sensor.GetOutputPort("reading").Eval(context)


def make(**fields: Any) -> WrenchSensorParams:
    return WrenchSensorParams(**{**NOTHING, "cross_talk": NONE, "position": (0.0,) * 3, **fields})


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (0.01, -0.02, 0.1)])
def test_an_ideal_sensor_reads_the_wrench_at_the_tip(position: Any) -> None:
    np.testing.assert_allclose(read(make(position=position)), WRENCH, atol=1e-12)
    decoupled = make(position=position, cross_talk=COUPLED, decoupling=True)
    np.testing.assert_allclose(read(decoupled), WRENCH, atol=1e-12)


def test_a_sensor_feels_moments_about_its_own_origin() -> None:
    p = np.array([0.01, -0.02, 0.1])
    felt = -make(position=tuple(p)).gauges.pick_up @ WRENCH
    np.testing.assert_allclose(felt[:3], WRENCH[3:])
    np.testing.assert_allclose(felt[3:], WRENCH[:3] - np.cross(p, WRENCH[3:]))
    # So a force's bias is a moment at the tip.
    off = read(make(position=tuple(p), bias=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0))) - WRENCH
    np.testing.assert_allclose(off, [*np.cross(p, [1.0, 2.0, 3.0]), 1.0, 2.0, 3.0], atol=1e-12)


def test_forces_leak_into_each_other() -> None:
    channels = np.array(COUPLED) @ np.roll(WRENCH, 3)
    np.testing.assert_allclose(read(make(cross_talk=COUPLED)), np.roll(channels, -3))


def test_a_bias_is_that_of_every_force_or_of_each_channel() -> None:
    alike = read(make(bias=0.5, radius=0.02)) - WRENCH
    np.testing.assert_allclose(alike, [0.01] * 3 + [0.5] * 3)
    with pytest.raises(
        ParameterError, match=r"^bias is \(1\.0, 2\.0\), allowed: one number, or 6$"
    ):
        read(make(bias=(1.0, 2.0)))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"cross_talk": ((1.0,) * 6,) * 6}, "allowed: a regular 6 x 6 matrix"),
        ({"cross_talk": ((1.0, 0.0),) * 2}, "allowed: a regular 6 x 6 matrix"),
        ({"position": (0.0, 0.0, np.inf)}, "allowed: three finite numbers"),
        ({"tare": 0.1}, "allowed: 0: the skill takes the zero"),
        ({"radius": 0.0}, "allowed: a finite number > 0"),
        ({"bias": (np.nan,) * 6}, "allowed: finite numbers"),
    ],
)
def test_refuses(fields: Any, message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        make(**fields)
    (name,) = fields
    assert str(refused.value).startswith(f"{name} is ")
    assert str(refused.value).endswith(message)
