"""What is predicted of the force, against simulated runs, and when it is warned of."""

import re
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.analysis.surface.force_prediction import force_error, warn_of_force
from chamfer.analysis.surface.unknown_surface import run_surface
from chamfer.diagrams.surface.surface_tracking import (
    SURFACE_CONTROL,
    SURFACE_CONTROL_ADAPTIVE,
    SURFACE_CONTROL_NOISE_FREE,
    ResolvedTrackingScenario,
    TrackingScenario,
    resolve_tracking,
)

WAVE = ("surface.shape=wave", "surface.amplitudes=[0.05]", "surface.wavelengths=[1.4]")
STIFF = ("gripper.stiffness=1000", "task.depth=0.005")


def scenario(
    *settings: str, default: TrackingScenario = SURFACE_CONTROL_ADAPTIVE
) -> ResolvedTrackingScenario:
    latest = dict(setting.split("=", 1) for setting in ("duration=5.0", *settings))
    text = [f"{name}={value}" for name, value in latest.items()]
    return resolve_tracking(make_scenario(default, settings=text))


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        (),
        WAVE,
        (*WAVE, *STIFF, "controller.force_integral=6.5"),
        ("surface.shape=sphere", "friction.coefficient=0.5", "sensor.bias=[0.0, 0.0, 0.2]"),
        ("force_delay=0.02", "observer.model_error.delay=0.02", "force_rate={}"),
    ],
)
def test_the_force_is_off_as_predicted(settings: tuple[str, ...]) -> None:
    asked = scenario(*settings)
    largest = []
    for seed in range(2):
        traces = run_surface(asked, seed)
        off = 100 * np.abs(traces["force"] / asked.task.force - 1)
        largest.append(off[traces["time"] > 1.0].max())
    # Of what 95 % stay within the mean is some three quarters.
    assert 0.7 * np.mean(largest) < force_error(asked).likely < 1.7 * np.mean(largest)


def test_without_noise_what_is_left_is_the_turning(value: Any) -> None:
    quiet = scenario(*WAVE, default=SURFACE_CONTROL_NOISE_FREE)
    found = force_error(quiet)
    assert found.likely == pytest.approx(found.turning)
    # The normal of y = A sin(2 pi x / L) turns fastest on a crest, by A (2 pi / L)^2 V.
    assert found.turns == pytest.approx(0.05 * (2 * np.pi / 1.4) ** 2 * 0.5, rel=0.02)
    # It is held over a period, in which it turns by up to 1.4 degrees.
    assert 0.2 < np.degrees(found.estimate) < 1.4


@pytest.mark.parametrize(
    ("settings", "remedy"),
    [
        ((), None),
        ((*WAVE, *STIFF, "controller.force_integral=3.0"), None),
        (("task.speed=0",), None),
        ((*WAVE, *STIFF, "task.speed=0.6"), r"% with task\.speed=0\.3"),
        (WAVE, "% with .*gripper.stiffness=1000"),
    ],
)
def test_a_warning_comes_where_the_force_will_not_hold(
    settings: tuple[str, ...], remedy: str | None
) -> None:
    asked = scenario(*settings)
    if remedy is None:
        with warnings.catch_warnings(action="error"):
            warn_of_force(asked)
        return
    with pytest.warns(UserWarning, match=remedy) as caught:
        warn_of_force(asked)
    change = re.findall(r"\S+=\S+", str(caught[0].message).split(" with ")[1])
    with warnings.catch_warnings(action="error"):
        warn_of_force(scenario(*settings, *change))


def test_the_thesis_own_run_is_warned_of() -> None:
    with pytest.warns(UserWarning, match=r"observer\.kind=thesis.*with observer\.kind=adaptive"):
        warn_of_force(resolve_tracking(replace(SURFACE_CONTROL, trials=1)))
