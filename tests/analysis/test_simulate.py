import numpy as np
import pytest
from pydrake.common import RandomDistribution
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    LinearSystem,
    RandomSource,
)

from analysis.simulate import simulate
from models.validation import ParameterError


def ramp(slopes: list[float]) -> Diagram:
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource(slopes))
    integrator = builder.AddSystem(Integrator(len(slopes)))
    builder.Connect(source.get_output_port(), integrator.get_input_port())
    builder.ExportOutput(integrator.get_output_port(), "position")
    builder.ExportOutput(source.get_output_port(), "slope")
    diagram = builder.Build()
    diagram.set_name("ramp")
    return diagram


def test_outputs_are_logged_by_name_from_zero_to_the_end() -> None:
    run = simulate(ramp([2.0, -1.0]), duration=1.0, step=0.25)
    np.testing.assert_allclose(run.time, [0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(run.outputs["position"][:, 0], 2 * run.time)
    np.testing.assert_allclose(run.outputs["position"][:, 1], -run.time)
    assert simulate(ramp([2.0]), duration=1.0, step=0.25).outputs["slope"].shape == (5,)


def test_progress_ends_at_one_and_never_falls() -> None:
    seen: list[float] = []
    simulate(
        ramp([1.0]), duration=1.0, step=0.5, progress=lambda done, doing="": seen.append(done)
    )
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_seed_fixes_the_noise() -> None:
    def noise(seed: int) -> np.ndarray:
        builder = DiagramBuilder()
        source = builder.AddSystem(RandomSource(RandomDistribution.kUniform, 1, 0.1))
        builder.ExportOutput(source.get_output_port(), "noise")
        return simulate(builder.Build(), duration=1.0, step=0.1, seed=seed).outputs["noise"]

    np.testing.assert_array_equal(noise(4), noise(4))
    assert np.any(noise(4) != noise(5))


def test_an_output_that_is_not_finite_is_named() -> None:
    unstable = LinearSystem(
        A=np.array([[1e4]]),
        B=np.zeros((1, 0)),
        C=np.ones((1, 1)),
        D=np.zeros((1, 0)),
        time_period=0.1,
    )
    unstable.configure_default_state(np.ones(1))
    builder = DiagramBuilder()
    builder.AddSystem(unstable)
    builder.ExportOutput(unstable.get_output_port(), "runaway")
    diagram = builder.Build()
    diagram.set_name("loop")
    with pytest.raises(
        ParameterError, match=r"output runaway of loop is (inf|nan), allowed: finite"
    ):
        simulate(diagram, duration=20.0, step=0.1)


@pytest.mark.parametrize("duration", [1.0, 0.3, 0.35, 1.1])
@pytest.mark.parametrize("step", [0.1, 0.07, 1 / 80])
def test_a_linear_system_is_logged_at_the_times_at_which_drake_logs(
    duration: float, step: float
) -> None:
    exact = simulate(decay(), duration=duration, step=step)
    builder = DiagramBuilder()
    builder.AddSystem(decay())
    builder.ExportOutput(builder.GetSystems()[0].get_output_port(), "y0")
    source = builder.AddSystem(ConstantVectorSource([0.0]))  # keeps it from being linear
    builder.ExportOutput(source.get_output_port(), "zero")
    stepped = simulate(builder.Build(), duration=duration, step=step)
    np.testing.assert_array_equal(exact.time, stepped.time)
    np.testing.assert_allclose(exact.outputs["y0"], 2 * np.exp(-3 * exact.time), rtol=1e-12)
    np.testing.assert_allclose(stepped.outputs["y0"], exact.outputs["y0"], atol=1e-3)


def decay() -> LinearSystem:
    system = LinearSystem(
        A=np.array([[-3.0]]), B=np.zeros((1, 0)), C=np.ones((1, 1)), D=np.zeros((1, 0))
    )
    system.configure_default_state(np.array([2.0]))
    return system
