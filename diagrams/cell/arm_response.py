"""An arm of the cell whose commanded pose makes a step, for its response."""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from diagrams.cell.work_cell import ArmName, WorkCellScenario, add_work_cell
from systems.force.compensated_pose import compensate
from systems.pose import pose_vector
from systems.vision.image_plane_error import AXES


def make_response_diagram(
    scenario: WorkCellScenario, arm: ArmName, axis: str, *, amplitude: float, begin: float
) -> Diagram:
    """Build one arm that holds its nominal pose until one axis of the command makes a step.

    It exports ``true_pose``, shape (7,), of the tool.

    Args:
        scenario: The cell.
        arm: Which arm.
        axis: One of :data:`systems.vision.image_plane_error.AXES`, of the hole's axes.
        amplitude: Of the step, m or rad.
        begin: s, when.
    """
    builder = DiagramBuilder()
    ports = add_work_cell(builder, scenario, arms=(arm,)).arms[arm]
    before = pose_vector(scenario.nominal_pose(arm))
    moved = np.reshape(amplitude * np.eye(len(AXES))[AXES.index(axis)], (2, 3))
    after = compensate(before, (moved @ scenario.hole_axes.matrix().T).ravel())
    step = PiecewisePolynomial.ZeroOrderHold(
        [0.0, begin, 2 * begin], np.column_stack([before, after, after])
    )
    command = builder.AddNamedSystem("command", TrajectorySource(step))
    builder.Connect(command.get_output_port(), ports.desired_pose)
    builder.ExportOutput(ports.true_pose, "true_pose")
    diagram = builder.Build()
    diagram.set_name(f"Response of the {arm}'s arm along {axis}")
    return diagram
