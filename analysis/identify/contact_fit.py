"""Identification of contact: the sensor's rotation, friction, stiffness, contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.friction_cone import Cone, fit_cone, rotation_vector
from chamfer.analysis.identify.motion import Motion
from chamfer.analysis.identify.quantity import (
    Array,
    Estimate,
    Quantity,
    in_blocks,
    jackknife,
    unknown,
)
from chamfer.analysis.identify.sensor_fit import Sensed
from chamfer.analysis.identify.surface_fit import Rows, Surface, fit_surface
from chamfer.analysis.scenario.errors import UserError

_SETTLED = 0.15  # s, after a touch and before a release that are left out
_LEAST = 200  # rows of contact, half of them sliding
_SLIDES_ON = 20.0  # times the height of its path: what goes so far on the plane is not free
_ONE_WAY = 0.1  # variance of the direction of sliding: less tells no rotation
_MIRRORED = 0.5  # of the misfit of the best rotation: a mirror that fits so well is the truth
_OFF_CONE = 0.15  # rms of a unit force off the cone: more is a second contact
_OFF_POINT = 0.3  # of the moment is what one point leaves: more is a second contact
_ROTATION: Final = ("sensor.rotation", *(f"sensor.rotation.{axis}" for axis in "xyz"))


@dataclass(frozen=True, kw_only=True)
class Touched:
    """Result of the rows in contact; n rows of the motion."""

    quantities: dict[str, Quantity]
    force: Array  # (n, 3), N, of the surface on the tool, fixed axes
    steady: Rows  # (n,), away from touch and release
    any: bool = True  # whether there is enough contact
    grounded: bool = False  # whether what was taken for free lies on the surface
    misfit: float = np.nan  # rms of a unit force off the friction cone; NaN without sliding
    height: Array | None = None  # (n,), m, over the plane that gives way; NaN without contact
    off_cone: Array | None = None  # (n, 3), N, force off the friction cone; NaN without sliding


def fit_contact(motion: Motion, sensed: Sensed) -> Touched:
    """Return the quantities that contact determines.

    Raises:
        UserError: If a mirrored sensor fits, and no rotation does.
    """
    size = np.linalg.norm(motion.force, axis=1)
    touching, apart = size > sensed.limit, max(1, round(_SETTLED / motion.period))
    used = binary_erosion(touching, iterations=apart)
    steady = used | binary_erosion(~touching, iterations=apart, border_value=1)
    told, weighed = _nothing("no contact in the log"), dict[str, Quantity]()
    force = motion.force
    if sensed.rotation is not None:
        weighed = _rotation(sensed.rotation, "in the tool's axes, from the tool's weight")
        told |= weighed
        mending = Rotation.from_rotvec(sensed.rotation.values).as_matrix()
        force = _mended(force, mending, motion.turn)
    if used.sum() < _LEAST:
        some, note = float(touching.any()), f"a contact exerts more than {sensed.limit:.2g} N"
        told["contacts"] = Quantity(some, some, some, "", note)
        return Touched(quantities=told, force=force, steady=steady, any=False)
    height = np.full_like(size, np.nan)
    surface, height[used] = fit_surface(motion, used)
    normal = surface.normal(surface.coefficients(surface.products.sum(axis=0)))
    over = np.abs((motion.position - motion.position[used].mean(axis=0)) @ normal)
    free = steady & ~used
    grounded = bool(
        free.any()
        and np.median(over[free]) < over[used].max()
        and np.ptp(motion.position[free], axis=0).max() > _SLIDES_ON * over[used].max()
    )
    heading = motion.heading - np.outer(motion.heading @ normal, normal)
    slides = used & motion.moves(used)
    spread = np.linalg.eigvalsh(np.cov(heading[slides].T))[-1] if slides.sum() > 1 else 0.0
    if slides.sum() < _LEAST / 2 or spread < _ONE_WAY:
        told |= _nothing("the tool slides too little, or one way only")
        told["contacts"] = _contacts(motion, force, motion.moment, used, np.nan)
        return Touched(
            quantities=told, force=force, steady=steady, grounded=grounded, height=height
        )
    way = heading / np.maximum(np.sum(heading**2, axis=1, keepdims=True), 0.1)  # as smoothed
    unit = np.where(slides, 1 / np.maximum(size, 1e-12), 0.0)[:, None] * motion.force
    turn, cone, sums = _best_axes(surface, way[used], unit[used], motion, used)
    near = Rotation.from_matrix(cone.mending).as_rotvec()

    def values(*parts: Array) -> Array:
        found = _cone(surface, parts, friction=cone.friction)
        compliance = surface.compliance(surface.coefficients(parts[0]))
        return np.array([found.friction, compliance, *rotation_vector(found.mending, near)])

    fit = jackknife(values, *sums)
    straight = "" if surface.told else "path too straight for a plane: normal taken as an axis"
    axes = "in fixed axes" if turn is None else "in the tool's axes"
    told |= _rotation(fit.part(2, 5), f"{axes}, {straight}" if straight else axes)
    told["friction"] = fit.quantity(0, "", straight)
    told["contact.stiffness"] = unknown("N/m", straight) if straight else _stiffness(fit)
    before, force = force, _mended(motion.force, cone.mending, turn)
    cone_force = (force @ normal)[:, None] * (normal - fit.values[0] * heading)
    off_cone = np.where(slides[:, None], force - cone_force, np.nan)
    misfit = float(np.sqrt(np.nanmean(np.sum(off_cone**2, axis=1) / size**2)))
    moment = None if motion.moment is None else _mended(motion.moment, cone.mending, turn)
    if misfit > _OFF_CONE:
        told |= _nothing("the force fits no friction cone: more than one contact, or no surface")
        force, moment = motion.force, motion.moment
    told["contacts"] = _contacts(motion, force, moment, used, misfit)
    if told["contacts"].value != 1.0:  # no normal, and so no sensor's axes, fits both
        told |= _nothing("more than one contact in the log") | weighed
        force = before
    return Touched(
        quantities=told, force=force, steady=steady, grounded=grounded, misfit=misfit,
        height=height, off_cone=off_cone,
    )  # fmt: skip


def _nothing(note: str) -> dict[str, Quantity]:
    """Return the quantities that only sliding determines, as unknown."""
    told = {"friction": unknown("", note), "contact.stiffness": unknown("N/m", note)}
    return told | {name: unknown("rad", note) for name in _ROTATION}


def _rotation(found: Estimate, note: str) -> dict[str, Quantity]:
    """Return the rotation's angle and vector."""
    parts = [found.quantity(i, "rad", note) for i in range(3)]
    return dict(zip(_ROTATION, [found.length("rad", note), *parts], strict=True))


