"""What a position-controlled arm makes of its wrist sensor: weight, zero, and giving way."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from chamfer.models.arms.wrist import tip_pose
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_admittance import (
    ContactAdmittanceLaw,
    ContactAdmittanceParams,
    WristSetting,
)
from chamfer.systems.force.wrist_wrench import WRIST_AXES, TurnedToSensor
from chamfer.systems.pose import pose_from_vector, pose_vector

Array = NDArray[np.float64]

R_WH = RotationMatrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))  # downwards
HOLE = RigidTransform(R_WH, [0.3, 0.1, -0.2])
SETTING = WristSetting(
    R_WH=R_WH.matrix(),
    R_TS=WRIST_AXES.rotation().matrix(),
    tool_mass=1.2,
    p_TC=np.array([-0.08, 0.01, 0.0]),
    hole_pose=pose_vector(HOLE),
    period=0.002,
)
PARAMS = ContactAdmittanceParams(
    damping=(2.0, 3.0, 4.0, 800.0, 900.0, 1000.0), spring=(5.0, 6.0, 7.0, 400.0, 500.0, 600.0)
)
TILTED = HOLE @ RigidTransform(RollPitchYaw(0.0, 0.03, -0.05), [-0.01, 0.002, 0.0])


def reading(wrench_W: Array, X_WT: RigidTransform, mass: float) -> Array:
    """Return what an ideal sensor reads: of a wrench at the tip, world axes, and of the tool."""
    R_WT = X_WT.rotation().matrix()
    weight = mass * np.array([0.0, 0.0, -9.81])
    felt = wrench_W + np.concatenate([np.cross(R_WT @ SETTING.p_TC, weight), weight])
    R_WS = R_WT @ SETTING.R_TS
    return (felt.reshape(2, 3) @ R_WS).ravel()


def run(law: ContactAdmittanceLaw, wrench: Array, time: float, **values: Any) -> tuple[Any, Any]:
    """Return state and command after a time, s, with a wrench in the hole's axes on the tool."""
    X_WT = values.pop("pose", TILTED)
    world = (wrench.reshape(2, 3) @ R_WH.matrix().T).ravel()
    seen = {
        "desired_pose": pose_vector(TILTED),
        "reading": reading(world, X_WT, values.pop("mass", 1.2)),
        "tool_pose": pose_vector(X_WT),
        "tares": [values.pop("tares", 0.0)],
    }
    state, told = values.pop("state", None) or law.start(), None
    for _ in range(round(time / law.period)):
        state, told = law.step(state, law.observe(seen), 0.0)
    return state, told


def test_it_gives_way_as_its_springs_in_the_holes_axes() -> None:
    law, wrench = ContactAdmittanceLaw(PARAMS, SETTING), np.array([0.1, 0.2, -0.1, 4.0, -3.0, 2.0])
    _, told = run(law, wrench, 60.0)
    moved = wrench / PARAMS.spring
    given = pose_from_vector(told.reference_pose)
    way = R_WH.inverse().matrix() @ (given.translation() - TILTED.translation())
    turn = (given.rotation() @ TILTED.rotation().inverse()).ToAngleAxis()
    assert np.allclose(way, moved[3:], rtol=1e-6)
    assert np.allclose(
        R_WH.inverse().matrix() @ (turn.angle() * turn.axis()), moved[:3], rtol=1e-6
    )
    # It pushes with the opposite of what it feels, and knows how far it is by the encoders.
    assert np.allclose(told.force, -wrench[3:], atol=1e-9)
    assert np.isclose(told.advance[0], -0.01)
    # At first it yields as its dampers alone.
    _, told = run(law, wrench, 0.02)
    given = pose_from_vector(told.reference_pose).translation() - TILTED.translation()
    first = (R_WH.inverse().matrix() @ given) / 0.02
    assert np.allclose(first, wrench[3:] / PARAMS.damping[3:], rtol=0.02)  # type: ignore[index]


