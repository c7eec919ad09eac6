"""The surfaces on which observers are compared, and the slides over them."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.surface.normal_trials import Slide
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    LeadSettings,
    ResolvedEstimationScenario,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import SurfaceSettings, SurfaceShape
from chamfer.models.surfaces.composed import Extruded
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.profile import Profile
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface, locate, normal
from chamfer.systems.sensing.force_rate import ForceRateSensorParams

Array = NDArray[np.float64]

_LENGTH: Final = 2.6  # m, of the path
_STRAIGHT: Final = 1.0  # m, before a bend
_FORCE: Final = 10.0  # N, along the normal
_FRICTION: Final = 0.5
_HEADING: Final = math.radians(30)  # of the path along a surface that is drawn out


class SlideCase(NamedTuple):
    """A surface with its friction."""

    surface: SurfaceSettings
    friction: SurfaceFriction
    tuned: bool  # the adaptive observer's parameters were chosen on it
    lead: LeadSettings = LeadSettings()

    @property
    def constant(self) -> bool:
        """Whether friction is the same everywhere."""
        return not (self.friction.ripple or self.friction.jump)

    def estimation(
        self,
        sensor: ForceRateSensorParams,
        until: float,
        *,
        hover: float = 0.0,
        press: float = 0.0,
    ) -> ResolvedEstimationScenario:
        """Return the slide's scenario, up to a time after the motion along x begins, s."""
        lead = replace(self.lead, hover=hover, press=press)
        return resolve_estimation(
            EstimationScenario(
                surface=self.surface,
                friction=self.friction,
                lead=lead,
                sensor=sensor,
                duration=lead.begins + until,
            )
        )


_AHEAD: Final = LeadSettings()


def _case(
    shape: SurfaceSettings,
    coefficient: float,
    tuned: bool,
    lead: LeadSettings = _AHEAD,
    **varying: float,
) -> SlideCase:
    friction = SurfaceFriction(coefficient=coefficient, **varying)
    return SlideCase(shape, friction, tuned, lead)


def _parabola(*coefficients: float) -> SurfaceSettings:
    shape: SurfaceShape = "parabola" if len(coefficients) == 1 else "paraboloid"
    return SurfaceSettings(shape=shape, coefficients=coefficients)


def _sheet(*waves: tuple[float, float]) -> SurfaceSettings:
    amplitudes, wavelengths = zip(*waves, strict=True)
    return SurfaceSettings(shape="wavy_sheet", amplitudes=amplitudes, wavelengths=wavelengths)


_WAVE: Final = SurfaceSettings(shape="wave", amplitudes=(0.03,), wavelengths=(2.0,))
_BOWL: Final = SurfaceSettings(shape="circle", radius=4.0, inside=True)
_ASIDE, _OTHER_SIDE = LeadSettings(sideways=0.3), LeadSettings(sideways=-0.4)
_SHEET: Final = _sheet((0.02, 1.6), (0.03, 2.5))
CASES: Final[Mapping[str, SlideCase]] = {
    "constant": _case(_parabola(0.05), 1.0, True),
    "ripple": _case(_parabola(0.05), 1.0, True, ripple=0.2),
    "low_ripple": _case(_parabola(0.05), 0.5, True, ripple=0.15),
    "step_down": _case(_parabola(0.05), 1.0, True, jump=-0.4, jump_at=1.2),
    "sharper": _case(_parabola(0.15), 0.3, True),
    "bowl": _case(_BOWL, 0.5, False),
    "falling": _case(_parabola(-0.005), 0.4, False),
    "step_up": _case(_parabola(0.1), 0.4, False, jump=0.5, jump_at=1.0),
    "wave_ripple": _case(_WAVE, 0.7, False, ripple=0.3, wavelength=0.6),
    "space_paraboloid": _case(_parabola(0.05, 0.15), 0.6, False, _ASIDE),
    "space_wavy": _case(_sheet((0.03, 2.0), (0.02, 1.5)), 0.4, True, _ASIDE, ripple=0.1),
    "space_sheet": _case(_SHEET, 0.6, False, _OTHER_SIDE, ripple=0.15, wavelength=0.7),
    "space_bowl": _case(
        replace(_BOWL, shape="sphere"), 0.3, False, LeadSettings(sideways=0.5, depth=0.15)
    ),
}


