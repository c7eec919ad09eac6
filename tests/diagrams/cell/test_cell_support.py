"""What the cell's arms are to a peg in the hole, against arms that are pushed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    PEG_ARM,
    WorkCellScenario,
    axial_stiffness,
    support_at,
)
from chamfer.models.cameras.camera import View
from chamfer.models.peg.support import Support
from chamfer.systems.force.impedance_controller import ImpedanceControllerParams

CELL = WorkCellScenario()
FIXTURE = replace(HOLE_ARM, kind="fixture")
depths = st.floats(0.0, 0.1)
stiff = st.floats(10.0, 2000.0)


@given(depth=depths)
def test_against_a_fixture_it_is_the_peg_s_arm(depth: float) -> None:
    cell = replace(CELL, hole=FIXTURE)
    expected = Support(lateral_stiffness=400.0, angular_stiffness=5.0, centre_distance=0.0)
    assert support_at(cell, depth) == expected
    assert axial_stiffness(cell) == 400.0


@given(across=st.tuples(stiff, stiff), turn=st.tuples(stiff, stiff), depth=depths)
def test_without_a_plane_it_is_the_one_that_tilts_more(
    across: tuple[float, float], turn: tuple[float, float], depth: float
) -> None:
    impedance = ImpedanceControllerParams(
        stiffness=(1.0, *across), rotational_stiffness=(1.0, *turn)
    )
    cell = replace(CELL, impedance=impedance)
    planes: tuple[View, View] = ("xy", "xz")
    both = [support_at(cell, depth, plane) for plane in planes]
    assert [one.angular_stiffness for one in both] == pytest.approx([turn[1] / 2, turn[0] / 2])
    found = support_at(cell, depth)
    assert found in both
    assert found.tilt_per_error == max(one.tilt_per_error for one in both)


DEPTH = 0.03
SPRINGS: dict[str, Any] = {
    "stiffness": (300.0, 400.0, 600.0),
    "rotational_stiffness": (3.0, 4.0, 6.0),
}


@pytest.mark.parametrize(
    ("plane", "lateral", "turn", "sign"),
    [("xy", 1, 2, 1.0), ("xz", 2, 1, -1.0)],  # a push to +z turns about -y
)
def test_arms_that_are_pushed_at_the_tip_give_way_as_it_says(
    make_cell: Any, still: Any, plane: View, lateral: int, turn: int, sign: float
) -> None:
    perfect = {"payload_error": 0.0, "joint_friction": (0.0,) * 7}
    scenario = replace(
        still(replace(PEG_ARM, **perfect), **SPRINGS),
        hole=replace(HOLE_ARM, **perfect),
        gap=-DEPTH,
    )
    force = 0.5
    moved, turned = 0.0, 0.0
    for arm, lever in (("peg", 0.0), ("hole", DEPTH)):  # of the tip, from the tool's point
        cell = make_cell(scenario, (arm,))
        wrench = np.zeros(6)
        wrench[turn], wrench[3 + lateral] = sign * lever * force, force
        cell.push(wrench)
        cell.run(4.0)
        error = cell.error(arm)
        moved += error[3 + lateral] + sign * lever * error[turn]
        turned += sign * error[turn]
    support = support_at(scenario, DEPTH, plane)
    tilt = force * support.centre_distance / support.angular_stiffness
    assert turned == pytest.approx(tilt, rel=0.01)
    expected = force / support.lateral_stiffness + support.centre_distance * tilt
    assert moved == pytest.approx(expected, rel=0.01)
