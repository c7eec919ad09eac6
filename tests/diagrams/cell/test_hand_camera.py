"""A camera in the hand says how far the peg is from the mouth, and what it can't is refused."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from scipy.spatial.transform import Rotation

from chamfer.analysis.cell.alignment_runs import AlignmentTrialsScenario, drawn
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import CameraSettings, add_cell_vision
from chamfer.diagrams.cell.work_cell import HOLE_ARM
from chamfer.models.cameras.camera_file import (
    CalibratedCamera,
    CameraFile,
    FramePose,
    camera_text,
)
from chamfer.models.peg.peg_and_hole import PRESETS, ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.hand_camera import HandMount
from chamfer.systems.pose import pose_vector

FIXTURE = replace(HOLE_ARM, kind="fixture", payload_error=0.0)
CELL = AlignmentScenario(
    parts=ColouredParts(**{**PRESETS["factory-8mm"], "friction": ColouredParts.friction}),
    hole=FIXTURE,
    cameras=CameraSettings(kind="hand"),
    initial_error=(0.0, 0.001, -0.001, 0.0, 0.02, -0.02),
    begin=0.1,
)


def seen(scenario, X_TM, seconds=0.3, forward=RigidTransform()):  # noqa: B008
    """Return the outputs of the vision of a peg at rest, from which the hole is at a pose."""
    builder = DiagramBuilder()
    X_WT = scenario.nominal_pose("peg") @ forward
    places = {"peg": X_WT, "hole": X_WT @ X_TM}
    poses = {
        arm: builder.AddSystem(ConstantVectorSource(pose_vector(X))).get_output_port()
        for arm, X in places.items()
    }
    error = add_cell_vision(
        builder, scenario, scenario.cameras, poses=poses, begin=0.1, tool_pose=poses["peg"]
    )
    for name in ("error", "valid", "blind"):
        builder.ExportOutput(error.GetOutputPort(name), name)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(seconds)
    context = simulator.get_context()
    return {
        name: diagram.GetOutputPort(name).Eval(context) for name in ("error", "valid", "blind")
    }


def test_the_error_is_the_way_to_the_mouth_in_the_holes_axes():
    scenario = replace(CELL, axis="downwards")
    scenario = replace(scenario, cameras=resolve(scenario).cameras)
    turn = RotationMatrix(Rotation.from_rotvec([0.0, 0.02, -0.03]).as_matrix())
    says = seen(scenario, RigidTransform(turn, [0.031, 0.0012, -0.0008]))
    assert says["valid"] == 1
    moved = says["error"][:3] * scenario.cameras.pixel_size
    assert moved == pytest.approx([0.001, 0.0012, -0.0008], abs=1e-4)
    assert moved[1:] == pytest.approx([0.0012, -0.0008], abs=2e-5)
    assert says["error"][3:] == pytest.approx([0.0, 0.02, -0.03], abs=4e-3)


def test_what_the_mounting_is_off_shows_in_the_error():
    off = replace(CELL.cameras.hand, error=(5e-4, 0.0, 0.0, 0.0, 0.0, 0.0))
    scenario = replace(CELL, cameras=replace(CELL.cameras, hand=off))
    scenario = replace(scenario, cameras=resolve(scenario).cameras)
    says = seen(scenario, RigidTransform([0.03, 0.0, 0.0]))
    # The camera's right is z of the peg: what it sees is as much to the left.
    moved = says["error"][:3] * scenario.cameras.pixel_size
    assert moved[1:] == pytest.approx([0.0, -5e-4], abs=2e-5)


def test_a_hidden_mouth_is_not_valid_and_a_lost_one_makes_blind():
    scenario = replace(CELL, cameras=resolve(CELL).cameras)
    aside = seen(scenario, RigidTransform([0.03, 0.05, 0.0]), 0.7)
    assert (aside["valid"], aside["blind"]) == (0, 1)
    for advance, valid in ((0.012, 1), (0.025, 0)):
        forward = RigidTransform([advance, 0.0, 0.0])
        near = seen(scenario, forward.inverse() @ RigidTransform([0.03, 0.0, 0.0]), 0.7, forward)
        assert (near["valid"], near["blind"]) == (valid, 0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"gap": 0.005}, r"cameras.hand.reach is 0.004, allowed: one with which some camera"),
        (
            {"initial_error": (0.0, 0.006, 0.0, 0.0, 0.0, 0.0)},
            r"cameras.hand.reach is 0.004, allow",
        ),
        (
            {"cameras": CameraSettings(kind="hand", hand=HandMount(angle=0.1))},
            "cameras.hand.angle",
        ),
    ],
)
def test_a_camera_that_never_sees_the_mouth_is_refused(changes, said):
    with pytest.raises(ParameterError, match=said):
        resolve(replace(CELL, **changes))


def test_a_hole_that_an_arm_holds_is_refused():
    with pytest.raises(ParameterError, match=r"hole.kind is 'arm', allowed: fixture"):
        resolve(AlignmentScenario(cameras=CameraSettings(kind="hand")))


def test_settings_are_finite_numbers():
    with pytest.raises(ParameterError, match="error"):
        HandMount(error=(np.nan,) * 6)


def test_a_calibrated_hand_says_lens_and_how_far_off_it_may_be(tmp_path):
    sd = FramePose(rotation_vector=(3e-4, 4e-4, 5e-4), translation=(1e-4, 1e-4, 2e-4))
    eye = FramePose(rotation_vector=(0.1, 0.0, 0.0), translation=(0.0, 0.05, 0.1), sd=sd)
    lens = (-0.05, 0.01, 0.0, 0.0, 0.0)
    left = CalibratedCamera(
        width=640,
        height=480,
        focal_length=(900.0, 900.0),
        principal_point=(320.0, 240.0),
        distortion=lens,
    )
    path = tmp_path / "camera.yaml"
    path.write_text(camera_text(CameraFile(left=left, hand_eye=eye)))
    mount = HandMount(file=str(path)).read()
    assert mount.distortion == lens
    assert mount.angle_deviation == pytest.approx(np.sqrt(50e-8 / 3))
    assert mount.position_deviation == pytest.approx(np.sqrt(6e-8 / 3))
    path.write_text(camera_text(CameraFile(left=left)))
    with pytest.raises(ParameterError, match="allowed: a file with hand_eye and its deviations"):
        HandMount(file=str(path)).read()
    drawn = np.array([mount.drawn(np.random.default_rng(k)).error for k in range(400)])
    sizes = np.repeat([mount.position_deviation, mount.angle_deviation], 3)
    assert np.allclose(drawn.std(axis=0) / sizes, 1.0, atol=0.15)


def test_trials_draw_what_calibration_left():
    trials = AlignmentTrialsScenario(**{**vars(CELL), "initial_error": (0.0,) * 6})
    one, other, again = (drawn(trials, trials.spread, 3, k).cameras.hand.error for k in (0, 1, 0))
    assert one == again != other
