"""Cameras and detection of the work cell around ideal arms: the tools are where they should be."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell import cell_vision
from chamfer.diagrams.cell.cell_vision import (
    VIEWS,
    CameraSettings,
    add_cell_vision,
    camera_placement,
)
from chamfer.diagrams.cell.work_cell import ArmName, WorkCellScenario
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.force.stoppable_motion import StoppableMotion
from chamfer.systems.pose import pose_vector

Array = np.ndarray

PERIOD = 1 / 80
CELL = WorkCellScenario()
STILL = FrameGrabberParams(noise=0.0)


def read(
    settings: CameraSettings,
    peg: RigidTransform,
    *,
    start: Array | None = None,
    begin: float = 0.02,
    duration: float = 0.2,
    cell: WorkCellScenario = CELL,
) -> tuple[Array, Array]:
    """Errors, shape (n, 6), and valid, that a controller reads; a peg that starts elsewhere moves.

    A moving peg is where it is desired, so that there is nothing to correct.
    """
    builder = DiagramBuilder()
    hole = builder.AddSystem(ConstantVectorSource(pose_vector(CELL.nominal_pose("hole"))))
    if start is None:
        pose = builder.AddSystem(ConstantVectorSource(pose_vector(peg))).get_output_port()
    else:
        motion = builder.AddSystem(
            StoppableMotion(peg.translation() + start, peg, 0.8 * duration, PERIOD)
        )
        pose = motion.GetOutputPort("desired_pose")
    poses: dict[ArmName, Any] = {"peg": pose, "hole": hole.get_output_port()}
    error = add_cell_vision(
        builder,
        cell,
        settings,
        poses=poses,
        begin=begin,
        desired=None if start is None else poses,
    )
    # Logged before the instant's updates: what a controller reads at its ticks.
    for name in ("error", "valid"):
        builder.ExportOutput(error.GetOutputPort(name), name)
    run = simulate(builder.Build(), duration=duration, step=PERIOD)
    return run.outputs["error"], run.outputs["valid"] > 0


# How old the images are


@pytest.mark.parametrize(("latency", "offset"), [(0, 0.005), (1, 0.0), (2, 0.005)])
def test_a_motion_as_desired_is_no_error(latency: int, offset: float) -> None:
    frames = FrameGrabberParams(noise=0.0, latency=latency, offset=offset)
    # 112 mm/s at most: in a period the tip goes on by 2.8 pixels, in 5 ms by 1.1.
    error, valid = read(
        CameraSettings(frames=frames),
        CELL.nominal_pose("peg"),
        start=np.array([0.0, 0.0, -0.03]),
        begin=0.0,
        duration=0.5,
    )
    # Nothing is seen before the first image is there, and from then on all.
    first = latency + 1
    assert not valid[:first].any()
    assert valid[first:].all()
    assert np.abs(error[first:, 1:]).max() < 0.05
    assert np.abs(error[first:, 0]).max() < 0.06  # of the detection, also at rest
    assert np.abs(error[first:, 3:]).max() < 2e-4


@pytest.mark.parametrize("offset", [0.0, 0.005])
@pytest.mark.parametrize("latency", [0, 1, 3])
def test_the_images_that_nobody_looks_at_are_missed_by_nobody(latency: int, offset: float) -> None:
    frames = FrameGrabberParams(noise=0.0, latency=latency, offset=offset)
    begin = 0.3
    _, valid = read(
        CameraSettings(frames=frames), CELL.nominal_pose("peg"), begin=begin, duration=0.4
    )
    first = round(begin / PERIOD)
    assert not valid[:first].any()
    assert valid[first:].all()


# What is measured

NEAR = {
    "x": (0.003, 0.0, 0.0, 0.0, 0.0),
    "y": (0.0, 0.003, 0.0, 0.0, 0.0),
    "z": (0.0, 0.0, 0.003, 0.0, 0.0),
    "pitch": (0.0, 0.0, 0.0, 0.05, 0.0),
    "yaw": (0.0, 0.0, 0.0, 0.0, 0.05),
    "all": (-0.002, 0.002, -0.003, -0.04, 0.03),
}


def off(x: float, y: float, z: float, pitch: float, yaw: float) -> RigidTransform:
    p_WT = CELL.nominal_pose("peg").translation() + np.array([x, y, z])
    return RigidTransform(RollPitchYaw(0.0, pitch, yaw), p_WT)


@lru_cache
def measured(by: Any, name: str, renderer: Any = "software") -> Array:
    settings = CameraSettings(measured=by, renderer=renderer, frames=STILL)
    error, valid = read(settings, off(*NEAR[name]), duration=0.1)
    assert valid[-1]
    return error[-1]


@pytest.mark.parametrize("by", ["image", "metric"])
def test_other_parts_are_drawn_and_found(by: Any) -> None:
    parts = ColouredParts(
        peg_radius=0.006,
        hole_radius=0.0065,
        peg_chamfer_share=0.7,
        peg_colour=(40, 205, 40),
        hole_colour=(205, 40, 205),
    )
    error, valid = read(
        CameraSettings(measured=by, frames=STILL),
        off(*NEAR["y"]),
        duration=0.1,
        cell=replace(CELL, parts=parts),
    )
    assert valid[-1]
    np.testing.assert_allclose(error[-1], [0.0, -6.0, 0.0, 0.0, 0.0, 0.0], rtol=0, atol=0.25)


@pytest.mark.parametrize("by", ["image", "metric"])
@pytest.mark.parametrize("name", NEAR)
def test_both_measurements_are_what_the_peg_lacks(by: Any, name: str) -> None:
    x, y, z, pitch, yaw = NEAR[name]
    true = np.array([-x / 0.0005, -y / 0.0005, -z / 0.0005, 0.0, -pitch, -yaw])
    error = measured(by, name)
    # To one image 3 mm towards the camera are 0.6 % more of 30 pixels, from the middle to the tip.
    near = 0.06 if by == "metric" else 0.25
    np.testing.assert_allclose(error[:3], true[:3], rtol=0, atol=near)
    np.testing.assert_allclose(error[3:], true[3:], rtol=0, atol=3e-4)


@pytest.mark.parametrize("by", ["image", "metric"])
def test_a_hidden_tip_leaves_all_but_the_way_along(by: Any) -> None:
    # 5 mm in the hole part: the tip is not seen, the axis passes the mouth 5 mm behind it.
    pitch, yaw, inside = 0.03, -0.02, 0.005
    peg = off(CELL.gap + inside, 0.001, -0.002, pitch, yaw)
    error, valid = read(CameraSettings(measured=by, frames=STILL), peg, duration=0.1)
    assert valid[-1]
    y, z = 0.001 - inside * yaw, -0.002 + inside * pitch
    assert error[-1, 0] == 0.0
    np.testing.assert_allclose(error[-1, 1:3], [-y / 0.0005, -z / 0.0005], rtol=0, atol=0.1)
    np.testing.assert_allclose(error[-1, 3:], [0.0, -pitch, -yaw], rtol=0, atol=5e-4)


# Where the cameras stand


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("gap", [0.03, 0.1])
def test_cameras_look_at_the_middle_of_the_gap(view: Any, gap: float) -> None:
    scenario = WorkCellScenario(gap=gap, meeting_point=(0.01, 0.02, 0.2))
    settings = CameraSettings(distance=0.6, pixel_size=0.0004, roll=0.2)
    camera = camera_placement(settings, scenario, view).camera
    tip, mouth = (scenario.nominal_pose(arm).translation() for arm in ("peg", "hole"))
    np.testing.assert_allclose(camera.project((tip + mouth) / 2), [159.5, 119.5], atol=1e-9)
    way = camera.project(mouth) - camera.project(tip)
    assert np.hypot(*way) == pytest.approx(gap / 0.0004)
    assert math.atan2(way[1], way[0]) == pytest.approx(-0.2)
    assert np.linalg.norm(camera.p_WC - (tip + mouth) / 2) == pytest.approx(0.6)


# What is refused


def test_vtk_without_graphics_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell_vision, "missing_graphics", lambda: "VTK can't draw here (why)")
    with pytest.raises(ParameterError) as caught:
        read(CameraSettings(renderer="vtk"), CELL.nominal_pose("peg"))
    assert str(caught.value) == (
        "cameras.renderer is 'vtk', allowed: software here: VTK can't draw here (why)"
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"renderer": "gl"}, "renderer is 'gl', allowed: software, vtk"),
        ({"measured": "depth"}, "measured is 'depth', allowed: image, metric"),
        ({"distance": 0.0}, "distance is 0.0, allowed: a finite number > 0"),
        ({"pixel_size": -1.0}, "pixel_size is -1.0, allowed: a finite number > 0"),
        ({"roll": math.nan}, "roll is nan, allowed: a finite number"),
    ],
)
def test_settings_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        CameraSettings(**change)
    assert str(caught.value) == message
