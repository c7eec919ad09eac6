"""An arm of the work cell in simulation, to push and to read."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from chamfer.diagrams.cell.work_cell import PEG_ARM, ArmName, WorkCellScenario, add_work_cell
from chamfer.systems.force.arm_model import ToolState
from chamfer.systems.force.desired_pose import StoppableMotion
from chamfer.systems.force.impedance_controller import ImpedanceControllerParams

Array = np.ndarray


def make_diagram(
    scenario: WorkCellScenario,
    arms: tuple[ArmName, ...],
    offsets: dict[ArmName, tuple[float, float, float]],
    motion_time: float,
) -> Diagram:
    builder = DiagramBuilder()
    goal = {arm: scenario.nominal_pose(arm) for arm in arms}
    start = {
        arm: RigidTransform(goal[arm].translation() + np.array(offset))
        for arm, offset in offsets.items()
        if arm in arms
    }
    cell = add_work_cell(builder, scenario, arms=arms, start=start)
    for arm, ports in cell.arms.items():
        first = start.get(arm, goal[arm]).translation()
        motion = builder.AddNamedSystem(
            f"{arm} desired motion",
            StoppableMotion(first, goal[arm], motion_time, scenario.impedance.period),
        )
        builder.Connect(motion.GetOutputPort("desired_pose"), ports.desired_pose)
        builder.Connect(motion.GetOutputPort("desired_velocity"), ports.desired_velocity)
        for name in ("true_pose", "tool_pose", "torque", "saturated"):
            builder.ExportOutput(getattr(ports, name), f"{arm}.{name}")
        builder.ExportOutput(motion.GetOutputPort("desired_pose"), f"{arm}.desired_pose")
    return builder.Build()


class Cell:
    """Arms under impedance control alone, to push and to read; the peg may go to its place.

    Its outputs are ``<arm>.true_pose``, ``<arm>.tool_pose``, ``<arm>.torque``,
    ``<arm>.saturated`` and ``<arm>.desired_pose``.
    """

    def __init__(
        self,
        scenario: WorkCellScenario,
        arms: tuple[ArmName, ...] = ("peg",),
        *,
        start_offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
        motion_time: float = 2.0,
    ) -> None:
        self.diagram = make_diagram(scenario, arms, {"peg": start_offset}, motion_time)
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.plant = self.diagram.GetSubsystemByName("arms")
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.controller = self.diagram.GetSubsystemByName(f"{arms[0]} impedance control")
        self.tool = self.plant.GetBodyByName(
            "tool", self.plant.GetModelInstanceByName(f"{arms[0]}_arm::wam")
        )

    def push(self, wrench: Array) -> None:
        """Act on the tool at its frame's origin, N m and N in the world's axes, shape (6,)."""
        force = ExternallyAppliedSpatialForce()
        force.body_index = self.tool.index()
        force.p_BoBq_B = np.zeros(3)
        force.F_Bq_W = SpatialForce(tau=wrench[:3], f=wrench[3:])
        port = self.plant.get_applied_spatial_force_input_port()
        port.FixValue(self.plant_context, AbstractValue.Make([force]))

    def run(self, *times: float) -> None:
        for time in times:
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

    def v(self) -> Array:
        return np.array(self.plant.GetVelocities(self.plant_context))

    def tool_state(self) -> tuple[ToolState, Array]:
        """What the controller knows of the peg's arm, and how the elbow moves alone."""
        known = PEG_ARM.known_arm().evaluate(self.q())
        return known, null_space(known.J_V_WT)[:, 0]


@pytest.fixture
def make_cell() -> type[Cell]:
    """The class, to be called with a scenario and the arms."""
    return Cell


@pytest.fixture
def still() -> Any:
    """Makes scenarios of the peg's arm, which is known but for ``peg``, with a long gap."""

    def make(peg: Any = None, *, step: float | None = None, **impedance: Any) -> WorkCellScenario:
        params = ImpedanceControllerParams(**impedance)
        return WorkCellScenario(
            peg=peg or replace(PEG_ARM, payload_error=0.0, joint_friction=(0.0,) * 7),
            gap=0.1,
            impedance=params,
            step=step or params.period,
        )

    return make
