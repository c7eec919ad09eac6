from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_loops import make_fsm_loop
from chamfer.diagrams.servo.servo_scenario import (
    STEP,
    CameraParams,
    FsmParams,
    PlantParams,
    ServoScenario,
    fsm_axis,
)
from chamfer.models.plants.servo_plant import Form
from chamfer.systems.servo.compensator import AxisParams
from chamfer.systems.servo.desired_trajectory import Sinusoid, Step

FORMS = ("position", "velocity", "compliance")
SIGNALS = ("desired_trajectory", "controller", "actual_trajectory")
EXAMPLES = 100
CLOSE = 1e-9  # m, from a guard, where rounding may decide


def drawn(random: np.random.Generator) -> ServoScenario:
    """Draw a loop that settles, reverses, cycles or saturates."""
    form: Form = random.choice(FORMS)  # type: ignore[assignment]
    mass, stiffness = 10 ** random.uniform((-1, 2), (1, 3.5))
    damping = 2 * random.uniform(0.1, 2.0) * np.sqrt(mass * stiffness)
    period = random.uniform(0.005, 0.02)
    resolution = random.integers(2) * random.uniform(0.001, 0.01)
    noise = random.integers(2) * random.uniform(0.0005, 0.005)
    late = random.integers(4)  # samples
    dead_zone = resolution / 2 + noise + random.uniform(0.002, 0.02)
    amplitude = random.choice([-1, 1]) * random.uniform(0.1, 1.5)
    sinusoid = Sinusoid(amplitude=amplitude, frequency=random.uniform(0.5, 20.0))
    scenario = ServoScenario(
        desired=sinusoid if random.integers(2) else Step(amplitude=amplitude),
        plant=PlantParams(mass=mass, damping=damping, stiffness=stiffness, form=form),
        camera=CameraParams(
            resolution=resolution,
            noise=noise,
            latency=max(0.0, late - random.uniform(0.1, 0.9)) * period,
        ),
        fsm=FsmParams(
            period=period,
            dead_zone=dead_zone,
            divider=random.uniform(1.0, 8.0),
            feedforward=bool(random.integers(2)) and form == "position",
        ),
        duration=60.3 * period,  # the last row is no tie
        step=period / random.choice([1, 2, 8]),
    )
    designed = fsm_axis(scenario, form)
    fsm = replace(
        scenario.fsm,
        increment=designed.increment * 10 ** random.uniform(-0.3, 1.0),
        large_error=dead_zone + random.uniform(0.0, 0.3),
        limit=random.uniform(0.5, 3.0) * min(designed.limit, 1e3),
    )
    return replace(scenario, fsm=fsm)


@pytest.mark.slow
def test_fsm_trials_are_what_the_diagram_does() -> None:
    set_aside = 0
    for seed in range(EXAMPLES):
        scenario = drawn(np.random.default_rng(seed))
        form, times = scenario.plant.form, {"duration": scenario.duration, "step": scenario.step}
        # A shift of the amplitude is one of every error until an action changes.
        below, found, above = (
            run_fsm_trials(
                scenario,
                form,
                axes=[fsm_axis(scenario, form)],
                amplitudes=np.array([scenario.desired.amplitude + shift]),
                seed=seed,
                **times,  # type: ignore[arg-type]
            )
            for shift in (-CLOSE, 0.0, CLOSE)
        )
        if not np.array_equal(below.increment, above.increment):
            set_aside += 1
            continue
        loop = make_fsm_loop(scenario, form, step=scenario.step)
        diagram = simulate(loop, seed=seed, **times)  # type: ignore[arg-type]
        np.testing.assert_allclose(found.time, diagram.time, rtol=0, atol=1e-12)
        for signal in SIGNALS:
            expected = diagram.outputs[signal]
            close = 1e-12 * max(1.0, float(np.abs(expected).max()))
            np.testing.assert_allclose(
                getattr(found, signal)[0], expected, rtol=0, atol=close, err_msg=signal
            )
    assert set_aside < 0.01 * EXAMPLES + 1


GRID = {"duration": 2.5, "step": 1 / 80}


def test_trials_differ_in_axes_and_amplitudes() -> None:
    axes = [
        AxisParams(dead_zone=0.01, large_error=0.1, increment=increment)
        for increment in (0.01, 0.03)
    ]
    amplitudes = np.array([0.3, -0.8])
    both = run_fsm_trials(STEP, "position", axes=axes, amplitudes=amplitudes, **GRID)
    for i in range(2):
        of = {"axes": axes[i : i + 1], "amplitudes": amplitudes[i : i + 1]}
        alone = run_fsm_trials(STEP, "position", **of, **GRID)  # type: ignore[arg-type]
        for name in (*SIGNALS, "increment"):
            np.testing.assert_array_equal(getattr(both, name)[i], getattr(alone, name)[0])
    assert both.desired_trajectory[:, -1].tolist() == [0.3, -0.8]
    assert set(both.increment[0]) == {0.0, 0.01, 0.002}


def test_noise_is_drawn_for_each_trial() -> None:
    scenario = replace(STEP, camera=CameraParams(noise=0.004, resolution=0.0))
    axes = [fsm_axis(scenario, "position")] * 2
    first, again = (
        run_fsm_trials(scenario, "position", axes=axes, seed=4, **GRID) for _ in range(2)
    )
    np.testing.assert_array_equal(first.actual_trajectory, again.actual_trajectory)
    assert np.any(first.actual_trajectory[0] != first.actual_trajectory[1])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"step": 0.005}, r"step is 0\.005, allowed: the FSM's period"),
        ({"step": 0.1}, r"step is 0\.1, allowed: the FSM's period"),
        ({"amplitudes": np.array([1.0, 2.0])}, "broadcast"),
        (
            {"axes": [AxisParams(dead_zone=0.01, large_error=0.1, increment=1e308)]},
            r"actual_trajectory is -?(inf|nan), allowed: finite",
        ),
    ],
)
def test_trials_that_are_no_grid_or_overflow_are_refused(given: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        run_fsm_trials(STEP, "position", **GRID | given)
