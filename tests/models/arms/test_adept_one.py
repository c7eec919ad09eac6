"""The Adept One of appendix A.2 against hand-computed poses and its mass matrix."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from chamfer.models.arms.adept_one import (
    ADEPT_ONE,
    LENGTH_1,
    LENGTH_2,
    endpoint,
    jacobian,
    joint_positions,
)
from chamfer.models.arms.arm import Elbow
from chamfer.models.validation import ParameterError

REACH = "more than 0.05 m and less than 0.8 m from the base's axis"
ELBOWS: tuple[Elbow, ...] = ("negative", "positive")
angles = st.floats(-math.pi, math.pi)


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(ADEPT_ONE.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


def test_tip() -> None:
    # Stretched along x it reaches 0.800 m, not the 0.4627 m of the misprint.
    np.testing.assert_allclose(endpoint(np.zeros(4)), [0.8, 0, 0.877, 0], rtol=0, atol=1e-15)
    bent = endpoint(np.array([math.pi / 2, -math.pi / 2, 0.5, 0.25]))
    np.testing.assert_allclose(bent, [0.375, 0.425, 0.377, 0.25], rtol=0, atol=1e-15)


@given(q1=angles, q2=angles, d3=st.floats(-1, 1), q4=angles)
def test_determinant(q1: float, q2: float, d3: float, q4: float) -> None:
    found = np.linalg.det(jacobian(np.array([q1, q2, d3, q4])))
    assert found == pytest.approx(-0.425 * 0.375 * math.sin(q2), abs=1e-14)


def test_vertical_axis_is_decoupled() -> None:
    found = jacobian(np.array([0.3, -1.2, 0.4, 0.9]))
    np.testing.assert_array_equal(found[2], [0, 0, -1, 0])
    np.testing.assert_array_equal(found[:, 2], [0, 0, -1, 0])
    np.testing.assert_array_equal(found[3], [1, 1, 0, 1])


@pytest.mark.parametrize("elbow", ELBOWS)
@pytest.mark.parametrize("phi", [-10.0, 0.0, 7.0])
def test_orientation_keeps_its_whole_turns(elbow: Elbow, phi: float) -> None:
    x = np.array([0.5, 0.3, 0.4, phi])
    np.testing.assert_allclose(endpoint(joint_positions(x, elbow)), x, rtol=0, atol=1e-14)


@pytest.mark.parametrize("elbow", ELBOWS)
@pytest.mark.parametrize(
    ("tip", "allowed"),
    [
        ((0.8, 0.0, 0.4, 0.0), REACH),
        ((0.0, -0.05, 0.4, 0.0), REACH),
        ((0.01, 0.0, 0.4, 0.0), REACH),
        ((0.7, 0.7, 0.4, 1.0), REACH),
        ((0.5, 0.3, math.nan, 0.0), "finite numbers"),
        ((0.5, 0.3, 0.4, math.inf), "finite numbers"),
    ],
)
def test_out_of_reach_or_singular(tip: tuple[float, ...], allowed: str, elbow: Elbow) -> None:
    message = re.escape(f"endpoint is {tip}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        joint_positions(np.array(tip), elbow)


@pytest.mark.parametrize("q2", [-1.5, 0.0, 0.8])
def test_mass_matrix(plant: MultibodyPlant, q2: float) -> None:
    quill_and_payload, turning = 6.0, 0.0002 + 0.005
    c2 = math.cos(q2)
    second = 0.15 + 9 * 0.15**2 + quill_and_payload * LENGTH_2**2 + turning
    coupling = LENGTH_1 * (9 * 0.15 + quill_and_payload * LENGTH_2) * c2
    first = 0.25 + 12 * 0.2**2 + (9 + quill_and_payload) * LENGTH_1**2
    expected = [
        [first + second + 2 * coupling + 0.3, second + coupling, 0, 0.005],
        [second + coupling, second + 0.1, 0, 0.005],
        [0, 0, 6, 0],
        [0.005, 0.005, 0, 0.02],
    ]
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.4, q2, 0.5, -0.3])
    np.testing.assert_allclose(plant.CalcMassMatrix(context), expected, rtol=0, atol=1e-12)


def test_weight_pulls_the_quill_out(plant: MultibodyPlant) -> None:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.4, 0.8, 0.5, 0.0])
    found = plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(found, [0, 0, 6 * 9.81, 0], rtol=0, atol=1e-9)
