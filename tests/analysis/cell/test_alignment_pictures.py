import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.cell.alignment import MOMENTS, picture, take_pictures
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import VIEWS, CameraSettings
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts

LOOKS = appearances(ColouredParts(), 0.0005)

Array = NDArray[np.float64]

CLEAN = AlignmentScenario(cameras=CameraSettings(frames=FrameGrabberParams(noise=0.0)))
BEGIN = 120  # the first row of the compensation
PIXEL = 0.0005  # m


def traces(before: tuple[float, float], after: tuple[float, float]) -> dict[str, Array]:
    """Poses of a peg that is so many metres off along Y and Z, before and after."""
    count = 321
    made = {"time": np.arange(count) / 80}
    for arm in ("peg", "hole"):
        for name in ("qw", "qx", "qy", "qz", "x", "y", "z"):
            made[f"{arm}_true_{name}"] = np.full(count, 1.0 if name == "qw" else 0.0)
        made[f"{arm}_true_z"] += CLEAN.mouth[2]
    made["peg_true_x"] -= CLEAN.gap
    for i, axis in enumerate(("y", "z")):
        made[f"peg_true_{axis}"][:BEGIN] += before[i]
        made[f"peg_true_{axis}"][BEGIN:-1] = np.nan  # not what is to be seen
        made[f"peg_true_{axis}"][-1] += after[i]
    return made


def tips(
    scenario: AlignmentScenario, table: dict[str, NDArray[np.uint8]], view: str, moment: str
) -> Array:
    """Way from tip to mouth, pixels along and down the picture without the camera's roll."""
    peg, hole = detect_parts(picture(scenario, table, view, moment), *LOOKS)
    assert not peg.status.lost
    assert not hole.status.lost
    way = np.array(hole.tip) - np.array(peg.tip)
    roll = Rotation.from_rotvec([0.0, 0.0, scenario.cameras.roll]).as_matrix()[:2, :2]
    turned: Array = roll @ way
    return turned


def test_the_tips_are_where_the_poses_say() -> None:
    found = traces((0.006, -0.008), (0.0, 0.0))
    table = take_pictures(CLEAN, found, 0)
    # Down in the pictures is -Z and -Y: the tip is too low by 16 pixels and too far up by 12.
    expected = {
        ("xz", "before"): -0.008 / PIXEL,
        ("xy", "before"): 0.006 / PIXEL,
        ("xz", "after"): 0.0,
        ("xy", "after"): 0.0,
    }
    for (view, moment), down in expected.items():
        way = tips(CLEAN, table, view, moment)
        assert way[1] == pytest.approx(down, abs=1.0)
        assert way[0] == pytest.approx(60.0, abs=1.5)


def test_a_row_is_a_pixel() -> None:
    table = take_pictures(CLEAN, traces((0.0, 0.0), (0.0, 0.0)), 0)
    assert len(table) == len(VIEWS) * len(MOMENTS) * 3
    camera = CLEAN.camera("xz")
    for values in table.values():
        assert values.dtype == np.uint8
        assert values.shape == (camera.width * camera.height,)
    image = picture(CLEAN, table, "xy", "after")
    assert image.shape == (camera.height, camera.width, 3)
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(
        image[3, 7],
        [
            table[f"xy_after_{channel}"][3 * camera.width + 7]
            for channel in ("red", "green", "blue")
        ],
    )
    # The peg is red and on the left, the hole's part blue.
    level, column = (
        int(one)
        for one in np.argwhere(image[:, :, 0].astype(int) - image[:, :, 2] > 90).mean(axis=0)
    )
    assert column < camera.width / 2
    assert abs(level - camera.height / 2) < 20
