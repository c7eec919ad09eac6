"""What the arm may touch while it charges a crucible, item by item."""

from dataclasses import replace
from typing import Final

from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.models.charging.packing import places
from chamfer.models.charging.station import Station
from chamfer.systems.contact.arm_in_contact import ContactPoint, Load, Scene

_FAR: Final = 10.0  # m, radius of a crucible whose wall is missing
_ABYSS: Final = 0.1  # m, by which a layer that is missing lies lower


def make_scenes(scenario: CrucibleChargingScenario) -> tuple[Scene, ...]:
    """Return two scenes an item: the gripper empty, then with the item in it.

    Empty, the fingers meet what stands in the feeder, or its ground where nothing does. With an
    item in the gripper it meets the wall with its side and the layer below with its bottom; what
    it stood on in the feeder no longer holds it. What lies in the crucible is what the plan has
    laid there before, where the plan wanted it, with the sizes that it has.

    Raises:
        ParameterError: If an item does not fit into the crucible.
    """
    station, fault = scenario.station.true, scenario.fault
    goals = places(scenario.plan, station, believed=False)
    standing = station.wall(lean=scenario.wall.lean)
    scenes = []
    for index, (nugget, goal) in enumerate(zip(scenario.nuggets, goals, strict=True)):
        hit = index == fault.item
        top = 0.0 if hit and fault.kind == "part_missing" else nugget.height
        grip = ContactPoint((0.0, 0.0, 0.0), station.tray(top), scenario.feeder)
        scenes.append(Scene((grip,)))
        wall = _far(station).wall() if hit and fault.kind == "wall_missing" else standing
        depth = _ABYSS if hit and fault.kind == "layer_missing" else 0.0
        layer = station.layer(goal.position, goal.layer - depth, tilt=scenario.layer.tilt)
        points = (
            ContactPoint(nugget.wall_point, wall, scenario.wall),
            ContactPoint(nugget.layer_point, layer, scenario.layer),
        )
        load = Load(nugget.mass, nugget.centre, nugget.inertia)
        scenes.append(Scene(points, load))
    return tuple(scenes)


def _far(station: Station) -> Station:
    """Return the station with a crucible whose wall is out of reach."""
    return replace(station, crucible_radius=_FAR)
