"""Fills in what a charging scenario leaves to be derived, and checks it."""

from dataclasses import replace

import numpy as np

from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.diagrams.charging.contact_loops import require_stable_contacts
from chamfer.diagrams.contact.sensing import computer_of, encoders_of, push_errors, sensor_of
from chamfer.models.charging.packing import places
from chamfer.models.validation import within

_TIME_EACH = 60.0  # s, that an item may take


def resolve(scenario: CrucibleChargingScenario) -> CrucibleChargingScenario:
    """Return the scenario with what it leaves open filled in, and checked.

    Sensors and computer are what ``sensing`` says. The controller knows gravity at the start, as
    a constant, and the arm's whole model.

    Raises:
        ParameterError: If blocks refuse their parameters, an item does not fit into the crucible,
            the arm can't reach a place, or a nugget's contact would be unstable and
            ``controller.allow_unstable`` is not set.
    """
    values = scenario.SENSING[scenario.sensing]
    q = scenario.ARM.joint_positions(scenario.start, scenario.arm.elbow)
    control = computer_of(scenario.controller, values)
    if control.feedforward_torque is None:
        gravity = scenario.dynamics().gravity_torque(q)
        control = replace(control, feedforward_torque=tuple(gravity.tolist()))
    with within("sensor"):
        sensor = sensor_of(scenario.sensor, values)
    with within("encoders"):
        encoders = encoders_of(scenario.encoders, values)
        encoders.quanta(len(q))
    compensation = scenario.friction_compensation
    if compensation is not None:
        with within("friction_compensation"):
            compensation.compensated(len(q))
            compensation = compensation.filled(scenario.sensing)
    charging = scenario.charging
    with within("charging.detection"):
        R_WE = scenario.dynamics().orientation(q)
        detection = charging.detection.resolved(*push_errors(sensor, np.eye(7)[0], R_WE))
    for station, believed in ((scenario.station.believed, True), (scenario.station.true, False)):
        places(scenario.plan, station, believed=believed)  # refuses what does not fit
    duration = scenario.duration
    if duration is None:
        duration = _TIME_EACH * len(scenario.plan)
    found = replace(
        scenario,
        controller=control,
        sensor=sensor,
        encoders=encoders,
        friction_compensation=compensation,
        charging=replace(charging, detection=detection),
        duration=duration,
    )
    require_stable_contacts(found)
    return found
