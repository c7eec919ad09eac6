"""What may be set, what is refused, and what the blocks are told."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from diagrams.surface.surface_estimation import (
    EstimationScenario,
    LargeNoiseEstimationScenario,
    LeadSettings,
    NoiseFreeEstimationScenario,
    SmoothEstimationScenario,
    resolve_estimation,
)
from diagrams.surface.surface_scenario import (
    NoiseSettings,
    ObserverSettings,
    Shape,
    SurfaceScenario,
    SurfaceSettings,
    fill_in,
    require_whole,
)
from diagrams.surface.surface_tracking import (
    GainSettings,
    ManipulatorSettings,
    TrackingScenario,
    TrackingTask,
    resolve_tracking,
)
from models.smooth_surfaces import Circle, Parabola, Paraboloid, Sphere, Wave, WavySheet, normal
from models.surface_friction import SurfaceFriction
from models.validation import ParameterError

PLANAR: tuple[Shape, ...] = ("parabola", "wave", "circle")
SPATIAL: tuple[Shape, ...] = ("paraboloid", "wavy_sheet", "sphere")


@pytest.mark.parametrize("shape", [*PLANAR, *SPATIAL])
def test_every_shape_goes_through_the_origin(shape: Shape) -> None:
    settings = SurfaceSettings(shape=shape)
    d = 2 if shape in PLANAR else 3
    assert settings.dimension == settings.make().dimension == d
    origin = np.zeros(d)
    assert settings.make().level(origin) == pytest.approx(0, abs=1e-12)
    up = SurfaceScenario(surface=settings).up
    np.testing.assert_array_equal(up, [0.0] * (d - 1) + [1.0])
    tilted = shape in ("wave", "wavy_sheet")  # a sine is steepest at 0
    assert (normal(settings.make(), origin) @ up < 0.99) == tilted
    assert settings.make().level(0.1 * up) > 0 > settings.make().level(-0.1 * up)


def test_settings_arrive_in_the_surface() -> None:
    assert SurfaceSettings().make() == Parabola(coefficient=0.05)
    assert SurfaceSettings(coefficients=(0.2,)).make() == Parabola(coefficient=0.2)
    wave = SurfaceSettings(shape="wave", amplitudes=(0.1,), wavelengths=(3.0,))
    assert wave.make() == Wave(amplitude=0.1, wavelength=3.0)
    bowl = SurfaceSettings(shape="circle", radius=4.0)
    assert bowl.make() == Circle(centre=(0.0, 4.0), radius=4.0, inside=True)
    ball = SurfaceSettings(shape="sphere", radius=4.0, inside=False)
    assert ball.make() == Sphere(centre=(0.0, 0.0, -4.0), radius=4.0, inside=False)
    sheet = SurfaceSettings(shape="wavy_sheet", amplitudes=(0.1, 0.2), wavelengths=(3.0, 4.0))
    assert sheet.make() == WavySheet(amplitudes=(0.1, 0.2), wavelengths=(3.0, 4.0))
    paraboloid = SurfaceSettings(shape="paraboloid", coefficients=(0.1, 0.2))
    assert paraboloid.make() == Paraboloid(coefficients=(0.1, 0.2))


@pytest.mark.parametrize("shape", [*PLANAR, *SPATIAL])
def test_what_is_resolved_makes_the_same_surface(shape: Shape) -> None:
    settings = SurfaceSettings(shape=shape)
    resolved = settings.resolved()
    assert resolved.make() == settings.make()
    assert resolved.resolved() == resolved
    set_now = {name for name, value in vars(resolved).items() if value is not None}
    assert (
        set_now - {"shape"}
        == {
            "parabola": {"coefficients"},
            "wave": {"amplitudes", "wavelengths"},
            "circle": {"radius", "inside"},
            "paraboloid": {"coefficients"},
            "wavy_sheet": {"amplitudes", "wavelengths"},
            "sphere": {"radius", "inside"},
        }[shape]
    )


def test_what_is_given_stays_when_the_rest_is_resolved() -> None:
    resolved = SurfaceSettings(shape="circle", inside=False).resolved()
    assert (resolved.radius, resolved.inside) == (2.0, False)


def test_the_observer_is_told_what_the_sensor_has_unless_it_is_told_otherwise() -> None:
    noise = NoiseSettings(force=2.0, force_rate=7.0)
    scenario = SurfaceScenario(noise=noise)
    assert (scenario.estimation.force_noise, scenario.estimation.force_rate_noise) == (2.0, 7.0)
    told = SurfaceScenario(noise=noise, observer=ObserverSettings(force_noise=0.0))
    assert (told.estimation.force_noise, told.estimation.force_rate_noise) == (0.0, 7.0)
    told = SurfaceScenario(noise=noise, observer=ObserverSettings(force_rate_noise=0.0))
    assert (told.estimation.force_noise, told.estimation.force_rate_noise) == (2.0, 0.0)
    for observer in (ObserverSettings(), told.observer):
        filled = fill_in(observer, noise)
        assert replace(scenario, observer=filled).estimation == (
            replace(scenario, observer=observer).estimation
        )
        assert None not in (filled.force_noise, filled.force_rate_noise)


def test_every_setting_of_the_observer_arrives() -> None:
    given = ObserverSettings(
        kind="gated", smallest_radius=3.0, initial_deviation=0.2, halt_speed=0.01, period=0.1
    )
    told = SurfaceScenario(observer=given, stiffness=50.0, surface=SurfaceSettings(shape="sphere"))
    assert told.estimation.kind == "gated"
    assert told.estimation.smallest_radius == 3.0
    assert told.estimation.initial_deviation == 0.2
    assert told.estimation.halt_speed == 0.01
    assert told.estimation.period == 0.1
    np.testing.assert_array_equal(told.estimation.stiffness, 50.0 * np.eye(3))


def test_a_prediction_is_resolved_too() -> None:
    seen = ObserverSettings(prediction=SurfaceSettings(shape="wave"))
    (prediction,) = [resolve_estimation(EstimationScenario(observer=seen)).observer.prediction]
    assert prediction == SurfaceSettings(shape="wave", amplitudes=(0.05,), wavelengths=(2.0,))
    assert fill_in(ObserverSettings(), NoiseSettings()).prediction is None


def test_the_scenarios_of_the_figures() -> None:
    fig_3, fig_4 = EstimationScenario(), SmoothEstimationScenario()
    fig_5, fig_6 = NoiseFreeEstimationScenario(), LargeNoiseEstimationScenario()
    for scenario in (fig_3, fig_4, fig_5, fig_6):
        assert scenario.surface.make() == Parabola(coefficient=0.05)
        assert scenario.friction == SurfaceFriction(coefficient=1.0)
        assert scenario.lead == LeadSettings(depth=0.1, speed=0.2, halt=15.0)
        assert (scenario.stiffness, scenario.observer.kind) == (100.0, "thesis")
    assert [s.observer.smallest_radius for s in (fig_3, fig_4, fig_5, fig_6)] == [
        0.75,
        10.0,
        0.75,
        0.75,
    ]
    assert fig_3.noise == fig_4.noise == fig_6.noise == NoiseSettings(force=1.0, force_rate=5.0)
    assert fig_5.noise == NoiseSettings(force=0.0, force_rate=0.0)
    assert (fig_6.estimation.force_noise, fig_6.estimation.force_rate_noise) == (1000.0, 5000.0)


def wrong_surface(**values: Any) -> Any:
    return lambda: SurfaceSettings(**values)


def wrong(**values: Any) -> Any:
    return lambda: SurfaceScenario(**values)


def wrong_lead(**values: Any) -> Any:
    return lambda: resolve_estimation(EstimationScenario(**values))


def wrong_track(**values: Any) -> Any:
    return lambda: resolve_tracking(TrackingScenario(**values))


BALL = SurfaceSettings(shape="circle", radius=0.04, inside=False)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (wrong_surface(shape="cube"), "shape is 'cube', allowed: parabola, wave, circle, "),
        (wrong_surface(radius=1.0), "radius is 1.0, allowed: none, for the shape parabola"),
        (wrong_surface(inside=False), "inside is False, allowed: none, for the shape parabola"),
        (
            wrong_surface(shape="circle", coefficients=(1.0,)),
            "coefficients is (1.0,), allowed: none, for the shape circle",
        ),
        (
            wrong_surface(coefficients=(1.0, 2.0)),
            "coefficients is (1.0, 2.0), allowed: 1 for the shape parabola",
        ),
        (
            wrong_surface(shape="wavy_sheet", wavelengths=(1.0,)),
            "wavelengths is (1.0,), allowed: 2 for the shape wavy_sheet",
        ),
        (
            lambda: SurfaceSettings(shape="sphere", radius=0.0).make(),
            "radius is 0.0, allowed: a finite number > 0",
        ),
        (
            lambda: NoiseSettings(force=-1.0),
            "force is -1.0, allowed: a finite number >= 0",
        ),
        (
            lambda: NoiseSettings(force_rate=float("nan")),
            "force_rate is nan, allowed: a finite number >= 0",
        ),
        (
            lambda: ObserverSettings(period=float("nan")),
            "period is nan, allowed: a finite number > 0",
        ),
        (wrong(stiffness=0.0), "stiffness is 0.0, allowed: a finite number > 0"),
        (wrong(duration=float("inf")), "duration is inf, allowed: a finite number > 0"),
        (wrong(step=-0.01), "step is -0.01, allowed: a finite number > 0"),
        (wrong(trials=0), "trials is 0, allowed: 1 to 1000"),
        (wrong(trials=1001), "trials is 1001, allowed: 1 to 1000"),
        (wrong(step=0.03), "step is 0.03, allowed: a whole part of 0.05 s"),
        (wrong(step=0.1), "step is 0.1, allowed: a whole part of 0.05 s"),
        (wrong(step=1e-320), "step is 1e-320, allowed: a whole part of 0.05 s"),
        (wrong(duration=0.4999), "duration is 0.4999, allowed: at least ten periods of 0.05 s"),
        (
            wrong(observer=ObserverSettings(prediction=SurfaceSettings(shape="sphere"))),
            "observer.prediction.shape is 'sphere', allowed: a shape with 2 dimensions, "
            "as the surface has",
        ),
        (
            wrong_lead(
                observer=ObserverSettings(prediction=SurfaceSettings(shape="circle", radius=-1.0))
            ),
            "radius is -1.0, allowed: a finite number > 0",
        ),
        (
            wrong_lead(lead=LeadSettings(sideways=0.1)),
            "lead.sideways is 0.1, allowed: 0 in the plane",
        ),
        (
            wrong_lead(surface=SurfaceSettings(shape="circle", radius=-1.0)),
            "radius is -1.0, allowed: a finite number > 0",
        ),
        (
            wrong_lead(observer=ObserverSettings(smallest_radius=0.0)),
            "smallest_radius is 0.0, allowed: a finite number > 0",
        ),
        (
            lambda: LeadSettings(speed=0.0),
            "speed is 0.0, allowed: a finite number other than 0",
        ),
        (
            lambda: LeadSettings(speed=float("-inf")),
            "speed is -inf, allowed: a finite number other than 0",
        ),
        (lambda: LeadSettings(depth=-0.1), "depth is -0.1, allowed: a finite number >= 0"),
        (lambda: LeadSettings(halt=0.0), "halt is 0.0, allowed: a finite number > 0"),
        (
            lambda: LeadSettings(sideways=float("nan")),
            "sideways is nan, allowed: a finite number",
        ),
        (wrong_track(surface=BALL), "task.depth is 0.1, allowed: a start below the surface"),
        (
            wrong_track(controller=GainSettings(period=0.006)),
            "step is 0.0025, allowed: a whole part of 0.006 s",
        ),
        (
            wrong_track(controller=GainSettings(period=0.02)),
            "controller.period is 0.02, allowed: a whole part of 0.05 s",
        ),
        (
            lambda: GainSettings(period=0.0),
            "period is 0.0, allowed: a finite number > 0",
        ),
        (
            wrong_track(controller=GainSettings(stiffness=-1.0)),
            "stiffness is (-1.0, -1.0), allowed: 2 finite numbers >= 0",
        ),
        (
            wrong_track(task=TrackingTask(speed=float("nan"))),
            "speed is nan, allowed: a finite number",
        ),
        (lambda: TrackingTask(force=0.0), "force is 0.0, allowed: a finite number > 0"),
        (lambda: TrackingTask(depth=-0.1), "depth is -0.1, allowed: a finite number >= 0"),
        (lambda: ManipulatorSettings(mass=0.0), "mass is 0.0, allowed: a finite number > 0"),
        (
            lambda: ManipulatorSettings(damping=-1.0),
            "damping is -1.0, allowed: a finite number >= 0",
        ),
    ],
)
def test_mistakes_are_named_with_what_is_allowed(make: Any, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        make()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_the_limits_themselves_are_allowed() -> None:
    SurfaceScenario(trials=1000, duration=0.5, step=0.05)
    resolve_tracking(TrackingScenario(task=TrackingTask(depth=0.0)))
    resolve_tracking(TrackingScenario(surface=replace(BALL, radius=0.051)))
    resolve_estimation(
        EstimationScenario(
            surface=SurfaceSettings(shape="sphere"), lead=LeadSettings(sideways=-0.1)
        )
    )


def test_whole_parts_are_told_from_others_in_spite_of_rounding() -> None:
    for count in (1, 3, 7, 20, 4000):
        require_whole(0.05, 0.05 / count, "step")
        require_whole(1 / 3, 1 / 3 / count, "step")
    for step in (0.05 / 2.5, 0.05 * (1 + 1e-6), 0.0499, 0.2):
        with pytest.raises(ParameterError, match=r"^x is .*, allowed: a whole part of 0\.05 s$"):
            require_whole(0.05, step, "x")
