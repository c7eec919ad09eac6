"""The linear loop along a surface against runs of the loop on a flat one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.surface.surface_scenario import SurfaceSettings
from chamfer.diagrams.surface.surface_tracking import (
    NoiseFreeTrackingScenario,
    TrackingScenario,
    make_tracking_diagram,
    resolve_tracking,
    tracking_loop,
    tracking_stability,
)
from chamfer.models.validation import ParameterError


def flat(force_integral: float, *, allow: bool = False) -> TrackingScenario:
    scenario = NoiseFreeTrackingScenario(
        duration=3.0, surface=SurfaceSettings(coefficients=(1e-6,))
    )
    control = replace(scenario.controller, force_integral=force_integral, allow_unstable=allow)
    return replace(scenario, controller=control)


@pytest.mark.parametrize(("force_integral", "late"), [(10.0, 0.0), (20.0, 0.0), (10.0, 0.04)])
def test_the_force_swings_as_the_poles_say(force_integral: float, late: float) -> None:
    scenario = replace(flat(force_integral, allow=True), force_delay=late)
    period = scenario.controller.period
    poles = np.linalg.eigvals(tracking_loop(scenario).period_map())
    rate = max(math.log(abs(pole)) for pole in poles if abs(pole.imag) > 1e-6) / period
    run = simulate(make_tracking_diagram(scenario), duration=2.0, step=period, seed=0)
    off = np.abs(run.outputs["contact_force"][:, 1] - scenario.task.force)
    early, late = (off[(run.time >= t) & (run.time < t + 0.5)].max() for t in (0.5, 1.5))
    assert math.log(late / early) == pytest.approx(rate, abs=0.25)


def test_a_force_integral_that_swings_is_refused() -> None:
    message = (
        r"controller\.force_integral is 50\.0, allowed: a lower one, or other gains: "
        r"the loop is unstable in contact, it grows at 3\.\d* 1/s"
    )
    with pytest.raises(ParameterError, match=message):
        resolve_tracking(flat(50.0))
    with pytest.warns(UserWarning, match="unstable in contact"):
        resolve_tracking(flat(50.0, allow=True))


def test_a_soft_loop_bears_many_times_its_torque() -> None:
    # Routh: a mass m with damping b on a spring bears a force integral up to b / m, here 20 / s.
    found = tracking_stability(flat(1.0))
    assert found.growth is None
    assert found.growth_contact == pytest.approx(0.0, abs=1e-6)
    assert found.gain_margin == pytest.approx(20.0, rel=0.05)
