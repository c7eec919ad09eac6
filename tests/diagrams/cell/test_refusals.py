"""Cells, their cameras and insertions that cannot be."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from chamfer.diagrams.cell.cell_vision import CameraSettings, ViewFrames, ViewSettings
from chamfer.diagrams.cell.work_cell import PEG_ARM, WorkCellScenario
from chamfer.diagrams.insertion.blind_feed import BlindFeedScenario
from chamfer.diagrams.insertion.insertion import InsertionScenario
from chamfer.diagrams.insertion.peg_insertion import FeedSupport, PegInsertionScenario
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import SensorParams
from chamfer.systems.strategies.insertion_law import InsertParams

SIX_JOINTS = str(Path(__file__).parents[2] / "models/arms/six_joints.urdf")
ARM = partial(replace, PEG_ARM)
OWN = partial(replace, PEG_ARM, model=SIX_JOINTS)
LATE = ViewSettings(sensor=SensorParams(exposure=0.02))
OPEN = ViewSettings(sensor=SensorParams(exposure=0.01))
BACKWARDS = ViewSettings(frames=ViewFrames(period=-1.0))


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        (ARM, {"model": "no.urdf"}, "model is 'no.urdf', allowed: wam, ur5e, scara, or a URDF"),
        (OWN, {"tool_frame": "hand"}, "tool_frame is 'hand', allowed: one of the model's links"),
        (OWN, {"posture": (0.0,) * 5}, "posture is (0.0, 0.0, 0.0, 0.0, 0.0), allowed: 6"),
        (OWN, {"rotor_inertia": (-0.1,) * 6}, "rotor_inertia is (-0.1, "),
        (OWN, {"joint_friction": (math.nan,) * 6}, "joint_friction is (nan, "),
        (OWN, {"joint_friction": "panda"}, "joint_friction is 'panda', allowed: 6 numbers, of "),
        (OWN, {"friction_asymmetry": (1.1,) * 6}, "friction_asymmetry is (1.1, "),
        (ARM, {"joint_friction": "panda", "friction_asymmetry": (0,) * 7}, "friction_asymmetr"),
        (WorkCellScenario, {"step": 0.0015}, "step is 0.0015, allowed: a whole part of the contr"),
        (WorkCellScenario, {"gap": math.inf}, "gap is inf, allowed: a finite number"),
        (CameraSettings, {"xz": LATE}, "xz.sensor.exposure is 0.02, allowed: at most the camera'"),
        (CameraSettings, {"xy": BACKWARDS}, "xy.frames.period is -1.0, allowed: a number from 0"),
        (CameraSettings, {"renderer": "vtk", "xz": OPEN}, "xz.sensor.exposure is 0.01, allowed:"),
        (InsertionScenario, {"insert": InsertParams(depth=0.06)}, "insert.depth is 0.06, allowed"),
        (InsertionScenario, {"peg_excess": 0.003}, "peg_excess is 0.003, allowed: such that the "),
        (InsertionScenario, {"insert": InsertParams(speed=0.3)}, "step is 0.002, allowed: at mos"),
        (PegInsertionScenario, {"gap": 1e-4}, "gap is 0.0001, allowed: > 0.000171 m, so that peg"),
        (
            PegInsertionScenario,
            {"support": FeedSupport(angular_stiffness=0.01)},
            "support.angular_stiffness is 0.01, allowed: > 0.017",
        ),
        (PegInsertionScenario, {"step": 0.03}, "step is 0.03, allowed: at most 0.0256 s: a feed "),
        (BlindFeedScenario, {"speed": 0.6}, "step is 0.001, allowed: at most 0.000853333 s: a fe"),
        (BlindFeedScenario, {"gap": 1e-4}, "gap is 0.0001, allowed: > 0.000233 m, so that peg an"),
        (
            BlindFeedScenario,
            {"parts": ColouredParts(peg_colour=(0, 200, 0))},
            "parts.peg_colour is (0, 200, 0), allowed: (205,",
        ),
    ],
)
def test_refuses(kind: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        kind(**changes)
    assert str(refused.value).startswith(message)
