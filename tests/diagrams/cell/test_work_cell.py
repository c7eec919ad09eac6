"""The cell's arms at rest and in motion, and what they are to the peg."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from chamfer.diagrams.cell.work_cell import (
    ARMS,
    HOLE_ARM,
    PEG_ARM,
    ArmName,
    WorkCellScenario,
    add_holders,
    add_work_cell,
    axial_stiffness,
    support_at,
)
from chamfer.models.arms import wam
from chamfer.models.cameras.camera import View
from chamfer.models.peg.support import Support
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.force.impedance_controller import ImpedanceController
from chamfer.systems.force.impedance_law import ImpedanceControllerParams
from chamfer.systems.pose import pose_vector

Array = np.ndarray
GRAVITY = 9.81
SMOOTH = (0.0,) * 7  # no dry friction
PERFECT = replace(PEG_ARM, payload_error=0.0, joint_friction=SMOOTH)


class Cell:
    """Arms under impedance control alone at their places, to push and to read."""

    def __init__(self, scenario: WorkCellScenario, arms: tuple[ArmName, ...] = ("peg",)) -> None:
        builder = DiagramBuilder()
        for arm, ports in add_work_cell(builder, scenario, arms=arms).arms.items():
            place = ConstantVectorSource(pose_vector(scenario.nominal_pose(arm)))
            pose = builder.AddNamedSystem(f"{arm} desired pose", place).get_output_port()
            builder.Connect(pose, ports.desired_pose)
            for name in ("true_pose", "tool_pose"):
                builder.ExportOutput(getattr(ports, name), f"{arm}.{name}")
            builder.ExportOutput(pose, f"{arm}.desired_pose")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.plant = self.diagram.GetSubsystemByName("arms")
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.controller = self.diagram.GetSubsystemByName(f"{arms[0]} impedance control")
        instance = self.plant.GetModelInstanceByName(f"{arms[0]}_arm::wam")
        self.tool = self.plant.GetBodyByName("tool", instance)

    def push(self, wrench: Array) -> None:
        """Act on the tool at its frame's origin, N m and N in the world's axes, shape (6,)."""
        force = ExternallyAppliedSpatialForce()
        force.body_index = self.tool.index()
        force.p_BoBq_B = np.zeros(3)
        force.F_Bq_W = SpatialForce(tau=wrench[:3], f=wrench[3:])
        port = self.plant.get_applied_spatial_force_input_port()
        port.FixValue(self.plant_context, AbstractValue.Make([force]))

    def run(self, time: float) -> None:
        self.simulator.AdvanceTo(time)

    def read(self, name: str) -> Array:
        return np.array(self.diagram.GetOutputPort(name).Eval(self.context))

    def error(self, arm: ArmName = "peg") -> Array:
        """Rotation vector, rad, and way, m, from the desired to the true pose, world's axes."""
        desired, pose = self.read(f"{arm}.desired_pose"), self.read(f"{arm}.true_pose")
        turn = Rotation.from_quat(pose[:4], scalar_first=True)
        turn = turn * Rotation.from_quat(desired[:4], scalar_first=True).inv()
        return np.concatenate([turn.as_rotvec(), pose[4:] - desired[4:]])

    def q(self) -> Array:
        return np.array(self.plant.GetPositions(self.plant_context))


def still(peg: Any = PERFECT, **impedance: Any) -> WorkCellScenario:
    """The peg's arm, which is known but for ``peg``, with a long gap."""
    params = ImpedanceControllerParams(**impedance)
    return WorkCellScenario(peg=peg, gap=0.1, impedance=params, step=params.period)


@pytest.mark.parametrize("gap", [0.03, 0.1])
def test_peg_and_hole_meet(gap: float) -> None:
    cell = Cell(replace(still(), gap=gap, hole=replace(HOLE_ARM, payload_error=0.0)), ARMS)
    for arm, x in (("peg", -gap), ("hole", 0.0)):
        found = cell.read(f"{arm}.true_pose")
        np.testing.assert_allclose(found, [1, 0, 0, 0, x, 0, 0.158], rtol=0, atol=1e-9)
    for k in range(2):
        q = cell.q()[7 * k : 7 * k + 7]
        room = np.minimum(q - wam.LOWER_LIMITS, wam.UPPER_LIMITS - q)
        assert room.min() > 0.4
        assert math.radians(85) < q[3] < math.radians(125)  # the elbow is well bent
        assert np.linalg.svd(wam.jacobian(q), compute_uv=False)[-1] > 0.15


