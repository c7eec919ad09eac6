"""Assesses the cameras: whether they find the parts, and the bias and noise of the measurement."""

import math
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.cell.camera_error_runs import with_drawn_errors
from chamfer.analysis.design.design_scenario import OFF_AXIS, ResolvedDesignScenario, target_of
from chamfer.analysis.design.link import Link, at_least
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, wrong_pose
from chamfer.diagrams.cell.cell_vision import VIEWS, looks_in
from chamfer.diagrams.cell.still_vision import StillVision
from chamfer.models.peg.peg_and_hole import OF_CONTACT, ColouredParts
from chamfer.systems.cameras.camera_image import Image, add_noise
from chamfer.systems.vision.cell_error import AXES
from chamfer.systems.vision.part_detector import measurement_spread

Array = NDArray[np.float64]

NEEDED: Final = tuple(AXES.index(axis) for axis in ("y", "z", "pitch", "yaw"))
_BLIND: Final = 0.5  # share of the pictures in which they are found, below which they are lost
_NEAR: Final = 0.2  # of the gap, from which on places follow each other closely
_PLACES: Final = 12  # from there to the depth
_FAR: Final = 4  # before
_COASTS: Final = 0.05  # s, of the feed, that the peg goes on once it is deep enough
_CAMERA_DRAWS: Final = 8  # of the cameras' errors, of which the largest bias counts


class _Way(NamedTuple):
    """The pictures of the parts on the way into the hole."""

    depth: float  # m
    across: float  # m, that both may be moved in the images by the compensation
    tilt: float  # rad, that may be left between them
    pictures: int  # at each place


class Sight(NamedTuple):
    """The measurement of aligned parts at rest, in the order of AXES."""

    bias: Array  # the largest size of measured minus true, m and rad, shape (6,)
    spread: Array  # standard deviation of one frame, m and rad, shape (6,)
    starts: int  # pictures of the parts at their gap and at starts, in which both were found
    of_starts: int
    way: tuple[float, ...]  # share of pictures with both, at places from the gap to the depth

    @property
    def share(self) -> float:
        """The share of pictures with both parts, at the worst two places in a row."""
        return min(sum(pair) / 2 for pair in pairwise(self.way))

    @property
    def seen(self) -> bool:
        """Whether the cameras see enough for an insertion to begin and end.

        They are blind if they lose the parts in more than half of the pictures at two places in a
        row.
        """
        lost = any(max(pair) < _BLIND for pair in pairwise(self.way))
        return self.starts > 0 and self.way[0] > 0 and not lost


def sight(scenario: ResolvedDesignScenario) -> Sight:
    """Return the cameras' measurement, from rendered images and the law of edges.

    The bias is that of a noise-free picture of the aligned parts, drawn by the true cameras with
    their light and lenses, measured with the believed ones. If ``spread.cameras`` is not zero, it
    is the largest of several random cameras.

    Parts are searched in pictures with noise: at the gap, at corners of the starts, and on the way
    into the hole, up to where the peg comes to rest. There the peg hides more and more of the
    mouth. :func:`chamfer.systems.vision.part_detector.measurement_spread` gives the effect of
    noise on the measurement.
    """
    starts, share = _corners(scenario), scenario.spread.cameras
    tilt = scenario.compensator.rotational.dead_zone or 0.0
    bore = scenario.parts.bore_depth or math.inf
    depth = min(target_of(scenario) + _COASTS * scenario.insert.speed, bore)
    way = _Way(depth, scenario.spread.lateral / 2, tilt, scenario.pictures)
    return _sight(_seen(scenario), starts, share, way)


def sight_links(scenario: ResolvedDesignScenario, seen: Sight) -> list[Link]:
    """Return whether the parts are found: before the insertion, and on the way into the hole."""
    if seen.starts < seen.of_starts:
        source = f"both parts found in {seen.starts} of {seen.of_starts} rendered images"
        first = at_least("sight", seen.starts / seen.of_starts, 1.0, "of the pictures", source)
    else:
        size = max(smallest_part(scenario), 1.0)
        source = "size in the images over the least that detection takes; found in all pictures"
        first = at_least("sight", size, 1.0, "of the least size", source)
    share = float(np.mean(seen.way))
    source = f"pictures at {len(seen.way)} places from gap to depth with both parts found"
    return [first, at_least("sight.way", share, 1.0, "of the way", source, by_design=share == 1)]


