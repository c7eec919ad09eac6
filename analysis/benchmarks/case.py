"""The numbers of the two loops, and the law that every engine gives its state machine."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.servo.servo_scenario import StepScenario, resolve

Samples = NDArray[np.float64]

_DURATION: Final = 2.5  # s, section 5
_PID_STEP: Final = 1e-3  # s, of the output of the PID loop


@dataclass(frozen=True, kw_only=True)
class Case:
    """A resolved step scenario as the plain numbers that the other engines' models take."""

    scenario: StepScenario

    @property
    def amplitude(self) -> float:
        """Height of the step, m."""
        return self.scenario.desired.amplitude

    @property
    def duration(self) -> float:
        """Length of the run, s."""
        return self.scenario.duration or _DURATION

    @property
    def period(self) -> float:
        """Time between the state machine's ticks, s."""
        return self.scenario.fsm.period

    @cached_property
    def pid_time(self) -> Samples:
        """Times, s, at which the PID loop's output is wanted."""
        return _grid(self.duration, _PID_STEP)

    @cached_property
    def fsm_time(self) -> Samples:
        """Times, s, at which the FSM loop's output is wanted: the ticks."""
        return _grid(self.duration, self.period)

    @cached_property
    def dynamics(self) -> Samples:
        """Matrix of the mass on spring and damper, state (position m, velocity m/s)."""
        m, b, k = self.mass_damping_stiffness
        return np.array([[0.0, 1.0], [-k / m, -b / m]])

    @property
    def mass_damping_stiffness(self) -> tuple[float, float, float]:
        """The plant's m kg, b N s/m and k N/m."""
        plant = self.scenario.plant
        return plant.mass, plant.damping, plant.stiffness

    @property
    def gains(self) -> tuple[float, float, float, float]:
        """P, I, D and N of eq. (2)."""
        pid = self.scenario.pid
        return pid.proportional, pid.integral, pid.derivative, pid.filter

    @cached_property
    def _law(self) -> tuple[float, float, float, float, float, float]:
        fsm = self.scenario.fsm
        if fsm.increment is None or fsm.large_error is None or fsm.limit is None:
            raise ValueError("the scenario has open values, resolve it first")
        return (
            self.scenario.camera.resolution,
            fsm.dead_zone,
            fsm.large_error,
            fsm.increment,
            fsm.increment / fsm.divider,
            fsm.limit,
        )

    def compensate(self, compensation: float, error: float) -> float:
        """Return the compensation, m, after a tick that finds this true error, m.

        The camera rounds the error to its resolution; Fig. 4 decides by what it shows.
        """
        resolution, dead_zone, large_error, large, small, limit = self._law
        measured = resolution * math.floor(error / resolution + 0.5)
        if abs(measured) < dead_zone:
            return compensation
        increment = large if abs(measured) >= large_error else small
        return max(-limit, min(limit, compensation + math.copysign(increment, measured)))


def make_case(duration: float = _DURATION) -> Case:
    """Return the default step scenario over a duration, s."""
    return Case(scenario=resolve(replace(StepScenario(), duration=duration)))


def _grid(duration: float, step: float) -> Samples:
    grid: Samples = np.arange(round(duration / step) + 1, dtype=np.float64) * step
    return grid
