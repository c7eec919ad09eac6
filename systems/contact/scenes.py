"""What an arm may touch, in which points, and what it holds meanwhile."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError, require_not_negative, require_positive
from chamfer.systems.contact.serial_chain import Chain

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ContactParams:
    """What happens where tip and surface touch."""

    stiffness: float = 1e4  # N/m, of the surface; assumed
    damping: float = 20.0  # N s/m, of the surface; assumed
    friction: SurfaceFriction = SurfaceFriction(coefficient=0.0)  # Coulomb's, along the world's x

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "damping")


@dataclass(frozen=True)
class ContactPoint:
    """A point of the tip and the surface that it may touch."""

    offset: tuple[float, float, float]  # m, in the endpoint's frame
    surface: Surface  # in space
    contact: ContactParams

    def __post_init__(self) -> None:
        if self.surface.dimension != 3:
            raise ParameterError("surface", self.surface, "a surface in space")
        if len(self.offset) != 3 or not all(map(math.isfinite, self.offset)):
            raise ParameterError("offset", self.offset, "three finite numbers")


@dataclass(frozen=True, eq=False)
class Load:
    """A rigid body that the endpoint holds; axes of its frame."""

    mass: float  # kg
    centre: tuple[float, float, float]  # m, of mass
    inertia: Array  # (3, 3), kg m^2, about the centre of mass

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        if len(self.centre) != 3 or not all(map(math.isfinite, self.centre)):
            raise ParameterError("centre", self.centre, "three finite numbers")
        inertia = np.asarray(self.inertia)
        symmetric = inertia.shape == (3, 3) and np.array_equal(inertia, inertia.T)
        if not (symmetric and np.all(np.linalg.eigvalsh(inertia) >= 0.0)):
            allowed = "a symmetric matrix of 3 rows, positive semidefinite"
            raise ParameterError("inertia", inertia.tolist(), allowed)


@dataclass(frozen=True, eq=False)
class Scene:
    """What holds for a while: the points that may touch, and what is held."""

    points: tuple[ContactPoint, ...]
    load: Load | None = None

    def __post_init__(self) -> None:
        if not self.points:
            raise ParameterError("points", self.points, "at least one point")


def with_load(chain: Chain, load: Load | None) -> Chain:
    """Return an arm whose last link is one body with a load."""
    if load is None:
        return chain
    inertia = np.array(load.inertia, dtype=np.float64)
    added = chain.endpoint + chain.R_WE @ np.array(load.centre)
    mass, centre, total = chain.mass.copy(), chain.centre.copy(), chain.inertia.copy()
    mass[-1] += load.mass
    centre[-1] = (chain.mass[-1] * chain.centre[-1] + load.mass * added) / mass[-1]
    total[-1] += chain.R_WE @ inertia @ chain.R_WE.T
    for part, place in ((chain.mass[-1], chain.centre[-1]), (load.mass, added)):
        arm = place - centre[-1]
        total[-1] += part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return chain._replace(mass=mass, centre=centre, inertia=total)
