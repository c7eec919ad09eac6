"""The insertion to look at: the peg at its true place, and the part with the hole, see-through.

It is no part of a loop. Whoever has joints' positions sets them and publishes.
"""

from typing import Final, NamedTuple

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.diagrams.insertion.peg_insertion import PegInsertionScenario, add_sprung_peg
from chamfer.models.peg.part_surfaces import part_shape
from chamfer.models.peg.peg_and_hole import Colour, ColouredParts

_SIDES: Final = 96  # corners of a circle
_SEE_THROUGH: Final = 0.45  # opacity of the part with the hole


class PegInsertionView(NamedTuple):
    """A diagram that shows an insertion in Meshcat when it publishes."""

    diagram: Diagram
    plant: MultibodyPlant


def make_peg_insertion_view(scenario: PegInsertionScenario, meshcat: Meshcat) -> PegInsertionView:
    """Build peg and hole, and what draws them."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, scenario.step)
    peg = add_sprung_peg(plant, scenario)
    parts = scenario.parts
    hole = plant.world_body()
    for body, name, profile, colour, opacity in (
        (peg.body, "peg", parts.peg.closed_profile, ColouredParts.peg_colour, 1.0),
        (hole, "hole", parts.hole.closed_profile, ColouredParts.hole_colour, _SEE_THROUGH),
    ):
        shape = part_shape(profile, _SIDES, name, parts.section)
        plant.RegisterVisualGeometry(body, RigidTransform(), shape, name, _rgba(colour, opacity))
    plant.Finalize()
    MeshcatVisualizer.AddToBuilder(
        builder, scene_graph, meshcat, MeshcatVisualizerParams(prefix="insertion")
    )
    return PegInsertionView(builder.Build(), plant)


def _rgba(colour: Colour, opacity: float) -> np.ndarray:
    return np.array([*(channel / 255 for channel in colour), opacity])
