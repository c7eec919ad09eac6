"""Replays of runs in three dimensions: live in a browser, or as one HTML file.

Both are Meshcat, Drake's viewer. It listens on localhost alone.
"""

import gc
import logging
import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, MeshcatParams, Rgba
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

from chamfer.analysis.scenario.errors import UserError

Array = NDArray[np.float64]

FRAME_RATE: Final = 40.0  # frames a second; more make a larger file

_BACKGROUND: Final = {"top_color": [0.97, 0.98, 1.0], "bottom_color": [0.80, 0.83, 0.87]}
_FLOOR: Final = (2.4, 1.6)  # m, along X and Y
_THICKNESS: Final = 0.02  # m, of the floor
_MESH: Final = 0.1  # m, between the floor's lines
_PLATE: Final = Rgba(0.86, 0.87, 0.88)
_LINES: Final = Rgba(0.70, 0.72, 0.75)


def open_meshcat(port: int | None = None) -> Meshcat:
    """Return a Meshcat that listens on localhost until nothing refers to it.

    The port is 1024 to 65535, or 0 for any that is free; unless given it is the first free one
    from 7000 on. A UserError says that it is taken.
    """
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(max(level, logging.WARNING))  # it would announce its address
    try:
        return Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))
    except RuntimeError as error:
        if port:
            raise UserError(f"--port is {port}, which is taken, allowed: a free one") from error
        raise UserError("no port is free on localhost for the 3-D view") from error
    finally:
        logger.setLevel(level)


def replay_html(show: Callable[[Meshcat], None]) -> str:
    """Return what a function shows as an HTML page that needs no other file and no server.

    The same scene gives the same text.
    """
    meshcat = open_meshcat(port=0)
    try:
        show(meshcat)
        page: str = meshcat.StaticHtml()
    finally:
        del meshcat
        gc.collect()  # a diagram that draws there is in a cycle, and keeps the port
    return page


def set_stage(meshcat: Meshcat, *, floor: Array, eye: Array, target: Array) -> None:
    """Put a floor, with lines every 0.1 m, around its middle, and the eye that sees the target.

    All three are points in the world frame, m, shape (3,).
    """
    for path in ("/Axes", "/Grid"):
        meshcat.SetProperty(path, "visible", False)
    for half, colour in _BACKGROUND.items():
        meshcat.SetProperty("/Background", half, colour)
    meshcat.SetTransform("floor", RigidTransform(floor))
    meshcat.SetObject("floor/plate", Box(*_FLOOR, _THICKNESS), _PLATE)
    meshcat.SetTransform("floor/plate", RigidTransform([0.0, 0.0, -_THICKNESS / 2]))
    x, y = (np.arange(0, size + _MESH / 2, _MESH) - size / 2 for size in _FLOOR)
    start = [*((u, y[0], 0) for u in x), *((x[0], v, 0) for v in y)]
    end = [*((u, y[-1], 0) for u in x), *((x[-1], v, 0) for v in y)]
    meshcat.SetLineSegments("floor/lines", np.array(start).T, np.array(end).T, 1.0, _LINES)
    meshcat.SetTransform("floor/lines", RigidTransform([0.0, 0.0, 0.001]))
    meshcat.SetCameraPose(eye, target)


def record(
    meshcat: Meshcat, diagram: Diagram, plant: MultibodyPlant, time: Array, positions: Array
) -> None:
    """Make an animation of positions that a plant had, interpolated at the frames' times.

    The diagram holds the plant and draws in Meshcat when it publishes. Times, s, ascend, shape
    (n,); the animation begins with the first one. Positions have shape (n, number of positions).

    Raises:
        ValueError: If a time or a position is not finite, or the times don't ascend.
    """
    for name, values in (("times", time), ("positions", positions)):
        if not np.isfinite(values).all():
            row = np.argwhere(~np.isfinite(values))[0, 0]
            raise ValueError(f"{name} are not finite in row {row}")
    if not len(time) or (np.diff(time) <= 0).any():
        raise ValueError("times have to ascend, and there has to be one")
    last = math.ceil((time[-1] - time[0]) * FRAME_RATE - 1e-6)
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)

    def publish(frame: int) -> None:
        now = time[0] + frame / FRAME_RATE
        q = np.array([np.interp(now, time, column) for column in positions.T])
        context.SetTime(frame / FRAME_RATE)
        plant.SetPositions(plant_context, q)
        diagram.ForcedPublish(context)

    publish(0)
    meshcat.StartRecording(FRAME_RATE, set_visualizations_while_recording=False)
    for frame in range(last + 1):
        publish(frame)
    meshcat.StopRecording()
    meshcat.PublishRecording()
