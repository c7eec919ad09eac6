"""Shapes that several connectors are made of, and what cameras see of them."""

import math
from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.connectors.connector import Array, Piece

OUTLINE_SIDES: Final = 16


def block(name: str, one: Sequence[float], other: Sequence[float]) -> Piece:
    """Return a box between two opposite corners, m."""
    size = np.abs(np.subtract(other, one))
    return Piece(name, Box(*size), RigidTransform(np.add(one, other) / 2))


def turns(number: int) -> list[RotationMatrix]:
    """Return the rotations about z that divide a turn."""
    return [RotationMatrix.MakeZRotation(2 * math.pi * i / number) for i in range(number)]


def prism(radius: float, bottom: float, top: float) -> Array:
    """Return the corners of an upright prism that stands for a cylinder, m, shape (32, 3)."""
    angle = 2 * math.pi * np.arange(OUTLINE_SIDES) / OUTLINE_SIDES
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.insert(ring, 2, z, axis=1) for z in (bottom, top)])


def box_corners(width: float, height: float, bottom: float, top: float) -> Array:
    """Return the corners of an upright box about z, m, shape (8, 3)."""
    corners = product((-width / 2, width / 2), (-height / 2, height / 2), (bottom, top))
    return np.array(list(corners))
