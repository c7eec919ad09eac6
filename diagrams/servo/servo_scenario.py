"""The scenario of the servo loops: what may be set, and how open values are filled in."""

import math
from dataclasses import dataclass, field, replace
from typing import TypeVar

from models.spring_mass_damper import Form, SpringMassDamperParams
from models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)
from systems.servo.compensator import AxisParams
from systems.servo.desired_trajectory import Sinusoid, Step
from systems.servo.pid import PidParams
from systems.servo.settling import (
    SettlingPlant,
    allowed_increment,
    allowed_large_error,
    approach_time,
    sample_plant,
)
from systems.servo.spring_mass_damper import make_spring_mass_damper
from systems.vision.measured_error import MeasuredErrorParams

_LEAST_STEPS = 10  # of a run
_MOST_STEPS = 5_000_000  # its traces have a row per step
_LEAST_DURATION = 2.5  # s, section 5
_AT_REST = 0.2  # of the run, at its end, in which the loop should be at rest


@dataclass(frozen=True, kw_only=True)
class PlantParams(SpringMassDamperParams):
    """The plant of the FSM loop; the PID always drives the force-to-velocity form, as eq. (2)."""

    form: Form = "position"  # velocity: what the paper says it simulated; compliance: force in

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "form", ("position", "velocity", "compliance"))


@dataclass(frozen=True, kw_only=True)
class FsmParams:
    """The state machine compensator; what is None follows from the settling theorem."""

    period: float = 1 / 80  # s, section 4
    dead_zone: float = 0.01  # m, 1 % of the step, assumed
    increment: float | None = None  # m (N with a plant driven by force), n of Fig. 4
    large_error: float | None = None  # m, from here on an error is large
    divider: float = 5.0  # Fig. 4
    limit: float | None = None  # m (N), bound on the total; without a DC gain None is no bound
    feedforward: bool = False  # position form: the desired trajectory goes to the plant too

    def __post_init__(self) -> None:
        require_positive(self, "period", "dead_zone")
        if not (math.isfinite(self.divider) and self.divider >= 1):
            raise ParameterError("divider", self.divider, "a finite number >= 1")
        for name in ("increment", "large_error", "limit"):
            if getattr(self, name) is not None:
                require_positive(self, name)
        if self.large_error is not None and self.large_error < self.dead_zone:
            raise ParameterError(
                "large_error", self.large_error, f"at least the dead zone, {self.dead_zone:g}"
            )


@dataclass(frozen=True, kw_only=True)
class CameraParams:
    """What the camera does to the error."""

    resolution: float = 0.005  # m, 0.5 % of the step, assumed
    latency: float = 0.0  # s, taken up to whole periods of the FSM
    noise: float = 0.0  # m, half-width of a uniform noise

    def __post_init__(self) -> None:
        require_not_negative(self, "resolution", "latency", "noise")


@dataclass(frozen=True, kw_only=True)
class ServoScenario:
    """A desired trajectory and the loops that follow it."""

    desired: Step | Sinusoid
    plant: PlantParams = field(default_factory=PlantParams)
    pid: PidParams = field(default_factory=PidParams)
    fsm: FsmParams = field(default_factory=FsmParams)
    camera: CameraParams = field(default_factory=CameraParams)
    duration: float | None = None  # s; None: until the FSM is at rest, or two periods
    step: float | None = None  # s, largest step of the traces; the loops are exact at any

    def __post_init__(self) -> None:
        for name in ("duration", "step"):
            if getattr(self, name) is not None:
                require_positive(self, name)
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
        return MeasuredErrorParams(
            period=self.fsm.period,
            resolution=self.camera.resolution,
            latency=self.camera.latency,
            noise=self.camera.noise,
        )


ScenarioT = TypeVar("ScenarioT", bound=ServoScenario)


@dataclass(frozen=True, kw_only=True)
class StepScenario(ServoScenario):
    """Fig. 8."""

    desired: Step = field(default_factory=Step)


@dataclass(frozen=True, kw_only=True)
class SinusoidScenario(ServoScenario):
    """Fig. 9; here the desired trajectory goes to the plant too, as on the robot.

    The paper does not say so, but without it increments that settle are too slow for it.
    """

    desired: Sinusoid = field(default_factory=Sinusoid)
    fsm: FsmParams = field(default_factory=lambda: FsmParams(feedforward=True))


def settling_plant(scenario: ServoScenario, form: Form) -> SettlingPlant:
    """Return the FSM's plant, with the camera's latency, as the settling theorem sees it."""
    try:
        return sample_plant(
            make_spring_mass_damper(scenario.plant, form),
            scenario.fsm.period,
            delay_samples=scenario.measurement.delay_samples,
        )
    except ParameterError as error:
        name = "fsm.period" if error.name == "period" else f"the plant's {error.name}"
        raise ParameterError(name, error.value, error.allowed) from error


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
        increment = fsm.increment or scenario.plant.stiffness * fsm.period * held
        large_error = fsm.large_error or 2 * fsm.dead_zone
        return AxisParams(
            dead_zone=fsm.dead_zone,
            large_error=large_error,
            increment=increment,
            divider=fsm.divider,
            limit=fsm.limit or math.inf,
        )
    plant, error = settling_plant(scenario, form), scenario.measurement.bound
    increment = fsm.increment or allowed_increment(
        plant, dead_zone=fsm.dead_zone, measurement_error=error, divider=fsm.divider
    )
    return AxisParams(
        dead_zone=fsm.dead_zone,
        large_error=fsm.large_error
        or allowed_large_error(
            plant,
            dead_zone=fsm.dead_zone,
            measurement_error=error,
            increment=increment,
            divider=fsm.divider,
        ),
        increment=increment,
        divider=fsm.divider,
        limit=fsm.limit or 2 * max(amplitude, fsm.dead_zone) / plant.gain,
    )


def resolve(scenario: ScenarioT) -> ScenarioT:
    """Return the scenario with every open value filled in.

    Raises:
        ParameterError: If the run would be too long to be stored.
    """
    fsm, form = scenario.fsm, scenario.plant.form
    axis = fsm_axis(scenario, form)
    step = scenario.step or _step(scenario)
    # Steps that are the period over a power of two meet the ticks exactly in floating point.
    step = fsm.period / 2 ** max(0, math.ceil(math.log2(fsm.period / step) - 1e-9))
    duration = scenario.duration or _duration(scenario, axis)
    if not _LEAST_STEPS <= duration / step <= _MOST_STEPS:
        raise ParameterError(
            "duration",
            duration,
            f"{_LEAST_STEPS} to {_MOST_STEPS} steps of {step:g} s, the step can be set",
        )
    return replace(
        scenario,
        fsm=replace(
            fsm,
            increment=axis.increment,
            large_error=axis.large_error,
            limit=axis.limit if math.isfinite(axis.limit) else None,
            feedforward=fsm.feedforward and form == "position",
        ),
        duration=duration,
        step=step,
    )


def _step(scenario: ServoScenario) -> float:
    if isinstance(scenario.desired, Sinusoid):
        return 2 * math.pi / scenario.desired.frequency / 2000
    return 4e-4


def _duration(scenario: ServoScenario, axis: AxisParams) -> float:
    if isinstance(scenario.desired, Sinusoid):
        return 4 * math.pi / scenario.desired.frequency
    if scenario.plant.form == "velocity":
        return _LEAST_DURATION
    plant = settling_plant(scenario, scenario.plant.form)
    needed = approach_time(axis, plant, scenario.desired.amplitude, scenario.fsm.period)
    return max(_LEAST_DURATION, math.ceil(2 * needed / (1 - _AT_REST)) / 2)
