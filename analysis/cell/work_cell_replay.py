"""The work cell's runs in three dimensions: arms and parts as they truly were, and the cameras."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import VIEWS
from chamfer.diagrams.cell.work_cell import ArmName, CellArmSettings, WorkCellScenario
from chamfer.diagrams.cell.work_cell_view import make_work_cell_view
from chamfer.models.cameras.camera import Camera

Array = NDArray[np.float64]

_EYE: Final = np.array([-0.04, -0.16, 0.10])  # m, from the middle of the gap; assumed
_BODY: Final = (0.04, 0.03, 0.05)  # m, of a camera, along its axes; assumed
_REACH: Final = 0.12  # m, that the lines of sight are drawn, along the optical axis
_CAMERA: Final = Rgba(0.15, 0.16, 0.18)
_SIGHT: Final = Rgba(0.85, 0.55, 0.1)


def replay_alignment(scenario: AlignmentScenario, outcome: Outcome, meshcat: Meshcat) -> None:
    """Show a run as an animation, with its cameras, seen at first from near the parts.

    Args:
        scenario: Of the run.
        outcome: Its traces have the columns ``time`` (s) and, in rad, the true joint positions
            ``peg_q1``, ... and, of an arm, ``hole_q1``, ...
        meshcat: Where.

    Raises:
        ValueError: If a column is missing, or what :func:`chamfer.analysis.report.replay.record`
        raises.
    """
    cell = make_work_cell_view(scenario, meshcat)
    target = scenario.nominal_pose("peg") @ np.array([scenario.gap / 2, 0.0, 0.0])
    floor = np.array([*target[:2], min(_foot(scenario, arm) for arm in scenario.arms)])
    set_stage(meshcat, floor=floor, eye=target + scenario.hole_axes @ _EYE, target=target)
    for i, view in enumerate(VIEWS):
        _draw_camera(meshcat, f"camera_{i + 1}", scenario.camera(view))
    joints = {
        arm: _joint_positions(outcome.traces, arm, getattr(scenario, arm).arm.num_joints)
        for arm in scenario.arms
    }
    time = _column(outcome.traces, "time")
    record(meshcat, cell.diagram, cell.plant, time, cell.positions(joints))


def _foot(scenario: WorkCellScenario, arm: ArmName) -> float:
    """Return how high an arm's foot is, m."""
    settings: CellArmSettings = getattr(scenario, arm)
    X_WB = settings.base.transform @ settings.base_error.transform
    return float(X_WB.translation()[2]) - settings.arm.base_height


def _joint_positions(traces: Table, arm: ArmName, n: int) -> Array:
    """Return an arm's joint positions, rad, shape (rows, n)."""
    names = [f"{arm}_q{i + 1}" for i in range(n)]
    return np.column_stack([_column(traces, name) for name in names])


def _column(traces: Table, name: str) -> Array:
    if name not in traces:
        raise ValueError(f"the traces lack the column {name!r}, which the replay needs")
    return np.asarray(traces[name], dtype=np.float64)


def _draw_camera(meshcat: Meshcat, path: str, camera: Camera) -> None:
    """Draw a box with its front at the camera's centre, and the edges of what it sees."""
    X_WC = RigidTransform(RotationMatrix(camera.R_WC), camera.p_WC)
    meshcat.SetObject(f"{path}/body", Box(*_BODY), _CAMERA)
    meshcat.SetTransform(f"{path}/body", X_WC @ RigidTransform([0.0, 0.0, -_BODY[2] / 2]))
    right, low = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, low], [-0.5, low]])
    rays = camera.ray(corners)
    # Corners in which a lens shows nothing are drawn as without it.
    rays = np.where(np.isfinite(rays), rays, camera.without_distortion().ray(corners))
    ends = camera.p_WC + rays * (_REACH / (rays @ camera.R_WC[:, 2:]))
    start = np.vstack([np.tile(camera.p_WC, (4, 1)), ends])
    end = np.vstack([ends, np.roll(ends, -1, axis=0)])
    meshcat.SetLineSegments(f"{path}/sight", start.T, end.T, 2.0, _SIGHT)
