"""A camera in a hand: beside the truth, beside the reprojection, and what is refused."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, f

from chamfer.analysis.calibration.camera_fit import Fit, Picture, fit_camera, moved, transform
from chamfer.analysis.calibration.hand_eye import HandEye, fit_hand_eye, plot_hand_eye, read_poses
from chamfer.analysis.scenario.errors import UserError
from chamfer.models.cameras.camera import Camera

Array = NDArray[np.float64]
Place = Callable[..., list[Camera]]
Look = Callable[..., list[Picture]]

X_TC = transform(np.array([0.2, -1.8, 1.1, 0.06, -0.03, 0.09]))
X_WB = transform(np.array([2.0, 0.4, 0.3, 0.5, -0.3, 0.1]))
ARM = np.array([3e-4, 1e-4])  # rad and m, standard deviations
SIZE = 640, 480
HEADER = "file,x,y,z,qw,qx,qy,qz\n"


def arm_poses(places: Sequence[Camera], seed: int, arm: Array = ARM) -> dict[str, Array]:
    """Return X_WT as an arm says it that held the camera at places before the board."""
    random, poses = np.random.default_rng([seed, 2]), {}
    for k, one in enumerate(places):
        X_BC = np.eye(4)
        X_BC[:3, :3], X_BC[:3, 3] = one.R_WC, one.p_WC
        off = transform(np.repeat(arm, 3) * random.standard_normal(6))
        poses[f"picture{k}.png"] = X_WB @ X_BC @ np.linalg.inv(X_TC) @ off
    return poses


@pytest.fixture(scope="module")
def places(place: Place) -> list[Camera]:
    return place(8, 5)


@pytest.fixture
def seen(places: list[Camera], look: Look) -> Fit:
    return fit_camera(look(places, 5), SIZE)


@pytest.fixture
def poses(places: list[Camera]) -> dict[str, Array]:
    return arm_poses(places, 5)


def fitted(fit: Fit, poses: dict[str, Array]) -> HandEye:
    return fit_hand_eye(fit, [f"picture{k}.png" for k in range(40)], poses)


def deviations(found: HandEye) -> Array:
    return np.asarray(np.sqrt(np.diag(found.covariance)))


def square(found: HandEye) -> float:
    """Return the error's square in standard deviations."""
    off = moved(X_TC, found.X_TC)
    return float(off @ np.linalg.solve(found.covariance, off))


def test_exact_poses_and_corners_tell_all(places: list[Camera], look: Look) -> None:
    fit = fit_camera(look(places, 5, noise=0.0), SIZE)
    found = fitted(fit, arm_poses(places, 5, np.zeros(2)))
    np.testing.assert_allclose(found.X_TC, X_TC, atol=1e-6)
    np.testing.assert_allclose(found.apart, 0, atol=1e-6)
    assert found.arm.max() < 1e-6
    assert deviations(found).max() < 1e-5


def test_it_is_the_least_squares_of_the_reprojection(seen: Fit, poses: dict[str, Array]) -> None:
    found = fitted(seen, poses)
    noise, lens = seen.adjustment.noise, seen.adjustment.intrinsic(0)[0]
    off, said = np.tile(np.repeat(found.arm, 3), 8), list(poses.values())

    def residuals(unknown: Array) -> Array:
        """Of lens, X_TC, X_WB and each pose of the arm, in standard deviations."""
        (fx, fy, cx, cy), distortion = unknown[:4], unknown[4:9]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        steps = np.reshape(unknown[9:], (-1, 6))
        X, Y = (turned(one, step) for one, step in ((found.X_TC, steps[0]), (X_WB, steps[1])))
        left = [unknown[21:] / off]
        for step, sight, X_WT in zip(steps[2:], seen.sights.values(), said, strict=True):
            X_CB = np.linalg.inv(X_WT @ transform(step) @ X) @ Y
            vector = Rotation.from_matrix(X_CB[:3, :3]).as_rotvec()
            points = np.pad(sight.corners.points, ((0, 0), (0, 1)))
            pixels, _ = cv2.projectPoints(points, vector, X_CB[:3, 3], matrix, distortion)
            left.append(((sight.corners.pixels - np.reshape(pixels, (-1, 2))) / noise).ravel())
        return np.concatenate(left)

    best = least_squares(residuals, np.append(lens, np.zeros(60)), x_scale="jac", jac="3-point")
    assert np.abs(best.x[9:15] / deviations(found)).max() < 0.15
    normal = np.linalg.inv(best.jac.T @ best.jac)[9:15, 9:15]
    wider = 6 * f.ppf(0.95, 6, 15) / chi2.ppf(0.95, 6)
    np.testing.assert_allclose(deviations(found) ** 2, wider * np.diag(normal), rtol=0.2)


def turned(X: Array, step: Array) -> Array:
    turn = Rotation.from_rotvec(step[:3]) * Rotation.from_matrix(X[:3, :3])
    return transform(np.append(turn.as_rotvec(), X[:3, 3] + step[3:]))


