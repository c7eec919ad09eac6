"""Arms of one's own, and makers' arms, in the cell."""

from dataclasses import replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pytest

from chamfer.analysis.insertion.cell_runs import insertion_metrics, run_cell_insertion
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.controller_design import step_responses
from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    PEG_ARM,
    CellArmSettings,
    WorkCellScenario,
    require_strong,
    resolve_arms,
)
from chamfer.diagrams.insertion.insertion import InsertionScenario
from chamfer.diagrams.insertion.insertion import resolve as resolve_makers_arms
from chamfer.models.arms.wam import DRY_FRICTION, POSTURE, URDF
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.force.impedance_law import ImpedanceControllerParams

FILE = Path(__file__).parents[2] / "models/arms/six_joints.urdf"
BASE = Placement(position=(-0.75, 0.0, 0.0))
PEG = replace(PEG_ARM, model=str(FILE), base=BASE)
FIXTURE = replace(HOLE_ARM, kind="fixture")
CELL = WorkCellScenario(peg=PEG, hole=FIXTURE)


@lru_cache
def resolved() -> AlignmentScenario:
    return resolve(AlignmentScenario(peg=PEG, hole=FIXTURE))


def changed(tmp_path: Path, old: str, new: str) -> CellArmSettings:
    text = FILE.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "arm.urdf"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return replace(PEG, model=str(path))


def test_what_is_left_open_follows_from_the_model() -> None:
    peg = resolved().peg
    assert peg.joint_friction == (0.2, 0, 0.15, 0, 0, 0)
    assert peg.rotor_inertia == pytest.approx((0, 0.4, 0, 0, 0, 0))
    assert peg.posture is not None
    np.testing.assert_array_equal(resolved().rest_posture("peg"), peg.posture)
    there = peg.known_arm().evaluate(np.array(peg.posture)).X_WT
    assert there.IsNearlyEqualTo(CELL.nominal_pose("peg"), 1e-9)
    assert resolve_arms(resolved()) == resolved()


def test_what_is_given_is_kept() -> None:
    posture = tuple(resolved().rest_posture("peg").tolist())
    own = replace(PEG, joint_friction=(0.1,) * 6, rotor_inertia=(0.3,) * 6, posture=posture)
    assert resolve_arms(replace(CELL, peg=own)).peg == own
    mass, of_file = (one.known_arm().evaluate(np.zeros(6)).mass for one in (own, PEG))
    np.testing.assert_allclose(
        mass - of_file, np.diag([0.3, -0.1, 0.3, 0.3, 0.3, 0.3]), atol=1e-12
    )


def test_the_controller_is_designed_for_the_arm() -> None:
    own, wam = resolved().compensator, resolve(AlignmentScenario(hole=FIXTURE)).compensator
    assert own.lateral.dead_zone > wam.lateral.dead_zone  # a heavier arm is slower
    assert own.lateral.dead_zone < 2 * wam.lateral.dead_zone


def refused(scenario: WorkCellScenario, push: float = 0.0) -> str:
    with pytest.raises(ParameterError) as caught:
        require_strong(resolve_arms(scenario), push)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_too_weak(tmp_path: Path) -> None:
    weak = replace(CELL, peg=changed(tmp_path, 'effort="130"', 'effort="30"'))
    message = refused(weak)
    assert "allowed: an arm strong enough to hold itself at its place: lift has 30 N m" in message
    assert message.startswith("peg.model is '")
    assert "hold itself and push with 300 N at its place" in refused(CELL, 300.0)
    require_strong(CELL, 30.0)
    given = replace(weak, impedance=ImpedanceControllerParams(torque_limits=(200.0,) * 6))
    resolve_arms(given)  # what is asked for is tried


def test_too_close_to_a_singularity() -> None:
    agile = ImpedanceControllerParams(smallest_singular_value=0.9)
    message = r"^rest posture is \(.*\), allowed: .* smallest singular value, here 0\..* is 0.9 or"
    with pytest.raises(ParameterError, match=message):
        resolve(AlignmentScenario(peg=PEG, hole=FIXTURE, impedance=agile))


def test_the_wam_s_own_file_is_the_wam() -> None:
    """By Drake's kinematics and from a searched posture it is reached as by the closed form."""
    of_file = replace(PEG_ARM, model=str(URDF), joint_friction=DRY_FRICTION)
    posture = replace(of_file, posture=POSTURE)
    one = step_responses(WorkCellScenario(peg=posture, hole=FIXTURE), "peg")
    other = step_responses(WorkCellScenario(hole=FIXTURE), "peg")
    np.testing.assert_allclose(one.gain, other.gain, rtol=0, atol=1e-8)
    np.testing.assert_allclose(one.undelivered, other.undelivered, rtol=0, atol=1e-7)
    found = resolve_arms(WorkCellScenario(peg=of_file, hole=FIXTURE))
    X_WT = found.peg.known_arm().evaluate(found.rest_posture("peg")).X_WT
    assert X_WT.IsNearlyEqualTo(CELL.nominal_pose("peg"), 1e-9)


PACKAGE = "example-robot-data"
# Friction is in none of the files: assumed, a WAM's.
ARMS = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_link8", 7),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0", 6),
}


def arm(name: str) -> CellArmSettings:
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_aligns_and_inserts_by_sight(name: str) -> None:
    fixture = replace(HOLE_ARM, kind="fixture")
    scenario = resolve_makers_arms(InsertionScenario(peg=arm(name), hole=fixture))
    done = insertion_metrics(run_cell_insertion(scenario, seed=0), scenario)
    assert done["seated"] == done["seated.first"] == 1
    assert done["touch.lateral_error"] is not None
    assert done["touch.lateral_error"] < 0.002  # m, on the chamfer
