import numpy as np
import pytest

from systems.servo.compensated_error import compensated_error, fsm_law, pid_law
from systems.servo.compensator import AxisParams
from systems.servo.sampled_pid import PidGains
from systems.servo.settling import SettlingPlant, guarantee

PERIOD = 0.0125
AXIS = AxisParams(dead_zone=2e-4, large_error=2e-3, increment=1e-4, limit=0.03)
PLANT = SettlingPlant(1.0, np.array([1.0, 1.0, 0.6, 0.2, -0.05]))


def run(start: list[float], *, play: float = 0.0, place: float = 0.0, ticks: int = 400):
    return compensated_error(
        fsm_law(AXIS),
        PLANT,
        np.array(start),
        play=play,
        place=np.full(len(start), place),
        period=PERIOD,
        ticks=ticks,
    )


def test_a_guaranteed_loop_rests_inside_its_dead_zone_from_every_start() -> None:
    axis = AxisParams(dead_zone=2e-4, large_error=2e-3, increment=3e-4, limit=0.03)
    assert guarantee(axis, PLANT, 0.0).everywhere
    found = compensated_error(
        fsm_law(axis),
        PLANT,
        np.linspace(-0.02, 0.02, 41),
        play=5e-4,
        place=np.tile([-1.0, 1.0], 21)[:41],
        period=PERIOD,
        ticks=800,
    )
    assert np.abs(found.true[-1]).max() < axis.dead_zone


def test_increments_arrive_as_late_as_the_plant_delivers_them() -> None:
    error = run([0.01]).true[:, 0]
    assert np.allclose(error[:3], 0.01)  # the first two samples after it have none of it
    assert error[3] == pytest.approx(0.01 - 0.4 * AXIS.increment)
    assert error[4] == pytest.approx(0.01 - (0.4 + 0.8) * AXIS.increment)


def test_a_play_takes_the_time_that_its_width_takes() -> None:
    near, far = (run([1e-3], play=4e-4, place=place).true[:, 0] for place in (1.0, -1.0))
    arrived = [int(np.argmax(error < AXIS.dead_zone)) for error in (near, far)]
    assert arrived[0] - arrived[1] == pytest.approx(8e-4 / AXIS.small_increment, abs=1)


def test_a_bias_is_left() -> None:
    found = compensated_error(
        pid_law(PidGains(proportional=0.1, integral=2.0)),
        PLANT,
        np.array([5e-3]),
        play=0.0,
        place=np.zeros(1),
        period=PERIOD,
        ticks=800,
        bias=3e-4,
    )
    assert found.true[-1, 0] == pytest.approx(-3e-4, rel=1e-6)
    assert found.measured[-1, 0] == pytest.approx(0.0, abs=1e-9)


def test_a_limit_holds_the_compensation() -> None:
    error = run([0.05], ticks=800).true[-1, 0]
    assert error == pytest.approx(0.05 - AXIS.limit)
