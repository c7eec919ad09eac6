"""Where cameras take parts at rest to be aligned, against closed forms and the diagram."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell.alignment import make_alignment_diagram, resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, wrong_pose
from chamfer.diagrams.cell.cell_vision import VIEWS, CameraSettings, Measured
from chamfer.diagrams.cell.still_vision import StillVision
from chamfer.models.cameras.camera import View
from chamfer.systems.cameras.camera_image import FrameGrabberParams, Image
from chamfer.systems.pose import pose_from_vector

MEASURED: tuple[Measured, ...] = ("image", "metric")
CELL = resolve(AlignmentScenario())
MOUTH = CELL.nominal_pose("hole")


def with_true(
    scenario: AlignmentScenario, views: Sequence[View] = VIEWS, **changed: Any
) -> AlignmentScenario:
    cameras = scenario.cameras
    for view in views:
        of = cameras.view(view)
        cameras = cameras.with_view(view, replace(of, true=replace(of.true, **changed)))
    return replace(scenario, cameras=cameras)


def measuring(measured: Measured, scenario: AlignmentScenario = CELL) -> AlignmentScenario:
    return replace(scenario, cameras=replace(scenario.cameras, measured=measured))


def off(X_WT: RigidTransform | None) -> tuple[float, float, float]:
    """How far a pose is from the aligned one: along and across the axis, m, and turned, rad."""
    assert X_WT is not None
    way = X_WT.translation() - CELL.nominal_pose("peg").translation()
    axis = X_WT.rotation().matrix()[:, 0]
    return float(way[0]), math.hypot(way[1], way[2]), math.hypot(axis[1], axis[2])


@pytest.mark.parametrize("measured", MEASURED)
def test_cameras_without_error_take_aligned_parts_to_be_aligned(measured: Measured) -> None:
    along, across, turned = off(StillVision(measuring(measured)).aligned())
    assert abs(along) < 1e-4
    assert across < 2e-5
    assert turned < 2e-4


@pytest.mark.parametrize("measured", MEASURED)
def test_the_error_is_that_of_the_diagram(measured: Measured) -> None:
    frames = FrameGrabberParams(noise=0.0)
    cameras = CameraSettings(measured=measured, frames=frames)
    scenario = resolve(AlignmentScenario(begin=0.1, compensation_time=0.05, cameras=cameras))
    scenario = with_true(scenario, focal_length=(1010.0, 1010.0), roll=0.02)
    outputs = simulate(
        make_alignment_diagram(scenario), duration=scenario.duration, step=1 / 80
    ).outputs
    first = int(np.flatnonzero(outputs["valid"])[0])
    # Of the frame that has arrived a period before, when it was a period old.
    X_WT, X_WM = (
        pose_from_vector(outputs[f"{arm}.true_pose"][first - 2]) for arm in ("peg", "hole")
    )
    expected = StillVision(scenario).error(X_WT, X_WM)
    scale = np.array([scenario.cameras.pixel_size] * 3 + [1.0] * 3)
    found = outputs["error"][first] * scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5)


def test_coinciding_axes_coincide_in_space_whatever_the_pinhole_camera() -> None:
    for change in (
        {"focal_length": (1200.0, 1200.0)},
        {"principal_point": (175.0, 110.0)},
        {"roll": 0.1},
        {"tilt": (0.03, -0.03)},
        {"position": (0.01, -0.01, 0.1)},
    ):
        _, across, turned = off(StillVision(with_true(CELL, **change)).aligned())
        assert across < 5e-5, change
        assert turned < 3e-4, change
    _, across, turned = off(StillVision(with_true(CELL, VIEWS[:1], roll=0.1)).aligned())
    assert (across < 5e-5, turned < 3e-4) == (True, True)


@pytest.mark.parametrize("offset", [-0.02, 0.01])
def test_distortion_turns_parts_that_are_off_the_axis(offset: float) -> None:
    """By about 0.94 |k1| d in each of the two planes together, d the distance in m."""
    k1 = -1.0
    cameras = CELL.cameras
    for view in VIEWS:
        of = cameras.view(view)
        known = replace(of.believed, position=(0.0, offset, 0.0))
        bent = replace(known, distortion=(k1, 0.0, 0.0, 0.0, 0.0))
        cameras = cameras.with_view(view, replace(of, believed=known, true=bent))
    scenario = replace(CELL, cameras=cameras)
    _, across, turned = off(StillVision(scenario).aligned())
    assert turned == pytest.approx(0.94 * abs(k1 * offset), rel=0.06)
    assert across < 0.015 * abs(k1 * offset)
    # What is believed of the lens too is straightened.
    for view in VIEWS:
        of = cameras.view(view)
        cameras = cameras.with_view(view, replace(of, believed=of.true))
    _, across, turned = off(StillVision(replace(CELL, cameras=cameras)).aligned())
    assert turned < 1e-3


def test_parts_that_are_not_found_are_nowhere() -> None:
    def black(image: Image) -> Image:
        return np.zeros_like(image)

    assert StillVision(CELL, black).aligned() is None
    away = with_true(CELL, tilt=(0.3, 0.3))
    assert StillVision(away).aligned() is None
    assert not np.isfinite(StillVision(away).error(CELL.nominal_pose("peg"), MOUTH)).all()


def test_the_error_is_what_the_peg_lacks() -> None:
    X_WT = wrong_pose(CELL, CELL.nominal_pose("peg"))
    for measured in MEASURED:
        error = StillVision(measuring(measured)).error(X_WT, MOUTH)
        wrong = np.array(CELL.initial_error)
        np.testing.assert_allclose(error[1:3], -wrong[1:3], rtol=0, atol=4e-4)
        np.testing.assert_allclose(error[4:], -wrong[4:], rtol=0, atol=4e-3)


@pytest.mark.parametrize("radius", [0.004, 0.010035])
def test_square_parts_are_measured_like_round_ones_but_for_the_gap(radius: float) -> None:
    names = ("chamfer_width", "peg_length", "hole_length", "outer_radius")
    lengths = {name: getattr(CELL.parts, name) * radius / 0.010035 for name in names}
    parts = replace(
        CELL.parts, section="square", hole_radius=radius, peg_radius=0.98 * radius, **lengths
    )
    sight = StillVision(resolve(AlignmentScenario(parts=parts)))
    X_WT = RigidTransform(RollPitchYaw(0.0, 0.02, -0.03), [-0.03, 0.002, 0.157])
    _, y, z, _, pitch, yaw = sight.error(X_WT, MOUTH)
    assert [y, z] == pytest.approx([-0.002, 0.001], abs=6e-5)
    assert [pitch, yaw] == pytest.approx([-0.02, 0.03], abs=5e-4)
    # What is seen of an end face is its far edge: the gap looks narrower by r over the distance.
    along = sight.error(CELL.nominal_pose("peg"), MOUTH)[0]
    assert along == pytest.approx(-CELL.gap * radius / CELL.cameras.distance, abs=1e-4)
