from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.compiled_loop import FsmTrials, run_fsm_trials
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


def draw_plant(random: np.random.Generator, form: Form) -> PlantParams:
    mass, stiffness = 10 ** random.uniform((-1, 2), (1, 3.5))
    damping = 2 * random.uniform(0.1, 2.0) * np.sqrt(mass * stiffness)
    return PlantParams(mass=mass, damping=damping, stiffness=stiffness, form=form)


@st.composite
def fsm_scenarios(draw: st.DrawFn) -> ServoScenario:
    """Loops that settle, reverse, cycle and saturate.

    What is continuous comes from a generator: Hypothesis likes round numbers, which tie with
    guards.
    """
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    form = draw(st.sampled_from(FORMS))
    period = random.uniform(0.005, 0.02)
    resolution = draw(st.booleans()) * random.uniform(0.001, 0.01)
    noise = draw(st.booleans()) * random.uniform(0.0005, 0.005)
    late = draw(st.integers(0, 3))  # samples
    dead_zone = resolution / 2 + noise + random.uniform(0.002, 0.02)
    amplitude = random.choice([-1, 1]) * random.uniform(0.1, 1.5)
    scenario = ServoScenario(
        desired=draw(
            st.sampled_from(
                [
                    Step(amplitude=amplitude),
                    Sinusoid(amplitude=amplitude, frequency=random.uniform(0.5, 20.0)),
                ]
            )
        ),
        plant=draw_plant(random, form),
        camera=CameraParams(
            resolution=resolution,
            noise=noise,
            latency=max(0.0, late - random.uniform(0.1, 0.9)) * period,
        ),
        fsm=FsmParams(
            period=period,
            dead_zone=dead_zone,
            divider=random.uniform(1.0, 8.0),
            feedforward=draw(st.booleans()) and form == "position",
        ),
        duration=60.3 * period,  # the last row is no tie
        step=period / draw(st.sampled_from([1, 2, 8])),
    )
    designed = fsm_axis(scenario, scenario.plant.form)
    return replace(
        scenario,
        fsm=replace(
            scenario.fsm,
            increment=designed.increment * 10 ** random.uniform(-0.3, 1.0),
            large_error=dead_zone + random.uniform(0.0, 0.3),
            limit=random.uniform(0.5, 3.0) * min(designed.limit, 1e3),
        ),
    )


def trial(scenario: ServoScenario, shift: float, seed: int) -> FsmTrials:
    """Run one trial; a shift of the amplitude is one of every error until an action changes."""
    form = scenario.plant.form
    amplitude = scenario.desired.amplitude + shift
    return run_fsm_trials(
        scenario,
        form,
        duration=scenario.duration or 0.0,
        step=scenario.step or 0.0,
        axes=[fsm_axis(scenario, form)],
        amplitudes=np.array([amplitude]),
        seed=seed,
    )


@pytest.mark.slow
def test_fsm_trials_are_what_the_diagram_does() -> None:
    set_aside = []

    @settings(max_examples=EXAMPLES, deadline=None)
    @given(scenario=fsm_scenarios(), seed=st.integers(0, 2**31 - 1))
    def compare(scenario: ServoScenario, seed: int) -> None:
        assert scenario.duration is not None
        assert scenario.step is not None
        below, found, above = (trial(scenario, shift, seed) for shift in (-CLOSE, 0.0, CLOSE))
        set_aside.append(not np.array_equal(below.increment, above.increment))
        if set_aside[-1]:
            return
        diagram = simulate(
            make_fsm_loop(scenario, scenario.plant.form, step=scenario.step),
            duration=scenario.duration,
            step=scenario.step,
            seed=seed,
        )
        np.testing.assert_allclose(found.time, diagram.time, rtol=0, atol=1e-12)
        for signal in SIGNALS:
            expected = diagram.outputs[signal]
            np.testing.assert_allclose(
                getattr(found, signal)[0],
                expected,
                rtol=0,
                atol=1e-12 * max(1.0, float(np.abs(expected).max())),
                err_msg=signal,
            )

    compare()
    assert sum(set_aside) < 0.01 * len(set_aside)


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
