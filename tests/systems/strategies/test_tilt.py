"""The search by a peg that leans, driven without Drake."""

import math
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import ParameterError
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams, make_peg_in_hole_skill
from chamfer.systems.strategies.face_and_search import Tilt

PEG: Final = RoundPeg()
TO_LEAN: Final = ("done", "done", "contact", "done", "done", "done")


@pytest.fixture
def drive(make_drive: Any) -> Any:
    """A drive of a skill that leans, at the begin of the leaning."""
    leaning = make_drive(make_peg_in_hole_skill(PegInHoleSkillParams(search="tilt"), PEG))
    for outcome in TO_LEAN:
        leaning.make(outcome)
    assert leaning.state == "lean"
    return leaning


def way_of(drive: Any) -> np.ndarray:
    """Return what it commands until the state is left, rad above m."""
    way = np.zeros(6)
    state = drive.state
    while drive.state == state:
        drive.tick()
        way = drive.way() if drive.state == state else way
    return way


def test_it_leans_away_from_where_it_comes_from_at_the_same_height_and_stands_up_again(
    drive: Any,
) -> None:
    tilt = Tilt()
    angle, low = tilt.angle, PEG.peg_radius * math.sin(tilt.angle)
    way = way_of(drive)
    np.testing.assert_allclose(way, [angle, 0, 0, 0, tilt.back, low], rtol=0.05, atol=1e-9)
    # A turn by +angle about x lowers the rim on the side of -y, which is where it slides to.
    for outcome in ("contact", "contact", "done"):
        drive.make(outcome)
    assert drive.state == "stand"
    way = way_of(drive)
    np.testing.assert_allclose(way[:3], [-angle, 0, 0], rtol=0.05, atol=1e-9)
    assert way[4] < 0
    assert way[5] < 0


def test_its_point_is_in_the_hole_wherever_the_hole_may_be() -> None:
    # The lowest point of the rim, with the axis ``back`` off, and 2 mm more either way.
    tilt = Tilt()
    foremost = PEG.peg_radius * math.cos(tilt.angle) - tilt.back
    for x in (-0.002, 0.002):
        for y in (-0.002, 0.002):
            assert math.hypot(x, foremost + y) < PEG.hole_radius - PEG.lead_in
    # So deep that a round edge does not take it for the wall.
    assert PEG.peg_radius * math.sin(tilt.angle) > 2 * PEG.lead_in


def test_friction_is_not_taken_for_the_wall() -> None:
    # Pressed with D v on the face, at twice the friction of the parts.
    tilt, params = Tilt(), PegInHoleSkillParams()
    assert tilt.threshold > 2 * PEG.material.friction * 800.0 * params.maintained


@pytest.mark.parametrize(
    ("name", "value"),
    [("angle", 0.0), ("angle", 0.6), ("back", 0.0), ("threshold", math.nan), ("cycles", -1.0)],
)
def test_it_refuses(name: str, value: float) -> None:
    with pytest.raises(ParameterError) as refused:
        Tilt(**{name: value})
    assert refused.value.name == name