@pytest.mark.parametrize(
    ("position", "stiffness"), [((0.0, 0.0, 0.0), 700.0), ((-0.05, 0.03, 0.0), 400.0)]
)
def test_droop_is_weight_over_stiffness(
    stiffness: float, position: tuple[float, float, float]
) -> None:
    peg = replace(PERFECT, payload_error=0.107, payload_position=position)
    cell = Cell(still(peg, stiffness=(stiffness,) * 3))
    cell.run(4.0)
    weight = 0.107 * GRAVITY * np.array([0, 0, -1.0])
    error = cell.error()
    np.testing.assert_allclose(error[3:], weight / stiffness, rtol=0, atol=2e-6)
    lever = Rotation.from_rotvec(error[:3]).apply(position)
    np.testing.assert_allclose(error[:3], np.cross(lever, weight) / 5.0, rtol=0, atol=2e-5)


@pytest.mark.parametrize("arm", ARMS)
def test_base_that_is_elsewhere_is_not_seen_by_the_encoders(arm: ArmName) -> None:
    error = Placement(position=(0.001, 0.002, 0.0), rpy=(0.0, 0.0, 0.01))
    settings = PEG_ARM if arm == "peg" else HOLE_ARM
    settings = replace(settings, payload_error=0.0, joint_friction=SMOOTH, base_error=error)
    cell = Cell(replace(still(), **{arm: settings}), (arm,))
    cell.run(1.0)
    X_WB, believed = settings.base.transform, cell.read(f"{arm}.tool_pose")
    X_WT = X_WB @ error.transform @ X_WB.inverse() @ RigidTransform(believed[4:])
    np.testing.assert_allclose(believed, cell.read(f"{arm}.desired_pose"), rtol=0, atol=1e-6)
    true = cell.read(f"{arm}.true_pose")
    np.testing.assert_allclose(true[4:], X_WT.translation(), rtol=0, atol=1e-6)
    assert true[3] == pytest.approx(math.sin(0.005), abs=1e-6)


def test_controllers_know_the_arms_by_their_encoders_alone(wires: Any) -> None:
    found = wires(Cell(WorkCellScenario(), ARMS).diagram)
    for arm in ARMS:
        block = f"{arm} impedance control"
        assert {wire for wire in found if wire[2] == block} == {
            ("arms", f"{arm}_arm::wam_state", block, "encoders"),
            (f"{arm} desired pose", "y0", block, "desired_pose"),
        }
    read_by = {wire[2] for wire in found if wire[:2] == ("arms", "body_poses")}
    assert read_by == {f"{arm} true pose" for arm in ARMS}
    assert not [wire for wire in found if "true pose" in wire[0]]  # exported only


SIX_JOINTS = str(Path(__file__).parents[2] / "models/arms/six_joints.urdf")
ARM_FILES = {
    "WAM": {},
    "WAM's file": {"model": str(wam.URDF), "tool_frame": "flange", "rotor_inertia": (0.1,) * 7},
    "six joints": {"model": SIX_JOINTS},  # its rotor is on a joint that has no friction of its own
}


@pytest.mark.parametrize("friction", [None, 0.0, 0.2])
@pytest.mark.parametrize("payload", [0.0, 0.3])
@pytest.mark.parametrize("file", ARM_FILES)
def test_arms_weigh_in_every_joint_what_their_law_believes(
    file: str, payload: float, friction: float | None
) -> None:
    own: dict[str, Any] = {"payload_error": payload, **ARM_FILES[file]}
    if friction is not None:
        own["joint_friction"] = (friction,) * (6 if file == "six joints" else 7)
    scenario = WorkCellScenario(peg=replace(PEG_ARM, **own), hole=replace(HOLE_ARM, **own))
    plant = MultibodyPlant(scenario.step)
    instances, _ = add_holders(plant, scenario)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(1)
    plant.SetPositions(context, rng.uniform(-1.0, 1.0, plant.num_positions()))
    mass = plant.CalcMassMatrix(context)
    for arm, instance in instances.items():
        settings = scenario.peg if arm == "peg" else scenario.hole
        known = settings.known_arm().evaluate(plant.GetPositions(context, instance))
        p = known.X_WT.rotation() @ np.array(settings.payload_position)
        J = known.J_V_WT[3:] + np.cross(known.J_V_WT[:3], p, axisa=0, axisb=0, axisc=0)
        numbers = np.arange(plant.num_velocities())
        joints = plant.GetVelocitiesFromArray(instance, numbers).astype(int)
        found = mass[np.ix_(joints, joints)]
        np.testing.assert_allclose(found, known.mass + payload * J.T @ J, rtol=0, atol=1e-9)


STIFFNESS = np.array([5.0] * 3 + [400.0] * 3)  # the default, N m/rad and N/m


def response(controller: ImpedanceController, wrench: Array, time: float) -> Array:
    """Way of the second-order system with inertia, damping and stiffness at a step, (6,)."""
    inverse = np.linalg.inv(controller.law.inertia)
    A = np.zeros((13, 13))
    A[:6, 6:12] = np.eye(6)
    A[6:12, :6], A[6:12, 6:12] = -inverse * STIFFNESS, -inverse @ controller.law.damping
    A[6:12, 12] = inverse @ wrench
    return np.asarray(expm(A * time)[:6, 12])


