"""Whatever is asked for, in whatever words: a result or one line, and soon."""

import pytest

from analysis.run.errors import UserError
from analysis.run.registry import find, select
from analysis.run.running import prepare


@pytest.mark.parametrize(
    ("name", "setting", "message"),
    [
        (
            "alignment",
            "compensation_time=1e9",
            "compensation_time is 1000000000.0, allowed: a finite number > 0 and <= 3600",
        ),
        (
            "alignment",
            "cameras.frames.period=1e-9",
            "cameras.frames.period is 1e-09, allowed: a number from 0.0001 to 1000",
        ),
        (
            "step-response",
            "camera.latency=1e9",
            "camera.latency is 1000000000.0, allowed: at most 125 s, 10000 periods of 0.0125 s",
        ),
        (
            "step-response",
            "plant.mass=1e-308",
            "plant.mass is 1e-308, allowed: at least what damping and stiffness can be divided by",
        ),
    ],
)
def test_numbers_beyond_what_can_be_computed_are_named(
    name: str, setting: str, message: str
) -> None:
    with pytest.raises(UserError) as raised:
        prepare(select(find(), [name]), settings=[setting])
    assert str(raised.value) == message
