"""Peg and hole in contact in the work cell: collision shapes and contact outputs."""

from collections.abc import Mapping
from typing import Final

from pydrake.geometry import SceneGraph
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
from chamfer.models.peg.bore_contact import ContactMaterial, add_hole_contact, add_peg_contact
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.contact.contact_approximation import Approximation, approximate
from chamfer.systems.contact.near_walls import NearWalls
from chamfer.systems.contact.peg_hole_contact_monitor import PegHoleContactMonitor

_IN_TOOL: Final = RigidTransform()  # the bodies' frames are those of peg and mouth


def add_cell_in_contact(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    parts: PegAndHole,
    *,
    seated_depth: float,
    material: ContactMaterial,
    approximation: Approximation = "lagged",
    start: dict[ArmName, RigidTransform] | None = None,
    add_parts: AddParts | None = None,
    controllers: Mapping[ArmName, System] | None = None,
) -> tuple[WorkCell, PegHoleContactMonitor]:
    """Add the work cell with a peg and a hole that touch each other, and nothing else does.

    ``start``, ``add_parts``, what is to be seen, and ``controllers`` are as of
    :func:`chamfer.diagrams.cell.work_cell.add_work_cell`, the others as of
    :class:`TouchingParts`.
    """
    touching = TouchingParts(parts, material, approximation)

    def add(plant: MultibodyPlant, tools: dict[ArmName, RigidBody]) -> None:
        if add_parts is not None:
            add_parts(plant, tools)
        touching.add(plant, tools["peg"], tools["hole"])

    cell = add_work_cell(builder, scenario, start=start, add_parts=add, controllers=controllers)
    return cell, touching.monitor(builder, cell.plant, seated_depth)


class TouchingParts:
    """Peg and hole of a plant, in the frames of two bodies; the material has its facets."""

    def __init__(
        self, parts: PegAndHole, material: ContactMaterial, approximation: Approximation
    ) -> None:
        self._parts, self._material, self._approximation = parts, material, approximation

    def add(self, plant: MultibodyPlant, peg: RigidBody, hole: RigidBody) -> None:
        """Add the collision shapes, before the plant is finalized."""
        approximate(plant, self._approximation)
        self._peg, self._hole = peg, hole
        of = _IN_TOOL, self._parts, self._material
        self._peg_shapes = add_peg_contact(plant, peg, *of)
        self._hole_shapes = add_hole_contact(plant, hole, *of)

    def monitor(
        self, builder: DiagramBuilder, plant: MultibodyPlant, seated_depth: float
    ) -> PegHoleContactMonitor:
        """Add the block that outputs the contacts and the wrench in the mouth's frame.

        The peg is seated from ``seated_depth`` on, m, of the tip below the mouth.
        """
        near = None
        if self._parts.is_round:
            near = NearWalls(
                self._parts,
                next(one for one in builder.GetSystems() if isinstance(one, SceneGraph)),
                (self._peg, self._hole),
                self._peg_shapes,
                self._hole_shapes[: self._material.facets],
            ).after_steps
        contact: PegHoleContactMonitor = builder.AddNamedSystem(
            "contact",
            PegHoleContactMonitor(
                self._parts,
                peg=self._peg,
                hole=self._hole,
                peg_shapes=self._peg_shapes,
                seated_depth=seated_depth,
                after_steps=near,
            ),
        )
        for name in ("contact_results", "body_poses"):
            builder.Connect(plant.GetOutputPort(name), contact.GetInputPort(name))
        return contact


def export_contact(
    builder: DiagramBuilder, contact: PegHoleContactMonitor, prefix: str = "contact."
) -> None:
    """Export the block's outputs, as ``contact.state`` and so on."""
    for i in range(contact.num_output_ports()):
        port = contact.get_output_port(i)
        builder.ExportOutput(port, f"{prefix}{port.get_name()}")
