"""The charging cycle's chart, told what a scenario wants it to believe."""

from dataclasses import replace
from typing import Final

from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.models.charging.packing import places
from chamfer.systems.charging.charging_chart import ChargingChart, make_charging_chart
from chamfer.systems.charging.charging_params import ChargingBeliefs

_PAST: Final = 1.2  # of the way to the index marks, that homing goes


def beliefs_of(scenario: CrucibleChargingScenario) -> ChargingBeliefs:
    """Return what a resolved scenario's cycle knows of the cell."""
    arm, station = scenario.ARM, scenario.station.believed
    error, distance = scenario.homing.for_joints(arm.num_joints)
    shown = arm.joint_positions(scenario.start, scenario.arm.elbow) + error
    nuggets = tuple(
        replace(item.believed_nugget, mass=held.mass)
        for item, held in zip(scenario.plan, scenario.nuggets, strict=True)
    )
    return ChargingBeliefs(
        station=station,
        plan=scenario.plan,
        nuggets=nuggets,
        places=places(scenario.plan, station, believed=True),
        start=tuple(arm.endpoint(shown).tolist()),
        home=tuple(arm.endpoint(shown + _PAST * distance).tolist()),
    )


def chart_of(scenario: CrucibleChargingScenario) -> ChargingChart:
    """Return a resolved scenario's chart."""
    return make_charging_chart(scenario.charging, beliefs_of(scenario))
