"""Two arms under impedance control: statics, dynamics, friction, stability and wiring."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from scipy.spatial.transform import Rotation

from chamfer.diagrams.cell.work_cell import (
    ARMS,
    HOLE_ARM,
    PEG_ARM,
    ArmName,
    WorkCellScenario,
    add_work_cell,
)
from chamfer.models.arms import wam
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Placement

GRAVITY = 9.81
SMOOTH = (0.0,) * 7  # no dry friction
PERFECT = replace(PEG_ARM, payload_error=0.0, joint_friction=SMOOTH)


# Where the arms stand


@pytest.mark.parametrize("gap", [0.03, 0.1])
def test_peg_and_hole_meet(make_cell: Any, still: Any, gap: float) -> None:
    cell = make_cell(replace(still(), gap=gap, hole=replace(HOLE_ARM, payload_error=0.0)), ARMS)
    np.testing.assert_allclose(
        cell.read("peg.true_pose"), [1, 0, 0, 0, -gap, 0, 0.158], rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(
        cell.read("hole.true_pose"), [1, 0, 0, 0, 0, 0, 0.158], rtol=0, atol=1e-9
    )
    for k in range(2):
        q = cell.q()[7 * k : 7 * k + 7]
        room = np.minimum(q - wam.LOWER_LIMITS, wam.UPPER_LIMITS - q)
        assert room.min() > 0.4
        assert math.radians(85) < q[3] < math.radians(125)  # the elbow is well bent
        assert np.linalg.svd(wam.jacobian(q), compute_uv=False)[-1] > 0.15
    points = [
        cell.plant.GetFrameByName(
            "link_4", cell.plant.GetModelInstanceByName(f"{arm}_arm::wam")
        ).CalcPoseInWorld(cell.plant_context)
        for arm in ARMS
    ]
    assert all(X.translation()[2] > 0.35 for X in points)  # elbows up
    assert points[0].translation()[0] < -0.3 < 0.3 < points[1].translation()[0]


# Statics


@pytest.mark.parametrize(
    ("position", "stiffness"), [((0.0, 0.0, 0.0), 700.0), ((-0.05, 0.03, 0.0), 400.0)]
)
def test_droop_is_weight_over_stiffness(
    make_cell: Any, still: Any, stiffness: float, position: tuple[float, float, float]
) -> None:
    peg = replace(PERFECT, payload_error=0.107, payload_position=position)
    cell = make_cell(still(peg, stiffness=(stiffness,) * 3))
    cell.run(4.0)
    weight = 0.107 * GRAVITY * np.array([0, 0, -1.0])
    error = cell.error()
    np.testing.assert_allclose(error[3:], weight / stiffness, rtol=0, atol=2e-6)
    lever = Rotation.from_rotvec(error[:3]).apply(position)
    np.testing.assert_allclose(error[:3], np.cross(lever, weight) / 5.0, rtol=0, atol=2e-5)


@pytest.mark.parametrize("axis", [0, 2, 4, 5])
def test_compliance_is_the_commanded_one(make_cell: Any, still: Any, axis: int) -> None:
    stiffness = [3.0, 5.0, 8.0, 300.0, 500.0, 700.0]
    cell = make_cell(
        still(rotational_stiffness=tuple(stiffness[:3]), stiffness=tuple(stiffness[3:]))
    )
    wrench = np.zeros(6)
    wrench[axis] = 0.05 if axis < 3 else 2.0
    cell.push(wrench)
    cell.run(4.0)
    expected = wrench / stiffness
    scale = np.abs(expected).max()
    np.testing.assert_allclose(cell.error(), expected, rtol=0, atol=2e-3 * scale)


@pytest.mark.parametrize("arm", ARMS)
def test_base_that_is_elsewhere_is_not_seen_by_the_encoders(
    make_cell: Any, still: Any, arm: ArmName
) -> None:
    error = Placement(position=(0.001, 0.002, 0.0), rpy=(0.0, 0.0, 0.01))
    settings = PEG_ARM if arm == "peg" else HOLE_ARM
    settings = replace(settings, payload_error=0.0, joint_friction=SMOOTH, base_error=error)
    cell = make_cell(replace(still(), **{arm: settings}), (arm,))
    cell.run(1.0)
    X_WB, believed = settings.base.transform, cell.read(f"{arm}.tool_pose")
    X_WT = X_WB @ error.transform @ X_WB.inverse() @ RigidTransform(believed[4:])
    np.testing.assert_allclose(believed, cell.read(f"{arm}.desired_pose"), rtol=0, atol=1e-6)
    true = cell.read(f"{arm}.true_pose")
    np.testing.assert_allclose(true[4:], X_WT.translation(), rtol=0, atol=1e-6)
    assert true[3] == pytest.approx(math.sin(0.005), abs=1e-6)


# Wiring


def test_controllers_know_the_arms_by_their_encoders_alone(make_cell: Any) -> None:
    diagram = make_cell(WorkCellScenario(), ARMS).diagram
    for arm in ARMS:
        controller = diagram.GetSubsystemByName(f"{arm} impedance control")
        sources = {
            target[0].get_input_port(target[1]).get_name(): (
                source[0].get_name(),
                source[0].get_output_port(source[1]).get_name(),
            )
            for target, source in diagram.connection_map().items()
            if target[0] is controller
        }
        assert sources == {
            "encoders": ("arms", f"{arm}_arm::wam_state"),
            "desired_pose": (f"{arm} desired motion", "desired_pose"),
            "desired_velocity": (f"{arm} desired motion", "desired_velocity"),
        }
    read_by = {
        target[0].get_name()
        for target, source in diagram.connection_map().items()
        if source[0].get_name() == "arms"
        and source[0].get_output_port(source[1]).get_name() == "body_poses"
    }
    assert read_by == {f"{arm} true pose" for arm in ARMS}
    true_poses = [
        target
        for target, source in diagram.connection_map().items()
        if "true pose" in source[0].get_name()
    ]
    assert not true_poses  # exported only


def test_parts_are_added_to_the_tools() -> None:
    seen: dict[ArmName, RigidBody] = {}

    def add_parts(plant: MultibodyPlant, tools: dict[ArmName, RigidBody]) -> None:
        assert not plant.is_finalized()
        assert plant.geometry_source_is_registered()
        seen.update(tools)

    builder = DiagramBuilder()
    cell = add_work_cell(builder, WorkCellScenario(), add_parts=add_parts)
    assert {arm: body.name() for arm, body in seen.items()} == dict.fromkeys(ARMS, "tool")
    for arm, ports in cell.arms.items():
        assert seen[arm].model_instance() == ports.instance
        pose = builder.AddSystem(ConstantVectorSource(np.array([1.0, 0, 0, 0, 0, 0, 0.158])))
        builder.Connect(pose.get_output_port(), ports.desired_pose)
    Simulator(builder.Build()).AdvanceTo(0.01)  # the desired velocity needs no source


# What is refused


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"payload_error": -0.1}, "payload_error is -0.1, allowed: a finite number >= 0"),
        ({"mass_scale": 0.0}, "mass_scale is 0.0, allowed: a finite number > 0"),
        ({"posture": (0.0,) * 6}, "posture is (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), allowed: 7 finite"),
        ({"joint_friction": (math.nan,) * 7}, "joint_friction is (nan, nan,"),
        ({"joint_friction": (-0.1,) * 7}, "joint_friction is (-0.1, -0.1,"),
        ({"payload_position": (0.0, 0.0)}, "payload_position is (0.0, 0.0), allowed: three"),
    ],
)
def test_arms_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        replace(PEG_ARM, **change)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step": 0.0}, "step is 0.0, allowed: a finite number > 0"),
        ({"step": 0.0015}, "step is 0.0015, allowed: a whole part of the controllers' period"),
        ({"gap": math.inf}, "gap is inf, allowed: a finite number"),
        ({"meeting_point": (0.0, 0.0)}, "meeting_point is (0.0, 0.0), allowed: three finite"),
    ],
)
def test_scenarios_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        WorkCellScenario(**change)
    assert str(caught.value).startswith(message)


def test_meeting_point_out_of_reach(make_cell: Any) -> None:
    scenario = WorkCellScenario(meeting_point=(0.0, 0.0, 1.5))
    with pytest.raises(ParameterError, match=r"allowed: within reach from|allowed: between"):
        make_cell(scenario)
