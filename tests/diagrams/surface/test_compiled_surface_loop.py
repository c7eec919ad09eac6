"""The loops with machine code between the observer's samples, against their diagrams."""

from typing import Any

import numpy as np
import pytest

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.surface.unknown_surface import run_surface
from chamfer.diagrams.surface.compiled_surface_loop import run_compiled
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    LeadSettings,
    make_estimation_diagram,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import ObserverSettings, SurfaceSettings
from chamfer.diagrams.surface.surface_tracking import (
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


def drawn(number: int, *, tracks: bool) -> dict[str, Any]:
    """Return what a scenario is like, of every kind of surface and observer in turn."""
    random = np.random.default_rng(number)
    shape, kind = SHAPES[number % len(SHAPES)], KINDS[number % len(KINDS)]
    sheet = SurfaceSettings(shape=shape)
    differenced = random.random() < 0.4
    sensor = ForceRateSensorParams(
        force_noise=random.uniform(0.2, 1.0),
        force_rate_noise=0.0 if differenced else random.uniform(0.0, 5.0),
        bias=tuple(random.uniform(-0.2, 0.2, sheet.dimension)),
    )
    return {
        "surface": sheet,
        "friction": SurfaceFriction(coefficient=random.uniform(0.3, 1.0), ripple=0.2),
        "sensor": sensor,
        "force_rate": ForceRateParams(time_constant=0.05) if differenced else None,
        "force_delay": float(random.integers(3)) * (0.005 if tracks else 0.05),
        "observer": ObserverSettings(
            kind=kind,
            average=int(random.integers(1, 11)) if tracks else 1,
            prediction=sheet if random.random() < 0.3 else None,
        ),
        "duration": 1.5 if tracks else 4.0,
        "step": random.choice([0.0025, 0.001, 0.005]) if tracks else 0.01,
    }


@pytest.mark.parametrize("number", range(12))
def test_loops_do_what_their_diagrams_do(number: int) -> None:
    speed, deep = 0.3 + 0.02 * number, 0.1
    tracking = resolve_tracking(
        TrackingScenario(
            task=TrackingTask(speed=speed, acceleration=0.5), **drawn(number, tracks=True)
        )
    )
    lead = LeadSettings(
        depth=deep, speed=speed, halt=3.0, hover=0.3 * (number % 2), press=0.6 * (number % 2)
    )
    estimation = resolve_estimation(EstimationScenario(lead=lead, **drawn(number, tracks=False)))
    for scenario, diagram in (
        (tracking, make_tracking_diagram(tracking)),
        (estimation, make_estimation_diagram(estimation)),
    ):
        period = scenario.sensor_period
        samples = round(scenario.duration / period)
        run = simulate(diagram, duration=samples * period, step=period, seed=number)
        found = run_compiled(scenario, samples, number)
        assert found is not None
        assert found.keys() == run.outputs.keys()
        for name, values in run.outputs.items():
            np.testing.assert_allclose(found[name], values, atol=1e-9, rtol=1e-9, err_msg=name)


def test_the_diagram_records_and_tells_why_it_cannot_go_on() -> None:
    lead = LeadSettings(depth=2.0, speed=0.1, halt=1.0)
    circle = SurfaceSettings(shape="circle", radius=2.0, inside=False)
    scenario = resolve_estimation(EstimationScenario(lead=lead, surface=circle, duration=1.0))
    assert run_compiled(scenario, 20, 0) is None
    with pytest.raises(ParameterError, match=r"^p is .* nearer to the surface than its radius"):
        run_surface(scenario, 0)
    with recording(Recorder()):
        assert run_compiled(resolve_tracking(TrackingScenario()), 20, 0) is None
