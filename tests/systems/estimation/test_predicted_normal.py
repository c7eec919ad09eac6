from dataclasses import dataclass

import numpy as np
import pytest

from chamfer.models.surfaces.graphs import Parabola, Paraboloid
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.surface_observer import PredictedNormal


def predicted(surface: Surface, motion: list[float]) -> np.ndarray:
    block = PredictedNormal(surface)
    context = block.CreateDefaultContext()
    block.GetInputPort("nominal_motion").FixValue(context, motion)
    found: np.ndarray = block.GetOutputPort("predicted_normal").Eval(context)
    return found


def test_it_is_the_normal_of_the_surface_at_the_position() -> None:
    # y = 0.1 x^2 has the slope 0.4 at x = 2.
    expected = np.array([-0.4, 1.0]) / np.hypot(0.4, 1.0)
    at = [2.0, 0.4, 0.0, 0.0]
    np.testing.assert_allclose(predicted(Parabola(coefficient=0.1), at), expected)
    expected = np.array([-0.4, 0.6, 1.0]) / np.sqrt(0.16 + 0.36 + 1)
    paraboloid = Paraboloid(coefficients=(0.1, -0.1))
    np.testing.assert_allclose(predicted(paraboloid, [2.0, 3.0, 9.0, 0, 0, 0]), expected)


def test_off_the_surface_it_is_that_of_the_level_there() -> None:
    ball = Sphere(centre=(0.0, 0.0, 0.0), radius=1.0)
    for height in (0.3, 1.0, 5.0):
        at = [0.0, 0.6 * height, 0.8 * height, 0.0, 0.0, 0.0]
        np.testing.assert_allclose(predicted(ball, at), [0.0, 0.6, 0.8])
    bowl = Circle(centre=(0.0, 2.0), radius=2.0, inside=True)
    np.testing.assert_allclose(predicted(bowl, [0.0, -0.5, 0.0, 0.0]), [0.0, 1.0])


def test_velocity_does_not_matter() -> None:
    surface = Parabola(coefficient=0.1)
    one, other = (predicted(surface, [1.0, 0.0, v, 2 * v]) for v in (0.0, 7.0))
    np.testing.assert_array_equal(one, other)


def test_the_output_follows_at_once() -> None:
    block = PredictedNormal(Parabola())
    assert block.HasDirectFeedthrough(0, 0)
    context = block.CreateDefaultContext()
    port = block.GetInputPort("nominal_motion")
    port.FixValue(context, [1.0, 0.0, 0.0, 0.0])
    before = block.GetOutputPort("predicted_normal").Eval(context).copy()
    port.FixValue(context, [2.0, 0.0, 0.0, 0.0])
    assert not np.allclose(block.GetOutputPort("predicted_normal").Eval(context), before)


def test_it_has_one_port_each_and_no_state() -> None:
    for surface, d in ((Parabola(), 2), (Paraboloid(), 3)):
        block = PredictedNormal(surface)
        assert (block.num_input_ports(), block.num_output_ports()) == (1, 1)
        assert block.GetInputPort("nominal_motion").size() == 2 * d
        assert block.GetOutputPort("predicted_normal").size() == d
        assert block.IsDifferenceEquationSystem()[0] is False
        assert block.CreateDefaultContext().num_total_states() == 0


def test_a_place_without_a_normal_is_refused() -> None:
    ball = Sphere(centre=(0.0, 0.0, 0.0), radius=1.0)
    with pytest.raises(ParameterError, match="a point where the surface has a normal"):
        predicted(ball, [0.0] * 6)


@dataclass(frozen=True)
class Steep:
    """A level whose gradient is not of unit length."""

    dimension: int = 2

    def level(self, p: np.ndarray) -> float:
        return float(10 * p[1])

    def gradient(self, p: np.ndarray) -> np.ndarray:
        return np.array([0.0, 10.0])

    def hessian(self, p: np.ndarray) -> np.ndarray:
        return np.zeros((2, 2))


def test_it_is_of_unit_length_whatever_the_level() -> None:
    np.testing.assert_array_equal(predicted(Steep(), [0.0, 1.0, 0.0, 0.0]), [0.0, 1.0])
