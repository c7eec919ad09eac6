"""The loop with machine code between the observer's samples, against its diagram."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.surface.unknown_surface import run_surface
from chamfer.diagrams.surface.compiled_surface_loop import run_compiled
from chamfer.diagrams.surface.surface_scenario import ObserverSettings, SurfaceSettings
from chamfer.diagrams.surface.surface_tracking import (
    ResolvedTrackingScenario,
    TrackingScenario,
    TrackingTask,
    make_tracking_diagram,
    resolve_tracking,
)
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.normal_filter import KINDS
from chamfer.systems.recording import Recorder, recording
from chamfer.systems.sensing.force_rate import ForceRateParams, ForceRateSensorParams

SHAPES = ("parabola", "wave", "circle", "profile", "paraboloid", "wavy_sheet", "sphere")


def drawn(number: int) -> ResolvedTrackingScenario:
    """Return a scenario, with every kind of surface and observer in turn."""
    random = np.random.default_rng(number)
    surface = SurfaceSettings(shape=SHAPES[number % len(SHAPES)])
    differenced = random.random() < 0.4
    sensor = ForceRateSensorParams(
        force_noise=random.uniform(0.2, 1.0),
        force_rate_noise=0.0 if differenced else random.uniform(0.0, 5.0),
        bias=tuple(random.uniform(-0.2, 0.2, surface.dimension)),
    )
    observer = ObserverSettings(
        kind=KINDS[number % len(KINDS)],
        average=int(random.integers(1, 11)),
        prediction=surface if random.random() < 0.3 else None,
    )
    scenario = TrackingScenario(
        surface=surface,
        friction=SurfaceFriction(coefficient=random.uniform(0.3, 1.0), ripple=0.2),
        task=TrackingTask(speed=random.uniform(-0.6, 0.6), acceleration=0.5),
        sensor=sensor,
        force_rate=ForceRateParams(time_constant=0.05) if differenced else None,
        force_delay=0.005 * float(random.integers(3)),
        observer=observer,
        step=random.choice([0.0025, 0.001, 0.005]),
    )
    return resolve_tracking(scenario)


@pytest.mark.parametrize("number", range(12))
def test_the_loop_does_what_its_diagram_does(number: int) -> None:
    scenario, samples = drawn(number), 300
    period = scenario.controller.period
    diagram = make_tracking_diagram(scenario)
    outputs = simulate(diagram, duration=samples * period, step=period, seed=number).outputs
    found = run_compiled(scenario, samples, number)
    assert found is not None
    assert found.keys() == outputs.keys()
    for name, values in outputs.items():
        np.testing.assert_allclose(found[name], values, atol=1e-9, rtol=1e-9, err_msg=name)
    with recording(Recorder()):
        assert run_compiled(scenario, samples, number) is None


def test_the_diagram_tells_why_a_run_ends_early() -> None:
    wild = replace(TrackingScenario.controller, force_integral=400.0, allow_unstable=True)
    with pytest.warns(match="unstable"):
        scenario = resolve_tracking(TrackingScenario(controller=wild))
    assert run_compiled(scenario, 2000, 0) is None
    with pytest.raises(ParameterError, match=r"^p is .* nearer to the surface"):
        run_surface(scenario, 0)
