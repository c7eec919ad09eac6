"""A view of the charging cell: arm, crucible, feeder, scanner, and the nuggets.

It is no part of a loop. Whoever has positions of joints and nuggets sets them and publishes.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    Cylinder,
    Ellipsoid,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Shape,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RpyFloatingJoint, SpatialInertia
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.charging.packing import ItemKind, LaidNugget, PlanItem
from chamfer.models.charging.station import Point, Station
from chamfer.models.peg.part_surfaces import part_shape

Array = NDArray[np.float64]
Colour = tuple[float, float, float, float]
_Show = Callable[[str, Shape, RigidTransform, Colour], None]

POSE: Final = 6  # roll, pitch, yaw, rad, then x, y, z, m, of a nugget's grip point

_SIDES: Final = 96  # corners of a circle
_BOTTOM: Final = 0.05  # m, of the crucible's below the bed; drawn by eye, as all that follows
_CORE: Final = 1e-4  # m, of its axis that is left out
_LEG: Final = 0.025  # m, radius of a table's leg
_PLATE: Final = (0.12, 0.12, 0.02)  # m, of feeder and scanner
_WAITING: Final = 0.085  # m, between nuggets that wait at the feeder
_SHOWN: Final = 3  # places of the queue
_SLIT: Final = 0.012  # m, of the scanner's light
_BELOW: Final = 0.025  # m, of the scanner under the nugget's lowest point
_PEBBLES: Final = 120  # of the bed
_PEBBLE: Final = 0.014  # m, semi-axis of one

_SILICA: Final[Colour] = (0.75, 0.85, 0.95, 0.30)
_STAND: Final[Colour] = (0.45, 0.47, 0.50, 1.0)
_BED: Final[Colour] = (0.33, 0.35, 0.39, 1.0)
_TABLE: Final[Colour] = (0.62, 0.55, 0.45, 1.0)
_SCANNER: Final[Colour] = (0.20, 0.22, 0.25, 1.0)
_LIGHT: Final[Colour] = (0.90, 0.15, 0.15, 1.0)
_LAID: Final[Colour] = (0.45, 0.48, 0.55, 1.0)
_NUGGETS: Final[dict[ItemKind, Colour]] = {
    "wall": (0.25, 0.38, 0.58, 1.0),
    "crown": (0.80, 0.50, 0.20, 1.0),
    "bulk": (0.45, 0.62, 0.45, 1.0),
}


class ChargingView(NamedTuple):
    """A diagram that shows the cell in Meshcat when it publishes."""

    diagram: Diagram
    plant: MultibodyPlant

    def positions(self, joints: Array, nuggets: Array) -> Array:
        """Return the plant's positions.

        Joints, rad and m, have the shape (k, 7), nuggets of the plan (k, items, POSE).
        """
        found = np.zeros((len(joints), self.plant.num_positions()))
        for i, name in enumerate(ADEPT_WRIST.joint_names):
            found[:, self.plant.GetJointByName(name).position_start()] = joints[:, i]
        for i in range(nuggets.shape[1]):
            first = self.plant.GetJointByName(_nugget(i)).position_start()
            found[:, first : first + POSE] = nuggets[:, i]
        return found


def make_charging_view(
    station: Station,
    plan: Sequence[PlanItem],
    meshcat: Meshcat,
    *,
    lean: float = 0.0,
    laid: Sequence[LaidNugget] = (),
) -> ChargingView:
    """Build the cell as shapes without contact, with the plan's true nuggets.

    The crucible stands off the vertical by ``lean``, rad, its top towards +x; ``laid`` is what
    lies in it already.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(str(ADEPT_WRIST.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    _add_station(plant, station, lean)
    for one in laid:
        plant.RegisterVisualGeometry(
            plant.world_body(),
            RigidTransform(RotationMatrix(one.rotation), np.array(one.middle)),
            Ellipsoid(*one.nugget.semi_axes),
            one.name,
            np.array(_LAID),
        )
    instance = plant.AddModelInstance("nuggets")
    any_inertia = SpatialInertia.SolidSphereWithMass(1.0, 1.0)  # nothing is simulated
    for i, item in enumerate(plan):
        nugget = item.true_nugget
        body = plant.AddRigidBody(_nugget(i), instance, any_inertia)
        plant.AddJoint(RpyFloatingJoint(_nugget(i), plant.world_frame(), body.body_frame()))
        plant.RegisterVisualGeometry(
            body,
            RigidTransform(np.array(nugget.centre)),
            Ellipsoid(*nugget.semi_axes),
            _nugget(i),
            np.array(_NUGGETS[item.kind]),
        )
    plant.Finalize()
    params = MeshcatVisualizerParams(prefix="charging")
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    diagram = builder.Build()
    diagram.set_name("Charging cell to look at")
    return ChargingView(diagram, plant)


def waiting_pose(station: Station, height: float, ahead: float) -> Array:
    """Return where a nugget of a height, m, waits at the feeder, shape (POSE,).

    ``ahead`` are before it, 0 for the one that is picked up next; a broken number while the queue
    moves up.
    """
    x, y, z = station.feeder
    return np.array([0.0, 0.0, 0.0, x - _WAITING * min(ahead, _SHOWN), y, z + height])


def _nugget(index: int) -> str:
    return f"nugget_{index + 1}"


def _add_station(plant: MultibodyPlant, station: Station, lean: float) -> None:
    def show(name: str, shape: Shape, X_WG: RigidTransform, colour: Colour) -> None:
        plant.RegisterVisualGeometry(plant.world_body(), X_WG, shape, name, np.array(colour))

    _show_crucible(show, station, lean)
    _show_bed(show, station)
    x, y, z = station.feeder
    row = (_SHOWN + 1) * _WAITING
    _show_table(show, "feeder", (x + _WAITING / 2 - row / 2, y, z), row, _PLATE[1], _TABLE)
    x, y, z = station.scanner
    length = station.scan_length + _PLATE[1]
    _show_table(show, "scanner", (x, y, z - _BELOW), _PLATE[0], length, _SCANNER)
    light = RigidTransform(np.array([x, y, z - _BELOW]))
    show("light", Box(0.9 * _PLATE[0], _SLIT, 2e-3), light, _LIGHT)


def _show_crucible(show: _Show, station: Station, lean: float) -> None:
    x, y = station.crucible_centre
    inner, low = station.crucible_radius, station.bed_height - _BOTTOM
    outer, base = inner + station.crucible_thickness, low - station.crucible_thickness
    # Its section, with the axis of the solid of revolution along x.
    profile = [
        (base, _CORE),
        (base, outer),
        (station.rim_height, outer),
        (station.rim_height, inner),
        (low, inner),
        (low, _CORE),
    ]
    upright = RigidTransform(RotationMatrix.MakeYRotation(-math.pi / 2))
    middle = np.array([x, y, station.bed_height])  # about which it leans, as the wall does
    leaning = RigidTransform(RotationMatrix.MakeYRotation(lean), middle)
    X_WG = leaning @ RigidTransform(np.array([0.0, 0.0, -station.bed_height])) @ upright
    show("crucible", part_shape(np.array(profile), _SIDES, "crucible"), X_WG, _SILICA)
    middle = RigidTransform(np.array([x, y, base / 2]))
    show("stand", Cylinder(0.8 * inner, base), middle, _STAND)


def _show_bed(show: _Show, station: Station) -> None:
    (x, y), inner, bed = station.crucible_centre, station.crucible_radius, station.bed_height
    middle = np.array([x, y, bed - (_BOTTOM + _PEBBLE) / 2])
    show("bed", Cylinder(inner - 1e-3, _BOTTOM), RigidTransform(middle), _BED)
    for i in range(_PEBBLES):  # on the spiral on which sunflower seeds stand
        radius = (inner - _PEBBLE) * math.sqrt((i + 0.5) / _PEBBLES)
        px, py = station.place(i * math.pi * (3 - math.sqrt(5)), radius)
        turn = RotationMatrix.MakeZRotation(1.7 * i)
        X_WG = RigidTransform(turn, np.array([px, py, bed - _PEBBLE / 2]))
        grey = 0.30 + 0.12 * math.sin(12.9 * i) ** 2
        shape = Ellipsoid(_PEBBLE, 0.8 * _PEBBLE, _PEBBLE / 2)
        show(f"pebble_{i + 1}", shape, X_WG, (grey, grey, grey + 0.04, 1.0))


def _show_table(
    show: _Show, name: str, top: Point, length: float, width: float, colour: Colour
) -> None:
    """Show a plate on a leg, by the middle of its top and its sizes along x and y, m."""
    x, y, z = top
    plate = RigidTransform(np.array([x, y, z - _PLATE[2] / 2]))
    show(name, Box(length, width, _PLATE[2]), plate, colour)
    under = z - _PLATE[2]
    leg = RigidTransform(np.array([x, y, under / 2]))
    show(f"{name}_leg", Cylinder(_LEG, under), leg, _STAND)
