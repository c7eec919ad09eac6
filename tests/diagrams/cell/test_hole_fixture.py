"""A hole that is fixed in the world: one arm, which takes all of the compensation."""

from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.framework import DiagramBuilder

from chamfer.analysis.cell.alignment_runs import (
    AlignmentTrialsScenario,
    Spread,
    Traces,
    drawn,
    run_alignment,
)
from chamfer.analysis.cell.work_cell_replay import replay_alignment
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, VerticalTrackingScenario
from chamfer.diagrams.cell.work_cell import HOLE_ARM, ArmSettings, WorkCellScenario, add_work_cell
from chamfer.diagrams.cell.work_cell_view import add_part_shapes
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.pose import pose_vector

FIXTURE = replace(HOLE_ARM, kind="fixture")
CELL = AlignmentScenario(hole=FIXTURE, meeting_point=(0.01, -0.02, 0.15))


@pytest.fixture(scope="module")
def traces() -> Traces:
    return run_alignment(CELL, 0)


def test_only_the_peg_s_arm_is_simulated() -> None:
    builder = DiagramBuilder()
    cell = add_work_cell(builder, CELL, add_parts=partial(add_part_shapes, CELL))
    assert cell.plant.num_positions() == 7
    assert set(cell.arms) == {"peg"}
    # The hole part is where the mouth is to be, and nothing holds it.
    context = cell.plant.CreateDefaultContext()
    X_WM = cell.plant.EvalBodyPoseInWorld(context, cell.tools["hole"])
    np.testing.assert_allclose(
        pose_vector(X_WM), [1, 0, 0, 0, 0.01, -0.02, 0.15], rtol=0, atol=1e-12
    )
    assert len(cell.plant.GetVisualGeometriesForBody(cell.tools["hole"])) == 1
    assert len(cell.plant.GetVisualGeometriesForBody(cell.tools["peg"])) == 2


@pytest.mark.slow
def test_the_peg_s_arm_aligns_the_peg_alone(traces: Traces) -> None:
    assert traces["lateral_error"][int(CELL.begin * 80) - 1] > 0.009
    assert traces["lateral_error"][-1] < 0.0006
    assert traces["rotational_error"][-1] < 0.015
    place = [1, 0, 0, 0, 0.01, -0.02, 0.15]
    names = ("qw", "qx", "qy", "qz", "x", "y", "z")
    for prefix in ("hole_", "hole_true_"):
        for name, value in zip(names, place, strict=True):
            assert (traces[f"{prefix}{name}"] == value).all()
    # All of it is the peg's.
    moved = traces["peg_z"] - traces["peg_z"][0]
    np.testing.assert_allclose(moved, traces["compensation_z"], rtol=0, atol=1e-12)
    assert "hole_q1" not in traces
    assert "hole_saturated" not in traces


def test_with_one_arm_the_compensation_is_the_peg_s() -> None:
    assert resolve(CELL).compensated == "peg"
    assert resolve(AlignmentScenario()).compensated == "both"
    assert resolve(replace(CELL, compensated="none")).compensated == "none"
    for value in ("hole", "both"):
        with pytest.raises(ParameterError, match=f"^compensated is '{value}', allowed: peg, none"):
            replace(CELL, compensated=value)


SIX_JOINTS = Path(__file__).parents[2] / "models/arms/six_joints.urdf"
OTHER: dict[str, Any] = {
    "base": Placement(position=(1.0, 0.0, 0.0)),
    "posture": (0.1,) * 7,
    "tool": replace(HOLE_ARM.tool, mass=1.0),
    "payload_error": 0.2,
    "payload_position": (0.0, 0.0, 0.0),
    "mass_scale": 1.1,
    "base_error": Placement(rpy=(0.0, 0.1, 0.0)),
    "joint_friction": (0.0,) * 7,
    "rotor_inertia": (0.1,) * 7,
    "model": str(SIX_JOINTS),
}


def test_all_fields_of_an_arm_are_looked_at() -> None:
    assert {one.name for one in fields(ArmSettings)} == {*OTHER, "tool_frame"}


@pytest.mark.parametrize("name", OTHER)
def test_what_only_an_arm_has_is_refused(name: str) -> None:
    with pytest.raises(ParameterError, match=rf"^hole\.{name} is .*, a fixture is no arm$"):
        WorkCellScenario(hole=replace(FIXTURE, **{name: OTHER[name]}))
    WorkCellScenario(hole=replace(HOLE_ARM, **{name: OTHER[name]}))


def test_fields_are_compared_with_the_scenario_s_own_defaults() -> None:
    hole = replace(VerticalTrackingScenario().hole, kind="fixture")
    assert VerticalTrackingScenario(hole=hole).arms == ("peg",)
    with pytest.raises(ParameterError, match=r"^hole\.payload_error is 0\.0865, allowed: 0\.0, a"):
        VerticalTrackingScenario(hole=FIXTURE)


def test_kinds() -> None:
    with pytest.raises(ParameterError, match=r"^kind is 'table', allowed: arm, fixture$"):
        replace(HOLE_ARM, kind="table")


@given(seed=st.integers(0, 2**63 - 1), trial=st.integers(0, 1000))
def test_the_peg_s_errors_are_drawn_as_with_two_arms(seed: int, trial: int) -> None:
    one, two = (
        drawn(AlignmentTrialsScenario(hole=hole), Spread(), seed, trial)
        for hole in (FIXTURE, HOLE_ARM)
    )
    assert one.hole == FIXTURE
    assert one.peg == two.peg
    assert one.initial_error == two.initial_error


def test_a_run_can_be_replayed(traces: Traces) -> None:
    short = {name: values[:2] for name, values in traces.items()}
    meshcat = Meshcat(MeshcatParams(host="localhost", port=0))
    replay_alignment(CELL, Outcome(metrics={}, traces=short, simulated_seconds=0.0), meshcat)
    assert meshcat.HasPath("/drake/cell/hole_fixture/fixture")
    assert not meshcat.HasPath("/drake/cell/hole_arm")
