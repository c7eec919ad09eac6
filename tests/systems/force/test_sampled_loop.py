"""Sampled systems against python-control and against loops whose margins are known."""

import math

import control
import numpy as np
import pytest

from chamfer.systems.force.sampled_loop import (
    Plant,
    Sampled,
    closed,
    delay_margin,
    gain_margin,
    growth_rate,
    held,
    parallel,
    series,
)

Array = np.ndarray

PERIOD = 0.1
FLOW = np.array([[0.0, 1.0], [-4.0, -0.5]])
DRIVE = np.array([[0.0, 0.2], [1.0, -0.3]])
PLANT = Plant(FLOW, DRIVE, np.array([[1.0, 0.0]]), np.zeros((0, 2)))


def responses(system: Sampled, inputs: Array) -> Array:
    z, seen = np.zeros(len(system.A)), []
    for u in inputs:
        seen.append(system.C @ z + system.D @ u)
        z = system.A @ z + system.B @ u
    return np.array(seen)


def as_control(system: Sampled) -> control.StateSpace:
    return control.ss(*system, PERIOD)


@pytest.mark.parametrize("parts", [0, 1, 4, 6, 8])
@pytest.mark.parametrize("behind", [0, 1, 3, 4, 5, 8, 9])
def test_an_output_shows_what_was(parts: int, behind: int) -> None:
    fine = held(PLANT, period=PERIOD / 4)
    inputs = np.random.default_rng(2).normal(size=(12, 2))
    late = np.vstack([np.zeros((parts, 2)), np.repeat(inputs, 4, axis=0)])[:48]
    seen = np.concatenate([np.zeros(behind), responses(fine, late)[:, 0]])[:48:4]
    slow = PLANT._replace(late=np.array([[1.0, 0.0]]), lateness=behind * PERIOD / 4)
    found = responses(held(slow, period=PERIOD, delay=parts * PERIOD / 4), inputs)
    np.testing.assert_allclose(found[:, 0], responses(fine, late)[::4, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], seen, rtol=0, atol=1e-12)


@pytest.mark.parametrize("scale", [0.0, 1e-6, 1.0, 300.0])
def test_a_period_is_that_of_the_matrix_exponential(scale: float) -> None:
    flow = scale * (np.random.default_rng(3).normal(size=(5, 5)) - 6 * np.eye(5))
    plant = Plant(flow, np.ones((5, 1)), np.eye(5), np.zeros((0, 5)))
    found = held(plant, period=PERIOD)
    expected = control.c2d(control.ss(flow, np.ones((5, 1)), np.eye(5), 0), PERIOD, "zoh")
    np.testing.assert_allclose(found.A, expected.A, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.B, expected.B, rtol=0, atol=1e-11)


def test_connections_are_those_of_python_control() -> None:
    first = held(PLANT, period=PERIOD)
    second = Sampled(
        np.array([[0.5]]), np.array([[1.0]]), np.array([[2.0], [1.0]]), np.array([[0.3], [-0.1]])
    )
    chain = as_control(first) * 1
    np.testing.assert_allclose(
        series(first, second).C @ np.ones(3),
        control.series(chain, as_control(second)).C @ np.ones(3),
    )
    u = np.random.default_rng(1).normal(size=(9, 2))
    np.testing.assert_allclose(
        responses(series(first, second), u), responses(second, responses(first, u)), atol=1e-14
    )
    np.testing.assert_allclose(
        responses(parallel(first, first._replace(D=np.ones((1, 2)))), u),
        2 * responses(first, u) + u.sum(axis=1, keepdims=True),
        atol=1e-14,
    )
    loop = control.feedback(3.0 * as_control(first), as_control(second), sign=1)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(closed(first, second, 3.0))),
        np.sort_complex(loop.poles()),
        rtol=1e-9,
    )


def integrator_loop(gain: float, factor: float = 1.0, delay: float = 0.0) -> float:
    """Return the growth of ``x' = u`` with ``u = -gain x`` held over a period."""
    integrator = Plant(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((0, 1)))
    plant = held(integrator, period=PERIOD, delay=delay)
    law = Sampled(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[-gain]]))
    return growth_rate(closed(plant, law, factor), PERIOD)


@pytest.mark.parametrize("gain", [2.0, 5.0, 15.0, 19.0])
def test_margins_of_an_integrator(gain: float) -> None:
    assert gain_margin(lambda factor: integrator_loop(gain, factor)) == pytest.approx(
        2 / (gain * PERIOD), rel=1e-3
    )
    if gain == 15.0:  # less than a period late, the poles' product is gain * delay
        margin = delay_margin(lambda delay: integrator_loop(gain, delay=delay), PERIOD)
        assert margin == pytest.approx(1 / gain, rel=5e-3)
    if gain == 2.0:  # slow: as in continuous time, less half a period of the hold
        margin = delay_margin(lambda delay: integrator_loop(gain, delay=delay), PERIOD)
        assert margin == pytest.approx(math.pi / 2 / gain - PERIOD / 2, rel=3e-2)


def test_a_loop_that_is_unstable_or_never_so() -> None:
    assert gain_margin(lambda factor: integrator_loop(40.0, factor)) == pytest.approx(
        0.5, rel=1e-3
    )
    assert delay_margin(lambda delay: integrator_loop(40.0, delay=delay), PERIOD) == 0.0
    assert gain_margin(lambda factor: -1.0) is None
    assert gain_margin(lambda factor: 1.0) is None
    assert delay_margin(lambda delay: -1.0, PERIOD) is None
