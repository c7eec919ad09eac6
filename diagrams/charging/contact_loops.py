"""The charging loop where a nugget touches, as hybrid loops whose stability can be told."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np

from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.diagrams.charging.wrist_control import SENSING
from chamfer.diagrams.contact.hybrid_loop_stability import (
    LinearLoop,
    Stability,
    linear_loops,
    require_stable,
    stability_of,
)
from chamfer.diagrams.contact.hybrid_scenario import (
    ContactArmSettings,
    HybridScenario,
    SlidingTask,
    fill,
)
from chamfer.diagrams.contact.sensing import Sensing, SensingValues
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm
from chamfer.models.charging.nugget import Nugget
from chamfer.models.charging.packing import Place, places
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.arm_in_contact import ContactParams

Vector3 = tuple[float, float, float]

_BEFORE: Final = 0.01  # m, from where the approach is looked at
_SWING: Final = 0.01  # m, by which the nugget slides up and down where the loop is looked at
_DOWN: Final = (0.0, 0.0, -1.0)
_STILL: Final = (0.0, 0.0, 0.0, 0.0)  # the other coordinates


@dataclass(frozen=True, kw_only=True)
class NuggetLoop(HybridScenario):
    """The Adept with its wrist, pressing a nugget on a surface."""

    ARM: ClassVar[Arm] = ADEPT_WRIST
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = SENSING

    touched: Surface
    task: SlidingTask

    @property
    def distance(self) -> float:
        """Distance from the start to where the nugget should touch, m."""
        return _BEFORE

    def make_surface(self) -> Surface:
        """Return what the nugget touches."""
        return self.touched


def contact_loops(scenario: CrucibleChargingScenario) -> tuple[NuggetLoop, ...]:
    """Return the loops in which the plan's nuggets are pressed on something.

    A wall nugget slides along the wall at its place; a crown nugget is pressed on what lies below.
    Both as the world is.

    Args:
        scenario: What it leaves open is filled in.
    """
    station, charging = scenario.station.true, scenario.charging
    wall = station.wall(lean=scenario.wall.lean)
    goals = places(scenario.plan, station, believed=False)
    loops = []
    for item, nugget, goal in zip(scenario.plan, scenario.nuggets, goals, strict=True):
        ahead = (math.cos(goal.azimuth), math.sin(goal.azimuth), 0.0)
        if item.kind == "wall":
            meets = _Meeting(nugget.wall_point, wall, scenario.wall, charging.wall_force)
            loops.append(fill(_loop(scenario, nugget, goal, meets, ahead, _DOWN)))
        elif item.kind == "crown":
            layer = station.layer(goal.position, goal.layer, tilt=scenario.layer.tilt)
            meets = _Meeting(nugget.layer_point, layer, scenario.layer, charging.layer_force)
            loops.append(fill(_loop(scenario, nugget, goal, meets, _DOWN, ahead)))
    return tuple(loops)


def charging_stability(scenario: CrucibleChargingScenario) -> Stability | None:
    """Return growth and margins, the worst of all nuggets; None if none is pressed on anything.

    Raises:
        ParameterError: If a place is out of reach.
    """
    linear: list[LinearLoop] = []
    for loop in contact_loops(scenario):
        linear += linear_loops(loop)
    return stability_of(tuple(linear)) if linear else None


def require_stable_contacts(scenario: CrucibleChargingScenario) -> None:
    """Refuse a loop that is unstable, or warn of it with ``controller.allow_unstable``.

    Raises:
        ParameterError: If a loop would be unstable and may not be, or a place is out of reach.
    """
    for loop in contact_loops(scenario):
        require_stable(loop)


class _Meeting(NamedTuple):
    """Where and on what a nugget is pressed."""

    point: tuple[float, float, float]  # m, of the nugget, in the endpoint's frame
    surface: Surface
    material: ContactParams
    force: float  # N


def _loop(
    scenario: CrucibleChargingScenario,
    nugget: Nugget,
    goal: Place,
    meets: _Meeting,
    ahead: Vector3,
    along: Vector3,
) -> NuggetLoop:
    """Return the loop of a nugget at its place, pushed ahead and moved along."""
    height = goal.layer + nugget.height
    start = np.array([*goal.position, height, goal.azimuth, 0.0, 0.0, scenario.charging.lean])
    start[:3] -= _BEFORE * np.array(ahead)
    return NuggetLoop(
        arm=ContactArmSettings(
            joint_friction=scenario.arm.joint_friction,
            elbow=scenario.arm.elbow,
            contact_offset=meets.point,
        ),
        gripper=scenario.gripper,
        touched=meets.surface,
        surface=meets.material,
        task=SlidingTask(
            start=tuple(start.tolist()),
            direction=(*ahead, *_STILL),
            along=(*along, *_STILL),
            speed=scenario.charging.seek_speed,
            force=meets.force,
            amplitude=_SWING,
        ),
        controller=scenario.controller,
        sensing=scenario.sensing,
        sensor=scenario.sensor,
        encoders=scenario.encoders,
        friction_compensation=scenario.friction_compensation,
        step=scenario.step,
    )
