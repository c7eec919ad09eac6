from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from chamfer.models.plants.measured_step import (
    IdentifiedPlant,
    MeasuredStep,
    identify,
    read_step,
    unit_response,
)
from chamfer.models.validation import ParameterError

TIME = np.arange(-0.2, 2.0, 0.01)


def measured(
    gain: float, lag: float, ratio: float, dead: float, *, noise: float = 0.0, seed: int = 0
) -> MeasuredStep:
    position = 0.3 + 0.02 * gain * unit_response(TIME - dead, lag, ratio)
    position += noise * np.random.default_rng(seed).standard_normal(len(TIME))
    return MeasuredStep(TIME, position, 0.02)


@pytest.mark.parametrize("ratio", [1e-3, 0.15, 0.25, 0.8, 4.0])
def test_the_response_solves_its_equation(ratio: float) -> None:
    lag, step = 0.2, 1e-4
    time = np.arange(0.0, 0.5, step)
    y = unit_response(time, lag, ratio)
    rate = np.gradient(y, step)
    left = ratio * lag**2 * np.gradient(rate, step) + lag * rate + y
    settled = time > 0.01
    assert left[settled][:-5] == pytest.approx(1.0, abs=2e-3)
    assert y[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("lag", "ratio", "dead"), [(0.15, 0.01, 0.0), (0.12, 0.25, 0.05), (0.08, 0.9, 0.03)]
)
def test_the_plant_is_found_without_noise(lag: float, ratio: float, dead: float) -> None:
    found = identify(measured(1.3, lag, ratio, dead))
    assert found.gain == pytest.approx(1.3, rel=1e-6)
    assert found.lag == pytest.approx(lag, rel=1e-3)
    assert found.dead_time == pytest.approx(dead, abs=1e-3 * lag)
    assert found.ratio == pytest.approx(ratio, rel=0.05)


def test_the_uncertainty_is_that_of_repeated_measurements() -> None:
    true = (1.3, 0.12, 0.4, 0.05)
    found = [identify(measured(*true, noise=4e-4, seed=seed)) for seed in range(8)]
    values = np.array([(one.gain, one.lag, one.ratio, one.dead_time) for one in found])
    deviations = np.array([one.deviations for one in found])
    off = (values - true) / deviations
    assert np.abs(off).max() < 4.5
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.6


def test_a_drawn_plant_is_as_far_off_as_the_uncertainty_says() -> None:
    found = identify(measured(1.3, 0.12, 0.4, 0.05, noise=4e-4))
    generator = np.random.default_rng(1)
    gains = [found.drawn(generator).gain for _ in range(200)]
    assert np.mean(gains) == pytest.approx(found.gain, abs=4 * found.deviations[0] / 14)
    assert np.std(gains) == pytest.approx(found.deviations[0], rel=0.25)
    # Little as is known of it, it has a gain, lags and no lead.
    unknown = replace(found, covariance=tuple(100 * np.eye(4).ravel()))
    drawn = [unknown.drawn(generator) for _ in range(20)]
    least = [min(getattr(one, name) for one in drawn) for name in ("gain", "lag", "ratio")]
    assert least == pytest.approx([0.1 * found.gain, 0.1 * found.lag, 1e-4])
    assert min(one.dead_time for one in drawn) == 0.0


def test_what_is_no_lag_is_refused() -> None:
    wild = MeasuredStep(TIME, np.where(TIME > 0, np.sin(9 * TIME) + 0.5 * TIME, 0.0), 0.02)
    for scale in (1e-3, 1.0):  # whatever the unit of the position
        scaled = wild._replace(position=scale * wild.position)
        with pytest.raises(ParameterError, match=r"^measured is 'its position', allowed: a step "):
            identify(scaled)
    with pytest.raises(ParameterError, match=r"^measured is -1\..*follows its command"):
        identify(measured(-1.3, 0.1, 0.2, 0.0))


def write(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join(["time, command, position", *rows]))
    return path


def test_a_file_is_read_from_the_commands_change_on(tmp_path: Path) -> None:
    rows = [f"{0.1 * i}, {0.5 + 0.02 * (i >= 10)}, {i}" for i in range(40)]
    step = read_step(write(tmp_path / "step.csv", rows))
    assert step.time[10] == 0.0
    assert step.time[0] == pytest.approx(-1.0)
    assert step.change == pytest.approx(0.02)
    assert step.position[-1] == 39


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([f"{i}, 0, 0" for i in range(40)], "command changes once, it does 0 times"),
        ([f"{i}, {i % 2}, 0" for i in range(40)], "command changes once, it does 39 times"),
        ([f"{i}, {i > 30}, 0" for i in range(40)], "columns time, command, position"),
        ([f"{i}, {int(i > 30)}, 0" for i in range(40)], "20 rows and more after"),
        ([f"{-i}, {int(i > 3)}, 0" for i in range(40)], "time increases"),
        ([f"{i}, {int(i > 3)}, nan" for i in range(40)], "finite numbers"),
        ([f"{i}, {int(i > 3)}" for i in range(40)], "columns time, command, position"),
        (["1, 2, 3"], "20 rows or more"),
    ],
)
def test_a_file_that_is_no_step_is_refused(tmp_path: Path, rows: list[str], message: str) -> None:
    with pytest.raises(ParameterError, match=rf"^measured is .*, allowed: .*{message}"):
        read_step(write(tmp_path / "step.csv", rows))


def test_an_identified_plant_needs_its_covariance() -> None:
    with pytest.raises(ParameterError, match=r"^covariance is \(1\.0,\), allowed: 16 finite"):
        IdentifiedPlant(gain=1.0, lag=0.1, ratio=0.2, dead_time=0.0, covariance=(1.0,))
