"""The scenario of the servo loops: its fields, and the derivation of open values."""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from chamfer.models.plants.linear_response import fastest_mode
from chamfer.models.plants.servo_plant import Form, SpringMassDamperParams
from chamfer.models.validation import (
    ParameterError,
    require_one_of,
    require_positive,
    within,
)
from chamfer.systems.servo.compensator_law import AxisParams, OpenAxisParams
from chamfer.systems.servo.desired_trajectory import Sinusoid, Step
from chamfer.systems.servo.pid import PidParams
from chamfer.systems.servo.pid_law import PidGains
from chamfer.systems.servo.sampled_pid import lag_and_dead_time, tuned_gains
from chamfer.systems.servo.servo_plant import make_spring_mass_damper
from chamfer.systems.servo.settling import (
    SettlingPlant,
    allowed_axis,
    approach_time,
    sample_plant,
)
from chamfer.systems.vision.measured_error import CameraErrorParams, MeasuredErrorParams

RADIANS_PER_STEP = 0.05  # of the fastest mode: a peak between two steps is 0.03 % higher at most
_LEAST_STEPS = 10  # of a run
_MOST_STEPS = 5_000_000  # its traces have a row per step
_LEAST_DURATION = 2.5  # s, section 5
_CLOSED_LOOP = 4.0  # dead times, of the PID that is designed for the camera
_AT_REST = 0.2  # of the run, at its end, in which the loop should be at rest


@dataclass(frozen=True, kw_only=True)
class PlantParams(SpringMassDamperParams):
    """The plant of the FSM loop; the PID always drives the force-to-velocity form, as eq. (2)."""

    form: Form = "position"  # velocity: the plant that the paper names; compliance: force in

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "form", ("position", "velocity", "compliance"))


@dataclass(frozen=True, kw_only=True)
class FsmParams(OpenAxisParams):
    """The state machine compensator; None follows from the settling theorem.

    Increment and limit are in m, with a plant that is driven by a force in N; without a DC gain
    there is no limit unless it is set.
    """

    dead_zone: float = 0.01  # m, 1 % of the step, assumed
    period: float = 1 / 80  # s, between two ticks; section 4
    feedforward: bool | None = None
    # the desired trajectory goes to the plant too, as on the robot, which needs a plant in
    # position form; None: for a sinusoid, not for a step

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "period")


@dataclass(frozen=True, kw_only=True)
class CameraParams(CameraErrorParams):
    """The camera's errors; its period is the FSM's."""

    resolution: float = 0.005  # m, 0.5 % of the step, assumed


@dataclass(frozen=True, kw_only=True)
class ServoScenario:
    """A desired trajectory and the loops that follow it."""

    desired: Step | Sinusoid
    plant: PlantParams = field(default_factory=PlantParams)
    pid: PidParams = field(default_factory=PidParams)
    fsm: FsmParams = field(default_factory=FsmParams)
    camera: CameraParams = field(default_factory=CameraParams)
    duration: float | None = None  # s, of the run; None: until the FSM is at rest, or two periods
    step: float | None = None
    # s, of the traces, the FSM's period over a power of two; None: small enough for the plant

    def __post_init__(self) -> None:
        require_positive(self, "duration", "step")
        if self.fsm.feedforward and self.plant.form != "position":
            raise ParameterError(
                "fsm.feedforward", True, f"false with plant.form={self.plant.form}"
            )
        bound = self.measurement.bound
        if not self.fsm.dead_zone > bound:
            raise ParameterError(
                "fsm.dead_zone",
                self.fsm.dead_zone,
                f"more than the camera's error, resolution/2 + noise = {bound:g}",
            )

    @property
    def measurement(self) -> MeasuredErrorParams:
        """The computer vision block of the FSM loop."""
        with within("camera"):
            return MeasuredErrorParams(period=self.fsm.period, **vars(self.camera))


@dataclass(frozen=True, kw_only=True)
class StepScenario(ServoScenario):
    """Fig. 8: a step as desired trajectory."""

    desired: Step = field(default_factory=Step)


@dataclass(frozen=True, kw_only=True)
class SinusoidScenario(ServoScenario):
    """Fig. 9: a sinusoid as desired trajectory."""

    desired: Sinusoid = field(default_factory=Sinusoid)


STEP: Final = StepScenario()
SINUSOID: Final = SinusoidScenario()


@dataclass(frozen=True, kw_only=True)
class ResolvedFsmParams(FsmParams):
    """The state machine compensator with nothing left open; no limit means no bound."""

    increment: float = field()
    large_error: float = field()
    feedforward: bool = field()


@dataclass(frozen=True, kw_only=True)
class ResolvedServoScenario(ServoScenario):
    """A desired trajectory and the loops that follow it, with nothing left open."""

    fsm: ResolvedFsmParams = field()
    duration: float = field()
    step: float = field()

    @property
    def axis(self) -> AxisParams:
        """The compensator's parameters on the plant of the scenario's own form."""
        return fsm_axis(self, self.plant.form)

    @property
    def frequency(self) -> float:
        """Of the sinusoid, rad/s."""
        if isinstance(self.desired, Step):
            raise ParameterError("desired", "a step", "a sinusoid")
        return self.desired.frequency


