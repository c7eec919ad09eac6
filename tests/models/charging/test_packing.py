"""Where the items of a packing plan go."""

import math

import numpy as np
import pytest

from chamfer.models.charging.packing import SILICON, PlanItem, nugget_of, places
from chamfer.models.charging.station import Station
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError

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
    # One centimetre from the middle of two alike, whose sum has twice their semi-axes.
    a, _, c = (2 * one for one in wall.true_nugget.semi_axes)
    lower = c * (1 - math.sqrt(1 - (0.01 / a) ** 2))
    assert above.layer == pytest.approx(STATION.bed_height + wall.true_nugget.height - lower)
    assert beside.layer == STATION.bed_height


def test_a_nugget_comes_to_rest_where_it_touches_what_was_laid() -> None:
    # Alike and laid alike: where two ellipsoids touch is known by a search over the lower one.
    laid = [PlanItem(kind="crown", mass=0.14, azimuth=0.3, radius=0.1)]
    item = PlanItem(kind="crown", mass=0.14, azimuth=0.3, radius=0.115)
    (place,) = places([item], STATION, believed=False, laid=laid)
    (lower,), upper = place.laid, place.lies
    rng = np.random.default_rng(0)
    points = rng.normal(size=(200_000, 3))
    points *= lower.nugget.semi_axes / np.linalg.norm(points, axis=1)[:, np.newaxis]
    met = (points @ lower.rotation.T + lower.middle - upper.middle) @ (
        upper.rotation / upper.nugget.semi_axes
    )
    assert np.linalg.norm(met, axis=1).min() == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("tilt_azimuth", [0.0, 2.0])
def test_a_tilted_nugget_slopes_and_nobody_believes_it(tilt_azimuth: float) -> None:
    laid = [PlanItem(kind="crown", radius=0.1, tilt=0.5, tilt_azimuth=tilt_azimuth)]
    plan = [PlanItem(kind="crown", radius=0.1)]
    true, believed = (places(plan, STATION, believed=one, laid=laid)[0] for one in (False, True))
    lowest = np.array([*true.position, true.layer])
    found = locate(true.laid[0].surface(plan[0].true_nugget), lowest)
    assert found.gap == pytest.approx(0.0, abs=1e-12)
    # Its top leans, and what was its side, further out than its top, comes up behind.
    way = np.array([math.cos(tilt_azimuth), math.sin(tilt_azimuth)])
    assert found.normal[:2] @ way > 0.05
    believed_normal = locate(believed.laid[0].surface(plan[0].true_nugget), lowest).normal
    np.testing.assert_allclose(believed_normal, [0.0, 0.0, 1.0], atol=1e-12)


def test_believed_place_follows_the_scanner() -> None:
    item = PlanItem(size=1.1, scanned_size=1.0)
    (true,), (believed,) = (places([item], STATION, believed=one) for one in (False, True))
    assert math.dist(true.position, believed.position) == pytest.approx(
        0.1 * item.believed_nugget.reach, rel=1e-9
    )


def test_nuggets_that_would_overlap_are_refused() -> None:
    plan = [PlanItem(mass=0.085, azimuth=0.0), PlanItem(mass=0.185, azimuth=0.3)]
    first, second = (item.true_nugget.reach for item in plan)
    beside = first + second
    message = (
        rf"^plan\[1\].azimuth is 0.3, allowed: one that brings it beside plan\[0\], at least "
        rf"{beside:.4f} m from its middle \(now 0.0\d+ m\), or on it, less than {first:.4f} m$"
    )
    with pytest.raises(ParameterError, match=message):
        places(plan, STATION, believed=True)
    # Side by side they touch where the middles are as far apart as both reach.
    a, b = (STATION.crucible_radius - one for one in (first, second))
    touching = math.acos((a * a + b * b - beside * beside) / (2 * a * b))
    for azimuth in (touching + 1e-6, 0.1):  # beside it, and on it
        places([plan[0], PlanItem(mass=0.185, azimuth=azimuth)], STATION, believed=True)
    with pytest.raises(ParameterError, match="beside"):
        places([plan[0], PlanItem(mass=0.185, azimuth=touching - 1e-6)], STATION, believed=True)


def test_only_those_of_the_same_height_overlap() -> None:
    # The upper ones stand 1 cm inwards: on the lower one's middle, and beside each other's side.
    below = PlanItem(mass=0.085, azimuth=0.0)
    aside = PlanItem(mass=0.014, azimuth=0.36)
    on_it = PlanItem(kind="crown", mass=0.185, azimuth=0.0)
    found = places([below, aside, on_it], STATION, believed=True)
    assert found[2].layer == STATION.bed_height + below.true_nugget.height
    bulk = PlanItem(kind="bulk", mass=0.4, radius=0.08, azimuth=0.0)
    with pytest.raises(ParameterError, match=r"plan\[1\].azimuth"):
        places([below, bulk], STATION, believed=True)
    places([bulk, bulk, below], STATION, believed=True)  # what is poured is no obstacle


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ([PlanItem(kind="crown", radius=0.2)], r"plan\[0\].radius is 0.2"),
        (
            [PlanItem(mass=0.185)] * 3,
            r"plan\[2\].azimuth is 0.0, allowed: one where its middle, 0.479 m high, is below",
        ),
        ([PlanItem(mass=30.0)], r"plan\[0\].mass is 30.0, allowed: less than 23.7 kg, to fit"),
    ],
)
def test_what_has_no_place_is_refused(plan: list[PlanItem], message: str) -> None:
    places(plan[:-1], STATION, believed=True)
    with pytest.raises(ParameterError, match=f"^{message}"):
        places(plan, STATION, believed=True)


def test_mass_is_that_of_solid_silicon() -> None:
    nugget = nugget_of(0.185)
    volume = 4 / 3 * math.pi * math.prod(nugget.semi_axes)
    assert volume * SILICON == pytest.approx(0.185, rel=1e-12)


def test_inertia_is_that_of_its_points() -> None:
    nugget = nugget_of(0.085)
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(400_000, 3))
    ball *= (rng.random(400_000) ** (1 / 3) / np.linalg.norm(ball, axis=1))[:, np.newaxis]
    points = ball * nugget.semi_axes
    square = np.mean(points**2, axis=0)
    expected = nugget.mass * (square.sum() - square)
    assert np.diag(nugget.inertia) == pytest.approx(expected, rel=0.01)


def test_points_that_touch_lie_on_it() -> None:
    nugget = nugget_of(0.028, size=1.2)
    for point in (nugget.wall_point, nugget.layer_point, (0.0, 0.0, 0.0)):
        scaled = np.subtract(point, nugget.centre) / nugget.semi_axes
        assert np.linalg.norm(scaled) == pytest.approx(1.0, rel=1e-12)


def test_no_mass_is_refused() -> None:
    with pytest.raises(ParameterError, match="mass is 0"):
        nugget_of(0.0)
