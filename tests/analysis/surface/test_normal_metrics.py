"""Every number against a trace made by hand."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.surface.normal_metrics import (
    angle_between,
    estimation_metrics,
    normalised_square,
    tracking_metrics,
)

Array = NDArray[np.float64]


def at(*degrees: float) -> Array:
    angles = np.radians(degrees)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def test_an_angle_has_a_sign_in_the_plane_alone() -> None:
    truth = at(90.0, 90.0, 170.0, -170.0, 0.0)
    estimate = at(95.0, 80.0, -170.0, 170.0, 180.0)
    found = angle_between(estimate, truth)
    np.testing.assert_allclose(found, [5.0, -10.0, 20.0, -20.0, 180.0])
    estimate, truth = np.insert(estimate, 1, 0.0, axis=1), np.insert(truth, 1, 0.0, axis=1)
    np.testing.assert_allclose(angle_between(estimate, truth), np.abs(found))
    truth[1] = 0.0  # nothing touches
    np.testing.assert_array_equal(np.isnan(angle_between(estimate, truth)), [0, 1, 0, 0, 0])
    np.testing.assert_array_equal(
        np.isnan(angle_between(estimate[:, [0, 2]], truth[:, [0, 2]])), [0, 1, 0, 0, 0]
    )


def observed(**columns: Any) -> dict[str, Array]:
    """An estimate along a path of 20 s, a row each 0.05 s."""
    time = 0.05 * np.arange(401)
    traces = {
        "time": time,
        "error": np.ones_like(time),
        "band": np.full_like(time, 6.0),
        "nees": np.full_like(time, 0.25),
        "change": np.zeros_like(time),
        "speed": np.where(time > 0.49, 0.2, 0.0),
        "normal_x": np.zeros_like(time),
        "normal_y": np.ones_like(time),
    }
    return traces | columns


TIME = observed()["time"]


def measured(halt: float = 15.0, **columns: Any) -> dict[str, float | None]:
    return estimation_metrics(observed(**columns), halt=halt)


@pytest.mark.parametrize(
    ("name", "first", "last"),
    [("band.equilibrium", 8.0, 14.85), ("band.mean", 1.0, 14.95)],
)
def test_where_the_band_counts(name: str, first: float, last: float) -> None:
    inside = (first - 0.01 < TIME) & (last + 0.01 > TIME)
    assert measured(band=np.where(inside, 4.0, 9.0))[name] == pytest.approx(4.0)
    for edge in (first, last):
        rows = np.isclose(TIME, edge)
        found = measured(band=np.where(rows, 100.0, 0.0))[name]
        assert found == pytest.approx(100.0 / inside.sum())


@pytest.mark.parametrize(
    ("names", "first", "last"),
    [(("error.rms", "error.bias", "coverage"), 2.0, 14.95), (("error.max",), 0.55, 14.95)],
)
def test_where_the_error_counts(names: tuple[str, ...], first: float, last: float) -> None:
    inside = (first - 0.01 < TIME) & (last + 0.01 > TIME)
    good = measured(error=np.where(inside, 2.0, 50.0))
    assert (good["error.max"] == 2.0) == ("error.max" in names)
    if "error.rms" in names:
        assert good["error.rms"] == pytest.approx(2.0)
        assert good["error.bias"] == pytest.approx(2.0)
        assert good["coverage"] == 100.0
    for edge in (first, last):
        bad = measured(error=np.where(np.isclose(TIME, edge), 50.0, 2.0))
        assert all(bad[name] != good[name] for name in names)


def test_the_windows_end_with_the_halt() -> None:
    moving = TIME < 9.99
    found = measured(
        halt=10.0, error=np.where(moving, 1.0, 50.0), band=np.where(moving, 6.0, 99.0)
    )
    assert found["error.max"] == found["error.rms"] == 1.0
    assert found["band.equilibrium"] == found["band.mean"] == 6.0
    assert measured(halt=5.0)["band.equilibrium"] is None  # it would begin at 8 s
    assert measured(halt=0.5)["error.max"] is None
    # A later halt does not make them longer.
    found = measured(halt=18.0, error=np.where(TIME < 14.99, 1.0, 50.0))
    assert found["error.max"] == found["error.rms"] == 1.0


def test_errors_are_summed_up() -> None:
    alternating = np.where(np.arange(401) % 2, 3.0, -4.0)
    found = measured(error=alternating, band=np.full(401, 3.5), nees=alternating)
    assert found["error.max"] == 4.0
    assert found["error.rms"] == pytest.approx(math.sqrt(12.5))
    assert found["error.bias"] == found["nees"] == pytest.approx(-0.5)
    assert found["coverage"] == pytest.approx(50.0)
    assert measured(error=alternating)["coverage"] == 100.0
    assert measured(error=alternating, band=np.full(401, 3.999))["coverage"] == 50.0
    # An exact estimate has no band: rounding does not count.
    assert measured(error=np.full(401, 1e-13), band=np.zeros(401))["coverage"] == 100.0


def test_the_contact_breaks_away_when_it_first_slides() -> None:
    assert measured(speed=np.zeros(401))["breakaway_time"] is None
    assert measured(speed=np.where(TIME > 3.01, 0.1, 0.0))["breakaway_time"] == pytest.approx(3.05)
    # A gripper that does not touch yet moves, and does not slide.
    found = measured(speed=np.full(401, 0.2), error=np.where(TIME < 2.01, np.nan, 1.0))
    assert found["breakaway_time"] == pytest.approx(2.05)


def test_what_happens_after_the_halt() -> None:
    # The sample at 15 s is the first of a gripper at rest.
    normals = at(*np.where(TIME < 14.99, 60.0, 90.0 + 2.0 * (TIME - 15.0)))
    band = np.where(TIME < 14.99, 9.0, 6.0 + 0.1 * (TIME - 15.0))
    change = np.where(TIME < 3.0, -8.0, 7.0)
    found = measured(band=band, change=change, normal_x=normals[:, 0], normal_y=normals[:, 1])
    assert found["drift_after_halt"] == pytest.approx(10.0)
    assert found["band_after_halt"] == pytest.approx(0.5)
    assert found["band.final"] == pytest.approx(6.5)
    assert found["estimate.change"] == 8.0
    assert measured(halt=20.0)["drift_after_halt"] is None  # only one sample is left
    assert measured(halt=30.0)["band_after_halt"] is None
    assert measured(halt=19.95)["band_after_halt"] == 0.0


def controlled(**columns: Any) -> dict[str, Array]:
    """Control for 10 s, a row each 5 ms, with the observer's samples each 50 ms."""
    time = 0.005 * np.arange(2001)
    traces = {
        "time": time,
        "force": np.full_like(time, 5.0),
        "error": np.ones_like(time),
        "band": np.full_like(time, 6.0),
        "nees": np.full_like(time, 0.25),
        "travel": 0.5 * time,
    }
    return traces | columns