def test_what_is_said_of_it(seen: Fit, poses: dict[str, Array]) -> None:
    found = fitted(seen, poses)
    assert square(found) < chi2.ppf(0.95, 6)
    np.testing.assert_allclose(found.arm, ARM, rtol=0.5)
    assert found.pose.sd is not None
    assert found.pose.sd.translation == pytest.approx(deviations(found)[3:])
    assert found.notes[2].startswith("24 more such pictures halve standard deviations; the tool ")
    turn, shift = plot_hand_eye(found).axes
    for axes, part in ((turn, found.apart[:, :3]), (shift, found.apart[:, 3:])):
        lengths = [bar.get_width() for bar in axes.patches]  # type: ignore[attr-defined]
        np.testing.assert_allclose(lengths, 1e3 * np.linalg.norm(part, axis=1))


@pytest.mark.slow
@pytest.mark.parametrize(("count", "arm"), [(6, ARM), (12, ARM), (10, 10 * ARM), (10, 0.1 * ARM)])
def test_the_region_holds_what_it_says(place: Place, look: Look, count: int, arm: Array) -> None:
    within = []
    for seed in range(1000, 1040):
        there = place(count, seed)
        fit = fit_camera(look(there, seed), SIZE)
        within.append(square(fitted(fit, arm_poses(there, seed, arm))) <= chi2.ppf(0.95, 6))
    assert sum(within) >= 38


def off_place(poses: dict[str, Array]) -> None:
    poses["picture3.png"] = poses["picture3.png"] + np.outer([0.03, 0, 0, 0], [0, 0, 0, 1])


def exchanged(poses: dict[str, Array]) -> None:
    poses["picture2.png"], poses["picture6.png"] = poses["picture6.png"], poses["picture2.png"]


def one_on(poses: dict[str, Array]) -> None:
    names, values = list(poses), list(poses.values())
    poses.update(zip(names, values[1:] + values[:1], strict=True))


def in_mm(poses: dict[str, Array]) -> None:
    for name in poses:
        poses[name] = np.vstack([poses[name][:3] * [1, 1, 1, 1e3], poses[name][3:]])


def reordered(poses: dict[str, Array]) -> None:
    for name, X in poses.items():
        quaternion = Rotation.from_matrix(X[:3, :3]).as_quat()
        turn = Rotation.from_quat(quaternion, scalar_first=True).as_rotvec()
        poses[name] = transform(np.append(turn, X[:3, 3]))


def about_one_axis(poses: dict[str, Array]) -> None:
    for k, name in enumerate(poses):
        poses[name] = poses["picture0.png"] @ transform(np.array([0, 0, 0.2 * k, 0, 0, 0]))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (off_place, r"worst picture3.png: (29|30).* mm and .* mrad; in the median 0\.\d* mm"),
        (exchanged, "poses don't belong to their pictures, worst picture[26].png"),
        (one_on, "poses don't belong to their pictures, .*; are rows mixed up"),
        (in_mm, "the poses fit the pictures only if places are taken as mm, allowed: m$"),
        (
            lambda poses: poses.update({name: np.linalg.inv(X) for name, X in poses.items()}),
            "only if they are taken as the base's in the tool, allowed: the tool",
        ),
        (reordered, "only if quaternions are taken as x,y,z,w, allowed: w,x,y,z$"),
        (
            about_one_axis,
            r"turns by 0.69 rad rms about its axis \[-?0.0, -?0.0, -?1.0\] and by .* across",
        ),
        (
            lambda poses: [poses.popitem() for _ in range(4)],
            "^4 pictures that show the board have a pose, allowed: at least 5$",
        ),
    ],
)
def test_poses_that_don_t_tell(
    seen: Fit,
    poses: dict[str, Array],
    spoil: Callable[[dict[str, Array]], object],
    message: str,
) -> None:
    spoil(poses)
    with pytest.raises(UserError, match=message) as caught:
        fitted(seen, poses)
    assert "\n" not in str(caught.value)


def test_poses_are_read(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(HEADER + "a.png, 1, 2, 3, 0.7071, 0, 0, 0.7071\n")
    X = read_poses(path, [Path("a.png"), Path("b.png")])["a.png"]
    np.testing.assert_allclose(X[:3], [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]], atol=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "No such file or directory"),
        ("file,x,y,z\na.png,1,2,3\n", "can't be read"),
        (HEADER + "a.png,1,2,3,1,0,0,b\n", "can't be read"),
        (HEADER + "a.png,1,2,3,0,0,0,0\n", "a.png has a quaternion of length 0,"),
        (HEADER + "a.png,1,2,nan,1,0,0,0\n", "a.png is not at a finite place,"),
        (HEADER + 2 * "a.png,1,2,3,1,0,0,0\n", "a.png has two poses,"),
        (HEADER + "c.png,1,2,3,1,0,0,0\n", "c.png is not the name of one of the pictures,"),
    ],
)
def test_a_file_of_poses_that_is_refused(tmp_path: Path, text: str | None, message: str) -> None:
    path = tmp_path / "poses.csv"
    if text is not None:
        path.write_text(text)
    allowed = "allowed: a CSV file with the header file,x,y,z,qw,qx,qy,qz and a row a picture"
    with pytest.raises(UserError, match=f"{message}.* ?{allowed}"):
        read_poses(path, [Path("a.png"), Path("b.png")])
