"""What a log tells of contact: the sensor's rotation, friction, stiffness, how many contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.friction_cone import Cone, cone_friction, fit_cone, rotation_vector
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
_ONE_WAY = 0.1  # variance of the direction of sliding: less tells no rotation
_MIRRORED = 0.5  # of the misfit of the best rotation: a mirror that fits so well is the truth
_OFF_CONE = 0.15  # rms of a unit force off the cone: more is a second contact
_OFF_POINT = 0.3  # of the moment is what one point leaves: more is a second contact
_ROTATION: Final = ("sensor.rotation", *(f"sensor.rotation.{axis}" for axis in "xyz"))
_TOOL, _FIXED = "in the tool's axes", "in fixed axes"


@dataclass(frozen=True, kw_only=True)
class Touched:
    """What the rows in contact tell; n rows of the motion."""

    quantities: dict[str, Quantity]
    any: bool  # whether there is contact
    misfit: float  # rms of a unit force off the friction cone; NaN without sliding
    force: Array  # (n, 3), N, of the surface on the tool, fixed axes
    height: Array  # (n,), m, over the plane that gives way; NaN without contact
    off_cone: Array  # (n, 3), N, force less its place on the friction cone; NaN without sliding


@dataclass(frozen=True, kw_only=True)
class _Slide:
    """The used rows of a surface, m of them, with what forces are compared with."""

    surface: Surface
    normal: Array  # (3,)
    heading: Array  # (m, 3), of sliding along the surface
    force: Array  # (m, 3), of size 1; 0 where nothing slides
    turn: Array  # (m, 3, 3), from fixed axes to those in which the sensor is turned

    def sums(self) -> tuple[Array, ...]:
        """Return sums over blocks: of the plane, of the parts of n f^T and v f^T, of rows."""
        force = np.einsum("mij,mj->mi", self.turn, self.force)
        heading = np.einsum("mij,mj->mi", self.turn, self.heading)
        parts = self.turn[:, :, :, None] * force[:, None, None, :]
        sliding = np.any(self.force != 0, axis=1).astype(float)
        rows = (self.surface.products, parts, heading[:, :, None] * force[:, None, :], sliding)
        return tuple(in_blocks(one) for one in rows)

    def cone(self, sums: Sequence[Array], sign: float = 1.0) -> Cone:
        """Return the fit to such sums."""
        products, parts, sliding, rows = sums
        normal = self.surface.normal(self.surface.coefficients(products))
        return fit_cone(np.einsum("a,jak->jk", normal, parts), sliding, float(rows), sign)


def fit_contact(motion: Motion, sensed: Sensed) -> Touched:
    """Return what contact tells.

    Raises:
        UserError: If a mirrored sensor fits, and no rotation does.
    """
    size = np.linalg.norm(motion.force, axis=1)
    used = binary_erosion(size > sensed.limit, iterations=max(1, round(_SETTLED / motion.period)))
    none = "no contact in the log"
    told = {"friction": unknown("", none), "contact.stiffness": unknown("N/m", none)}
    told |= {name: unknown("rad", none) for name in _ROTATION}
    turns, mending = motion.turn is not None, np.eye(3)
    if sensed.rotation is not None:
        told |= _rotation(sensed.rotation, f"{_TOOL}, from the tool's weight")
        mending = Rotation.from_rotvec(sensed.rotation.values).as_matrix()
    height, off_cone = np.full_like(size, np.nan), np.full_like(motion.force, np.nan)
    if used.sum() < _LEAST:
        some = float(used.any())
        told["contacts"] = Quantity(some, some, some, "")
        force = _mended(motion, motion.force, mending, turns)
        return Touched(
            quantities=told, any=bool(used.any()), misfit=np.nan, force=force, height=height,
            off_cone=off_cone,
        )  # fmt: skip
    surface, height[used] = fit_surface(motion, used)
    normal = surface.normal(surface.coefficients(surface.products.sum(axis=0)))
    heading = motion.heading - np.outer(motion.heading @ normal, normal)
    slides = used & motion.moves(used)
    unit = np.where(slides, 1 / np.maximum(size, 1e-12), 0.0)[:, None] * motion.force
    still = np.broadcast_to(np.eye(3), (int(used.sum()), 3, 3))
    way = heading / np.maximum(np.sum(heading**2, axis=1, keepdims=True), 0.1)  # as smoothed
    slide = _Slide(surface=surface, normal=normal, heading=way[used], force=unit[used], turn=still)
    spread = np.linalg.eigvalsh(np.cov(heading[slides].T))[-1] if slides.sum() > 1 else 0.0
    notes = [] if surface.told else ["path too straight for a plane: normal taken as an axis"]
    if turning := bool(slides.sum() > _LEAST / 2 and spread > _ONE_WAY):
        slide, turns, cone = _best_frame(motion, used, slide)
        mending = cone.mending
    else:
        notes.append("one way only: sensor taken as not turned")
    fit = _fit(slide, mending, turning)
    told["friction"] = fit.quantity(0, "", ", ".join(notes))
    if turning:
        told |= _rotation(fit.part(2, 5), ", ".join([_TOOL if turns else _FIXED, *notes]))
    elif sensed.rotation is None:
        told |= {name: unknown("rad", "the tool slides one way only") for name in _ROTATION}
    told["contact.stiffness"] = _stiffness(fit, surface.told)
    force = _mended(motion, motion.force, mending, turns)
    pushed = (force @ normal)[:, None] * (normal - fit.values[0] * heading)
    off_cone[slides] = (force - pushed)[slides]
    off = np.linalg.norm(off_cone[slides], axis=1) / size[slides]
    misfit = float(np.sqrt(np.mean(off**2))) if len(off) else np.nan
    moment = None if motion.moment is None else _mended(motion, motion.moment, mending, turns)
    told["contacts"] = _contacts(motion, force, moment, used, misfit)
    return Touched(
        quantities=told, any=True, misfit=misfit, force=force, height=height, off_cone=off_cone
    )


def _rotation(found: Estimate, note: str) -> dict[str, Quantity]:
    """Return the rotation's angle and vector."""
    parts = [found.quantity(i, "rad", note) for i in range(3)]
    return dict(zip(_ROTATION, [found.length("rad", note), *parts], strict=True))


