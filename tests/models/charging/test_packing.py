"""Where the items of a packing plan go."""

import math

import pytest

from models.charging.packing import PlanItem, places
from models.charging.station import Station
from models.validation import ParameterError

STATION = Station()


def test_wall_nugget_touches_the_wall() -> None:
    item = PlanItem(azimuth=0.7)
    (place,) = places([item], STATION, believed=False)
    gap = STATION.crucible_radius - math.dist(place.position, STATION.crucible_centre)
    assert gap == pytest.approx(item.true_nugget.reach, rel=1e-12)
    assert place.layer == STATION.bed_height


def test_crown_lies_on_the_wall_nugget_below() -> None:
    wall = PlanItem(mass=0.14, azimuth=0.3)
    crown = PlanItem(kind="crown", mass=0.14, azimuth=0.3)
    aside = PlanItem(kind="crown", mass=0.14, azimuth=2.0)
    _, above, beside = places([wall, crown, aside], STATION, believed=False)
    assert above.layer == STATION.bed_height + wall.true_nugget.height
    assert beside.layer == STATION.bed_height


def test_believed_place_follows_the_scanner() -> None:
    item = PlanItem(size=1.1, scanned_size=1.0)
    (true,), (believed,) = (places([item], STATION, believed=one) for one in (False, True))
    assert math.dist(true.position, believed.position) == pytest.approx(
        0.1 * item.believed_nugget.reach, rel=1e-9
    )


def test_place_outside_of_the_crucible_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"plan\[0\].radius is 0.2"):
        places([PlanItem(kind="crown", radius=0.2)], STATION, believed=True)
