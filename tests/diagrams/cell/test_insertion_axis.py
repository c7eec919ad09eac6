"""Insertion downwards: gravity stays, all that cameras and compensation do goes by the hole."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import VIEWS, CameraSettings, add_cell_vision
from chamfer.diagrams.cell.work_cell import HOLE_ARM, ArmName, WorkCellScenario
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.force.stoppable_motion import StoppableMotion
from chamfer.systems.pose import pose_vector

Array = np.ndarray

ACROSS = AlignmentScenario()
DOWN = AlignmentScenario(axis="downwards", hole=replace(HOLE_ARM, kind="fixture"))
PERIOD = 1 / 80
ARMS: tuple[ArmName, ...] = ("peg", "hole")


def off(scenario: WorkCellScenario, arm: ArmName, error: Array) -> RigidTransform:
    """Return a pose that is off along and about the hole's axes, m and rad, shape (6,)."""
    X_WT = scenario.nominal_pose(arm)
    return X_WT @ RigidTransform(RollPitchYaw(error[3:]), error[:3])


# Where things are


def test_the_peg_comes_from_above() -> None:
    peg, hole = (DOWN.nominal_pose(arm) for arm in ARMS)
    np.testing.assert_allclose(peg.translation() - hole.translation(), [0, 0, DOWN.gap])
    np.testing.assert_allclose(hole.rotation().matrix()[:, 0], [0, 0, -1], atol=1e-15)
    assert np.linalg.det(hole.rotation().matrix()) == pytest.approx(1.0)
    assert ACROSS.hole_axes.IsExactlyIdentity()


def test_where_the_parts_meet_follows_from_the_axis_unless_it_is_said() -> None:
    assert resolve(ACROSS).meeting_point == (0.0, 0.0, 0.158)
    assert resolve(DOWN).meeting_point == DOWN.mouth == (-0.3, 0.0, -0.3)
    said = replace(DOWN, meeting_point=(-0.25, 0.0, -0.1))
    assert resolve(said).meeting_point == said.mouth == (-0.25, 0.0, -0.1)


def test_two_arms_that_do_not_reach_each_other_are_refused_in_a_line() -> None:
    two = replace(DOWN, hole=HOLE_ARM)
    with pytest.raises(ParameterError) as caught:
        resolve(two)
    said = str(caught.value)
    assert said.startswith(
        "meeting_point is (-0.3, 0.0, -0.3), allowed: one that the hole's arm reaches with an "
        "axis that is downwards; its flange position is"
    )
    assert "\n" not in said
    near = replace(HOLE_ARM, base=Placement(position=(-0.1, 0.0, -1.1), rpy=(0.0, 0.0, np.pi)))
    assert resolve(replace(two, hole=near)).arms == ARMS


@pytest.mark.parametrize("axis", ["start_offset", "initial_error"])
def test_what_leaves_the_image_is_along_the_hole_s_axes(axis: str) -> None:
    far: dict[str, Any] = {
        "start_offset": (0.0, 0.0, 0.5),
        "initial_error": (0.0, 0.0, 0.1, 0.0, 0.0, 0.0),
    }
    with pytest.raises(ParameterError, match=rf"^{axis} is .*in that of xz, .* it is at \(.*, -"):
        resolve(replace(DOWN, **{axis: far[axis]}))


# What is seen


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_cameras_see_what_they_see_of_a_horizontal_insertion(seed: int) -> None:
    generator = np.random.default_rng(seed)
    errors = [generator.uniform(-1, 1, 6) * ([0.02] * 3 + [0.2] * 3) for _ in ARMS]
    for view in VIEWS:
        images = [
            render(
                ColouredParts(),
                scenario.camera(view),
                *(off(scenario, arm, one) for arm, one in zip(ARMS, errors, strict=True)),
            )
            for scenario in (ACROSS, DOWN)
        ]
        assert np.abs(np.subtract(*images, dtype=float)).max() <= 1.0


ERROR = np.array([0.002, 0.003, -0.004, 0.0, 0.03, -0.05])


@lru_cache
def seen(by: Any, *, moves: bool = False) -> Array:
    """Return the last measured error of a peg that is off, or that goes as it is desired."""
    builder = DiagramBuilder()
    poses = {}
    for arm, error in (("peg", 0 * ERROR if moves else ERROR), ("hole", 0 * ERROR)):
        X_WT = off(DOWN, arm, error)
        if moves and arm == "peg":
            start = X_WT @ np.array([-0.01, 0.0, 0.02])
            source = builder.AddSystem(StoppableMotion(start, X_WT, 1.0, PERIOD))
        else:
            source = builder.AddSystem(ConstantVectorSource(pose_vector(X_WT)))
        poses[arm] = source.get_output_port(0)
    cameras = CameraSettings(measured=by, frames=FrameGrabberParams(noise=0.0))
    vision = add_cell_vision(
        builder, DOWN, cameras, poses=poses, begin=0.02, desired=poses if moves else None
    )
    for name in ("error", "valid"):
        builder.ExportOutput(vision.GetOutputPort(name), name)
    outputs = simulate(builder.Build(), duration=0.3 if moves else 0.1, step=PERIOD).outputs
    assert outputs["valid"][-1]
    return outputs["error"][-1]


@pytest.mark.parametrize("by", ["image", "metric"])
def test_errors_are_along_and_about_the_hole_s_axes(by: Any) -> None:
    lacks = -ERROR / ([0.0005] * 3 + [1.0] * 3)
    np.testing.assert_allclose(seen(by)[:3], lacks[:3], rtol=0, atol=0.3)
    np.testing.assert_allclose(seen(by)[3:], lacks[3:], rtol=0, atol=2e-3)


# What the arm does
