"""Dry friction that is not the same forward and backward, and what was measured of a Panda."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from chamfer.analysis.design.assumptions import assumptions
from chamfer.analysis.scenario.scenario_io import make_scenario, unstructure
from chamfer.diagrams.cell.work_cell import PEG_ARM, WorkCellScenario, add_work_cell, resolve_arms
from chamfer.models.recordings.recordings import panda_friction
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.force.tool_pose import compensate
from chamfer.systems.pose import pose_vector

FILE = Path(__file__).parents[2] / "models/arms/six_joints.urdf"
OF_FILE = replace(PEG_ARM, model=str(FILE), base=Placement(position=(-0.75, 0.0, 0.0)))
CELL = WorkCellScenario()
FORWARD, BACKWARD = 0.32, 0.08  # N m, of the second joint


@pytest.mark.parametrize("side", [1, -1])
def test_an_arm_stops_where_its_springs_pull_as_friction_does_in_that_direction(side: int) -> None:
    """Sunk or lifted slowly to its place, it stays off by K^-1 J^-T of the joint's friction."""
    rubs = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    peg = replace(
        OF_FILE,
        payload_error=0.0,
        joint_friction=tuple((FORWARD + BACKWARD) / 2 * rubs),
        friction_asymmetry=tuple((FORWARD - BACKWARD) / (FORWARD + BACKWARD) * rubs),
    )
    scenario, builder = replace(CELL, peg=peg), DiagramBuilder()
    arm = add_work_cell(builder, scenario, arms=("peg",)).arms["peg"]
    builder.ExportInput(arm.desired_pose, "pose")
    builder.ExportOutput(arm.encoders, "encoders")
    simulator, place = Simulator(diagram := builder.Build()), scenario.nominal_pose("peg")
    context = simulator.get_mutable_context()
    for time in np.arange(0.0, 2.6, 0.02).tolist():
        away = -0.02 * side * max(1 - time / 2, 0.0) ** 2  # m, higher or lower
        command = compensate(pose_vector(place), np.array([0.0, 0.0, away, 0.0, 0.0, 0.0]))
        diagram.get_input_port().FixValue(context, command)
        simulator.AdvanceTo(time + 0.02)
    q = diagram.get_output_port().Eval(context)[:6]
    there, control = peg.known_arm().evaluate(q), scenario.impedance
    turn = (there.X_WT.rotation() @ place.rotation().inverse()).ToAngleAxis()
    way = there.X_WT.translation() - place.translation()
    off = np.concatenate([turn.angle() * turn.axis(), way])
    stiffness = np.array([*control.rotational_stiffness, *control.stiffness])
    forward = np.linalg.solve(there.J_V_WT, np.array([0, 0, 0, 0, 0, side]))[1] > 0
    torque = FORWARD if forward else -BACKWARD
    expected = -np.linalg.solve(there.J_V_WT.T, torque * rubs) / stiffness
    tolerance = np.abs(expected / torque * 0.02) + 5e-5  # it stops within 0.02 N m of it
    np.testing.assert_array_less(np.abs(off - expected), tolerance)


def test_a_name_stands_for_what_was_measured_and_is_told() -> None:
    given = make_scenario(CELL, settings=["peg.joint_friction=panda"])
    found, measured = resolve_arms(given).peg.arm, panda_friction()
    for sign, one in ((1, measured.coulomb_plus), (-1, measured.coulomb_minus)):
        np.testing.assert_allclose(found.dry_friction + sign * found.friction_bias, one)
    assert found.joint_damping == tuple(measured.damping.tolist())
    assert make_scenario(CELL, given=unstructure(resolve_arms(given))).peg.arm == found
    first, *_ = assumptions(given, resolve_arms(given))
    assert first.field == "peg.joint_friction"
    assert first.says.startswith("dry friction of a Panda: 0.3058 to 0.4877 N m, measured")
    assert "Tara Knežević and co-authors, github.com/" in first.says