def surfaces(radius: float) -> dict[str, Surface]:
    """Return surfaces that bend with the radius, m, and no sharper, by name."""
    bend = 1 / radius

    def smooth(degrees: float, *signs: int) -> Profile:
        lengths = [2 * radius * math.radians(degrees)] * len(signs)
        curvatures = tuple(sign * bend for sign in signs)
        return Profile(lengths=(_STRAIGHT, *lengths), curvatures=(0.0, *curvatures))

    def switching(length: float) -> Profile:
        count = math.ceil(_LENGTH / length)
        turns = tuple(bend * (-1) ** i for i in range(count))
        return Profile(lengths=(length,) * count, curvatures=turns, smooth=False)

    def wave(length: float) -> Wave:
        height = (length / (2 * math.pi)) ** 2 / radius
        return Wave(amplitudes=(height,), wavelengths=(length,))

    def arc(*curvatures: float) -> Profile:
        lengths = (_STRAIGHT, _LENGTH - _STRAIGHT)
        return Profile(lengths=lengths, curvatures=curvatures, smooth=False)

    plane: dict[str, Surface] = {
        "flat": Parabola(coefficients=(0.0,)),
        "parabola": Parabola(),
        "ball": Circle(centre=(0.0, -radius), radius=radius),
        "hollow": Circle(centre=(0.0, radius), radius=radius, inside=True),
        **{f"bend_{angle}": smooth(angle, 1) for angle in (5, 10, 15, 30, 45, 60)},
        "flat_to_arc": arc(0.0, bend),
        "arc_to_flat": arc(bend, 0.0),
        **{f"wave_{int(1000 * length)}": wave(length) for length in (0.2, 0.4, 0.8, 1.4)},
        **{f"s_bend_{angle}": smooth(angle, 1, -1) for angle in (5, 15, 30)},
        **{f"switch_{int(1000 * length)}": switching(length) for length in (0.125, 0.25, 0.5)},
    }
    drawn_out = ("bend_5", "bend_30", "flat_to_arc", "wave_400", "switch_250")
    return {
        **plane,
        "space_ball": Sphere(centre=(0.0, -radius, 0.0), radius=radius),
        "space_hollow": Sphere(centre=(0.0, radius, 0.0), radius=radius, inside=True),
        **{f"space_{name}": Extruded(curve=plane[name]) for name in drawn_out},
    }


def glide(surface: Surface, stiffness: float, speed: float, period: float) -> Slide:
    """Return a slide along a geodesic at a constant speed, pressed with a constant force.

    This is the slide of a gripper under force control: contact point and force are given, the
    nominal motion follows from them by (4-2). The path leaves the origin along x, in space turned
    towards z.

    Args:
        surface: Through the origin.
        stiffness: N/m, of the gripper, in every direction.
        speed: m/s, of the contact point.
        period: s, between two samples.
    """
    d, ds = surface.dimension, speed * period
    p, t = np.zeros(d), np.eye(d)[0]
    if d == 3:
        t = np.array([math.cos(_HEADING), 0.0, math.sin(_HEADING)])
    rows = []
    for _ in range(round(_LENGTH / ds) + 1):
        gap, n = locate(surface, p)
        p, t = p - gap * n, t - (t @ n) * n  # back onto the surface, straight ahead
        t /= math.sqrt(t @ t)
        gradient = surface.gradient(p)
        turn = surface.hessian(p) @ t / math.sqrt(gradient @ gradient)
        n = normal(surface, p)
        rows.append((p, t, n, turn - (turn @ n) * n))  # the last is the normal's derivative, 1/m
        p = p + ds * (t - 0.5 * ds * (t @ turn) * n)
    points, tangents, normals, turns = (np.array(one) for one in zip(*rows, strict=True))
    bends = -np.sum(tangents * turns, axis=1)[:, np.newaxis] * normals
    force = _FORCE * (normals - _FRICTION * tangents)
    rate = speed * _FORCE * (turns - _FRICTION * bends)
    nominal = np.hstack([points - force / stiffness, speed * tangents - rate / stiffness])
    time: Array = period * np.arange(len(points), dtype=np.float64)
    return Slide(time=time, force=force, force_rate=rate, nominal=nominal, normal=normals)
