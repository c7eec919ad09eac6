"""Identification of sensor and tool without contact: offset, drift, noise, weight."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.signal import detrend
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.friction_cone import rotation_vector
from chamfer.analysis.identify.log import Log
from chamfer.analysis.identify.motion import smooth
from chamfer.analysis.identify.quantity import (
    BLOCKS,
    Array,
    Estimate,
    Quantity,
    in_blocks,
    jackknife,
    solve,
    unknown,
)

GRAVITY: Final = 9.81  # m/s^2, along the base's -z
_WINDOW = 0.25  # s, over which a free force is a line and noise
_PUSHED = 20.0  # times the noise: a force that something exerts
_QUIET = 0.4  # of that: what free motion shakes the force by within a window
_STILL = 0.15  # of that: the same as free motion begins
_PULLS = 0.2  # of the windows in contact: a surface pulls in no more of them
_WIDE = 0.5  # of the mass: half an interval that tells one is narrower
_BETTER = 0.9  # of the free force's deviation: what a weight leaves over that is one
_DRIFTS = 0.8  # of a drift: the least that its interval has where it is taken off
_LEFT = 0.3  # of the weight's swing is left over where the tool's weight tells the rotation
_LIGHT = "the tool turns too little without contact, or weighs too little"
_UNSURE = "weighs too little to determine its centre and the sensor's rotation"
_NAMES: Final = {
    **{f"sensor.offset.{axis}": "N" for axis in "xyz"},
    "sensor.drift": "N/s",
    "sensor.noise": "N",
    "tool.mass": "kg",
    **{f"tool.centre_of_mass.{axis}": "m" for axis in "xyz"},
}


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """Knowledge of the forces before the sensor's rotation is known, n rows."""

    quantities: dict[str, Quantity]
    force: Array  # (n, 3), N, without offset and weight, in fixed axes if the sensor isn't turned
    moment: Array | None  # (n, 3), N m, the same
    limit: float  # N, bound of a free sensor's force
    residual: Array  # (n, 3), N, force where nothing is touched; else NaN
    rotation: Estimate | None  # rad, rotation vector in the tool's axes, from the tool's weight


