"""Pegs and holes by name."""

import pytest

from chamfer.models.peg.peg_and_hole import PRESETS, ColouredParts, PegAndHole


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_parts_that_fit(name: str) -> None:
    parts = ColouredParts(**PRESETS[name])  # type: ignore[arg-type]
    assert 0 < parts.clearance_ratio < 0.05
    assert parts.bore_length < parts.peg_length


@pytest.mark.parametrize(
    ("name", "diameter", "bore"),
    [
        ("nist-12.675mm", 12.675e-3, 12.70e-3),
        ("factory-8mm", 7.986e-3, 8.1e-3),
        ("nist-16mm", 16e-3, 16.1e-3),
    ],
)
def test_published_diameters(name: str, diameter: float, bore: float) -> None:
    parts = PegAndHole(**PRESETS[name])  # type: ignore[arg-type]
    assert 2 * parts.peg_radius == pytest.approx(diameter)
    assert 2 * parts.hole_radius == pytest.approx(bore)


def test_scaled_parts_have_the_same_shape() -> None:
    parts = ColouredParts(bore_depth=0.03).scaled(0.0020070, 0.01)
    assert parts.hole_radius == 0.0020070
    assert parts.clearance_ratio == pytest.approx(0.01)
    assert parts.friction == ColouredParts.friction
    for name, length in (("peg_length", 0.012), ("bore_depth", 0.006), ("chamfer_width", 8e-4)):
        assert getattr(parts, name) == pytest.approx(length)
