"""What a hybrid position/force loop's scenario leaves open: what is told, and what sensors do."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from chamfer.diagrams.contact.hybrid_scenario import ControllerSettings, HybridScenario
from chamfer.diagrams.contact.sensing import SensingValues, detection_of, encoders_of, sensor_of
from chamfer.models.validation import known, within
from chamfer.systems.sensing.computation_delay import require_within_period

HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


def filled(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return the scenario with all that it leaves open, stable or not.

    Sensors and computer are what ``sensing`` says. The controller knows gravity at the start, as
    a constant (section 2.1.2), and with full dynamics the inertia where it should touch.

    Raises:
        ParameterError: If blocks refuse their parameters, or the arm can't reach the task.
    """
    return _sensed(replace(scenario, controller=_told(scenario)))


def computer_of(control: ControllerSettings, values: SensingValues) -> ControllerSettings:
    """Return the controller with what it leaves open of its computer.

    Raises:
        ParameterError: If the torque would be later than a period.
    """
    if control.computation_delay is None:
        control = replace(control, computation_delay=values.computation_delay)
    if control.computation_jitter is None:
        # no more than what an own delay leaves room for
        delay = known("computation_delay", control.computation_delay)
        room = min(delay, control.period - delay)
        control = replace(control, computation_jitter=min(values.computation_jitter, room))
    with within("controller"):
        require_within_period(
            known("computation_delay", control.computation_delay),
            known("computation_jitter", control.computation_jitter),
            control.period,
        )
    return control


def _sensed(scenario: HybridScenarioT) -> HybridScenarioT:
    values = scenario.SENSING[scenario.sensing]
    q = scenario.joint_positions(scenario.touching)
    control = computer_of(scenario.controller, values)
    with within("sensor"):
        sensor = sensor_of(scenario.sensor, values)
    with within("encoders"):
        encoders = encoders_of(scenario.encoders, values)
        encoders.quanta(len(q))
    with within("detection"):
        R_WE = scenario.dynamics().orientation(q)
        detection = detection_of(scenario.detection, sensor, scenario.direction, R_WE)
    return replace(
        scenario, controller=control, sensor=sensor, encoders=encoders, detection=detection
    )


def _told(scenario: HybridScenario) -> ControllerSettings:
    controller, dynamics = scenario.controller, scenario.dynamics()
    if controller.feedforward_torque is None:
        q = scenario.joint_positions(np.array(scenario.task.start))
        gravity = dynamics.gravity_torque(q)
        controller = replace(controller, feedforward_torque=tuple(gravity.tolist()))
    if controller.full_dynamics and controller.inertia is None:
        q = scenario.joint_positions(scenario.touching)
        mass = dynamics.evaluate(q, np.zeros(len(q))).mass
        controller = replace(controller, inertia=tuple(np.diag(mass).tolist()))
    return controller
