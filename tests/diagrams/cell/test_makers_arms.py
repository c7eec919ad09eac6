"""The work cell with the Panda and a UR, as the package example-robot-data has them."""

from dataclasses import replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution

import numpy as np
import pytest

from chamfer.analysis.insertion.cell_runs import insertion_metrics, run_cell_insertion
from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    PEG_ARM,
    ArmSettings,
    WorkCellScenario,
    resolve_arms,
)
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve
from chamfer.models.validation import ParameterError

PACKAGE = "example-robot-data"
# Friction is in none of the files: assumed, a WAM's.
ARMS = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_link8", 7),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0", 6),
}


def arm(name: str) -> ArmSettings:
    path, tool_frame, joints = ARMS[name]
    return replace(
        PEG_ARM, model=file(path), tool_frame=tool_frame, joint_friction=(0.1,) * joints
    )


@lru_cache
def file(path: str) -> str:
    try:
        found = distribution(PACKAGE)
    except PackageNotFoundError:
        pytest.skip(f"{PACKAGE} is not installed: pip install 'chamfer[robots]'")
    place = f"cmeel.prefix/share/{PACKAGE}/robots/{path}"
    return str(found.locate_file(place))


def cell(name: str) -> WorkCellScenario:
    return WorkCellScenario(peg=arm(name), hole=replace(HOLE_ARM, kind="fixture"))


@pytest.mark.parametrize("name", ARMS)
def test_reaches_its_place(name: str) -> None:
    found = resolve_arms(cell(name))
    there = found.peg.known_arm().evaluate(found.rest_posture("peg"))
    assert there.X_WT.IsNearlyEqualTo(found.nominal_pose("peg"), 1e-9)
    assert np.linalg.svd(there.J_V_WT, compute_uv=False)[-1] > 0.1


def test_what_the_files_say() -> None:
    panda, ur5 = arm("panda").arm, arm("ur5").arm
    assert panda.torque_limits == (87, 87, 87, 87, 12, 12, 12)
    assert ur5.torque_limits == (150, 150, 150, 28, 28, 28)
    assert panda.lower_limits[3] == -3.0718
    assert sum(panda.rotor_inertia) == sum(ur5.rotor_inertia) == 0
    assert replace(arm("panda"), tool_frame=None).arm.flange == "panda_hand_tcp"
    message = "^tool_frame is None, allowed: one of the model's links ee_link, tool0$"
    with pytest.raises(ParameterError, match=message):
        replace(arm("ur5"), tool_frame=None)


def test_a_small_arm_does_not_reach() -> None:
    small = replace(arm("ur5"), model=file("ur_description/urdf/ur3_robot.urdf"))
    with pytest.raises(ParameterError, match=r"arm reaches .* within reach of ur3_robot"):
        resolve_arms(replace(cell("ur5"), peg=small))


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_aligns_and_inserts_by_sight(name: str) -> None:
    fixture = replace(HOLE_ARM, kind="fixture")
    scenario = resolve(InsertionScenario(peg=arm(name), hole=fixture))
    done = insertion_metrics(run_cell_insertion(scenario, seed=0), scenario)
    assert done["seated"] == done["seated.first"] == 1
    assert done["touch.lateral_error"] is not None
    assert done["touch.lateral_error"] < 0.002  # m, on the chamfer
