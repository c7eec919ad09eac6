"""The Puma 250 of appendix A.1 against hand-computed poses."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from chamfer.models.arms.arm import Elbow
from chamfer.models.arms.puma_250 import OFFSET, PUMA_250, endpoint, jacobian, joint_positions
from chamfer.models.validation import ParameterError

WAIST = "more than 0.011 m from the waist's axis"
SHOULDER = "more than 0.1368 m and less than 0.5432 m from the shoulder, in its plane"
ELBOWS: tuple[Elbow, ...] = ("negative", "positive")
angles = st.floats(-math.pi, math.pi)


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(PUMA_250.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


@pytest.mark.parametrize(
    ("degrees", "tip"),
    [
        # Stretched ahead: l3 + l5 out, l2 + l4 to the right.
        ((0, 0, 0), (0.5432, -0.0110, 0.3429)),
        # Turned left, the forearm up: l5 above the shoulder.
        ((90, 0, 90), (0.0110, 0.2032, 0.6829)),
        # The upper arm up, the forearm level: l3 above the shoulder.
        ((0, 90, -90), (0.3400, -0.0110, 0.5461)),
        ((180, 0, -90), (-0.2032, 0.0110, 0.0029)),
    ],
)
def test_tip(degrees: tuple[float, ...], tip: tuple[float, ...]) -> None:
    np.testing.assert_allclose(endpoint(np.radians(degrees)), tip, rtol=0, atol=1e-15)


@given(q1=angles, q2=angles, q3=angles)
def test_determinant(q1: float, q2: float, q3: float) -> None:
    r = 0.34 * math.cos(q2 + q3) + 0.2032 * math.cos(q2)
    found = np.linalg.det(jacobian(np.array([q1, q2, q3])))
    assert found == pytest.approx(-0.2032 * 0.34 * math.sin(q3) * r, abs=1e-15)


def test_elbow_up_and_down() -> None:
    # Level with the shoulder the two elbows mirror each other about the line to the tip.
    x = np.array([0.4, -0.011, 0.3429])
    up, down = joint_positions(x, "negative"), joint_positions(x, "positive")
    assert up[1] > 0 > up[2]
    np.testing.assert_allclose(down, up * [1, -1, -1], rtol=0, atol=1e-14)
    assert up[0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("elbow", ELBOWS)
@pytest.mark.parametrize(
    ("tip", "allowed"),
    [
        ((0.0, 0.0, 0.7), WAIST),
        ((0.0, 0.011, 0.7), WAIST),
        ((math.nan, 0.3, 0.3), WAIST),
        ((0.5432, -0.011, 0.3429), SHOULDER),
        ((0.1368, -0.011, 0.3429), SHOULDER),
        ((0.1, 0.0, 0.3429), SHOULDER),
        ((0.4, 0.4, 0.3429), SHOULDER),
        ((0.3, 0.0, -0.2), SHOULDER),
        ((0.3, 0.0, math.nan), SHOULDER),
    ],
)
def test_out_of_reach_or_singular(tip: tuple[float, ...], allowed: str, elbow: Elbow) -> None:
    message = re.escape(f"endpoint is {tip}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        joint_positions(np.array(tip), elbow)


def test_assumed_masses(plant: MultibodyPlant) -> None:
    assert PUMA_250.assumed
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(6.5)


def test_weight_of_the_stretched_arm(plant: MultibodyPlant) -> None:
    # Shoulder and elbow lift the arm when their angles grow, so that its weight turns them back.
    forearm = 1.2 * 0.15
    shoulder = 2.3 * 0.08 + 1.2 * 0.2032 + forearm
    context = plant.CreateDefaultContext()
    found = plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(found, [0, -9.81 * shoulder, -9.81 * forearm], rtol=0, atol=1e-9)


def test_above_the_waist_in_every_direction() -> None:
    for direction in np.radians(np.arange(360)):
        # At r = 0 the rounding of the tip decides on which side it lies.
        x, y = OFFSET * math.cos(direction), OFFSET * math.sin(direction)
        with pytest.raises(ParameterError, match=re.escape(WAIST)):
            joint_positions(np.array([x, y, 0.6829]), "positive")


def test_waist_stays_within_a_turn() -> None:
    q = joint_positions(np.array([-0.4, 0.001, 0.3]), "negative")
    assert -math.pi <= q[0] < -3.1
