"""Slides of a compliant gripper along a surface, and filters that follow them."""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.sliding_contact import SLIP, Touch, advance
from chamfer.systems.estimation.model_error import ModelErrorParams
from chamfer.systems.estimation.normal_filter import (
    NormalFilter,
    ResolvedSurfaceObserverParams,
    Sample,
    tangential_deviation,
)
from chamfer.systems.estimation.surface_observer_law import make_filter

Array = np.ndarray
Motion = Callable[[float], tuple[Array, Array]]


class Slide(NamedTuple):
    """Samples of a sensor without noise, and the truth."""

    samples: list[Sample]
    normals: Array  # (samples, d), zeros while free
    velocities: Array  # (samples, d), m/s, of the contact point
    modes: Array  # (samples,)


class Followed(NamedTuple):
    """What a filter made of a slide's samples."""

    normals: Array  # (samples, d)
    covariances: Array  # (samples, d, d)
    deviations: Array  # (samples,), rad
    statuses: Array  # (samples,)
    memory: Array  # after the last sample


class Noisy(NamedTuple):
    """Errors while the contact slides, of several seeds, rad."""

    errors: Array  # (seeds, samples)
    deviations: Array  # (seeds, samples)

    @property
    def rms(self) -> float:
        """In degrees."""
        return math.degrees(math.sqrt(float(np.mean(self.errors**2))))

    @property
    def coverage(self) -> float:
        """How often the error is within three standard deviations."""
        return float(np.mean(self.errors <= 3 * self.deviations))

    @property
    def band(self) -> float:
        """Three standard deviations, degrees, mean."""
        return math.degrees(3 * float(np.mean(self.deviations)))


class Slides:
    """Makes slides, adds noise to them and runs filters over them."""

    @staticmethod
    def stiffness(dimension: int, value: float = 100.0) -> tuple[tuple[float, ...], ...]:
        """Return that of a gripper that is as stiff in every direction, N/m."""
        return tuple(map(tuple, (value * np.eye(dimension)).tolist()))

    @classmethod
    def told(cls, dimension: int, **changes: Any) -> ResolvedSurfaceObserverParams:
        """Return what an observer is told of that gripper and the sensor of section 5.2.2."""
        known = {"force_noise": 1.0, "force_rate_noise": 5.0}
        known["stiffness"] = cls.stiffness(dimension)  # type: ignore[assignment]
        return ResolvedSurfaceObserverParams(**{**known, **changes})

    @classmethod
    def observer(
        cls, dimension: int, error: Mapping[str, float] | None = None, **changes: Any
    ) -> NormalFilter:
        """Return the filter of an observer that is told this; ``error`` is what may be wrong."""
        return make_filter(
            cls.told(dimension, model_error=ModelErrorParams(**error or {}), **changes)
        )

    @staticmethod
    def lead(
        dimension: int, *, speed: float = 0.2, depth: float = 0.1, heading: float = 0.0
    ) -> Motion:
        """Return a nominal motion at a constant speed and depth, from the origin (5-4)."""
        v = np.zeros(dimension)
        v[0] = speed
        if dimension == 3:
            v[:2] = speed * math.cos(heading), speed * math.sin(heading)
        start = np.zeros(dimension)
        start[-1] = -depth
        return lambda t: (start + t * v, v)

    @staticmethod
    def legs(start: Any, legs: list[tuple[float, Any]]) -> Motion:
        """Return a nominal motion of legs, each a duration, s, and a velocity, m/s."""
        ends = np.cumsum([duration for duration, _ in legs])
        velocities = np.array([velocity for _, velocity in legs], dtype=float)
        corners = [np.array(start, dtype=float)]
        for duration, velocity in legs:
            corners.append(corners[-1] + duration * np.array(velocity))

        def motion(t: float) -> tuple[Array, Array]:
            i = min(int(np.searchsorted(ends, t - 1e-9)), len(legs) - 1)
            return corners[i] + (t - (ends[i] - legs[i][0])) * velocities[i], velocities[i]

        return motion

    @staticmethod
    @lru_cache(maxsize=64)
    def make(
        surface: Surface,
        motion: Motion,
        duration: float,
        *,
        friction: SurfaceFriction | None = None,
        period: float = 0.05,
    ) -> Slide:
        """Return a slide: one sample a period, the contact in smaller steps."""
        d = surface.dimension
        friction = SurfaceFriction() if friction is None else friction
        touch: Touch | None = None
        touches, samples = [], []
        for k in range(round(duration / period) + 1):
            for t in ((k - 0.5) * period, k * period) if k else (0.0,):
                position, velocity = motion(t)
                touch = advance(surface, friction, 100 * np.eye(d), touch, position, velocity)
            assert touch is not None
            touches.append(touch)
            samples.append(Sample(touch.force, touch.force_rate, position, velocity))
        return Slide(
            samples,
            np.array([touch.normal for touch in touches]),
            np.array([touch.velocity for touch in touches]),
            np.array([touch.mode for touch in touches]),
        )

    @staticmethod
    def disturb(samples: list[Sample], seed: int) -> list[Sample]:
        """Return samples with noise: u_F = 1 N, and u_Fdot = 5 N/s (section 5.2.2)."""
        draw, d = np.random.default_rng(seed).standard_normal, len(samples[0].force)
        return [
            sample._replace(
                force=sample.force + 1 / math.sqrt(3) * draw(d),
                force_rate=sample.force_rate + 5 / math.sqrt(3) * draw(d),
            )
            for sample in samples
        ]

    @staticmethod
    def follow(observer: NormalFilter, samples: list[Sample]) -> Followed:
        """Run a filter over samples; it begins with the last axis as the normal."""
        memory = observer.start(np.eye(len(samples[0].force))[-1])
        found = []
        for sample in samples:
            found.append(observer.update(memory, sample))
            memory = found[-1].memory
        return Followed(
            np.array([estimate.normal for estimate in found]),
            np.array([estimate.covariance for estimate in found]),
            np.array([tangential_deviation(e.normal, e.covariance) for e in found]),
            np.array([estimate.status for estimate in found]),
            memory,
        )

    @staticmethod
    def unit(random: np.random.Generator, dimension: int) -> Array:
        """Return a unit vector, shape (d,), of any direction."""
        vector = random.standard_normal(dimension)
        return np.asarray(vector / np.linalg.norm(vector))

    @staticmethod
    def covariance(random: np.random.Generator, dimension: int, scale: float = 1.0) -> Array:
        """Return a symmetric positive definite matrix, shape (d, d)."""
        root = random.standard_normal((dimension, dimension))
        return np.asarray(scale * (root @ root.T + 0.01 * np.eye(dimension)))

    @staticmethod
    def angles(normals: Array, others: Array) -> Array:
        """Return the angles, rad, between unit vectors, shape (samples, d)."""
        return 2 * np.arcsin(np.clip(np.linalg.norm(normals - others, axis=1) / 2, 0, 1))

    @classmethod
    def noisy(
        cls, observer: NormalFilter, slide: Slide, *, seeds: int = 10, after: int = 20
    ) -> Noisy:
        """Run a filter over the same slide with the noise of several seeds."""
        counted = slide.modes == SLIP
        counted[:after] = False
        runs = [cls.follow(observer, cls.disturb(slide.samples, seed)) for seed in range(seeds)]
        return Noisy(
            np.array([cls.angles(run.normals, slide.normals)[counted] for run in runs]),
            np.array([run.deviations[counted] for run in runs]),
        )


@pytest.fixture(scope="package")
def slides() -> Slides:
    return Slides()