@pytest.mark.parametrize("axis", range(6))
def test_step_response_is_that_of_the_effective_inertia(axis: int) -> None:
    cell = Cell(still(period=0.001))
    wrench = np.zeros(6)
    wrench[axis] = 0.02 if axis < 3 else 1.0
    cell.push(wrench)
    found, continuous, stepped = [], [], []
    x, v = np.zeros(6), np.zeros(6)
    inverse = np.linalg.inv(cell.controller.law.inertia)
    for k in range(1, 801):
        v = v + 0.001 * inverse @ (wrench - STIFFNESS * x - cell.controller.law.damping @ v)
        x = x + 0.001 * v
        if k in (5, 10, 20, 50, 100, 200, 400, 800):
            cell.run(0.001 * k - 0.0002)
            found.append(cell.error())
            continuous.append(response(cell.controller, wrench, 0.001 * k))
            stepped.append(x)
    group = slice(0, 3) if axis < 3 else slice(3, 6)
    scale = np.abs(continuous)[:, group].max()
    close = 0.06 if axis == 0 else 0.03  # the turn about the peg's axis takes few periods
    np.testing.assert_allclose(
        np.array(found)[:, group], np.array(continuous)[:, group], rtol=0, atol=close * scale
    )
    np.testing.assert_allclose(
        np.array(found)[:, group], np.array(stepped)[:, group], rtol=0, atol=0.01 * scale
    )


def test_joints_stick_up_to_their_friction() -> None:
    cell = Cell(still(replace(PEG_ARM, payload_error=0.0)))
    start = cell.q()
    cell.push(np.array([0, 0, 0, 0, 0, -0.1]))  # less than 0.1 N m about any joint
    cell.run(2.0)
    np.testing.assert_allclose(cell.q(), start, rtol=0, atol=1e-4)
    cell.push(np.array([0, 0, 0, 0, 0, -3.0]))
    cell.run(5.0)
    assert cell.error()[5] < -0.004


CELL = WorkCellScenario()
stiff = st.floats(10.0, 2000.0)


def test_against_a_fixture_it_is_the_peg_s_arm() -> None:
    cell = replace(CELL, hole=replace(HOLE_ARM, kind="fixture"))
    expected = Support(lateral_stiffness=400.0, angular_stiffness=5.0, centre_distance=0.0)
    assert support_at(cell, 0.03) == expected
    assert axial_stiffness(cell) == 400.0


@given(across=st.tuples(stiff, stiff), turn=st.tuples(stiff, stiff), depth=st.floats(0.0, 0.1))
def test_without_a_plane_it_is_the_one_that_tilts_more(
    across: tuple[float, float], turn: tuple[float, float], depth: float
) -> None:
    impedance = ImpedanceControllerParams(
        stiffness=(1.0, *across), rotational_stiffness=(1.0, *turn)
    )
    cell = replace(CELL, impedance=impedance)
    planes: tuple[View, View] = ("xy", "xz")
    both = [support_at(cell, depth, plane) for plane in planes]
    assert [one.angular_stiffness for one in both] == pytest.approx([turn[1] / 2, turn[0] / 2])
    found = support_at(cell, depth)
    assert found in both
    assert found.tilt_per_error == max(one.tilt_per_error for one in both)


DEPTH = 0.03
SPRINGS: dict[str, Any] = {
    "stiffness": (300.0, 400.0, 600.0),
    "rotational_stiffness": (3.0, 4.0, 6.0),
}


@pytest.mark.parametrize(
    ("plane", "lateral", "turn", "sign"),
    [("xy", 1, 2, 1.0), ("xz", 2, 1, -1.0)],  # a push to +z turns about -y
)
def test_arms_that_are_pushed_at_the_tip_give_way_as_it_says(
    plane: View, lateral: int, turn: int, sign: float
) -> None:
    hole = replace(HOLE_ARM, payload_error=0.0, joint_friction=SMOOTH)
    scenario = replace(still(PERFECT, **SPRINGS), hole=hole, gap=-DEPTH)
    force = 0.5
    moved, turned = 0.0, 0.0
    for arm, lever in (("peg", 0.0), ("hole", DEPTH)):  # of the tip, from the tool's point
        cell = Cell(scenario, (arm,))
        wrench = np.zeros(6)
        wrench[turn], wrench[3 + lateral] = sign * lever * force, force
        cell.push(wrench)
        cell.run(4.0)
        error = cell.error(arm)
        moved += error[3 + lateral] + sign * lever * error[turn]
        turned += sign * error[turn]
    support = support_at(scenario, DEPTH, plane)
    tilt = force * support.centre_distance / support.angular_stiffness
    assert turned == pytest.approx(tilt, rel=0.01)
    expected = force / support.lateral_stiffness + support.centre_distance * tilt
    assert moved == pytest.approx(expected, rel=0.01)
