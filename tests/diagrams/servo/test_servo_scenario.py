import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.diagrams.servo.servo_scenario import (
    RADIANS_PER_STEP,
    CameraParams,
    FsmParams,
    PlantParams,
    SinusoidScenario,
    StepScenario,
    fsm_axis,
    resolve,
    settling_plant,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.desired_trajectory import Sinusoid
from chamfer.systems.servo.settling import guarantee


@settings(max_examples=40, deadline=None)
@given(
    mass=st.floats(0.2, 10.0),
    ratio=st.floats(0.15, 2.5),
    stiffness=st.floats(50.0, 3000.0),
    resolution=st.floats(0.0, 0.015),
    latency=st.floats(0.0, 0.05),
)
def test_open_values_follow_from_the_settling_theorem(
    mass: float, ratio: float, stiffness: float, resolution: float, latency: float
) -> None:
    plant = PlantParams(
        mass=mass, damping=2 * ratio * math.sqrt(mass * stiffness), stiffness=stiffness
    )
    scenario = StepScenario(
        plant=plant, camera=CameraParams(resolution=resolution, latency=latency)
    )
    axis = fsm_axis(scenario, "position")
    said = guarantee(axis, settling_plant(scenario, "position"), scenario.measurement.bound)
    assert said.everywhere


def test_resolve_fills_in_every_open_value_and_keeps_what_is_set() -> None:
    open_ = resolve(StepScenario())
    assert open_.axis == fsm_axis(StepScenario(), "position")
    assert resolve(open_) == open_
    fsm = FsmParams(increment=0.004, large_error=0.05, limit=3.0)
    chosen = resolve(StepScenario(fsm=fsm, duration=1.5, step=1 / 80 / 64))
    assert vars(chosen.fsm) == vars(fsm) | {"feedforward": False}
    assert (chosen.duration, chosen.step) == (1.5, 1 / 80 / 64)


@pytest.mark.parametrize("period", [1 / 80, 0.001, 0.013, 1 / 3])
def test_steps_are_the_period_over_a_power_of_two(period: float) -> None:
    scenario = resolve(StepScenario(fsm=FsmParams(period=period), duration=1.0))
    assert scenario.step is not None
    assert scenario.step <= 4e-4
    halvings = math.log2(period / scenario.step)
    assert halvings == pytest.approx(round(halvings), abs=1e-12)


@pytest.mark.parametrize(
    ("step", "plant", "message"),
    [
        (1.0, {}, r"step is 1\.0, allowed: .*, such as 0\.0015625, at most 0\.00277"),
        (1e-3, {}, r"step is 0\.001, .*, such as 0\.00078125, at most 0\.00277"),
        (1 / 80, {}, r"step is 0\.0125, .*, such as 0\.0015625, at most 0\.00277"),
        (1 / 5120, {"stiffness": 3e6}, r"step is .*, such as 2\.44140625e-05, at most 4\.23e-05"),
    ],
)
def test_a_step_that_does_not_meet_the_ticks_or_misses_peaks_is_refused(
    step: float, plant: dict[str, float], message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        resolve(StepScenario(step=step, plant=PlantParams(**plant)))  # type: ignore[arg-type]


def test_the_step_follows_a_fast_plant() -> None:
    fast = PlantParams(stiffness=3e6)  # sqrt(k/m) is 1182 rad/s
    step = resolve(StepScenario(plant=fast)).step
    assert step == 1 / 80 / 2**9
    assert step * math.sqrt(3e6 / fast.mass) < RADIANS_PER_STEP < 2 * step * 1182


def test_the_duration_grows_with_a_plant_that_needs_longer() -> None:
    slow = PlantParams(mass=2.0, damping=8.0, stiffness=700.0)
    duration = resolve(StepScenario(plant=slow)).duration
    assert duration is not None
    assert duration > 5


def test_a_sinusoid_runs_for_two_periods_with_feedforward() -> None:
    scenario = resolve(SinusoidScenario(desired=Sinusoid(frequency=2.0)))
    assert scenario.duration == pytest.approx(2 * math.pi)
    assert scenario.fsm.feedforward


def test_what_is_set_is_meant_for_its_own_form() -> None:
    scenario = StepScenario(fsm=FsmParams(increment=0.004))
    assert fsm_axis(scenario, "position").increment == 0.004
    held = 0.98 * 700.0 / 80
    assert fsm_axis(scenario, "velocity").increment == pytest.approx(held)


@pytest.mark.parametrize("factor", [0.5, 20.0])
def test_an_increment_that_is_set_gets_a_large_error_of_its_own(factor: float) -> None:
    default = fsm_axis(StepScenario(), "position")
    scenario = StepScenario(fsm=FsmParams(increment=factor * default.increment))
    axis = fsm_axis(scenario, "position")
    assert (axis.large_error > default.large_error) == (factor > 1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: StepScenario(camera=CameraParams(resolution=0.03)),
            r"fsm\.dead_zone is 0\.01, allowed: more than the camera's error, .* 0\.015",
        ),
        (
            lambda: resolve(StepScenario(duration=1e9)),
            r"duration is 1000000000\.0, allowed: 10 to 5000000 steps of",
        ),
        (lambda: resolve(StepScenario(duration=1e-9)), "duration is 1e-09, allowed: 10 to"),
        (
            lambda: resolve(StepScenario(plant=PlantParams(damping=1e9))),
            r"fsm\.period is 0\.0125, allowed: at least .* s, the plant's slowest pole is",
        ),
        (
            lambda: resolve(StepScenario(plant=PlantParams(mass=1e-300))),
            "the plant's slowest pole is .*, allowed: a real part < 0",
        ),
    ],
)
def test_what_is_not_allowed_is_named_with_its_value(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ParameterError, match=message):
        make()
