import numpy as np
import pytest
from pydrake.common import RandomDistribution
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    LinearSystem,
    RandomSource,
)

from chamfer.analysis.linear.simulate import simulate
from chamfer.models.validation import ParameterError


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


def test_the_last_time_is_the_whole_duration_to_its_last_digit() -> None:
    duration = 8448 * 0.000390625  # a twentieth of it, twenty times, is less
    step = duration / 64
    assert simulate(ramp([1.0]), duration=duration, step=step).time[-1] == 64 * step


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


def stepped_ramp() -> Diagram:
    """A ramp that is not linear to Drake, so that it is stepped."""
    builder = DiagramBuilder()
    system = builder.AddSystem(ramp([2.0]))
    builder.ExportOutput(system.GetOutputPort("position"), "position")
    return builder.Build()


def position(context: Context) -> float:
    (found,) = context.get_continuous_state_vector().CopyToVector()
    return float(found)


def test_a_run_ends_when_it_is_over() -> None:
    asked: list[float] = []
    told: list[float] = []

    def over(context: Context) -> bool:
        asked.append(context.get_time())
        return position(context) >= 0.85

    run = simulate(
        stepped_ramp(),
        duration=3.0,
        step=0.01,
        ended=over,
        progress=lambda done, doing="": told.append(done),
    )
    # It is asked once in ten log entries, and the log ends there.
    np.testing.assert_allclose(asked, [0.1, 0.2, 0.3, 0.4, 0.5])
    assert run.time[-1] == pytest.approx(0.5)
    assert run.outputs["position"][-1] == pytest.approx(1.0)
    np.testing.assert_allclose(told, [0.1 / 3, 0.2 / 3, 0.1, 0.4 / 3, 1.0])


def test_the_last_state_is_that_of_the_root_at_the_end() -> None:
    run = simulate(stepped_ramp(), duration=0.7, step=0.1)
    assert run.final is not None
    assert run.final.get_time() == pytest.approx(0.7)
    assert position(run.final) == pytest.approx(1.4)
    over = simulate(stepped_ramp(), duration=7.0, step=0.1, ended=lambda _: True).final
    assert over is not None
    assert over.get_time() == pytest.approx(1.0)
