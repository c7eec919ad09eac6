"""What the cell's cameras saw at the begin and at the end of a compensation."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.analysis.cell.alignment_runs import row_before
from chamfer.analysis.scenario.experiment import Table
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_cameras import VIEWS
from chamfer.systems.cameras.camera_image import Image, add_noise, shaded
from chamfer.systems.cameras.software_camera import between, render, render_moving
from chamfer.systems.pose import POSE_NAMES, pose_from_vector

MOMENTS: Final = ("before", "after")

_CHANNELS: Final = ("red", "green", "blue")


def take_pictures(
    scenario: AlignmentScenario, traces: Table, seed: int
) -> dict[str, NDArray[np.uint8]]:
    """Return the pictures as a table, a row a pixel, row after row.

    Columns ``xz_before_red`` and so on; drawn by the software camera at the true poses, with the
    scenario's noise.
    """
    begin = row_before(traces["time"], scenario.begin)
    return pictures_at(scenario, traces, dict(zip(MOMENTS, (begin, -1), strict=True)), seed)


def pictures_at(
    scenario: AlignmentScenario, traces: Table, rows: Mapping[str, int], seed: int
) -> dict[str, NDArray[np.uint8]]:
    """Return likewise the pictures at some rows of the traces, by the moments' names."""
    generator = np.random.default_rng(seed)
    table = {}
    for view in VIEWS:
        camera, sensor = scenario.camera(view), scenario.cameras.view(view).sensor
        for moment, row in rows.items():
            peg, hole = _poses(traces, row)
            if sensor.exposure:
                earlier = _poses(traces, max(row - 1, 0))
                share = 1 - sensor.exposure / scenario.cameras.frames.period
                opening = between(earlier[0], peg, share), between(earlier[1], hole, share)
                picture = render_moving(scenario.parts, camera, opening, (peg, hole))
            else:
                picture = render(scenario.parts, camera, peg, hole)
            if sensor.shades:
                picture = shaded(picture, sensor.vignetting, sensor.white_balance)
            if noise := scenario.cameras.frames_of(view).noise:
                picture = add_noise(picture, noise, generator)
            for i, channel in enumerate(_CHANNELS):
                table[f"{view}_{moment}_{channel}"] = picture[:, :, i].ravel()
    return table


def _poses(traces: Table, row: int) -> tuple[RigidTransform, RigidTransform]:
    """Return X_WT and X_WM."""
    peg, hole = (
        pose_from_vector(np.array([traces[f"{arm}_true_{name}"][row] for name in POSE_NAMES]))
        for arm in ("peg", "hole")
    )
    return peg, hole


def picture(
    scenario: AlignmentScenario, table: Mapping[str, NDArray[Any]], view: str, moment: str
) -> Image:
    """Return a picture of the table, shape (height, width, 3)."""
    camera = scenario.camera("xz")
    channels = [table[f"{view}_{moment}_{channel}"] for channel in _CHANNELS]
    shape = (camera.height, camera.width, len(_CHANNELS))
    return np.column_stack(channels).reshape(shape).astype(np.uint8)
