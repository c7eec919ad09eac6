"""Peg and hole that touch in the work cell: what collides there, and what is read of it."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder, System

from chamfer.diagrams.cell.work_cell import (
    AddParts,
    ArmName,
    WorkCell,
    WorkCellScenario,
    add_work_cell,
)
from chamfer.models.peg.bore_contact import (
    ContactMaterial,
    add_hole_contact,
    add_peg_contact,
)
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.contact.peg_hole_contact_monitor import PegHoleContactMonitor

_IN_TOOL: Final = RigidTransform()  # the tools' frames are those of peg and mouth


class CellInContact(NamedTuple):
    """What was added to a builder."""

    cell: WorkCell
    contact: PegHoleContactMonitor


def add_cell_in_contact(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    parts: PegAndHole,
    *,
    seated_depth: float,
    material: ContactMaterial,
    start: dict[ArmName, RigidTransform] | None = None,
    add_parts: AddParts | None = None,
    controllers: Mapping[ArmName, System] | None = None,
) -> CellInContact:
    """Add the work cell with a peg and a hole that touch each other, and nothing else does.

    Args:
        builder: Where to.
        scenario: The cell; its step is that of contact too.
        parts: Peg and hole.
        seated_depth: m, of the tip below the mouth; from there on the peg is seated.
        material: Stiffness of contact, with its facets known.
        start: As of :func:`chamfer.diagrams.cell.work_cell.add_work_cell`.
        add_parts: Likewise, for what is to be seen.
        controllers: Likewise, a user's own.

    Returns:
        The cell, and the block whose outputs are what touches and the wrench in the mouth's
        frame.
    """
    peg_shapes: list[GeometryId] = []
    hole_shapes: list[GeometryId] = []

    def add(plant: MultibodyPlant, tools: dict[ArmName, RigidBody]) -> None:
        if add_parts is not None:
            add_parts(plant, tools)
        peg_shapes.extend(add_peg_contact(plant, tools["peg"], _IN_TOOL, parts, material))
        hole_shapes.extend(add_hole_contact(plant, tools["hole"], _IN_TOOL, parts, material))

    cell = add_work_cell(builder, scenario, start=start, add_parts=add, controllers=controllers)
    plant = cell.plant
    contact = builder.AddNamedSystem(
        "contact",
        PegHoleContactMonitor(
            parts,
            peg=(cell.tools["peg"], _IN_TOOL),
            hole=(cell.tools["hole"], _IN_TOOL),
            peg_shapes=peg_shapes,
            hole_shapes=hole_shapes,
            seated_depth=seated_depth,
        ),
    )
    builder.Connect(
        plant.get_contact_results_output_port(), contact.GetInputPort("contact_results")
    )
    builder.Connect(plant.get_body_poses_output_port(), contact.GetInputPort("body_poses"))
    return CellInContact(cell, contact)


def export_contact(builder: DiagramBuilder, contact: PegHoleContactMonitor) -> None:
    """Export the block's outputs, as ``contact.state`` and so on."""
    for i in range(contact.num_output_ports()):
        port = contact.get_output_port(i)
        builder.ExportOutput(port, f"contact.{port.get_name()}")
