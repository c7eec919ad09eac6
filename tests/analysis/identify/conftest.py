"""Logs of an arm that is known: an impedance's arm slides a tool over a plane that gives way."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.log import Log

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Arm:
    """The truth behind simulated logs."""

    stiffness: tuple[float, float, float] = (600.0, 700.0, 650.0)  # N/m
    damping: tuple[float, float, float] = (60.0, 75.0, 90.0)  # N s/m
    mass: float = 4.0  # kg
    arm_friction: float = 2.0  # N
    delay: float = 0.03  # s
    friction: float = 0.22
    surface: float = 4e4  # N/m
    normal: tuple[float, float, float] = (0.04, -0.03, 1.0)
    rotation: tuple[float, float, float] = (0.02, -0.01, 0.0)  # rad, of the sensor in the tool
    tool_axes: bool = False  # forces are recorded in the sensor's axes
    fixed: bool = False  # the rotation is one of fixed axes
    offset: tuple[float, float, float] = (0.0, 0.8, -0.8)  # N
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)  # N/s
    noise: float = 0.06  # N
    tool_mass: float = 0.0  # kg, that the sensor sees
    tool_centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m
    turning: float = 0.3  # rad, of the tool
    wall: bool = False  # a second surface touches the tool's side
    touches: float = 3.0  # s; infinite: never
    duration: float = 25.0  # s
    rate: int = 100  # Hz
    unit: float = 1.0  # newton of a recorded unit


def _wander(rng: np.random.Generator, time: Array, shape: tuple[int, ...], low: float, high: float
            ) -> Array:  # fmt: skip
    """Return smooth signals of rms 1, (len(time), *shape), of frequencies low to high, Hz."""
    total = np.zeros((len(time), *shape))
    for _ in range(6):
        speed = 2 * np.pi * rng.uniform(low, high, shape)
        total += np.sin(np.multiply.outer(time, speed) + rng.uniform(0, 2 * np.pi, shape))
    return np.asarray(total / np.sqrt(3.0))


def simulate(arm: Arm, seeds: int, first: int = 0) -> list[Log]:
    """Return logs of so many seeds; the motion is integrated at 1 kHz, all at once."""
    rng = np.random.default_rng(first)
    every = 1000 // arm.rate
    step = 1 / arm.rate / every
    time = np.arange(0.0, arm.duration + 0.5, step)
    coarse = np.arange(0.0, arm.duration + 0.6, 0.02)
    normal = np.array(arm.normal) / np.linalg.norm(arm.normal)
    stiffness, damping = np.array(arm.stiffness), np.array(arm.damping)
    down = np.clip((coarse - arm.touches + 1.0) / 1.0, -0.0, 1.0)
    height = 0.04 * (1 - down)[:, None] - down[:, None] * (
        0.04 + 0.012 * _wander(rng, coarse, (seeds,), 0.1, 0.5)
    )
    if not np.isfinite(arm.touches):
        height = 0.05 + 0.01 * _wander(rng, coarse, (seeds,), 0.1, 0.5)
    asked = np.concatenate(
        [0.05 * _wander(rng, coarse, (seeds, 2), 0.08, 0.6), height[:, :, None]], axis=2
    )
    asked[:, :, 2] -= asked[:, :, :2] @ normal[:2]  # along the surface
    rough = rng.uniform(0, 2 * np.pi, (seeds, 5))
    waves = (
        2 * np.pi / rng.uniform(0.008, 0.04, (seeds, 5, 2)) * rng.choice([-1, 1], (seeds, 5, 2))
    )
    slips = 0.08 * _wander(rng, coarse, (seeds,), 0.5, 6.0)
    rows = int(arm.duration * arm.rate)
    x, v = asked[0].copy(), np.zeros((seeds, 3))
    kept = {name: np.zeros((rows, seeds, 3)) for name in ("x", "v", "a", "f", "side")}
    for k in range(rows * every):
        at = max(0.0, time[k] - arm.delay) / 0.02
        i = int(at)
        goal = asked[i] + (at - i) * (asked[i + 1] - asked[i])
        bumps = np.sin(np.einsum("sij,sj->si", waves, x[:, :2]) + rough).sum(axis=1)
        depth = 2.5e-5 * bumps - x @ normal
        load = np.maximum(0.0, arm.surface * depth - 150.0 * (v @ normal)) * (depth > 0)
        along = v - (v @ normal)[:, None] * normal
        pace = np.sqrt(np.sum(along**2, axis=1) + 1e-3**2)
        friction = arm.friction * (1 + slips[int(time[k] / 0.02)])
        force = load[:, None] * (normal - (friction / pace)[:, None] * along)
        side = np.zeros((seeds, 3))
        if arm.wall:
            side[:, 0] = -2000.0 * np.maximum(0.0, x[:, 0] - 0.02)
        own = arm.arm_friction * v / np.sqrt(np.sum(v**2, axis=1, keepdims=True) + 2e-3**2)
        a = (stiffness * (goal - x) - damping * v - own + force + side) / arm.mass
        if k % every == 0:
            for name, value in zip(kept, (x, v, a, force, side), strict=True):
                kept[name][k // every] = value
        v = v + step * a
        x = x + step * v
    return [_record(arm, asked[:, s], {n: o[:, s] for n, o in kept.items()}, first + s)
            for s in range(seeds)]  # fmt: skip


def _record(arm: Arm, asked: Array, kept: dict[str, Array], seed: int) -> Log:
    """Return what the sensors see."""
    rng = np.random.default_rng([seed, 1])
    time = np.arange(len(kept["x"])) / arm.rate
    lean = arm.turning * _wander(rng, time, (3,), 0.05, 0.2) / 1.5
    turn = Rotation.from_rotvec([np.pi, 0.0, 0.0]) * Rotation.from_rotvec(lean)
    seen = Rotation.from_rotvec(arm.rotation).inv()
    weight = arm.tool_mass * (np.array([0.0, 0.0, -9.81]) - kept["a"])
    force = kept["f"] + kept["side"]
    moment = np.cross(turn.apply([0.0, 0.0, 0.04]), kept["f"])
    moment += np.cross(turn.apply([0.0, 0.01, -0.06]), kept["side"])
    moment += np.cross(turn.apply(arm.tool_centre), weight)
    force = force + weight

    def sensed(vectors: Array) -> Array:
        if arm.fixed:
            return np.asarray(seen.apply(vectors))
        turned = seen.apply(turn.inv().apply(vectors))
        return np.asarray(turned if arm.tool_axes else turn.apply(turned))

    force = sensed(force) + arm.offset + np.outer(time, arm.drift)
    force += arm.noise * rng.standard_normal(force.shape)
    moment = sensed(moment) + 1e-3 * rng.standard_normal(force.shape)
    coarse = 0.02 * np.arange(len(asked))
    return Log(
        time=time, force=force / arm.unit, moment=moment / arm.unit,
        position=kept["x"] + 2e-5 * rng.standard_normal(force.shape), rotation=turn.as_rotvec(),
        reference_position=np.stack([np.interp(time, coarse, c) for c in asked.T], axis=1),
    )  # fmt: skip


@pytest.fixture(scope="session")
def simulated() -> Callable[..., list[Log]]:
    """The simulator of logs, and :class:`Arm` by keyword."""

    def run(seeds: int = 1, first: int = 0, **truth: object) -> list[Log]:
        return simulate(Arm(**truth), seeds, first)  # type: ignore[arg-type]

    return run
