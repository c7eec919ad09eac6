"""What may be set, what is refused, and what the blocks are told."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    LeadSettings,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import (
    THESIS,
    ObserverSettings,
    SurfaceScenario,
    SurfaceSettings,
    SurfaceShape,
    require_whole,
)
from chamfer.diagrams.surface.surface_tracking import (
    TrackingScenario,
    resolve_tracking,
)
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import normal
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.model_error import ModelErrorParams
from chamfer.systems.sensing.force_rate import ForceRateParams, ForceRateSensorParams

PLANAR: tuple[SurfaceShape, ...] = ("parabola", "wave", "circle", "profile")
SPATIAL: tuple[SurfaceShape, ...] = ("paraboloid", "wavy_sheet", "sphere")


@pytest.mark.parametrize("shape", [*PLANAR, *SPATIAL])
def test_every_shape_goes_through_the_origin(shape: SurfaceShape) -> None:
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
    assert SurfaceSettings().make() == Parabola(coefficients=(0.05,))
    assert SurfaceSettings(coefficients=(0.2,)).make() == Parabola(coefficients=(0.2,))
    wave = SurfaceSettings(shape="wave", amplitudes=(0.1,), wavelengths=(3.0,))
    assert wave.make() == Wave(amplitudes=(0.1,), wavelengths=(3.0,))
    bowl = SurfaceSettings(shape="circle", radius=4.0)
    assert bowl.make() == Circle(centre=(0.0, 4.0), radius=4.0, inside=True)
    ball = SurfaceSettings(shape="sphere", radius=4.0, inside=False)
    assert ball.make() == Sphere(centre=(0.0, 0.0, -4.0), radius=4.0, inside=False)
    sheet = SurfaceSettings(shape="wavy_sheet", amplitudes=(0.1, 0.2), wavelengths=(3.0, 4.0))
    assert sheet.make() == Wave(amplitudes=(0.1, 0.2), wavelengths=(3.0, 4.0))
    paraboloid = SurfaceSettings(shape="paraboloid", coefficients=(0.1, 0.2))
    assert paraboloid.make() == Parabola(coefficients=(0.1, 0.2))


def test_the_observer_is_told_what_gripper_and_sensor_have_unless_it_is_told_otherwise() -> None:
    scenario = EstimationScenario(
        sensor=ForceRateSensorParams(force_noise=2.0, force_rate_noise=7.0),
        gripper=GripperCompliance(stiffness=50.0),
        surface=SurfaceSettings(shape="sphere"),
    )
    known = {
        "stiffness": ((50.0, 0.0, 0.0), (0.0, 50.0, 0.0), (0.0, 0.0, 50.0)),
        "force_noise": 2.0,
        "force_rate_noise": 7.0,
    }

    def told(scenario: EstimationScenario) -> dict[str, Any]:
        return vars(resolve_estimation(scenario).observer)

    assert told(scenario) == vars(THESIS) | known
    believed = {"stiffness": ((9.0, 1.0, 0.0), (1.0, 9.0, 0.0), (0.0, 0.0, 9.0))}
    for other in (believed, {"force_noise": 0.0}, {"force_rate_noise": 0.0}):
        observer = replace(THESIS, **other)  # type: ignore[arg-type]
        once = resolve_estimation(replace(scenario, observer=observer))
        assert vars(once.observer) == vars(THESIS) | known | other
        assert resolve_estimation(once) == once


def wrong_surface(**values: Any) -> Any:
    return lambda: SurfaceSettings(**values)


def wrong(**values: Any) -> Any:
    return lambda: SurfaceScenario(**values)


def wrong_lead(**values: Any) -> Any:
    return lambda: resolve_estimation(EstimationScenario(**values))


def wrong_track(**values: Any) -> Any:
    return lambda: resolve_tracking(TrackingScenario(**values))


BALL = SurfaceSettings(shape="circle", radius=0.04, inside=False)
HOLLOW = SurfaceSettings(shape="sphere")
GAINS = TrackingScenario().controller


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (wrong_surface(radius=1.0), "radius is 1.0, allowed: none, for the shape parabola"),
        (wrong_surface(inside=False), "inside is False, allowed: none, for the shape parabola"),
        (wrong_surface(shape="circle", coefficients=(1.0,)), "coefficients is (1.0,), allowed:"),
        (wrong_surface(coefficients=(1.0, 2.0)), "coefficients is (1.0, 2.0), allowed: 1 for th"),
        (wrong_surface(shape="wavy_sheet", wavelengths=(1.0,)), "wavelengths is (1.0,), allowed"),
        (wrong(gripper=GripperCompliance(damping=1.0)), "gripper.damping is 1.0, allowed: 0; a"),
        (wrong(step=0.03), "step is 0.03, allowed: a whole part of 0.05 s"),
        (wrong(step=0.1), "step is 0.1, allowed: a whole part of 0.05 s"),
        (wrong(step=1e-320), "step is 1e-320, allowed: a whole part of 0.05 s"),
        (wrong(duration=0.4999), "duration is 0.4999, allowed: at least ten periods of 0.05 s"),
        (
            wrong(observer=replace(THESIS, prediction=SurfaceSettings(shape="sphere"))),
            "observer.prediction.shape is 'sphere', allowed: a shape with 2 dimensions, "
            "as the surface has",
        ),
        (wrong_lead(lead=LeadSettings(sideways=0.1)), "lead.sideways is 0.1, allowed: 0 in the"),
        (
            wrong_lead(
                observer=replace(THESIS, stiffness=((1.0, 0.0), (0.0, 1.0))), surface=HOLLOW
            ),
            "observer.stiffness is ((1.0, 0.0), (0.0, 1.0)), allowed: 3 rows of 3 numbers",
        ),
        (lambda: LeadSettings(speed=0.0), "speed is 0.0, allowed: a finite number other than 0"),
        (lambda: LeadSettings(speed=float("-inf")), "speed is -inf, allowed: a finite number ot"),
        (wrong(force_delay=0.07), "force_delay is 0.07, allowed: whole periods of the sensor, 0"),
        (
            wrong(
                force_rate=ForceRateParams(), sensor=ForceRateSensorParams(force_rate_noise=3.0)
            ),
            "sensor.force_rate_noise is 3.0, allowed: 5.0, the rate is made of the force",
        ),
        (wrong_track(surface=BALL), "task.depth is 0.1, allowed: a start below the surface"),
        (wrong_track(controller=replace(GAINS, period=0.006)), "step is 0.0025, allowed: a whol"),
        (
            wrong_track(controller=replace(GAINS, period=0.02)),
            "controller.period is 0.02, allowed: a whole part of 0.05 s",
        ),
        (
            wrong_track(controller=replace(GAINS, stiffness=(1.0, 2.0, 3.0))),
            "controller.stiffness is (1.0, 2.0, 3.0), allowed: 2 numbers, or one for all",
        ),
    ],
)
def test_mistakes_are_named_with_what_is_allowed(make: Any, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        make()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_whole_parts_are_told_from_others_in_spite_of_rounding() -> None:
    for count in (1, 3, 7, 20, 4000):
        require_whole(0.05, 0.05 / count, "step")
        require_whole(1 / 3, 1 / 3 / count, "step")
    for step in (0.05 / 2.5, 0.05 * (1 + 1e-6), 0.0499, 0.2):
        with pytest.raises(ParameterError, match=r"^x is .*, allowed: a whole part of 0\.05 s$"):
            require_whole(0.05, step, "x")


def test_a_prediction_is_of_now_and_a_late_force_is_not() -> None:
    with pytest.raises(ParameterError, match=r"^model_error.delay is 0.1, allowed: 0 with a pred"):
        ObserverSettings(prediction=SurfaceSettings(), model_error=ModelErrorParams(delay=0.1))


@pytest.mark.parametrize(
    ("scenario", "error", "name"),
    [
        (TrackingScenario, {"stiffness": 0.3, "press": 3.0}, "press"),
        (TrackingScenario, {"bias": 2.0, "tare": 1.0}, "tare"),
        (EstimationScenario, {"bias": 2.0, "tare": 1.0}, "tare"),
    ],
)
def test_an_observer_calibrates_only_where_the_gripper_is_free_or_pressed(
    scenario: type[SurfaceScenario], error: dict[str, float], name: str
) -> None:
    observer = ObserverSettings(kind="adaptive", model_error=ModelErrorParams(**error))
    with pytest.raises(ParameterError, match=f"observer.model_error.{name} is .* at most the 0 s"):
        scenario(observer=observer)
