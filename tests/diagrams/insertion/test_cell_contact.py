"""Peg and hole in the work cell: what can touch, and what is read where they do."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.diagrams.cell.work_cell import HOLE_ARM, HoleKind, HoleSettings, WorkCellScenario
from chamfer.diagrams.insertion.cell_contact import (
    CellInContact,
    add_cell_in_contact,
    export_contact,
)
from chamfer.models.peg.bore_contact import ContactMaterial, facets_needed
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.contact.peg_hole_contact_monitor import ContactState
from chamfer.systems.pose import pose_vector

PARTS = PegAndHole()
MATERIAL = ContactMaterial()


def build(
    gap: float, hole: HoleSettings = HOLE_ARM, material: ContactMaterial = MATERIAL
) -> tuple[Diagram, CellInContact]:
    """Return the cell at rest at a gap."""
    scenario = WorkCellScenario(gap=gap, hole=hole)
    builder = DiagramBuilder()
    found = add_cell_in_contact(
        builder, scenario, PARTS, seated_depth=0.036, material=material.over(PARTS)
    )
    for arm in scenario.arms:
        pose = ConstantVectorSource(pose_vector(scenario.nominal_pose(arm)))
        builder.Connect(
            builder.AddSystem(pose).get_output_port(), found.cell.arms[arm].desired_pose
        )
    export_contact(builder, found.contact)
    return builder.Build(), found


def read(diagram: Diagram, context: Context, name: str) -> np.ndarray:
    value: np.ndarray = diagram.GetOutputPort(f"contact.{name}").Eval(context)
    return value


def test_only_the_peg_against_the_hole_can_touch() -> None:
    diagram, _ = build(0.03)
    inspector = diagram.GetSubsystemByName("geometry").model_inspector()
    pairs = inspector.GetCollisionCandidates()
    assert len(pairs) == facets_needed(PARTS)
    for pair in pairs:
        names = sorted(inspector.GetName(one).rpartition("::")[2].split()[0] for one in pair)
        assert names == ["peg", "wedge"]


@pytest.mark.parametrize("kind", get_args(HoleKind))
def test_a_peg_in_the_bore_is_pushed_back_by_the_wall_that_it_leans_on(kind: HoleKind) -> None:
    diagram, found = build(-0.02, replace(HOLE_ARM, kind=kind))  # in the bore, in line
    simulator = Simulator(diagram)
    simulator.Initialize()
    plant = found.cell.plant
    context = plant.GetMyContextFromRoot(simulator.get_context())
    q = plant.GetPositions(context)
    q[0] += 0.0004  # rad, about the vertical: 0.3 mm to +y, where the clearance is less
    plant.SetPositions(context, q)
    simulator.AdvanceTo(0.002)
    root = simulator.get_context()
    assert read(diagram, root, "state") in (ContactState.ONE_POINT, ContactState.TWO_POINT)
    assert read(diagram, root, "wrench")[4] < -0.01
    assert read(diagram, root, "depth") == pytest.approx(0.02, abs=1e-3)
