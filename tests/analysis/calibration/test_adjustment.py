"""The adjustment beside OpenCV's own, and its standard deviations beside what they mean."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from chamfer.analysis.calibration.board import Chessboard
from chamfer.analysis.calibration.camera_fit import (
    BoardView,
    Places,
    Seen,
    _linearised,
    adjust,
    fit_camera,
)
from chamfer.models.cameras.camera import Camera

SIZE = (640, 480)


def truth(camera: Camera) -> np.ndarray:
    return np.array([*camera.focal, *camera.centre, *camera.distortion])


def seen_by(sights: Sequence[BoardView]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    points = [
        np.column_stack([one.points, np.zeros(len(one.points))]).astype(np.float32)
        for one in sights
    ]
    return points, [one.pixels.astype(np.float32) for one in sights]


@pytest.fixture
def photographed(photographs: Path, board: Chessboard) -> list[Seen]:
    seen = []
    for path in sorted(photographs.glob("*.jpg")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        seen.append(Seen(name=path.name, corners=board.find(image.astype(np.uint8))))
    return seen


def test_exact_corners_give_the_camera_exactly(
    camera: Camera, place: Callable[..., list[Camera]], look: Callable[..., list[Seen]]
) -> None:
    fit = fit_camera(look(place(8), noise=0.0), SIZE)
    found, deviations = fit.adjustment.intrinsic(0)
    np.testing.assert_allclose(found, truth(camera), rtol=1e-6, atol=1e-6)
    assert deviations.max() < 1e-4


def test_one_camera_is_what_opencv_finds_of_the_photographs(photographed: list[Seen]) -> None:
    fit = fit_camera(photographed, SIZE)
    rms, matrix, distortion, *_, deviations, _, errors = cv2.calibrateCameraExtended(
        *seen_by(fit.sights), SIZE, np.eye(3), np.zeros(5)
    )
    found, _ = fit.adjustment.intrinsic(0)
    expected = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(distortion)]
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    independent, _ = fit.adjustment.covariances
    np.testing.assert_allclose(
        np.sqrt(np.diag(independent)[:9]), np.ravel(deviations)[:9], rtol=1e-4
    )
    np.testing.assert_allclose(fit.errors, np.ravel(errors), rtol=1e-4)
    assert np.sqrt(np.mean(fit.errors**2)) == pytest.approx(rms, rel=1e-6)


def test_the_jackknife_is_what_leaving_out_pictures_changes(photographed: list[Seen]) -> None:
    fit = fit_camera(photographed, SIZE)
    without = np.array(
        [
            fit_camera(photographed[:k] + photographed[k + 1 :], SIZE).adjustment.intrinsic(0)[0]
            for k in range(len(photographed))
        ]
    )
    count = len(without)
    spread = np.sqrt((count - 1) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    independent, jackknife = (np.sqrt(np.diag(one)[:9]) for one in fit.adjustment.covariances)
    np.testing.assert_allclose(jackknife, spread, rtol=0.1)
    assert (jackknife > 1.3 * independent).all()  # the photographs' errors hang together
    np.testing.assert_allclose(fit.adjustment.intrinsic(0)[1], jackknife)


def test_independent_errors_spread_as_their_covariance_says(
    camera: Camera, place: Callable[..., list[Camera]], look: Callable[..., list[Seen]]
) -> None:
    places = place(6)
    fits = [fit_camera(look(places, seed), SIZE).adjustment for seed in range(60)]
    found = np.array([fit.intrinsic(0)[0] for fit in fits])
    said = np.mean([np.diag(fit.covariances[0])[:9] for fit in fits], axis=0)
    ratio = np.var(found, axis=0) / said
    assert (ratio > 0.5).all()  # chi-square of 59: 0.5 to 1.7 in 99.9 %
    assert (ratio < 1.7).all()
    assert np.mean([fit.noise for fit in fits]) == pytest.approx(0.05, rel=0.01)


def test_derivatives_of_two_cameras(
    place: Callable[..., list[Camera]], look: Callable[..., list[Seen]]
) -> None:
    """The normal equations' slope is that of the sum of squares."""
    fit = fit_camera(look(place(3)), SIZE)
    parameters = fit.adjustment.parameters
    stereo = [0.02, -0.1, 0.05, -0.1, 0.01, 0.02]
    both = np.concatenate([parameters[:9], parameters[:9] + 0.1, stereo, parameters[9:]])
    right = [
        BoardView(camera=1, picture=one.picture, points=one.points, pixels=one.pixels)
        for one in fit.sights
    ]
    sights, places, noise = [*fit.sights, *right], Places(2), [0.05, 0.1]
    _, _, slope = _linearised(sights, both, places, noise)
    numeric = []
    for k in range(len(both)):
        turn = np.zeros(len(both))
        turn[k] = 1e-6 * max(1.0, abs(both[k]))
        costs = [_linearised(sights, both + s * turn, places, noise)[0] for s in (-1, 1)]
        numeric.append(-(costs[1] - costs[0]) / (4 * turn[k]))
    np.testing.assert_allclose(slope, numeric, rtol=1e-4, atol=1e-6 * np.abs(slope).max())


def test_corners_that_tell_nothing_are_refused(
    place: Callable[..., list[Camera]], look: Callable[..., list[Seen]]
) -> None:
    fit = fit_camera(look(place(3)), SIZE)
    start = fit.adjustment.parameters[:15]
    with pytest.raises(np.linalg.LinAlgError):
        adjust(fit.sights[:1], start, places=Places(1), noise=[1.0])
