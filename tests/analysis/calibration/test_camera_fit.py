"""The adjustment beside OpenCV's own, what it uses, and calibrations beside the truth."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import Chessboard, Corners
from chamfer.analysis.calibration.calibration import Calibration, calibrate
from chamfer.analysis.calibration.calibration_accuracy import BoardPoses
from chamfer.analysis.calibration.camera_fit import (
    Fit,
    Picture,
    Places,
    _linearised,
    adjust,
    doubts,
    fit_camera,
    fit_pair,
)
from chamfer.analysis.scenario.errors import UserError
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_file import FramePose

SIZE = (640, 480)

Place = Callable[..., list[Camera]]
Look = Callable[..., list[Picture]]


def seen_by(fit: Fit) -> tuple[list[np.ndarray], list[np.ndarray]]:
    corners = [one.corners for one in fit.sights.values()]
    points = [np.pad(one.points, ((0, 0), (0, 1))).astype(np.float32) for one in corners]
    return points, [one.pixels.astype(np.float32) for one in corners]


@pytest.fixture
def photographed(photographs: Path, board: Chessboard) -> list[Picture]:
    seen = []
    for path in sorted(photographs.glob("*.jpg")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        seen.append(Picture(name=path.name, corners=board.find(image.astype(np.uint8))))
    return seen


def test_one_camera_is_what_opencv_finds_of_the_photographs(photographed: list[Picture]) -> None:
    fit = fit_camera(photographed, SIZE)
    rms, matrix, distortion, *_, deviations, _, errors = cv2.calibrateCameraExtended(
        *seen_by(fit), SIZE, np.eye(3), np.zeros(5)
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


def test_the_jackknife_is_what_leaving_out_pictures_changes(photographed: list[Picture]) -> None:
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


def test_derivatives_of_two_cameras(place: Place, look: Look) -> None:
    """The normal equations' slope is that of the sum of squares."""
    fit = fit_camera(look(place(3)), SIZE)
    parameters = fit.adjustment.parameters
    stereo = [0.02, -0.1, 0.05, -0.1, 0.01, 0.02]
    both = np.concatenate([parameters[:9], parameters[:9] + 0.1, stereo, parameters[9:]])
    left = list(fit.sights.values())
    sights = [*left, *(one._replace(camera=1) for one in left)]
    places, noise = Places(2), [0.05, 0.1]
    _, _, slope = _linearised(sights, both, places, noise)
    numeric = []
    for k in range(len(both)):
        turn = np.zeros(len(both))
        turn[k] = 1e-6 * max(1.0, abs(both[k]))
        costs = [_linearised(sights, both + s * turn, places, noise)[0] for s in (-1, 1)]
        numeric.append(-(costs[1] - costs[0]) / (4 * turn[k]))
    np.testing.assert_allclose(slope, numeric, rtol=1e-4, atol=1e-6 * np.abs(slope).max())


def test_corners_that_tell_nothing_are_refused(place: Place, look: Look) -> None:
    fit = fit_camera(look(place(3)), SIZE)
    start = fit.adjustment.parameters[:15]
    with pytest.raises(np.linalg.LinAlgError):
        adjust([fit.sights[0, 0]], start, places=Places(1), noise=[1.0])


X_LR = np.eye(4)
X_LR[:3, :3] = Rotation.from_rotvec([0.02, -0.15, 0.03]).as_matrix()
X_LR[:3, 3] = [0.1, 0.005, 0.01]
X_WB = np.eye(4)
X_WB[:3, :3] = Rotation.from_euler("xyz", [3.0, 0.1, 0.5]).as_matrix()
X_WB[:3, 3] = [0.4, 0.1, -0.2]
NOT_FOUND = "the board is not found"


def moved(one: Picture, shift: float) -> Picture:
    """Return a picture of a board that is not flat."""
    assert one.corners is not None
    points, pixels = one.corners.points, one.corners.pixels
    bent = pixels + shift * np.sin(80 * points[:, :1]) * [1.0, 0.0]
    return replace(one, corners=Corners(points=points, pixels=bent))


def seen_from(places: list[Camera], camera: Camera) -> list[Camera]:
    """Return where the right camera stands if the left one stands at places."""
    return [
        camera.placed(there.R_WC @ X_LR[:3, :3], there.p_WC + there.R_WC @ X_LR[:3, 3])
        for there in places
    ]


def fit_both(left: list[Picture], right: list[Picture]) -> Fit:
    fits = [fit_camera(left, SIZE, whose="left: "), fit_camera(right, SIZE, whose="right: ")]
    return fit_pair(fits)


@pytest.fixture
def pairs(camera: Camera, place: Place, look: Look) -> tuple[list[Picture], list[Picture]]:
    places = place(8, poses=BoardPoses(extent=(0.3, 0.5)))
    return look(places, 1, name="left"), look(seen_from(places, camera), 2, name="right")


def test_a_picture_that_fits_badly_is_left_out(place: Place, look: Look) -> None:
    seen = look(place(10))
    seen[4] = moved(seen[4], 1.5)
    seen[7] = Picture(name="picture7.png", left_out=NOT_FOUND)
    fit = fit_camera(seen, SIZE)
    assert list(fit.left_out) == [(0, 7), (0, 4)]
    assert fit.left_out[0, 7] == NOT_FOUND
    assert fit.left_out[0, 4].startswith("an outlier: its error of ")
    assert fit.left_out[0, 4].endswith(" is more than 3 times the median, 0.068")
    assert len(fit.sights) == 8