def _mended(vectors: Array, mending: Array, turn: Rotation | None) -> Array:
    """Return recorded vectors, (n, 3), of a sensor turned in the tool or in fixed axes (None)."""
    if turn is None:
        return vectors @ mending.T
    return np.asarray(turn.apply(turn.inv().apply(vectors) @ mending.T))


def _cone(surface: Surface, sums: Sequence[Array], **options: float) -> Cone:
    """Return the fit to sums: of the plane, of the parts of n f^T and v f^T, of rows."""
    normal = surface.normal(surface.coefficients(sums[0]))
    along = np.einsum("a,jak->jk", normal, sums[1])
    return fit_cone(along, sums[2], float(sums[3]), **options)


def _best_axes(
    surface: Surface, way: Array, unit: Array, motion: Motion, used: Rows
) -> tuple[Rotation | None, Cone, tuple[Array, ...]]:
    """Return the axes in which the sensor is rotated, the fit, and its sums over blocks.

    They are the tool's, unless fixed axes (None) fit better by more than chance. ``way`` and
    ``unit``, (m, 3), are directions of sliding and force, the latter 0 where nothing slides.

    Raises:
        UserError: If a mirrored sensor fits, and no rotation does.
    """
    normal = surface.normal(surface.coefficients(surface.products.sum(axis=0)))
    fits, mirrors, agreements = [], [], []
    for turn in [None] if motion.turn is None else [motion.turn, None]:
        back = np.broadcast_to(np.eye(3), (len(way), 3, 3))
        if turn is not None:
            back = turn[used].inv().as_matrix()
        force, along = (np.einsum("mij,mj->mi", back, one) for one in (unit, way))
        sums = (
            in_blocks(surface.products),
            in_blocks(back[:, :, :, None] * force[:, None, None, :]),
            in_blocks(along[:, :, None] * force[:, None, :]),
            in_blocks(np.any(unit != 0, axis=1).astype(float)),
        )
        totals = [one.sum(axis=0) for one in sums]
        cone = _cone(surface, totals)
        fits.append((turn, cone, sums))
        mirrors.append(_cone(surface, totals, sign=-1.0))
        on = np.einsum("a,bjak->bjk", normal, sums[1]) - cone.friction * sums[2]
        on = np.einsum("bjk,jk->b", on, cone.mending) / np.sqrt(1 + cone.friction**2)
        agreements.append(on)
    mirror = min(mirrors, key=lambda one: one.misfit)
    if mirror.misfit < min(_OFF_CONE, _MIRRORED * min(one[1].misfit for one in fits)):
        how = "one of them points the other way"
        if np.trace(mirror.mending) < -2.5:
            how = "they look like those of the tool on the surface: turn their sign"
        raise UserError(f"the axes of the force are mirrored, no rotation corrects them; {how}")
    gain = agreements[-1] - agreements[0]
    return fits[-1 if gain.mean() > 2 * gain.std(ddof=1) / np.sqrt(len(gain)) else 0]


def _stiffness(fit: Estimate) -> Quantity:
    """Return the stiffness along the normal: force over how far the tool sinks in."""
    compliance = fit.values[1] * np.sqrt(1 + fit.values[0] ** 2)  # of the normal force
    half = fit.half()[1] * np.sqrt(1 + fit.values[0] ** 2)
    if half < compliance:
        low, high = 1 / (compliance + half), 1 / (compliance - half)
        return Quantity(1 / compliance, low, high, "N/m", "of the normal force")
    if compliance + half > 0:
        return unknown("N/m", f"above {1 / (compliance + half):.3g} N/m")
    return unknown("N/m", "the surface doesn't give way")


def _contacts(
    motion: Motion, force: Array, moment: Array | None, used: Rows, misfit: float
) -> Quantity:
    """Return 1, or 2 for more than one contact.

    One point, still in the tool or beneath it, has one lever: M = (R a + b) x F.
    """
    left, notes = 0.0, []
    if not np.isnan(misfit):
        notes.append(f"{100 * misfit:.0f} % of the force off the friction cone")
    if moment is not None:
        levers = np.cross(np.eye(3)[:, None], force[used][None]).transpose(1, 2, 0)
        if motion.turn is not None:
            levers = np.concatenate([levers, levers @ motion.turn[used].as_matrix()], axis=2)
        rows, wanted = levers.reshape(-1, levers.shape[2]), moment[used].ravel()
        rest = wanted - rows @ np.linalg.lstsq(rows, wanted, rcond=None)[0]
        left = float(np.linalg.norm(rest) / max(float(np.linalg.norm(wanted)), 1e-300))
        notes.append(f"{100 * left:.0f} % of the moment off one point")
    number = 2.0 if misfit > _OFF_CONE or left > _OFF_POINT else 1.0
    return Quantity(number, number, number, "", ", ".join(notes))
