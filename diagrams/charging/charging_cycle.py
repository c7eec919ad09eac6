"""The charging cycle's chart, told what a scenario wants it to believe."""

from dataclasses import replace

import numpy as np

from diagrams.charging.charging_scenario import CrucibleChargingScenario
from models.charging.packing import places
from systems.charging.charging_chart import ChargingChart, make_charging_chart
from systems.charging.charging_machine import ChargingMachine
from systems.charging.charging_params import ChargingBeliefs

_HOMING = np.array([0.0, 0.02, 0.02, 0.05, 0.0, 0.0, 0.0])  # m and rad, to the index marks


def beliefs_of(scenario: CrucibleChargingScenario) -> ChargingBeliefs:
    """Return what a resolved scenario's cycle knows of the cell."""
    station, start = scenario.station.believed, scenario.start
    nuggets = tuple(
        replace(item.believed_nugget, mass=held.mass)
        for item, held in zip(scenario.plan, scenario.nuggets, strict=True)
    )
    return ChargingBeliefs(
        station=station,
        plan=scenario.plan,
        nuggets=nuggets,
        places=places(scenario.plan, station, believed=True),
        start=tuple(start.tolist()),
        home=tuple((start + _HOMING).tolist()),
    )


def make_machine(scenario: CrucibleChargingScenario) -> ChargingMachine:
    """Return the block that runs a resolved scenario's cycle."""
    return ChargingMachine(scenario.charging, beliefs_of(scenario))


def chart_of(scenario: CrucibleChargingScenario) -> ChargingChart:
    """Return a resolved scenario's chart."""
    return make_charging_chart(scenario.charging, beliefs_of(scenario))
