"""Scenarios of a gripper that slides on an unknown surface (chapters 4 and 5)."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import DiscreteTimeDelay, RandomSource

from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.profile import Profile
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
    require_same,
    within,
)
from chamfer.systems.contact.sliding_contact import SlidingContact, SlidingContactParams
from chamfer.systems.estimation.normal_filter import (
    ResolvedSurfaceObserverParams,
    SurfaceObserverParams,
)
from chamfer.systems.estimation.surface_observer import PredictedNormal, SurfaceObserver
from chamfer.systems.ports import require_ports
from chamfer.systems.sensing.force_rate import (
    ForceRate,
    ForceRateParams,
    ForceRateSensor,
    ForceRateSensorParams,
    MovingAverage,
)

Array = NDArray[np.float64]
SurfaceShape = Literal[
    "parabola", "wave", "circle", "profile", "paraboloid", "wavy_sheet", "sphere"
]

_MOST_TRIALS: Final = 1000
# The fields of each shape and their defaults.
_FIELDS: Final[dict[SurfaceShape, dict[str, object]]] = {
    "parabola": {"coefficients": (0.05,)},  # (5-1)
    "wave": {"amplitudes": (0.05,), "wavelengths": (2.0,)},
    "circle": {"radius": 2.0, "inside": True},
    "profile": {"lengths": (1.0, 0.4), "curvatures": (0.0, 1.0), "smooth": True},
    "paraboloid": {"coefficients": (0.05, 0.05)},
    "wavy_sheet": {"amplitudes": (0.05, 0.05), "wavelengths": (2.0, 2.0)},
    "sphere": {"radius": 2.0, "inside": True},
}


@dataclass(frozen=True, kw_only=True)
class SurfaceSettings:
    """A rigid surface through the origin, level there except for waves; y is up, or z in space.

    Fields that a shape does not have stay None.
    """

    shape: SurfaceShape = "parabola"
    # in the plane: parabola, wave, circle, profile; in space: paraboloid, wavy_sheet, sphere
    coefficients: tuple[float, ...] | None = None  # 1/m, a of y = a x^2, or a and b (5-1)
    amplitudes: tuple[float, ...] | None = None  # m, of waves along x, and y in space
    wavelengths: tuple[float, ...] | None = None  # m, of the waves along x, and y in space
    radius: float | None = None  # m, of a circle or sphere
    inside: bool | None = None  # of a circle or sphere; True: a bowl, False: a ball
    lengths: tuple[float, ...] | None = None  # m, along a profile, of its pieces
    curvatures: tuple[float, ...] | None = None  # 1/m, the largest of each piece, > 0: upwards
    smooth: bool | None = None  # of a profile; True: its pieces are bends, False: arcs

    def __post_init__(self) -> None:
        require_one_of(self, "shape", tuple(_FIELDS))
        own = _FIELDS[self.shape]
        for name in (one.name for one in fields(SurfaceSettings)[1:]):
            value = getattr(self, name)
            if value is None:
                continue
            if name not in own:
                raise ParameterError(name, value, f"none, for the shape {self.shape}")
            default = own[name]
            if self.shape == "profile" or not isinstance(default, tuple):
                continue
            if len(value) != len(default):
                raise ParameterError(name, value, f"{len(default)} for the shape {self.shape}")

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.shape in ("parabola", "wave", "circle", "profile") else 3

    def resolved(self) -> Self:
        """Return the settings with the shape's defaults filled in."""
        own = _FIELDS[self.shape].items()
        missing = {name: value for name, value in own if getattr(self, name) is None}
        return replace(self, **missing)  # type: ignore[arg-type]

    def make(self) -> Surface:
        """Return the surface."""
        resolved = self.resolved()
        given: dict[str, Any] = {name: getattr(resolved, name) for name in _FIELDS[self.shape]}
        match self.shape:
            case "parabola" | "paraboloid":
                return Parabola(**given)
            case "wave" | "wavy_sheet":
                return Wave(**given)
            case "profile":
                return Profile(**given)
        above = given["radius"] if given["inside"] else -given["radius"]
        if self.shape == "circle":
            return Circle(centre=(0.0, above), **given)
        return Sphere(centre=(0.0, 0.0, above), **given)


@dataclass(frozen=True, kw_only=True)
class ObserverSettings(SurfaceObserverParams):
    """The observer, and its prediction of the surface.

    A mean over the period has less noise than the period's last sample. If force and nominal
    motion are both averaged, the result is that of the contact point, delayed by half the period.
    """

    prediction: SurfaceSettings | None = None  # the surface as a camera saw it, section 4.5
    average: int = 1  # samples of the sensor and of the nominal motion in its mean

    def __post_init__(self) -> None:
        super().__post_init__()
        error = self.model_error
        if self.prediction is not None and (error.delay or error.delay_deviation):
            # It would be that of where the gripper is, not of where the force was.
            raise ParameterError("model_error.delay", error.delay, "0 with a prediction")


