from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.simulate import simulate
from diagrams.alignment import AlignmentScenario, CameraSettings, make_alignment_diagram
from models.validation import ParameterError
from systems.vision.camera_image import FrameGrabberParams

Array = np.ndarray


def final_errors(outputs: dict[str, Array], row: int) -> tuple[float, float]:
    """Distance of the tip from the hole's axis, m, and angle between the axes, rad."""
    peg, hole = outputs["peg.true_pose"][row], outputs["hole.true_pose"][row]
    R_WM = Rotation.from_quat(hole[:4], scalar_first=True)
    R_WT = Rotation.from_quat(peg[:4], scalar_first=True)
    p = R_WM.inv().apply(peg[4:] - hole[4:])
    axis = (R_WM.inv() * R_WT).apply([1.0, 0.0, 0.0])
    return float(np.hypot(p[1], p[2])), float(np.arctan2(np.hypot(axis[1], axis[2]), axis[0]))


def test_the_cameras_align_the_parts() -> None:
    scenario = AlignmentScenario()
    run = simulate(
        make_alignment_diagram(scenario), duration=scenario.duration, step=1 / 80, seed=0
    )
    before = final_errors(run.outputs, int(scenario.begin * 80) - 1)
    after = final_errors(run.outputs, -1)
    assert before[0] > 0.008
    assert before[1] > 0.06
    # published: 2.5 mm and 0.022 rad on the average
    assert after[0] < 0.001
    assert after[1] < 0.01
    assert run.outputs["blind"][-1] == 0
    command = run.outputs["peg.command"][:, :4]
    assert np.abs(np.diff(command, axis=0)).max() < 0.01  # the quaternion does not jump


def test_blank_images_stop_the_compensation() -> None:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=1.0))
    scenario = replace(AlignmentScenario(), cameras=cameras, begin=0.2, compensation_time=0.3)
    run = simulate(
        make_alignment_diagram(scenario), duration=scenario.duration, step=1 / 80, seed=0
    )
    assert not run.outputs["compensation"].any()
    assert not run.outputs["valid"].any()
    assert run.outputs["blind"][-1] == 1
    assert run.outputs["age"][-1] == pytest.approx(0.3, abs=0.03)


def test_refused() -> None:
    with pytest.raises(ParameterError, match="initial_error"):
        AlignmentScenario(initial_error=(0.0, 1.0))
    with pytest.raises(ParameterError, match="compensated is 'left'"):
        AlignmentScenario(compensated="left")  # type: ignore[arg-type]