class _Windows(NamedTuple):
    """Short parts of a force, k of them."""

    means: Array  # (k, 3), N
    rough: Array  # (k,), N, rms of an axis about its line
    width: int  # rows

    @classmethod
    def of(cls, force: Array, width: int) -> "_Windows":
        """Return those of a force, (n, 3)."""
        shaped = force[: len(force) // width * width].reshape(-1, width, 3)
        ramp = np.linspace(-1.0, 1.0, width)
        slopes = np.einsum("w,kwi->ki", ramp, shaped) / (ramp @ ramp)
        means = shaped.mean(axis=1)
        line = shaped - means[:, None] - slopes[:, None] * ramp[:, None]
        return cls(means, np.sqrt((line**2).sum(axis=(1, 2)) / 3 / (width - 2)), width)


def fit_sensor(log: Log, *, tared: bool = True) -> Sensed:
    """Return the quantities from the free part of a log with forces; their axes are known.

    Without ``tared`` no part is taken for free.
    """
    assert log.force is not None
    force, n = log.force, len(log.time)
    parts = _Windows.of(force, min(max(8, round(_WINDOW / log.period)), n // 8))
    width, count = parts.width, len(parts.means)
    largest = float(np.quantile(np.linalg.norm(parts.means, axis=1), 0.99))
    limit = max(_PUSHED * float(np.sort(parts.rough)[:3].mean()), 0.01 * largest)
    turn = Rotation.identity(n) if log.rotation is None else Rotation.from_rotvec(log.rotation)
    outward = turn if log.wrench_axes == "tool" else Rotation.identity(n)
    weight = _weigh(log, turn, slice(0, n))
    begin, end = 0, count
    if weight is None or weight.rotation is None or weight.left > limit:  # more acts than weight
        begin, end = _free_run(parts, limit) if tared else (0, 0)
    if begin == end:
        why = "no part of the log is free of contact"
        return Sensed(
            quantities={name: unknown(unit, why) for name, unit in _NAMES.items()},
            force=outward.apply(force), moment=None, limit=limit,
            residual=np.full_like(force, np.nan), rotation=None,
        )  # fmt: skip
    run = slice(begin * width, end * width)
    if begin > 0 or end < count:
        weight = _weigh(log, turn, run) if end - begin >= BLOCKS else None
    offset = _line(log.time[run], force[run], end - begin, 0)
    push = outward.apply(force - force[run].mean(axis=0))
    told = {name: unknown(_NAMES[name], _LIGHT) for name in _NAMES}
    if weight is not None:
        told |= weight.told
        if weight.rotation is not None:
            push = turn.apply(weight.rest)
            offset = weight.offset if log.wrench_axes == "tool" else offset
    moment = log.moment
    if moment is not None:
        moment = outward.apply(moment - moment[run].mean(axis=0))
    rests = _Windows.of(push, width)
    calm = (parts.rough <= _QUIET * limit) & (np.linalg.norm(rests.means, axis=1) <= limit)
    calm = binary_erosion(calm, border_value=1)  # a touch may begin or end beside
    calm[begin:end] = True
    blocks = min(BLOCKS, int(calm.sum()))
    times = log.time[: count * width].reshape(count, width).mean(axis=1)
    at = f"mean of {log.time[run][0]:.2f} to {log.time[run][-1]:.2f} s, in the log's axes"
    told |= {f"sensor.offset.{axis}": offset.quantity(i, "N", at) for i, axis in enumerate("xyz")}
    squares = in_blocks(np.c_[rests.rough[calm] ** 2, np.ones(calm.sum())], blocks)
    noise = jackknife(lambda s: np.sqrt(s[:1] / s[1]), squares)
    told["sensor.noise"] = noise.quantity(0, "N", f"of one axis, within {_WINDOW:g} s")
    told["sensor.drift"] = unknown("N/s", "the free part is too short")
    if blocks > 5:
        swings = weight is not None and weight.rotation is not None
        drift = _line(times[calm], rests.means[calm], blocks, 1)
        if weight is not None and swings:
            drift = weight.drift
        told["sensor.drift"] = one = drift.length("N/s", "of the three axes together")
        known = (one.low or 0.0) > _DRIFTS * np.linalg.norm(drift.values)
        if blocks == BLOCKS and known and not swings:
            push = push - np.outer(log.time - times[begin:end].mean(), drift.values)
    free = np.append(np.repeat(calm, width), np.zeros(n - count * width, dtype=bool))
    return Sensed(
        quantities=told, force=push, moment=moment, limit=limit,
        residual=np.where(free[:, None], push, np.nan),
        rotation=None if weight is None else weight.rotation,
    )  # fmt: skip


def _line(times: Array, forces: Array, blocks: int, order: int) -> Estimate:
    """Return the forces, (k, 3), in the middle of the times (``order`` 0), or their slopes (1)."""
    line = np.c_[np.ones_like(times), times - times.mean(), forces]
    sums = in_blocks(line[:, :, None] * line[:, None, :], min(BLOCKS, blocks))
    return jackknife(lambda s: solve(s[:2, :2], s[:2, 2:])[order], sums)


def _free_run(parts: _Windows, limit: float) -> tuple[int, int]:
    """Return the first windows in a row that are quiet, without a jump, and not in contact.

    A surface does not pull: where forces point both ways along their main direction, the offset
    is false.
    """
    means, begin = parts.means, 0
    while begin < len(means) - 1:
        end = begin
        while end < len(means):
            expected = means[max(0, end - 1)]
            if end > begin + 1:  # as the weight of a turning tool goes on
                expected = 2 * means[end - 1] - means[end - 2]
            jumps = end > begin and np.linalg.norm(means[end] - expected) > limit
            if jumps or parts.rough[end] > (_QUIET if end > begin + 1 else _STILL) * limit:
                break
            end += 1
        end -= end - begin > 2 and end < len(means)  # a touch may begin in the last one
        if end - begin >= 2:
            pushes = means - means[begin:end].mean(axis=0)
            pushes = pushes[np.linalg.norm(pushes, axis=1) > limit]
            main = np.linalg.svd(pushes, full_matrices=False)[2][0] if len(pushes) else None
            share = 0.0 if main is None else float(np.mean(pushes @ main > 0))
            if min(share, 1 - share) <= _PULLS:
                return begin, end
        begin = max(end, begin) + 1
    return 0, 0


class _Weight(NamedTuple):
    """The weight of a tool that turns."""

    told: dict[str, Quantity]
    rotation: Estimate | None  # rad, of the sensor; None: the weight is not nearly all that acts
    offset: Estimate  # N, in the sensor's axes
    drift: Estimate  # N/s, the same
    rest: Array  # (n, 3), N, without those and the weight
    left: float  # N, the largest force that is left over


def _weigh(log: Log, turn: Rotation, run: slice) -> _Weight | None:
    """Return the weight if the tool turns enough for its mass.

    A sensor turned by Q in the tool's axes reads offset + drift + Q^T R^T m (g - a). Mass and
    rotation are the similarity that takes the directions of the weight to the forces (Umeyama
    1991).
    """
    if log.rotation is None or log.force is None:
        return None
    back = turn.inv()
    heavy = np.tile([0.0, 0.0, -1.0], (len(log.time), 1))
    if log.position is not None:
        heavy -= smooth(log.position, log.period, 2) / GRAVITY
    heavy = back.apply(heavy)
    force, moment = log.force, np.zeros_like(log.force) if log.moment is None else log.moment
    if log.wrench_axes != "tool":
        force, moment = back.apply(force), back.apply(moment)
    since = log.time - log.time[run].mean()
    rows = np.c_[np.ones(len(heavy)), since, heavy, force, moment][run]
    near = np.zeros(3)

    def similarity(s: Array) -> Array:
        lines = solve(s[:2, :2], s[:2, 2:])  # mean and drift of each
        about = s[2:, 2:] - s[2:, :2] @ lines
        u, sizes, vt = np.linalg.svd(about[:3, 3:6])
        keep = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        turned = u * keep @ vt  # from the sensor's axes to the tool's
        pull = float(sizes @ keep / np.trace(about[:3, :3]))
        weights = pull**2 * turned.T @ about[:3, :3] @ turned
        crossed = pull * turned.T @ about[:3, 6:]  # sums of weight times moment
        lever = (crossed - crossed.T)[[1, 2, 0], [2, 0, 1]]
        centre = turned @ solve(np.trace(weights) * np.eye(3) - weights, lever)
        offset = lines[:, 3:6] - pull * lines[:, :3] @ turned  # and drift
        vector = rotation_vector(turned, near)
        return np.array([pull / GRAVITY, *vector, *centre, *offset.ravel()])

    sums = in_blocks(rows[:, :, None] * rows[:, None, :])
    first = similarity(sums.sum(axis=0))
    mass, near = float(first[0]), first[1:4]
    pull = mass * GRAVITY * Rotation.from_rotvec(near).inv().apply(heavy)
    left, swing, all_of = (
        float(np.linalg.norm(np.std(detrend(one[run], axis=0), axis=0)))
        for one in (force - pull, pull, log.force)
    )
    if left > _BETTER * all_of:
        return None
    found = jackknife(similarity, sums)
    if found.half()[0] > _WIDE * mass:
        return None
    sure = left < _LEFT * swing
    told = {"tool.mass": found.quantity(0, "kg", "" if sure else _UNSURE)}
    if sure and log.moment is not None:
        note = "in the tool's axes, from the sensor's origin"
        for i, axis in enumerate("xyz"):
            told[f"tool.centre_of_mass.{axis}"] = found.quantity(4 + i, "m", note)
    offset, drift = found.part(7, 10), found.part(10, 13)
    rest = force - pull - offset.values - np.outer(since, drift.values)
    return _Weight(told, found.part(1, 4) if sure else None, offset, drift, rest, 3 * left)