@dataclass(frozen=True, kw_only=True)
class ResolvedObserverSettings(ResolvedSurfaceObserverParams, ObserverSettings):
    """The same, with nothing left open."""


THESIS: Final = ObserverSettings(kind="thesis")


@dataclass(frozen=True, kw_only=True)
class SurfaceScenario:
    """A compliant gripper on a rigid surface that its observer does not know."""

    surface: SurfaceSettings = SurfaceSettings()
    friction: SurfaceFriction = SurfaceFriction()  # mu = 1, section 5.2.1
    gripper: GripperCompliance = GripperCompliance()
    sensor: ForceRateSensorParams = ForceRateSensorParams()
    force_delay: float = 0.0  # s, delay of force and rate, whole samples of the sensor
    force_rate: ForceRateParams | None = None  # None: the rate is sensed; else differenced
    observer: ObserverSettings = THESIS
    duration: float = 20.0  # s, of the run
    trials: int = 40  # seeds over which the metrics are averaged
    step: float = 0.01  # s, of the contact

    def __post_init__(self) -> None:
        require_positive(self, "duration", "step")
        require_not_negative(self, "force_delay")
        if self.force_rate is not None:
            why = "the rate is made of the force"
            if self.sensor.force_rate_noise:
                default = ForceRateSensorParams
                require_same(self.sensor, default, "sensor", "force_rate_noise", why=why)
        late = self.force_delay / self.sensor_period
        if not abs(late - round(late)) < 1e-9:
            allowed = f"whole periods of the sensor, {self.sensor_period:g} s"
            raise ParameterError("force_delay", self.force_delay, allowed)
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")
        require_whole(self.observer.period, self.step, "step")
        with within("gripper"):
            if np.any(self.gripper.damping_matrix(self.dimension)):
                allowed = "0; a gripper that slides here is a spring alone"
                raise ParameterError("damping", self.gripper.damping, allowed)
        seen = self.observer.prediction
        if seen is not None and seen.dimension != self.dimension:
            allowed = f"a shape with {self.dimension} dimensions, as the surface has"
            raise ParameterError("observer.prediction.shape", seen.shape, allowed)
        if not self.duration >= 10 * self.observer.period:
            allowed = f"at least ten periods of {self.observer.period:g} s"
            raise ParameterError("duration", self.duration, allowed)

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.surface.dimension

    @property
    def sensor_period(self) -> float:
        """How often the force is sensed, s."""
        return self.observer.period

    @property
    def up(self) -> Array:
        """The observer's first estimate of the normal, shape (d,)."""
        return np.array([0.0] * (self.dimension - 1) + [1.0])


def require_calibration(observer: SurfaceObserverParams, *, free: float, pressed: float) -> None:
    """Raise :class:`ParameterError` if an observer's calibration finds no suitable motion.

    Args:
        observer: The observer.
        free: s, from the start, in which the gripper touches nothing.
        pressed: s, then, in which it is pressed onto the surface and does not slide.
    """
    given = observer.model_error
    for name, value, most in (("tare", given.tare, free), ("press", given.press, pressed)):
        if value > most * (1 + 1e-9):
            doing = "touches nothing" if name == "tare" else "is pressed onto the surface"
            allowed = f"at most the {most:g} s in which the gripper {doing}"
            raise ParameterError(f"observer.model_error.{name}", value, allowed)


def require_whole(period: float, step: float, name: str) -> None:
    """Raise :class:`ParameterError` unless a period is a whole number of steps."""
    ratio = period / step
    count = round(ratio) if math.isfinite(ratio) else 0
    if not (count >= 1 and abs(count * step / period - 1) < 1e-9):
        raise ParameterError(name, step, f"a whole part of {period:g} s")


@dataclass(frozen=True, kw_only=True)
class ResolvedSurfaceScenario(SurfaceScenario):
    """The same, with nothing left open."""

    observer: ResolvedObserverSettings


def resolved_fields(scenario: SurfaceScenario) -> dict[str, Any]:
    """Return the scenario's fields, with the surface's defaults and the observer's assumptions.

    The observer knows the true gripper and sensor, unless its fields are set.

    Raises:
        ParameterError: If the observer's gripper has other dimensions, or there is no
            such surface.
    """
    given, d = scenario.observer, scenario.dimension
    rate_noise, lag = scenario.sensor.force_rate_noise / math.sqrt(given.average), 0.0
    if scenario.force_rate is not None:
        lag, period = scenario.force_rate.time_constant, scenario.sensor_period
        # What was filtered before does not get better by a mean over less than the filter's time.
        rate_noise = scenario.sensor.force_noise * scenario.force_rate.noise_gain(period)
    scenario.surface.make()
    seen = given.prediction
    if seen is not None:
        seen.make()
        seen = seen.resolved()
    derived = derived_observer(
        given,
        stiffness=scenario.gripper.matrix(d),
        force_noise=scenario.sensor.force_noise / math.sqrt(given.average),
        force_rate_noise=rate_noise,
        rate_lag=lag,
    )
    observer = ResolvedObserverSettings(**vars(given) | derived | {"prediction": seen})
    if len(observer.stiffness) != d:
        raise ParameterError("observer.stiffness", observer.stiffness, f"{d} rows of {d} numbers")
    return vars(scenario) | {"surface": scenario.surface.resolved(), "observer": observer}


