"""Stiffness of a contact from its two materials (Hertz; moduli of appendix B).

A sphere of radius R, m, that is pressed on a plane with F, N, sinks in by d, m, with
``F = 4/3 E* sqrt(R) d^1.5`` and ``1/E* = (1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2``. Small motions
about F see the stiffness ``dF/dd = 2 E* sqrt(R d) = (6 E*^2 R F)^(1/3)``.
"""

from dataclasses import dataclass
from typing import Final

from chamfer.models.validation import ParameterError, require_between, require_positive


@dataclass(frozen=True, kw_only=True)
class ElasticSolid:
    """An elastic material."""

    modulus: float  # Pa, of elasticity
    poisson: float  # Poisson's ratio

    def __post_init__(self) -> None:
        require_positive(self, "modulus")
        require_between(self, 0.0, 0.5, "poisson")


# Appendix B.1 and B.2
SILICON: Final = ElasticSolid(modulus=150e9, poisson=0.17)
FUSED_SILICA: Final = ElasticSolid(modulus=72e9, poisson=0.17)
WINDOW_GLASS: Final = ElasticSolid(modulus=69e9, poisson=0.23)


def hertz_modulus(one: ElasticSolid, other: ElasticSolid) -> float:
    """Return E*, Pa, of two materials that touch."""
    return 1 / sum((1 - solid.poisson**2) / solid.modulus for solid in (one, other))


def hertz_stiffness(
    one: ElasticSolid, other: ElasticSolid, *, radius: float, force: float
) -> float:
    """Return the stiffness of a contact about a force, N/m.

    Args:
        one: The first material.
        other: The second material.
        radius: m, of the sphere on a plane; of two spheres, 1 / (1 / R_1 + 1 / R_2).
        force: N.

    Raises:
        ParameterError: If radius or force is not a finite number > 0.
    """
    for name, value in (("radius", radius), ("force", force)):
        if not 0 < value < float("inf"):
            raise ParameterError(name, value, "a finite number > 0")
    return float((6 * hertz_modulus(one, other) ** 2 * radius * force) ** (1 / 3))
