"""Calibrations beside the truth, and the figure of what they leave over."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from matplotlib.quiver import Quiver
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.calibration import (
    Calibration,
    calibrate,
    plot_residuals,
)
from chamfer.analysis.calibration.calibration_accuracy import BoardPoses
from chamfer.analysis.calibration.camera_fit import Seen
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_file import MeasuredPose

SIZE = (640, 480)
NEAR = BoardPoses(extent=(0.3, 0.5))
X_LR = np.eye(4)
X_LR[:3, :3] = Rotation.from_rotvec([0.02, -0.15, 0.03]).as_matrix()
X_LR[:3, 3] = [0.1, 0.005, 0.01]
X_WB = np.eye(4)
X_WB[:3, :3] = Rotation.from_euler("xyz", [3.0, 0.1, 0.5]).as_matrix()
X_WB[:3, 3] = [0.4, 0.1, -0.2]

Place = Callable[..., list[Camera]]
Look = Callable[..., list[Seen]]


def deviations_off(pose: MeasuredPose | None, X: np.ndarray) -> np.ndarray:
    """Return how far a pose is off, in its standard deviations, shape (6,)."""
    assert pose is not None
    assert pose.sd is not None
    turned = Rotation.from_matrix(pose.value.rotation @ X[:3, :3].T).as_rotvec()
    shift = np.array(pose.value.translation) - X[:3, 3]
    sd = [*pose.sd.rotation_vector, *pose.sd.translation]
    return np.concatenate([turned, shift]) / sd


def in_front(places: Sequence[Camera]) -> np.ndarray:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = places[0].R_WC, places[0].p_WC
    return X


def board_seen_from(there: Camera) -> np.ndarray:
    """Return the board's pose in the frame of a camera whose world is the board."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = there.R_WC.T, -there.R_WC.T @ there.p_WC
    return X


def calibrated_pair(
    camera: Camera, place: Place, look: Look, seed: int
) -> tuple[Calibration, np.ndarray]:
    places = place(8, seed, poses=NEAR)
    others = [
        camera.placed(there.R_WC @ X_LR[:3, :3], there.p_WC + there.R_WC @ X_LR[:3, 3])
        for there in places
    ]
    seen = [look(places, seed, name="left"), look(others, seed + 1000, noise=0.1, name="right")]
    found = calibrate(seen, [SIZE, SIZE], known=(0, X_WB))
    off = [
        deviations_off(one.board, board_seen_from(there))
        for pictures, standing in zip(found.pictures, (places, others), strict=True)
        for one, there in zip(pictures, standing, strict=True)
    ]
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6
    return found, X_WB @ in_front(places)


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
    off = deviations_off(found.cameras.world_pose, X_WB @ in_front(places))
    assert np.abs(off).max() < 4


def test_each_corner_has_an_arrow_and_each_picture_a_bar(place: Place, look: Look) -> None:
    seen = [*look(place(5)), Seen(name="a$b.png", reason="the board is not found")]
    found = calibrate([seen], [SIZE])
    residuals, coverage, errors, _ = plot_residuals(found).axes
    (arrows,) = (one for one in residuals.collections if isinstance(one, Quiver))
    (pictures,) = found.pictures
    expected = np.concatenate([one.residuals for one in pictures if one.residuals is not None])
    np.testing.assert_array_equal(np.column_stack([arrows.U, arrows.V]), expected)
    assert residuals.get_ylim() == (479.5, -0.5)  # v down, as in the picture
    assert [bar.get_width() for bar in errors.patches] == [one.error or 0.0 for one in pictures]
    assert [text.get_text() for text in errors.texts] == [" left out"]
    assert errors.get_yticklabels()[-1].get_text() == r"a\$b.png"
    (mesh,) = coverage.collections
    counts = np.ma.filled(mesh.get_array(), 0.0)
    assert np.nansum(counts) == 5 * 54