@pytest.mark.parametrize("tilt", [0.0, 1e-4, 0.01])
def test_boards_that_all_face_the_camera_don_t_tell_the_focal_length(
    place: Place, look: Look, tilt: float
) -> None:
    seen = look(place(8, poses=BoardPoses(tilt=tilt)))
    with pytest.raises(UserError, match=r"the pictures don't tell .*; tilt the board by 20 to 40"):
        doubts(fit_camera(seen, SIZE), [SIZE], [""])


def test_boards_that_hardly_lean_are_said(place: Place, look: Look) -> None:
    seen = look(place(8, poses=BoardPoses(tilt=0.12)))
    said, *_ = doubts(fit_camera(seen, SIZE), [SIZE], [""])
    assert said.startswith("the focal length is known to ")
    assert not doubts(fit_camera(look(place(20)), SIZE), [SIZE], [""])


def test_a_pair_of_cameras(pairs: tuple[list[Picture], list[Picture]]) -> None:
    left, right = pairs
    right[2] = Picture(name="right2.png", left_out=NOT_FOUND)
    left[5] = Picture(name="left5.png", left_out=NOT_FOUND)
    fit = fit_both(left, right)
    assert fit.pairs == 6
    assert fit.left_out == {(1, 2): NOT_FOUND, (0, 5): NOT_FOUND}
    assert fit.alone == {(0, 2): "without the right camera's", (1, 5): "without the left camera's"}
    assert len(fit.sights) == 14
    X_RL = np.linalg.inv(X_LR)
    stereo = fit.adjustment.parameters[fit.adjustment.places.stereo]
    turned = Rotation.from_rotvec(stereo[:3]).as_matrix() @ X_RL[:3, :3].T
    assert Rotation.from_matrix(turned).magnitude() < 2e-3
    np.testing.assert_allclose(stereo[3:], X_RL[:3, 3], atol=2e-4)


def test_pictures_in_another_order_are_taken_apart(
    pairs: tuple[list[Picture], list[Picture]],
) -> None:
    left, right = pairs
    right[3], right[4] = right[4], right[3]
    fit = fit_both(left, right)
    assert fit.pairs == 6
    assert set(fit.alone) == {(camera, k) for camera in (0, 1) for k in (3, 4)}
    assert set(fit.alone.values()) == {"both together don't fit the other pairs"}
    assert not fit.left_out


def test_a_board_that_moved_between_two_pictures_is_no_pair(
    camera: Camera, place: Place, look: Look
) -> None:
    places = place(8, poses=BoardPoses(extent=(0.3, 0.5)))
    others = seen_from(places, camera)
    others[3] = others[3].placed(others[3].R_WC, others[3].p_WC + 1e-3)
    fit = fit_both(look(places, 1), look(others, 2))
    assert set(fit.alone) == {(0, 3), (1, 3)}


def test_pairs_that_don_t_agree_at_all(pairs: tuple[list[Picture], list[Picture]]) -> None:
    left, right = pairs
    with pytest.raises(UserError) as raised:
        fit_both(left, [*right[3:], *right[:3]])
    assert "agree on how the cameras stand: are both in the same order" in str(raised.value)
    nothing = [Picture(name="a.png", left_out=NOT_FOUND)]
    with pytest.raises(UserError) as raised:
        fit_both(left[:6] + 2 * nothing, 4 * nothing + right[4:])
    assert str(raised.value) == (
        "both cameras see the board in 2 of 8 pairs of pictures, allowed: at least 3"
    )


def deviations_off(pose: FramePose | None, X: np.ndarray) -> np.ndarray:
    """Return how far a pose is off, in its standard deviations, shape (6,)."""
    assert pose is not None
    assert pose.sd is not None
    turned = Rotation.from_matrix(pose.rotation @ X[:3, :3].T).as_rotvec()
    shift = np.array(pose.translation) - X[:3, 3]
    sd = [*pose.sd.rotation_vector, *pose.sd.translation]
    return np.concatenate([turned, shift]) / sd


def standing(camera: Camera) -> np.ndarray:
    """Return a camera's pose in its world, the board."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = camera.R_WC, camera.p_WC
    return X


def calibrated_pair(
    camera: Camera, place: Place, look: Look, seed: int
) -> tuple[Calibration, np.ndarray]:
    places = place(8, seed, poses=BoardPoses(extent=(0.3, 0.5)))
    others = seen_from(places, camera)
    seen = [look(places, seed, name="left"), look(others, seed + 1000, noise=0.1, name="right")]
    found = calibrate(seen, [SIZE, SIZE], known=(0, X_WB))
    off = [
        deviations_off(one.board, np.linalg.inv(standing(there)))
        for pictures, cameras in zip(found.pictures, (places, others), strict=True)
        for one, there in zip(pictures, cameras, strict=True)
    ]
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6
    return found, X_WB @ standing(places[0])


@pytest.mark.slow
def test_two_cameras_and_where_they_stand(camera: Camera, place: Place, look: Look) -> None:
    off = []
    for seed in range(8):
        found, X_WL = calibrated_pair(camera, place, look, seed)
        off.append(deviations_off(found.cameras.pose, X_LR))
        off.append(deviations_off(found.cameras.world_pose, X_WL))
        assert found.pairs == 8
        left, right = found.cameras.left, found.cameras.right
        assert right is not None
        assert left.reprojection_error == pytest.approx(0.05 * 2**0.5, rel=0.1)
        assert right.reprojection_error == pytest.approx(0.1 * 2**0.5, rel=0.1)
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.2
    assert np.abs(off).max() < 4


def test_a_camera_in_the_world_by_a_picture_of_its_own(place: Place, look: Look) -> None:
    places = place(6, 3)
    found = calibrate([look(places)], [SIZE], known=(0, X_WB))
    assert found.cameras.pose is None
    off = deviations_off(found.cameras.world_pose, X_WB @ standing(places[0]))
    assert np.abs(off).max() < 4
