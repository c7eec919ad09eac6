"""The planar two-link arm of section 2.2 against hand-computed poses and its mass matrix."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from chamfer.models.arms.arm import Elbow
from chamfer.models.arms.planar_two_link import (
    PLANAR_TWO_LINK,
    endpoint,
    jacobian,
    joint_positions,
    two_link_angles,
)
from chamfer.models.validation import ParameterError

ALLOWED = "allowed: more than 0 m and less than 2 m from the base"
ELBOWS: tuple[Elbow, ...] = ("negative", "positive")
angles = st.floats(-math.pi, math.pi)


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(PLANAR_TWO_LINK.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


@pytest.mark.parametrize(
    ("degrees", "tip"),
    [
        ((0, 0), (2, 0)),
        ((0, 90), (1, 1)),
        ((90, -90), (1, 1)),
        ((-90, 90), (1, -1)),
        ((30, 30), ((math.sqrt(3) + 1) / 2, (1 + math.sqrt(3)) / 2)),
    ],
)
def test_tip(degrees: tuple[float, float], tip: tuple[float, float]) -> None:
    np.testing.assert_allclose(endpoint(np.radians(degrees)), tip, rtol=0, atol=1e-15)


@given(q1=angles, q2=angles)
def test_determinant(q1: float, q2: float) -> None:
    found = np.linalg.det(jacobian(np.array([q1, q2])))
    assert found == pytest.approx(math.sin(q2), abs=1e-14)


@pytest.mark.parametrize(("elbow", "sign"), [("negative", -1), ("positive", 1)])
def test_elbow_at_the_contact_point(elbow: Elbow, sign: int) -> None:
    # <1, -1.5>, the nominal contact point: cos(q2) = (1 + 2.25 - 2) / 2.
    q = joint_positions(np.array([1.0, -1.5]), elbow)
    assert math.degrees(q[1]) == pytest.approx(sign * 51.3178, abs=1e-4)
    np.testing.assert_allclose(endpoint(q), [1.0, -1.5], rtol=0, atol=1e-14)


@pytest.mark.parametrize("elbow", ELBOWS)
@pytest.mark.parametrize(
    "tip",
    # The farthest point of the crucible is exactly at the edge of the reach.
    [(1.6, -1.2), (0.0, 0.0), (2.0, 0.0), (0.0, 2.5), (math.nan, 1.0), (0.0, math.inf)],
)
def test_out_of_reach_or_singular(tip: tuple[float, float], elbow: Elbow) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(f'endpoint is {tip}, {ALLOWED}')}$"):
        joint_positions(np.array(tip), elbow)


@given(direction=angles, radius=st.sampled_from([0.0, 2.0]))
def test_edge_is_singular_in_every_direction(direction: float, radius: float) -> None:
    tip = radius * np.array([math.cos(direction), math.sin(direction)])
    with pytest.raises(ParameterError):
        joint_positions(tip, "negative")


def test_just_inside_the_reach() -> None:
    for tip in ([1.9999999, 0.0], [0.0, 1e-5]):
        q = joint_positions(np.array(tip), "negative")
        np.testing.assert_allclose(endpoint(q), tip, rtol=0, atol=1e-9)


def test_angles_stay_within_a_turn() -> None:
    for direction in np.radians(np.arange(0, 360, 5)):
        for elbow in ELBOWS:
            q = joint_positions(np.array([math.cos(direction), math.sin(direction)]), elbow)
            assert np.abs(q).max() <= math.pi


def test_links_of_unequal_length_leave_a_hole() -> None:
    asked = np.array([0.5, 0.0])
    with pytest.raises(ParameterError, match=r"more than 1 m and less than 3 m from the pivot$"):
        two_link_angles(0.5, 0.0, (2.0, 1.0), "positive", asked, "the pivot")
    q1, q2 = two_link_angles(2.0, 1.0, (2.0, 1.0), "positive", asked, "the pivot")
    assert (q1, q2) == pytest.approx((0.0, math.pi / 2), abs=1e-15)


@pytest.mark.parametrize("q2", [-2.0, -0.9, 0.0, 0.5, math.pi / 2, 3.0])
def test_mass_matrix_of_two_rods(plant: MultibodyPlant, q2: float) -> None:
    m1, m2 = 2.0, 1.0
    a1, a2, a3 = m1 / 3 + m2 / 12 + m2 * 5 / 4, m2 / 2, m2 / 3
    c2 = math.cos(q2)
    expected = [[a1 + 2 * a2 * c2, a3 + a2 * c2], [a3 + a2 * c2, a3]]
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.7, q2])
    np.testing.assert_allclose(plant.CalcMassMatrix(context), expected, rtol=1e-12)


def test_weight_does_not_load_the_joints(plant: MultibodyPlant) -> None:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.3, -0.9])
    gravity = plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(gravity, 0.0, atol=1e-12)
