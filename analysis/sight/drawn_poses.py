"""Poses of the parts at and away from alignment, drawn at random."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.sight.detection_trials import Poses
from chamfer.models.validation import require_not_negative


@dataclass(frozen=True, kw_only=True)
class Reach:
    """How far a part is from its nominal pose at most, along and about each axis; uniform."""

    distance: float  # m, from the nominal pose, at most, along each axis
    angle: float  # rad, from the nominal pose, at most, about each axis

    def __post_init__(self) -> None:
        require_not_negative(self, "distance", "angle")


@dataclass(frozen=True, kw_only=True)
class PoseSpread:
    """Where the parts may be."""

    peg: Reach  # relative to the hole
    hole: Reach  # in the world


WIDE: Final = PoseSpread(
    peg=Reach(distance=0.01, angle=0.1), hole=Reach(distance=0.003, angle=0.03)
)  # as at the start of an alignment
NEAR: Final = PoseSpread(
    peg=Reach(distance=0.001, angle=0.005), hole=Reach(distance=0.003, angle=0.002)
)  # as at its end


def draw_poses(gap: float, spread: PoseSpread, random: np.random.Generator) -> Poses:
    """Return random poses of the parts.

    Args:
        gap: From the peg's tip to the hole's mouth, nominal, m; the world's origin is its middle.
        spread: Where the parts may be.
        random: Where they are.
    """
    X_WM = RigidTransform([gap / 2, 0.0, 0.0]) @ _deviation(spread.hole, random)
    X_MT = RigidTransform([-gap, 0.0, 0.0]) @ _deviation(spread.peg, random)
    return Poses(X_WT=X_WM @ X_MT, X_WM=X_WM)


def _deviation(reach: Reach, random: np.random.Generator) -> RigidTransform:
    angles = random.uniform(-reach.angle, reach.angle, 3)
    return RigidTransform(RollPitchYaw(angles), random.uniform(-reach.distance, reach.distance, 3))