ROWS = controlled()["time"]


def tracked(**columns: Any) -> dict[str, float | None]:
    return tracking_metrics(controlled(**columns), force=5.0, every=10)


def test_force_counts_from_the_first_second_on() -> None:
    found = tracked(force=np.where(ROWS < 0.999, 50.0, np.where(ROWS < 1.001, 4.6, 5.2)))
    assert (found["force.min"], found["force.max"]) == (4.6, 5.2)
    assert found["force.final"] == 5.2
    assert found["force.within_10"] == 100.0
    assert found["position.travel"] == pytest.approx(5.0)


def test_force_settles_within_five_and_ten_percent() -> None:
    found = tracked(force=5.0 * (1 + np.exp(-ROWS)))
    assert found["force.settling_time"] == pytest.approx(math.log(20), abs=5e-3)
    assert found["force.settling_time_10"] == pytest.approx(math.log(10), abs=5e-3)
    restless = tracked(force=np.where(ROWS > 9.9, 5.3, 5.0))
    assert restless["force.settling_time"] is None
    assert restless["force.settling_time_10"] == 0.0


def test_the_estimate_counts_at_the_observers_samples_from_the_first_second_on() -> None:
    error, band = np.full(2001, 90.0), np.full(2001, 90.0)
    error[200::10], band[200::10] = 2.0, 3.0
    found = tracked(error=error, band=band)
    assert found["error.max"] == found["error.rms"] == found["error.bias"] == 2.0
    assert found["band.mean"] == 3.0
    assert found["coverage"] == 100.0
    error[200] = 5.0
    found = tracked(error=error, band=band)
    assert found["error.max"] == 5.0
    assert found["coverage"] == pytest.approx(100 * 180 / 181)


def test_a_band_that_tells_nothing_covers_nothing() -> None:
    # Such as that of a lost contact.
    lost = (TIME > 5.0) & (TIME < 6.0)
    found = measured(band=np.where(lost, 357.0, 6.0))["coverage"]
    inside = (TIME > 1.99) & (TIME < 14.96)
    assert found == pytest.approx(100 * (1 - (lost & inside).sum() / inside.sum()))


@pytest.mark.parametrize("d", [2, 3])
def test_normalised_square_of_errors_as_large_as_their_covariance(d: int) -> None:
    random = np.random.default_rng(0)
    root = np.zeros((d, d))
    root[:-1, :-1] = 0.02 * random.standard_normal((d - 1, d - 1))
    estimate = np.tile(np.eye(d)[-1], (20_000, 1))
    truth = estimate + random.standard_normal(estimate.shape) @ root.T
    truth /= np.linalg.norm(truth, axis=1)[:, None]
    # What it says of the normal's length has no part.
    length = 5.0 * np.outer(np.eye(d)[-1], np.eye(d)[-1])
    covariance = np.tile(root @ root.T + length, (20_000, 1, 1))
    for wider in (1.0, 4.0):
        found = normalised_square(estimate, truth, wider * covariance)
        assert found.mean() == pytest.approx(1 / wider, rel=0.03)


def test_normalised_square_where_there_is_none() -> None:
    estimate, truth = np.eye(2)[[1, 1, 1]], np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    covariance = np.zeros((3, 2, 2))
    covariance[2] = np.eye(2)
    found = normalised_square(estimate, truth, covariance)
    np.testing.assert_array_equal(found, [np.nan, np.nan, 0.0])