def _mended(motion: Motion, vectors: Array, mending: Array, turns: bool) -> Array:
    """Return recorded vectors, (n, 3), in fixed axes."""
    if not turns or motion.turn is None:
        return vectors @ mending.T
    return motion.turn.apply(motion.turn.inv().apply(vectors) @ mending.T)


def _best_frame(motion: Motion, used: Rows, slide: _Slide) -> tuple[_Slide, bool, Cone]:
    """Return the slide with the axes in which the sensor is turned, whether those are the tool's.

    They are, unless a sensor turned in fixed axes fits better by more than chance.

    Raises:
        UserError: If a mirrored sensor fits, and no rotation does.
    """
    slides, agreements = [slide], []
    if motion.turn is not None:
        back = motion.turn[used].inv().as_matrix()
        slides.insert(0, _Slide(surface=slide.surface, normal=slide.normal,
            heading=slide.heading, force=slide.force, turn=back))  # fmt: skip
    cones, mirrors = [], []
    for one in slides:
        sums = one.sums()
        total = [s.sum(axis=0) for s in sums]
        cone = one.cone(total)
        cones.append(cone)
        mirrors.append(one.cone(total, sign=-1.0))
        off = np.einsum("a,bjak->bjk", one.normal, sums[1]) - cone.friction * sums[2]
        off /= np.sqrt(1 + cone.friction**2)
        agreements.append(np.einsum("bjk,jk->b", off, cone.mending))
    mirror = min(mirrors, key=lambda c: c.misfit)
    if mirror.misfit < min(_OFF_CONE, _MIRRORED * min(c.misfit for c in cones)):
        opposite = "they look like those of the tool on the surface: turn their sign"
        both = opposite if np.trace(mirror.mending) < -2.5 else "one of them points the other way"
        raise UserError(f"the axes of the force are mirrored, no rotation mends them; {both}")
    gain = agreements[-1] - agreements[0]
    if len(slides) == 2 and gain.mean() > 2 * gain.std(ddof=1) / np.sqrt(len(gain)):
        return slides[1], False, cones[1]
    return slides[0], len(slides) == 2, cones[0]


def _fit(slide: _Slide, mending: Array, turning: bool) -> Estimate:
    """Return friction, compliance, m/N, and the rotation's vector, if the way turns enough."""
    near = Rotation.from_matrix(mending).as_rotvec()

    def values(products: Array, parts: Array, sliding: Array, rows: Array) -> Array:
        coefficients = slide.surface.coefficients(products)
        compliance = slide.surface.compliance(coefficients)
        normal = slide.surface.normal(coefficients)
        if not turning:
            pushed = np.einsum("a,jak->jk", normal, parts)
            return np.array([cone_friction(pushed, sliding, mending), compliance])
        cone = slide.cone((products, parts, sliding, rows))
        vector = rotation_vector(cone.mending, near)
        return np.array([cone.friction, compliance, *vector])

    return jackknife(values, *slide.sums())


def _stiffness(fit: Estimate, told: bool) -> Quantity:
    """Return the stiffness along the normal: force over how far the tool sinks in."""
    friction, compliance = fit.values[:2]
    cone = np.sqrt(1 + friction**2)  # size of the force over the normal force
    half = fit.half()[1]
    low, high = 1 / cone / (compliance + half), compliance - half
    if not told:
        return unknown("N/m", "path too straight for a plane")
    if high <= 0:
        note = f"above {low:.3g} N/m" if low > 0 else "the surface doesn't give way"
        return unknown("N/m", note)
    return Quantity(1 / cone / compliance, low, 1 / cone / high, "N/m", "of the normal force")


def _contacts(
    motion: Motion, force: Array, moment: Array | None, used: Rows, misfit: float
) -> Quantity:
    """Return 1, or 2 for more than one contact.

    One point, still in the tool or beneath it, has one lever: M = (R a + b) x F.
    """
    left = 0.0
    if moment is not None:
        push, pull = force[used], moment[used]
        cross = np.cross(np.eye(3)[:, None], push[None]).transpose(1, 2, 0)  # lever to moment
        turn = motion.turn
        levers = cross if turn is None else np.concatenate(
            [cross, cross @ turn[used].as_matrix()], axis=2
        )  # fmt: skip
        flat, wanted = levers.reshape(-1, levers.shape[2]), pull.ravel()
        found = np.linalg.lstsq(flat, wanted, rcond=None)[0]
        left = float(np.linalg.norm(wanted - flat @ found) / np.linalg.norm(wanted))
    number = 2.0 if misfit > _OFF_CONE or left > _OFF_POINT else 1.0
    note = "" if np.isnan(misfit) else f"{100 * misfit:.0f} % of the force off the friction cone, "
    note += "no moment" if moment is None else f"{100 * left:.0f} % of the moment off one point"
    return Quantity(number, number, number, "", note)