def smallest_part(scenario: AlignmentScenario) -> float:
    """Return the size of the smaller part in an image over the least that is detected.

    It is the smaller of the length of the edges, and the root of the area.
    """
    parts, found = scenario.parts, []
    radii, columns = (parts.peg_radius, parts.outer_radius), edge_columns(scenario)
    for view in VIEWS:
        looks = looks_in(scenario.cameras, scenario, view)
        scale = scenario.cameras.pixel_size * scenario.cameras.pixel_scale(view)
        for look, radius, length in zip(looks, radii, columns, strict=True):
            found += [length / look.length, math.sqrt(length * 2 * radius / scale / look.area)]
    return min(found)


def edge_columns(scenario: AlignmentScenario) -> tuple[float, float]:
    """Return how many columns the straight edges of peg and hole part have in an image."""
    cameras, parts = scenario.cameras, scenario.parts
    side = (cameras.width * cameras.pixel_size - scenario.gap) / 2  # m, from a tip to the border
    peg = min(parts.peg_length, side) - parts.peg_chamfer.height
    hole = min(parts.hole_length, side)
    return max(peg / cameras.pixel_size, 2.0), max(hole / cameras.pixel_size, 2.0)


@lru_cache(maxsize=256)
def _sight(
    scenario: AlignmentScenario,
    starts: tuple[tuple[float, ...], ...],
    share: float,
    way: _Way,
) -> Sight:
    aligned, X_WM = scenario.nominal_pose("peg"), scenario.nominal_pose("hole")
    cells = [scenario]
    if share:
        draws = range(_CAMERA_DRAWS)
        cells = [with_drawn_errors(scenario, 0, k, share, OFF_AXIS) for k in draws]
    bias, found = np.zeros(len(AXES)), []
    for cell in cells:
        error = StillVision(cell).error(aligned, X_WM)
        found.append(_is_found(error))
        bias = np.fmax(bias, np.abs(error))
    generator = np.random.default_rng(0)
    noise = max(scenario.cameras.frames_of(view).noise for view in VIEWS)

    def noisy(image: Image) -> Image:
        return add_noise(image, noise, generator)

    look = StillVision(scenario, noisy)
    poses = [wrong_pose(replace(scenario, initial_error=one), aligned) for one in starts]
    for X_WT in (aligned, *poses):
        found += [_is_found(look.error(X_WT, X_WM)) for _ in range(way.pictures)]
    near = np.linspace(-_NEAR * scenario.gap, way.depth, _PLACES)
    places = np.concatenate([np.linspace(-scenario.gap, near[0], _FAR)[:-1], near])
    R = X_WM.rotation()
    on_way = []
    for x in places.tolist():
        seen = []
        for _ in range(way.pictures):
            moved = generator.uniform(-way.across, way.across, 3) * (0.0, 1.0, 1.0)
            turn = RollPitchYaw(generator.uniform(-way.tilt, way.tilt, 3) * (0.0, 1.0, 1.0))
            X_WM_moved = RigidTransform(R, X_WM.translation() + R @ moved)
            X_WT = X_WM_moved @ RigidTransform(turn, np.array([x, 0.0, 0.0]))
            seen.append(_is_found(look.error(X_WT, X_WM_moved)))
        on_way.append(float(np.mean(seen)))
    pixel = scenario.cameras.pixel_size
    one = measurement_spread(noise, *edge_columns(scenario), scenario.gap / pixel)
    spread = np.array([pixel * one.lateral] * 3 + [one.rotational] * 3)
    return Sight(bias, spread, sum(found), len(found), tuple(on_way))


def _is_found(error: Array) -> bool:
    return bool(np.isfinite(error[list(NEEDED)]).all())


def _seen(scenario: ResolvedDesignScenario) -> AlignmentScenario:
    """Return the part of a scenario that the cameras see."""
    usual = {name: getattr(ColouredParts, name) for name in OF_CONTACT}
    return AlignmentScenario(
        parts=replace(scenario.parts, **usual),
        cameras=scenario.cameras,
        axis=scenario.axis,
        meeting_point=scenario.mouth,
        gap=scenario.gap,
    )


def _corners(scenario: ResolvedDesignScenario) -> tuple[tuple[float, ...], ...]:
    """Return the initial errors of two opposite starts."""
    far = scenario.spread
    reach = (0.0, far.lateral, far.lateral, 0.0, far.rotational, far.rotational)
    return tuple(
        tuple(np.add(scenario.initial_error, np.multiply(sign, reach)).tolist())
        for sign in (1.0, -1.0)
    )
