"""Peg and hole as theory knows them."""

import dataclasses
import math
import re

import pytest

from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.validation import ParameterError

PAPER = PegHoleGeometry()
# Every number differs from the paper's, so that no two can be mixed up unseen.
OTHER = PegHoleGeometry(
    hole_radius=0.012, peg_radius=0.0117, friction=0.3, chamfer_width=0.003, chamfer_angle=0.9
)


def test_published_numbers() -> None:
    assert PAPER.clearance_ratio == pytest.approx(0.0255107, abs=5e-8)
    assert PAPER.rotation_limit == pytest.approx(0.05817, abs=5e-6)
    assert PAPER.lateral_limit == pytest.approx(0.019814, abs=5e-7)
    # Section 4 writes the limit as (c 2R) / (mu 2r), which is not c / mu.
    c, R, r, mu = PAPER.clearance_ratio, 0.010035, 0.009779, 0.45
    assert PAPER.rotation_limit == pytest.approx(c * 2 * R / (mu * 2 * r), rel=1e-12)
    assert PAPER.rotation_limit != pytest.approx(c / mu, rel=0.02)


def test_lengths_of_the_parts() -> None:
    assert OTHER.clearance == pytest.approx(3e-4)
    assert OTHER.friction_radius == pytest.approx(0.3 * 0.0117)
    assert OTHER.wedging_depth == pytest.approx(2 * 0.3 * 0.0117)
    assert OTHER.chamfer_limit == pytest.approx(0.0033)
    assert OTHER.lateral_limit == pytest.approx(0.0237)
    # A peg that leans by that much just spans the mouth.
    assert 2 * 0.0117 / math.cos(OTHER.mouth_tilt_limit) == pytest.approx(2 * 0.012)
    # Two points touch at theta_w where lambda is one.
    assert OTHER.wedging_depth * OTHER.rotation_limit == pytest.approx(2 * OTHER.clearance)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        *(
            (name, value, "a finite number > 0")
            for value in (0.0, -1.0, math.nan, math.inf)
            for name in ("hole_radius", "peg_radius", "friction")
        ),
        *(
            ("chamfer_width", value, "a finite number >= 0")
            for value in (-1e-9, math.nan, math.inf)
        ),
        ("peg_radius", 0.010035, "less than the hole's radius, 0.010035"),
        ("peg_radius", 0.02, "less than the hole's radius, 0.010035"),
        ("chamfer_angle", 0.0, "between 0 and pi/2"),
        ("chamfer_angle", math.pi / 2, "between 0 and pi/2"),
        ("chamfer_angle", math.nan, "between 0 and pi/2"),
        ("chamfer_width", 0.02, "with less than the peg's radius, 0.009779, on the peg"),
    ],
)
def test_errors(name: str, value: float, allowed: str) -> None:
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        dataclasses.replace(PAPER, **{name: value})
