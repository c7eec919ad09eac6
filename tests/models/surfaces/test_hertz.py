"""The stiffness of a contact against Hertz' closed form and the thesis' materials."""

import pytest

from chamfer.models.surfaces.hertz import (
    FUSED_SILICA,
    SILICON,
    ElasticSolid,
    hertz_modulus,
    hertz_stiffness,
)
from chamfer.models.validation import ParameterError


@pytest.mark.parametrize(("force", "radius"), [(0.5, 0.01), (1.2, 0.02), (5.0, 0.01)])
def test_it_is_the_slope_of_the_force_over_the_depth(force: float, radius: float) -> None:
    def force_at(depth: float) -> float:
        return 4 / 3 * hertz_modulus(SILICON, FUSED_SILICA) * radius**0.5 * depth**1.5

    depth = (force / force_at(1.0)) ** (2 / 3)
    slope = (force_at(depth * 1.001) - force_at(depth * 0.999)) / (0.002 * depth)
    found = hertz_stiffness(SILICON, FUSED_SILICA, radius=radius, force=force)
    assert found == pytest.approx(slope, rel=1e-5)


def test_silicon_on_fused_silica() -> None:
    # By hand: 1 / (0.9711 / 150 + 0.9711 / 72) GPa
    assert hertz_modulus(SILICON, FUSED_SILICA) == pytest.approx(50.10e9, rel=1e-3)
    found = hertz_stiffness(SILICON, FUSED_SILICA, radius=0.02, force=1.2)
    assert found == pytest.approx(7.12e6, rel=2e-3)


def test_what_is_no_contact_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^force is 0, allowed: a finite number > 0"):
        hertz_stiffness(SILICON, SILICON, radius=0.01, force=0)
    with pytest.raises(ParameterError, match=r"^poisson is 0.6"):
        ElasticSolid(modulus=1e9, poisson=0.6)
