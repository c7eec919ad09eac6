"""What the free part of a log tells of the sensor and its tool: offset, drift, noise, weight."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion
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
_UNSURE = "weighs too little to tell its centre and the sensor's rotation"
_NAMES: Final = {
    **{f"sensor.offset.{axis}": "N" for axis in "xyz"},
    "sensor.drift": "N/s",
    "sensor.noise": "N",
    "tool.mass": "kg",
    **{f"tool.centre_of_mass.{axis}": "m" for axis in "xyz"},
}


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """What is known of the forces before the sensor's rotation is; n rows, m of them free."""

    quantities: dict[str, Quantity]
    force: Array  # (n, 3), N, without offset and weight, in fixed axes if the sensor isn't turned
    moment: Array | None  # (n, 3), N m, the same
    limit: float  # N, what a free sensor stays below
    free: NDArray[np.bool_]  # (n,), nothing is touched
    residual: Array  # (n, 3), N, of the free rows
    rotation: Estimate | None  # rad, rotation vector in the tool's axes, from the tool's weight


def fit_sensor(log: Log, *, tared: bool = True) -> Sensed:
    """Return what the free part of a log with forces tells; their axes are known.

    Without ``tared`` no part is taken for free.
    """
    assert log.force is not None
    force, n = log.force, len(log.time)
    width = min(max(8, round(_WINDOW / log.period)), n // 8)
    count = n // width
    means, powers = _windows(force[: count * width].reshape(count, width, 3))
    noise = float(np.sqrt(np.sort(powers)[:3].mean()))
    limit = max(_PUSHED * noise, 0.01 * float(np.quantile(np.linalg.norm(means, axis=1), 0.99)))
    turn = Rotation.identity(n) if log.rotation is None else Rotation.from_rotvec(log.rotation)
    turns, in_tool = log.rotation is not None, log.wrench_axes == "tool"
    weight = _weigh(log, turn, slice(0, n)) if turns else None
    begin, end = 0, count
    if weight is None or not weight.sure or weight.left > limit:  # it is not all that acts
        begin, end = _free_run(means, np.sqrt(powers), limit) if tared else (0, 0)
    if begin == end:
        why = "no part of the log is free of contact"
        fixed = turn.apply(force) if in_tool else force
        return Sensed(
            quantities={name: unknown(unit, why) for name, unit in _NAMES.items()}, force=fixed,
            moment=None, limit=limit, free=np.zeros(n, dtype=bool), residual=0 * force,
            rotation=None,
        )  # fmt: skip
    run = slice(begin * width, end * width)
    blocks = min(BLOCKS, end - begin)
    offset = force[run].mean(axis=0)
    line = np.c_[np.ones(run.stop - run.start), log.time[run] - log.time[run].mean(), force[run]]
    sums = in_blocks(line[:, :, None] * line[:, None, :], blocks)
    centre = jackknife(lambda s: solve(s[:2, :2], s[:2, 2:])[0], sums)
    weight = _weigh(log, turn, run) if turns and end - begin >= BLOCKS else None
    tool = {name: unknown(_NAMES[name], _LIGHT) for name in _NAMES if name.startswith("tool")}
    push = turn.apply(force - offset) if in_tool else force - offset
    if weight is not None:
        tool["tool.mass"] = weight.found.quantity(0, "kg", "" if weight.sure else _UNSURE)
    if weight is not None and weight.sure:
        held = force if in_tool or not turns else turn.inv().apply(force)
        if in_tool:
            centre = weight.found.part(7, 10)
        push = turn.apply(held - weight.pull - weight.found.values[7:])
        if log.moment is not None:
            note = "in the tool's axes, from the sensor's origin"
            for i, axis in enumerate("xyz"):
                tool[f"tool.centre_of_mass.{axis}"] = weight.found.quantity(4 + i, "m", note)
    moment = log.moment
    if moment is not None:
        moment = moment - moment[run].mean(axis=0)
        moment = turn.apply(moment) if in_tool else moment
    rest, rests = _windows(push[: count * width].reshape(count, width, 3))
    calm = (np.sqrt(powers) <= _QUIET * limit) & (np.linalg.norm(rest, axis=1) <= limit)
    calm = binary_erosion(calm, border_value=1)  # a touch may begin or end beside
    calm[begin:end] = True
    if weight is not None and weight.sure:
        calm[[0, -1]] = False  # there the acceleration is not known
    free = np.append(np.repeat(calm, width), np.zeros(n - count * width, dtype=bool))
    at = f"mean of {log.time[run][0]:.2f} to {log.time[run][-1]:.2f} s, in the log's axes"
    rough = jackknife(lambda s: np.sqrt(s[:1] / s[1]), in_blocks(
        np.c_[rests[calm], np.ones(calm.sum())], min(BLOCKS, int(calm.sum()))))  # fmt: skip
    quantities = {f"sensor.offset.{a}": centre.quantity(i, "N", at) for i, a in enumerate("xyz")}
    times = log.time[: count * width].reshape(count, width).mean(axis=1)
    drift = _drift(times[calm], rest[calm])
    drifts = unknown("N/s", "the free part is too short")
    if drift is not None:
        drifts = drift.length("N/s", "of the three axes together")
        sure = (drifts.low or 0.0) > _DRIFTS * np.linalg.norm(drift.values)
        if sure and drift.blocks == BLOCKS:
            push = push - np.outer(log.time - times[begin:end].mean(), drift.values)
    quantities |= {
        "sensor.drift": drifts,
        "sensor.noise": rough.quantity(0, "N", f"of one axis, within {_WINDOW:g} s"),
        **tool,
    }
    rotation = None if weight is None or not weight.sure else weight.found.part(1, 4)
    return Sensed(
        quantities=quantities, force=push, moment=moment, limit=limit, free=free,
        residual=np.where(free[:, None], push, np.nan), rotation=rotation,
    )  # fmt: skip


def _windows(shaped: Array) -> tuple[Array, Array]:
    """Return the mean of each window, (k, 3), and an axis' power about its line, (k,)."""
    width = shaped.shape[1]
    ramp = np.linspace(-1.0, 1.0, width)
    means = shaped.mean(axis=1)
    slopes = np.einsum("w,kwi->ki", ramp, shaped) / (ramp @ ramp)
    line = shaped - means[:, None] - slopes[:, None] * ramp[:, None]
    return means, (line**2).sum(axis=(1, 2)) / 3 / (width - 2)


def _free_run(means: Array, rough: Array, limit: float) -> tuple[int, int]:
    """Return the first windows in a row that are quiet, without a jump, and not in contact."""
    begin = 0
    while begin < len(means) - 1:
        end = begin
        while end < len(means) and rough[end] <= (_QUIET if end > begin + 1 else _STILL) * limit:
            if not _goes_on(means[begin : end + 1], limit):
                break
            end += 1
        end -= end - begin > 2 and end < len(means)  # a touch may begin in the last one
        others = np.delete(means, slice(begin, end), axis=0)
        if end - begin >= 2 and not _pulls(others - means[begin:end].mean(axis=0), limit):
            return begin, end
        begin = max(end, begin) + 1
    return 0, 0


def _goes_on(means: Array, limit: float) -> bool:
    """Tell whether the last window follows the others, as the weight of a turning tool does."""
    expected = 2 * means[-2] - means[-3] if len(means) > 2 else means[0]
    return bool(np.linalg.norm(means[-1] - expected) <= limit)


def _pulls(pushes: Array, limit: float) -> bool:
    """Tell whether forces point both ways along their main direction: the offset is false."""
    pushes = pushes[np.linalg.norm(pushes, axis=1) > limit]
    if not len(pushes):
        return False
    main = np.linalg.svd(pushes, full_matrices=False)[2][0]
    share = float(np.mean(pushes @ main > 0))
    return min(share, 1 - share) > _PULLS


def _drift(times: Array, forces: Array) -> Estimate | None:
    """Return how fast free forces, (k, 3), N, change, if there are enough of them."""
    if len(times) < 6:
        return None
    line = np.c_[np.ones_like(times), times - times.mean(), forces]
    sums = in_blocks(line[:, :, None] * line[:, None, :], min(BLOCKS, len(times)))
    return jackknife(lambda s: solve(s[:2, :2], s[:2, 2:])[1], sums)


class _Weight(NamedTuple):
    """The weight of a tool that turns."""

    found: Estimate  # mass, kg, rotation vector of the sensor, rad, centre, m, in the
    # tool's axes, and offset, N, in the sensor's
    pull: Array  # (n, 3), N, in the sensor's axes
    left: float  # N, the largest force but the noise that it does not explain
    sure: bool  # whether it is nearly all that the free force does


def _weigh(log: Log, turn: Rotation, run: slice) -> _Weight | None:
    """Return the weight if the tool turns enough for its mass.

    A sensor turned by Q in the tool's axes reads offset + Q^T R^T m (g - a). Mass and rotation are
    the similarity that takes the directions of the weight to the forces (Umeyama 1991).
    """
    assert log.force is not None
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
        spread = about[:3, :3]
        u, sizes, vt = np.linalg.svd(about[:3, 3:6])
        keep = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        turned = u * keep @ vt  # from the sensor's axes to the tool's
        pull = float(sizes @ keep / np.trace(spread))
        weights = pull**2 * turned.T @ spread @ turned
        crossed = pull * turned.T @ about[:3, 6:]  # sums of weight times moment
        lever = np.array([crossed[1, 2] - crossed[2, 1], crossed[2, 0] - crossed[0, 2],
            crossed[0, 1] - crossed[1, 0]])  # fmt: skip
        centre = turned @ solve(np.trace(weights) * np.eye(3) - weights, lever)
        offset = lines[0, 3:6] - pull * turned.T @ lines[0, :3]
        vector = rotation_vector(turned, near)
        return np.array([pull / GRAVITY, *vector, *centre, *offset])

    sums = in_blocks(rows[:, :, None] * rows[:, None, :])
    near = similarity(sums.sum(axis=0))[1:4]
    found = jackknife(similarity, sums)
    mass, half = float(found.values[0]), float(found.half()[0])
    if half > _WIDE * mass:
        return None
    pull = mass * GRAVITY * Rotation.from_rotvec(found.values[1:4]).inv().apply(heavy)
    rest = (force - pull)[run]
    left = float(np.linalg.norm(np.std(rest, axis=0)))
    if left > _BETTER * np.linalg.norm(np.std(log.force[run], axis=0)):
        return None
    swing = float(np.linalg.norm(np.std(pull[run], axis=0)))
    return _Weight(found, pull, 3 * left, left < _LEFT * swing)