def derived_observer(given: SurfaceObserverParams, **derived: object) -> dict[str, Any]:
    """Return the observer's open fields that can be derived, with their values."""
    if given.kind != "adaptive":
        del derived["rate_lag"]
    return {name: value for name, value in derived.items() if getattr(given, name) is None}


def add_observed_contact(
    builder: DiagramBuilder,
    scenario: ResolvedSurfaceScenario,
    motion: OutputPort,
    observer: LeafSystem | None = None,
) -> tuple[SlidingContact, OutputPort, LeafSystem]:
    """Add contact, force sensor with its noise, and observer, and connect them (Fig. 5-1).

    Returns the contact, the measured force, and the observer.

    Args:
        builder: Of the loop.
        scenario: Parameters of the blocks.
        motion: Nominal position and velocity of the gripper.
        observer: In place of the :class:`SurfaceObserver`, with its ports; ``predicted_normal``
            only where the scenario's observer has a prediction.
    """
    d, period = scenario.dimension, scenario.sensor_period
    params = SlidingContactParams(
        stiffness=scenario.gripper.matrix(d), friction=scenario.friction, step=scenario.step
    )
    add, connect = builder.AddNamedSystem, builder.Connect
    contact = add("contact model", SlidingContact(scenario.surface.make(), params))
    sensor = add("force sensor", ForceRateSensor(scenario.sensor, dimension=d))
    seen = scenario.observer.prediction
    if observer is None:
        observer = SurfaceObserver(scenario.observer, scenario.up)
    require_ports(
        "observer",
        observer,
        inputs={"measured_force": d, "measured_force_rate": d, "nominal_motion": 2 * d}
        | ({"predicted_normal": d} if seen else {}),
        outputs={"normal": d, "covariance": d * d, "deviation": 1, "status": 1},
    )
    add("surface estimator", observer)
    connect(motion, contact.GetInputPort("nominal_motion"))
    for name in ("contact_force", "contact_force_rate"):
        connect(contact.GetOutputPort(name), sensor.GetInputPort(name))
    shown = _shown(builder, scenario, sensor)
    samples = scenario.observer.average
    for name, port in {**shown, "nominal_motion": motion}.items():
        if samples > 1:
            average = MovingAverage(samples=samples, period=period, size=port.size())
            mean = add(f"mean {name.replace('_', ' ')}", average)
            connect(port, mean.get_input_port())
            port = mean.get_output_port()
        connect(port, observer.GetInputPort(name))
    if scenario.sensor.force_noise or scenario.sensor.force_rate_noise:
        noise = add("sensor noise", RandomSource(RandomDistribution.kGaussian, 2 * d, period))
        connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    if seen is not None:
        predicted = add("predicted surface", PredictedNormal(seen.make()))
        connect(motion, predicted.get_input_port())
        connect(predicted.get_output_port(), observer.GetInputPort("predicted_normal"))
    for name in ("normal", "covariance", "deviation", "status"):
        builder.ExportOutput(observer.GetOutputPort(name), name)
    for name in ("measured_force", "measured_force_rate"):
        builder.ExportOutput(shown[name], name)
    for name in ("contact", "contact_force"):
        builder.ExportOutput(contact.GetOutputPort(name), name)
    builder.ExportOutput(motion, "nominal_motion")
    return contact, shown["measured_force"], observer


def _shown(
    builder: DiagramBuilder, scenario: SurfaceScenario, sensor: ForceRateSensor
) -> dict[str, OutputPort]:
    """Add the processing between the sensor and its users; return force and rate."""
    d, period = scenario.dimension, scenario.sensor_period
    names = ["measured_force", "measured_force_rate"]
    if scenario.force_rate is not None:
        names.pop()
    shown: dict[str, OutputPort] = {}
    late = round(scenario.force_delay / period)
    for name in names:
        shown[name] = sensor.GetOutputPort(name)
        if late:
            # Who looks at the tick, before the delay takes its own sample, is a period behind.
            delay = builder.AddNamedSystem(
                f"late {name.replace('_', ' ')}", DiscreteTimeDelay(period, late - 1, d)
            )
            builder.Connect(shown[name], delay.get_input_port())
            shown[name] = delay.get_output_port()
    if scenario.force_rate is not None:
        differencing = ForceRate(scenario.force_rate, dimension=d, period=period)
        rate = builder.AddNamedSystem("force rate", differencing)
        builder.Connect(shown["measured_force"], rate.get_input_port())
        shown["measured_force_rate"] = rate.get_output_port()
    return shown
