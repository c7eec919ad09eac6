"""What may be set where a gripper slides on an unknown surface (chapters 4 and 5)."""

import math
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import RandomSource

from models.smooth_surfaces import (
    Circle,
    Parabola,
    Paraboloid,
    SmoothSurface,
    Sphere,
    Wave,
    WavySheet,
)
from models.surface_friction import SurfaceFriction
from models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)
from systems.contact.sliding_contact import SlidingContact, SlidingContactParams
from systems.estimation.predicted_normal import PredictedNormal
from systems.estimation.surface_observer import Kind, SurfaceObserver, SurfaceObserverParams
from systems.force.force_rate_sensor import ForceRateSensor, ForceRateSensorParams

Array = NDArray[np.float64]
Shape = Literal["parabola", "wave", "circle", "paraboloid", "wavy_sheet", "sphere"]

_MOST_TRIALS: Final = 1000
# The fields of each shape and their defaults.
_FIELDS: Final[dict[Shape, dict[str, object]]] = {
    "parabola": {"coefficients": (0.05,)},  # (5-1)
    "wave": {"amplitudes": (0.05,), "wavelengths": (2.0,)},
    "circle": {"radius": 2.0, "inside": True},
    "paraboloid": {"coefficients": (0.05, 0.05)},
    "wavy_sheet": {"amplitudes": (0.05, 0.05), "wavelengths": (2.0, 2.0)},
    "sphere": {"radius": 2.0, "inside": True},
}


@dataclass(frozen=True, kw_only=True)
class SurfaceSettings:
    """A rigid surface through the origin, level there but for waves; y is up, or z in space.

    What a shape does not have stays None.
    """

    shape: Shape = "parabola"
    coefficients: tuple[float, ...] | None = None  # 1/m, a of y = a x^2, or a and b (5-1)
    amplitudes: tuple[float, ...] | None = None  # m, of waves along x, and y in space
    wavelengths: tuple[float, ...] | None = None  # m
    radius: float | None = None  # m
    inside: bool | None = None  # True: a bowl, False: a ball

    def __post_init__(self) -> None:
        require_one_of(self, "shape", tuple(_FIELDS))
        own = _FIELDS[self.shape]
        for name in ("coefficients", "amplitudes", "wavelengths", "radius", "inside"):
            value = getattr(self, name)
            if value is not None and name not in own:
                raise ParameterError(name, value, f"none, for the shape {self.shape}")
            default = own.get(name)
            if value is not None and isinstance(default, tuple) and len(value) != len(default):
                raise ParameterError(name, value, f"{len(default)} for the shape {self.shape}")

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.shape in ("parabola", "wave", "circle") else 3

    def resolved(self) -> "SurfaceSettings":
        """Return the settings with the shape's defaults filled in."""
        missing = {
            name: value
            for name, value in _FIELDS[self.shape].items()
            if getattr(self, name) is None
        }
        return replace(self, **missing)  # type: ignore[arg-type]

    def make(self) -> SmoothSurface:
        """Return the surface."""
        given = self.resolved()
        coefficients = given.coefficients or ()
        amplitudes, wavelengths = given.amplitudes or (), given.wavelengths or ()
        radius, inside = given.radius or 0.0, bool(given.inside)
        above = radius if inside else -radius
        match self.shape:
            case "parabola":
                return Parabola(coefficient=coefficients[0])
            case "wave":
                return Wave(amplitude=amplitudes[0], wavelength=wavelengths[0])
            case "circle":
                return Circle(centre=(0.0, above), radius=radius, inside=inside)
            case "paraboloid":
                return Paraboloid(coefficients=(coefficients[0], coefficients[1]))
            case "wavy_sheet":
                return WavySheet(
                    amplitudes=(amplitudes[0], amplitudes[1]),
                    wavelengths=(wavelengths[0], wavelengths[1]),
                )
            case "sphere":
                return Sphere(centre=(0.0, 0.0, above), radius=radius, inside=inside)


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """What the force sensor adds; each is the rms length of a vector with three axes."""

    force: float = 1.0  # N, u_F, section 5.2.2
    force_rate: float = 5.0  # N/s, u_Fdot, section 5.2.2

    def __post_init__(self) -> None:
        require_not_negative(self, "force", "force_rate")


@dataclass(frozen=True, kw_only=True)
class ObserverSettings:
    """The observer, and what it is told."""

    kind: Kind = "thesis"
    smallest_radius: float = 0.75  # m, rho_min, section 5.2.2
    force_noise: float | None = None  # N, assumed; None: what the sensor has
    force_rate_noise: float | None = None  # N/s, likewise
    initial_deviation: float = 0.1  # rad, calibrated on Figs. 5-3 to 5-6
    halt_speed: float = 1e-3  # m/s, less commanded speed is a halt
    period: float = 0.05  # s, T, calibrated on Figs. 5-3 to 5-6
    prediction: SurfaceSettings | None = None  # the surface as a camera saw it, section 4.5

    def __post_init__(self) -> None:
        require_positive(self, "period")


