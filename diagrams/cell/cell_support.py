"""What holds the peg against the hole in the cell, as the theory of insertion asks for it.

Under impedance control an arm is a spring across the peg and one that turns it, both about the
tool's own point: the tip of the peg, or the mouth of the hole. Two arms are in series, so that
the support depends on how deep the tip is; against a fixture it is that of the peg's arm alone.

The dry friction of the joints is not part of it. It is no spring: per arm nothing moves below
0.03 N m, 0.1 N across and 0.4 N along the peg, and two-point forces are 2 to 4 times larger.
"""

from chamfer.diagrams.cell.work_cell import WorkCellScenario
from chamfer.models.cameras.camera import View
from chamfer.models.peg.support import Support, in_series

_ACROSS = {"xy": (1, 2), "xz": (2, 1)}  # the lateral axis of a plane, and the one that it turns


def support_at(scenario: WorkCellScenario, depth: float, plane: View | None = None) -> Support:
    """Return the one support that the arms are to the peg.

    Args:
        scenario: The cell.
        depth: Of the tip below the mouth, m.
        plane: Of insertion; by default the one in which a lateral error tilts the peg more.
    """
    if plane is None:
        both = (support_at(scenario, depth, "xy"), support_at(scenario, depth, "xz"))
        return max(both, key=lambda support: abs(support.tilt_per_error))
    lateral, turn = _ACROSS[plane]
    arm = Support(
        lateral_stiffness=scenario.impedance.stiffness[lateral],
        angular_stiffness=scenario.impedance.rotational_stiffness[turn],
        centre_distance=0.0,
    )
    return arm if scenario.hole.kind == "fixture" else in_series(arm, arm, depth)


def wedging_support(scenario: WorkCellScenario) -> Support:
    """Return the support at the depth at which two points decide whether the peg can wedge."""
    parts = scenario.parts
    return support_at(scenario, parts.chamfer_height + parts.wedging_depth)


def axial_stiffness(scenario: WorkCellScenario) -> float:
    """Return the stiffness of the arms, one behind the other, along the axis, N/m."""
    return scenario.impedance.stiffness[0] / len(scenario.arms)
