"""The mean of a signal's last samples."""

from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_rate import MovingAverage


def means(samples: int, signal: np.ndarray) -> np.ndarray:
    """Return what the block makes of a signal, shape (size, n), a column a period of 0.25 s."""
    period = 0.25
    builder = DiagramBuilder()
    times = period * (np.arange(signal.shape[1]) - 0.5)  # steps between the samples
    source = builder.AddSystem(TrajectorySource(PiecewisePolynomial.ZeroOrderHold(times, signal)))
    block = builder.AddSystem(MovingAverage(samples=samples, period=period, size=len(signal)))
    builder.Connect(source.get_output_port(), block.get_input_port())
    log = LogVectorOutput(block.get_output_port(), builder, period)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(period * (signal.shape[1] - 2))
    found: np.ndarray = log.FindLog(simulator.get_context()).data().copy()
    return found


@pytest.mark.parametrize("samples", [1, 2, 5])
def test_mean_of_the_last_samples_or_of_those_that_there_were(samples: int) -> None:
    signal = np.random.default_rng(0).standard_normal((3, 20))
    found = means(samples, signal)
    for k in range(found.shape[1]):
        expected = signal[:, max(k - samples + 1, 0) : k + 1].mean(axis=1)
        np.testing.assert_allclose(found[:, k], expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("changes", "name"), [({"samples": 0}, "samples"), ({"period": 0.0}, "period")]
)
def test_what_is_refused(changes: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{name} is "):
        MovingAverage(**{"samples": 2, "period": 0.1, "size": 1, **changes})


def test_a_signal_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^signal is \[nan\]"):
        means(2, np.array([[0.0, 1.0, np.nan, 1.0, 1.0]]))