@dataclass(frozen=True, kw_only=True)
class SurfaceScenario:
    """A compliant gripper on a rigid surface that its observer does not know."""

    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    friction: SurfaceFriction = field(default_factory=SurfaceFriction)  # mu = 1, section 5.2.1
    stiffness: float = 100.0  # N/m, of the gripper in every direction, section 5.2.1
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    observer: ObserverSettings = field(default_factory=ObserverSettings)
    duration: float = 20.0  # s
    trials: int = 40  # seeds over which the metrics are averaged
    step: float = 0.01  # s, of the contact

    def __post_init__(self) -> None:
        require_positive(self, "stiffness", "duration", "step")
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")
        require_whole(self.observer.period, self.step, "step")
        seen = self.observer.prediction
        if seen is not None and seen.dimension != self.dimension:
            allowed = f"a shape with {self.dimension} dimensions, as the surface has"
            raise ParameterError("observer.prediction.shape", seen.shape, allowed)
        if not self.duration >= 10 * self.observer.period:
            raise ParameterError(
                "duration", self.duration, f"at least ten periods of {self.observer.period:g} s"
            )

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.surface.dimension

    @property
    def up(self) -> Array:
        """The observer's first estimate of the normal, shape (d,)."""
        return np.array([0.0] * (self.dimension - 1) + [1.0])

    @property
    def gripper(self) -> tuple[tuple[float, ...], ...]:
        """The gripper's stiffness matrix K, N/m."""
        d = self.dimension
        return tuple(tuple(self.stiffness if i == j else 0.0 for j in range(d)) for i in range(d))

    @property
    def estimation(self) -> SurfaceObserverParams:
        """The observer's parameters."""
        given = self.observer
        force, rate = given.force_noise, given.force_rate_noise
        return SurfaceObserverParams(
            kind=given.kind,
            stiffness=self.gripper,
            force_noise=self.noise.force if force is None else force,
            force_rate_noise=self.noise.force_rate if rate is None else rate,
            smallest_radius=given.smallest_radius,
            initial_deviation=given.initial_deviation,
            halt_speed=given.halt_speed,
            period=given.period,
        )


def require_whole(period: float, step: float, name: str) -> None:
    """Raise :class:`ParameterError` unless a period is a whole number of steps."""
    ratio = period / step
    count = round(ratio) if math.isfinite(ratio) else 0
    if not (count >= 1 and abs(count * step / period - 1) < 1e-9):
        raise ParameterError(name, step, f"a whole part of {period:g} s")


def fill_in(given: ObserverSettings, noise: NoiseSettings) -> ObserverSettings:
    """Return the observer's settings with what it assumes about the sensor.

    Raises:
        ParameterError: If there is no such predicted surface.
    """
    if given.prediction is not None:
        given.prediction.make()
    return replace(
        given,
        force_noise=noise.force if given.force_noise is None else given.force_noise,
        force_rate_noise=(
            noise.force_rate if given.force_rate_noise is None else given.force_rate_noise
        ),
        prediction=given.prediction.resolved() if given.prediction is not None else None,
    )


def add_observed_contact(
    builder: DiagramBuilder, scenario: SurfaceScenario, motion: OutputPort, *, noise_period: float
) -> tuple[SlidingContact, ForceRateSensor, SurfaceObserver]:
    """Add contact, force sensor with its noise, and observer, and connect them (Fig. 5-1).

    Args:
        builder: Of the loop.
        scenario: What the blocks are like.
        motion: Nominal position and velocity of the gripper.
        noise_period: s, at which the sensor's noise changes.
    """
    d = scenario.dimension
    contact = builder.AddNamedSystem(
        "contact model",
        SlidingContact(
            scenario.surface.make(),
            SlidingContactParams(
                stiffness=scenario.gripper, friction=scenario.friction, step=scenario.step
            ),
        ),
    )
    sensor = builder.AddNamedSystem(
        "force sensor",
        ForceRateSensor(
            ForceRateSensorParams(
                dimension=d,
                force_noise=scenario.noise.force,
                force_rate_noise=scenario.noise.force_rate,
            )
        ),
    )
    observer = builder.AddNamedSystem(
        "surface estimator", SurfaceObserver(scenario.estimation, scenario.up)
    )
    connect = builder.Connect
    connect(motion, contact.GetInputPort("nominal_motion"))
    connect(motion, observer.GetInputPort("nominal_motion"))
    for name in ("contact_force", "contact_force_rate"):
        connect(contact.GetOutputPort(name), sensor.GetInputPort(name))
    for name in ("measured_force", "measured_force_rate"):
        connect(sensor.GetOutputPort(name), observer.GetInputPort(name))
    if scenario.noise.force or scenario.noise.force_rate:
        noise = builder.AddNamedSystem(
            "sensor noise", RandomSource(RandomDistribution.kGaussian, 2 * d, noise_period)
        )
        connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    if scenario.observer.prediction is not None:
        predicted = builder.AddNamedSystem(
            "predicted surface", PredictedNormal(scenario.observer.prediction.make())
        )
        connect(motion, predicted.get_input_port())
        connect(predicted.get_output_port(), observer.GetInputPort("predicted_normal"))
    for name in ("normal", "covariance", "deviation", "status"):
        builder.ExportOutput(observer.GetOutputPort(name), name)
    for name in ("measured_force", "measured_force_rate"):
        builder.ExportOutput(sensor.GetOutputPort(name), name)
    builder.ExportOutput(contact.GetOutputPort("contact"), "contact")
    builder.ExportOutput(contact.GetOutputPort("contact_force"), "contact_force")
    builder.ExportOutput(motion, "nominal_motion")
    return contact, sensor, observer
