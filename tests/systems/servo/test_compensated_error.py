from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.systems.servo.compensated_error import (
    CompensatedErrors,
    Law,
    fsm_law,
    no_law,
    pid_law,
)
from chamfer.systems.servo.compensator import AxisParams
from chamfer.systems.servo.sampled_pid import PidGains
from chamfer.systems.servo.settling import SettlingPlant, guarantee

AXIS = AxisParams(dead_zone=2e-4, large_error=2e-3, increment=1e-4, limit=0.03)
PLANT = SettlingPlant(1.0, np.array([1.0, 1.0, 0.6, 0.2, -0.05]))


def run(
    law: Law,
    start: Sequence[float] | NDArray[np.float64],
    *,
    plants: Sequence[SettlingPlant] = (PLANT,),
    play: float = 0.0,
    place: float = 0.0,
    bias: float = 0.0,
    spread: float = 0.0,
    ticks: int = 400,
) -> CompensatedErrors:
    """Run one axis, or one a plant, from some starts."""
    of = np.atleast_2d(start)
    errors = CompensatedErrors(
        law,
        plants,
        of,
        play=np.full(len(of), play),
        place=np.full_like(of, place),
        period=0.0125,
        bias=np.full_like(of, bias),
        spread=np.full(len(of), spread),
        generator=np.random.default_rng(0),
    )
    errors.advance(ticks // 2)
    errors.advance(ticks - ticks // 2)
    return errors


def of_first(errors: CompensatedErrors) -> NDArray[np.float64]:
    return errors.true[:, 0, 0]


@pytest.mark.parametrize("place", [-1.0, 1.0])
def test_a_guaranteed_loop_rests_inside_its_dead_zone_from_every_start(place: float) -> None:
    axis = AxisParams(dead_zone=2e-4, large_error=2e-3, increment=3e-4, limit=0.03)
    assert guarantee(axis, PLANT, 0.0).everywhere
    starts = np.linspace(-0.02, 0.02, 41).tolist()
    errors = run(fsm_law([axis]), starts, play=5e-4, place=place, ticks=800)
    assert np.abs(errors.true[-1]).max() < axis.dead_zone
    assert np.array_equal(errors.true[-1], errors.true[-100])


def test_increments_arrive_as_late_as_the_plant_delivers_them() -> None:
    error = of_first(run(fsm_law([AXIS]), [0.01]))
    assert np.allclose(error[:3], 0.01)  # the first two samples after it have none of it
    assert error[3] == pytest.approx(0.01 - 0.4 * AXIS.increment)
    assert error[4] == pytest.approx(0.01 - (0.4 + 0.8) * AXIS.increment)


def test_a_play_takes_the_time_that_its_width_takes() -> None:
    far, near = (
        of_first(run(fsm_law([AXIS]), [1e-3], play=4e-4, place=place)) for place in (1.0, -1.0)
    )
    arrived = [int(np.argmax(error < AXIS.dead_zone)) for error in (far, near)]
    assert arrived[0] - arrived[1] == pytest.approx(8e-4 / (AXIS.increment / 5), abs=1)


def test_a_pid_leaves_the_bias_alone() -> None:
    law = pid_law([PidGains(proportional=0.1, integral=2.0)])
    errors = run(law, [5e-3], bias=3e-4, ticks=800)
    assert errors.true[-1, 0, 0] == pytest.approx(-3e-4, rel=1e-6)
    assert errors.measured[-1, 0, 0] == pytest.approx(0.0, abs=1e-9)


def test_a_limit_holds_the_compensation() -> None:
    gains = PidGains(proportional=0.1, integral=2.0, limit=0.03)
    for law in (fsm_law([AXIS]), pid_law([gains])):
        assert of_first(run(law, [0.05]))[-1] == pytest.approx(0.02, rel=0.02)


def test_noise_is_in_what_is_measured_alone() -> None:
    errors = run(no_law, [1e-3], spread=1e-4)
    assert np.all(errors.true == 1e-3)
    assert np.std(errors.measured - errors.true) == pytest.approx(1e-4, rel=0.2)


def test_axes_have_their_own_plants_and_laws() -> None:
    plants = [SettlingPlant(gain, np.array([1.0])) for gain in (1.0, 2.0)]
    other = AxisParams(dead_zone=2e-4, large_error=2e-3, increment=2e-4, limit=0.03)
    errors = run(fsm_law([AXIS, other]), np.full((2, 1), 0.01), plants=plants, ticks=3)
    assert np.allclose(errors.true[2, :, 0], [0.01 - 1e-4, 0.01 - 2 * 2e-4])