def settling_plant(scenario: ServoScenario, form: Form) -> SettlingPlant:
    """Return the FSM's plant, with the camera's latency, as the settling theorem sees it."""
    return sample_plant(
        make_spring_mass_damper(scenario.plant, form),
        scenario.fsm.period,
        delay_samples=scenario.measurement.delay_samples,
        owner="fsm.",
    )


def fsm_axis(scenario: ServoScenario, form: Form) -> AxisParams:
    """Return the compensator's parameters on a plant of that form, open ones filled in.

    With a DC gain they follow from the settling theorem. The velocity form has none and holds a
    level only while something is added at every tick: there the large increment is what holds
    the amplitude less two dead zones, and the error that remains is large. More overshoots, less
    holds less.
    """
    fsm, amplitude = scenario.fsm, abs(scenario.desired.amplitude)
    if form != scenario.plant.form:
        fsm = replace(fsm, increment=None, large_error=None, limit=None)
    if form == "velocity":
        held = max(amplitude - 2 * fsm.dead_zone, fsm.dead_zone)
        axis = AxisParams(
            dead_zone=fsm.dead_zone,
            large_error=2 * fsm.dead_zone,
            increment=fsm.increment or scenario.plant.stiffness * fsm.period * held,
            divider=fsm.divider,
            limit=fsm.limit or math.inf,
        )
    else:
        plant = settling_plant(scenario, form)
        axis = allowed_axis(
            plant,
            dead_zone=fsm.dead_zone,
            measurement_error=scenario.measurement.bound,
            divider=fsm.divider,
            increment=fsm.increment,
            limit=fsm.limit or 2 * max(amplitude, fsm.dead_zone) / plant.gain,
        )
    return replace(axis, large_error=fsm.large_error or axis.large_error)


def camera_gains(scenario: ServoScenario) -> PidGains:
    """Return the PI by Skogestad's rules for the camera and the plant in position form.

    Its closed loop has a time constant of four dead times: of whole ones the least with which the
    step of Fig. 8 does not overshoot.
    """
    plant, period = settling_plant(scenario, "position"), scenario.fsm.period
    _, dead = lag_and_dead_time(plant, period)
    return tuned_gains(plant, closed_loop=_CLOSED_LOOP * dead, period=period)


def has_feedforward(scenario: ServoScenario) -> bool:
    """Return whether the desired trajectory goes to the FSM's plant too.

    The paper does not say so of the sinusoid, but without it increments that settle are too slow.
    """
    if scenario.fsm.feedforward is not None:
        return scenario.fsm.feedforward
    return isinstance(scenario.desired, Sinusoid) and scenario.plant.form == "position"


def resolve(scenario: ServoScenario) -> ResolvedServoScenario:
    """Return the scenario with every open value filled in, if step and duration can be."""
    axis = fsm_axis(scenario, scenario.plant.form)
    step = _step(scenario)
    duration = scenario.duration or _duration(scenario, axis)
    if not _LEAST_STEPS <= duration / step <= _MOST_STEPS:
        raise ParameterError(
            "duration",
            duration,
            f"{_LEAST_STEPS} to {_MOST_STEPS} steps of {step:g} s, the step can be set",
        )
    found = {
        "increment": axis.increment,
        "large_error": axis.large_error,
        "limit": axis.limit if math.isfinite(axis.limit) else None,
        "feedforward": has_feedforward(scenario),
    }
    fsm = ResolvedFsmParams(**vars(scenario.fsm) | found)
    return ResolvedServoScenario(
        **vars(scenario) | {"fsm": fsm, "duration": duration, "step": step}
    )


def _step(scenario: ServoScenario) -> float:
    """Return the step, s: at a step, not at a sinusoid, no peak is missed between two of them."""
    period = scenario.fsm.period
    if isinstance(scenario.desired, Sinusoid):
        longest, usual = period, 2 * math.pi / scenario.desired.frequency / 2000
    else:
        forms: set[Form] = {scenario.plant.form, "velocity"}
        plants = [make_spring_mass_damper(scenario.plant, form) for form in forms]
        fastest = [
            fastest_mode(plant.A(), plant.C()[0], np.linalg.solve(plant.A(), plant.B())[:, 0])
            for plant in plants
        ]
        longest, usual = min(period, RADIANS_PER_STEP / max(fastest)), 4e-4
    wanted = min(longest, scenario.step or usual)
    # Steps that are the period over a power of two meet the ticks exactly in floating point.
    halvings = max(0, math.ceil(math.log2(period / wanted) - 1e-9))
    step: float = period / 2.0**halvings
    if scenario.step is not None and scenario.step != step:
        raise ParameterError(
            "step",
            scenario.step,
            f"fsm.period over a power of two, such as {step!r}, at most {longest:.3g}",
        )
    return step


def _duration(scenario: ServoScenario, axis: AxisParams) -> float:
    if isinstance(scenario.desired, Sinusoid):
        return 4 * math.pi / scenario.desired.frequency
    if scenario.plant.form == "velocity":
        return _LEAST_DURATION
    plant = settling_plant(scenario, scenario.plant.form)
    needed = approach_time(axis, plant, scenario.desired.amplitude, scenario.fsm.period)
    return max(_LEAST_DURATION, math.ceil(2 * needed / (1 - _AT_REST)) / 2)