def test_what_is_wrong_of_the_weight_goes_with_the_zero_until_the_tool_turns() -> None:
    law, nothing = ContactAdmittanceLaw(PARAMS, SETTING), np.zeros(6)
    _, told = run(law, nothing, 0.002)
    assert np.allclose(told.force, 0.0, atol=1e-12)
    _, told = run(law, nothing, 0.002, mass=1.3)
    assert np.allclose(told.force, [-0.1 * 9.81, 0.0, 0.0], atol=1e-9)  # along the hole, downwards
    state, told = run(law, nothing, 0.1, mass=1.3, tares=1.0)
    assert np.allclose(told.force, 0.0)
    assert state.counted[0] == 50
    state, told = run(law, nothing, 0.002, mass=1.3, state=state)
    assert np.allclose(told.force, 0.0, atol=1e-9)
    assert state.counted[0] == 0
    # A bias of the sensor turns with it, the weight does not: here only the moment's arm turns.
    turned = TILTED @ RigidTransform(RollPitchYaw(0.0, 0.1, 0.0), np.zeros(3))
    state, _ = run(law, nothing, 0.02, mass=1.3, state=state, pose=turned)
    expected = np.cross(
        (turned.rotation().matrix() - TILTED.rotation().matrix()) @ SETTING.p_TC,
        [0.0, 0.0, -0.1 * 9.81],
    )
    speed = R_WH.inverse().matrix() @ expected / PARAMS.damping[:3]  # type: ignore[index]
    assert np.allclose(state.displacement[:3] / 0.02, speed, rtol=0.05, atol=1e-6)


def test_while_the_zero_is_taken_it_goes_back() -> None:
    law, wrench = ContactAdmittanceLaw(PARAMS, SETTING), np.array([0.0, 0.0, 0.0, 8.0, 0.0, 0.0])
    state, _ = run(law, wrench, 5.0)
    after, _ = run(law, wrench, 0.1, state=state, tares=1.0)
    assert np.isclose(after.displacement[3] / state.displacement[3], np.exp(-1.0), rtol=1e-9)


def test_an_arm_that_does_not_give_way_stays_and_tells_the_force() -> None:
    law = ContactAdmittanceLaw(ContactAdmittanceParams(kind="none"), SETTING)
    _, told = run(law, np.full(6, 9.0), 1.0)
    assert pose_from_vector(told.reference_pose).IsNearlyEqualTo(TILTED, 1e-12)
    assert np.allclose(told.force, -9.0)


def test_what_is_refused() -> None:
    for given, said in (
        ({"damping": (1.0,) * 5}, "damping is .*, allowed: six finite numbers > 0, or null"),
        ({"damping": (np.inf,) * 6}, "allowed: six finite numbers > 0, or null"),
        ({"spring": (0.0,) * 6}, "spring is .*, allowed: six finite numbers > 0"),
        ({"inertia": (-1.0,) * 6}, "inertia is .*, allowed: six finite numbers >= 0"),
        ({"kind": "none", "centre": (0.1, 0.0, 0.0)}, "^centre is .*kind is none"),
    ):
        with pytest.raises(ParameterError, match=said):
            ContactAdmittanceParams(**given)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="damping is None, allowed: six numbers > 0"):
        ContactAdmittanceLaw(replace(PARAMS, damping=None), SETTING)


def test_the_sensor_turns_with_the_arm() -> None:
    block = TurnedToSensor()
    context = block.CreateDefaultContext()
    wrench, turns = np.array([0.1, -0.2, 0.3, 4.0, 5.0, -6.0]), np.array([0.1, -0.2, 0.3])
    block.GetInputPort("wrench").FixValue(context, wrench)
    block.GetInputPort("motion").FixValue(context, np.concatenate([turns, np.zeros(9)]))
    felt = block.GetOutputPort("felt").Eval(context).reshape(2, 3)
    R = tip_pose(np.concatenate([turns, np.zeros(3)])).rotation()
    np.testing.assert_allclose([R @ one for one in felt], wrench.reshape(2, 3), atol=1e-12)
