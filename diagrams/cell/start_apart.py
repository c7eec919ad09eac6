"""Whether peg and hole part are apart where the arms start, and where they are told to be."""

from typing import Final

import numpy as np
from pydrake.math import RigidTransform

from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.work_cell import ArmName, WorkCellScenario
from chamfer.models.peg.part_overlap import require_apart
from chamfer.systems.force.desired_pose import compensate
from chamfer.systems.pose import pose_from_vector, pose_vector

_WAY: Final = np.linspace(1.0, 0.0, 21)  # of the start's offset, where the peg is looked at


def require_start_apart(scenario: AlignmentScenario) -> None:
    """Refuse parts that overlap before the compensation begins.

    The arms are taken to be where their commands and their bases make them be: at the start
    without the commands' initial error, and on the way to the goal with it.

    Raises:
        ParameterError: It names the field that brings the parts into each other.
    """
    way = _WAY if scenario.moves else _WAY[-1:]
    starts = [offset_pose(scenario, share) for share in way.tolist()]
    commands = [wrong_pose(scenario, X_WT) for X_WT in starts]
    X_WM = scenario.nominal_pose("hole")
    for name, poses in (
        ("gap", [scenario.nominal_pose("peg")]),
        ("start_offset", starts[:1]),
        ("initial_error", commands),
    ):
        blamed = name if scenario.gap > 0 else "gap"
        for X_WT in poses:
            X_MT = X_WM.InvertAndCompose(X_WT)
            require_apart(scenario.parts, X_MT, blamed, getattr(scenario, blamed))
    for name in scenario.arms:
        off = true_pose(scenario, "hole", X_WM) if name == "hole" else X_WM
        for X_WT in (starts[0], *commands):
            X_MT = off.InvertAndCompose(true_pose(scenario, "peg", X_WT))
            value = getattr(scenario, name).base_error
            require_apart(scenario.parts, X_MT, f"{name}.base_error", value)


def true_pose(scenario: WorkCellScenario, arm: ArmName, X_WT: RigidTransform) -> RigidTransform:
    """Return where a tool is if its arm takes it to be at a pose: its base may be elsewhere."""
    settings = getattr(scenario, arm)
    X_WB = settings.base.transform
    return X_WB @ settings.base_error.transform @ X_WB.inverse() @ X_WT


def offset_pose(scenario: AlignmentScenario, share: float) -> RigidTransform:
    """Return the peg's desired pose where a share of its way to the goal is left."""
    goal = scenario.nominal_pose("peg")
    return RigidTransform(goal.rotation(), goal @ (share * np.array(scenario.start_offset)))


def wrong_pose(scenario: AlignmentScenario, X_WT: RigidTransform) -> RigidTransform:
    """Return the pose that the peg's arm is commanded to instead of the desired one."""
    error = np.reshape(scenario.initial_error, (2, 3)) @ scenario.hole_axes.matrix().T
    return pose_from_vector(compensate(pose_vector(X_WT), error.ravel()))
