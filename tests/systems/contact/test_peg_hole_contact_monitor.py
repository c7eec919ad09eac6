"""The block that says what of a peg touches what of its hole."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator

from chamfer.diagrams.insertion.peg_insertion import (
    PegInsertionScenario,
    make_peg_insertion_diagram,
    resolve_peg_insertion,
)
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.contact.peg_hole_contact_monitor import (
    FEATURES,
    ContactState,
    shape_of,
    told,
)

Array = NDArray[np.float64]
PARTS = PegAndHole()  # chamfers of 2 mm on both
R, r = PARTS.hole_radius, PARTS.peg_radius
EDGE = 0.002  # m, where the bore begins


def pose(x: float, y: float = 0.0, tilt: float = 0.0) -> RigidTransform:
    return RigidTransform(RotationMatrix.MakeZRotation(-tilt), np.array([x, y, 0.0]))


X_WM = RigidTransform(RotationMatrix.MakeXRotation(0.3), np.array([1.0, -2.0, 0.5]))


class Found:
    """What the block says of contacts, in the mouth's frame: a place, a normal, and a force."""

    def __init__(self, rows: Any, X_MT: RigidTransform, parts: PegAndHole) -> None:
        table, R_WM = [], X_WM.rotation().matrix()
        for position, normal, force in rows:
            n = np.array(normal) / np.linalg.norm(normal)
            on_hole = -force * n if np.isscalar(force) else -np.array(force)
            turned = X_WM @ np.array(position), R_WM @ on_hole, R_WM @ n
            table.append([*np.concatenate(turned), 0.02, -0.001, 1.0])
        frames = X_WM.GetAsMatrix34(), (X_WM @ X_MT).GetAsMatrix34()
        found = told(np.array(table), *frames, shape_of(parts))
        self.state, self.wrench, self.forces = found[0], found[1:7], found[7:12]
        self.sides, self.loss = found[12:15], found[16]


LEFT, RIGHT = (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)  # out of the walls at -y and +y


def test_sixteen_pairs_may_be_one_point() -> None:
    angles = np.linspace(-0.2, 0.2, 16)
    rows = [
        ((EDGE, R * math.cos(a), R * math.sin(a)), (0.0, -math.cos(a), -math.sin(a)), 1.0)
        for a in angles
    ]
    found = Found(rows, pose(0.02), PARTS)
    assert found.state == ContactState.ONE_POINT
    assert dict(zip(FEATURES, found.forces, strict=True)) == pytest.approx(
        {"mouth": 16.0, "tip": 0.0, "chamfer": 0.0, "face": 0.0, "bottom": 0.0}
    )
    assert found.sides[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_two_points_are_at_the_mouth_and_across_at_the_tip(side: float) -> None:
    depth, tilt = 0.014, side * 0.05
    corner = depth - 0.002 * math.cos(tilt) - r * math.sin(abs(tilt))  # of the other side
    rows = (
        ((EDGE, side * R, 0.0), (0.05, -side, 0.0), 3.0),
        ((corner, -side * R, 0.0), (0.0, side, 0.0), 2.0),
    )
    found = Found(rows, pose(depth, -side * (R - r), tilt), PARTS)
    assert found.state == ContactState.TWO_POINT
    np.testing.assert_allclose(found.forces[:2], [3.0, 2.0], rtol=1e-9)
    assert math.cos(found.sides[0]) == pytest.approx(side)
    assert math.cos(found.sides[1]) == pytest.approx(-side)


def test_a_steep_peg_s_tip_is_told_from_the_mouth_close_above_it() -> None:
    tilt, depth = 0.21, 0.0058
    corner = depth - 0.002 * math.cos(tilt) - r * math.sin(tilt)
    rows = (((EDGE, R, 0.0), RIGHT, 3.0), ((corner, -R, 0.0), LEFT, 2.0))
    found = Found(rows, pose(depth, -(R - r * math.cos(tilt)), tilt), PARTS)
    assert corner < EDGE  # the corner is not even in the bore
    np.testing.assert_allclose(found.forces[:2], [3.0, 2.0], rtol=1e-9)


@pytest.mark.parametrize(
    ("place", "normal", "state", "feature"),
    [
        ((0.001, R + 0.001, 0.0), (-1.0, -1.0, 0.0), ContactState.CHAMFER, "chamfer"),
        ((0.0, 0.013, 0.0), (-1.0, 0.0, 0.0), ContactState.FACE, "face"),
        ((0.0013, R + 0.0007, 0.0), (-1.0, -0.1, 0.0), ContactState.CHAMFER, "chamfer"),
        ((0.03, 0.0, 0.0), (-1.0, 0.0, 0.0), ContactState.SEATED, "bottom"),
    ],
)
def test_normals_tell_the_features_apart(
    place: Any, normal: Any, state: ContactState, feature: str
) -> None:
    blind = PegAndHole(bore_depth=0.03)
    found = Found([(place, normal, 2.0)], pose(max(place[0], 0.0)), blind)
    assert found.state == state
    assert found.forces[FEATURES.index(feature)] == pytest.approx(2.0)


def test_wrench_and_loss() -> None:
    rubbed = ((0.002, 0.01, 0.0), RIGHT, (-1.0, -5.0, 0.0))  # friction against the insertion
    found = Found([rubbed], pose(0.0), PARTS)
    np.testing.assert_allclose(found.wrench, [0, 0, 0.002 * -5 - 0.01 * -1, -1, -5, 0], atol=1e-12)
    assert found.loss == pytest.approx(1.0 * 0.02 + 5.0 * 0.001)
    position, force = np.array([[0.3, 0.5, 0.7], [0.2, -0.4, 0.1]]), np.arange(6.0).reshape(2, 3)
    both = Found(zip(position, np.eye(3)[:2], force, strict=True), pose(0.0), PARTS).wrench
    np.testing.assert_allclose(both[:3], np.cross(position, force).sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(both[3:], force.sum(axis=0))


def test_in_a_plant_the_hole_s_wrench_is_what_the_springs_put_on_the_peg() -> None:
    """Drake's contacts against the strain of the springs, forces and moment."""
    scenario = PegInsertionScenario(lateral=0.001, tilt=0.03, speed=0.05, gap=0.001, step=0.002)
    diagram = make_peg_insertion_diagram(resolve_peg_insertion(scenario))
    simulator = Simulator(diagram)
    context = simulator.get_context()
    simulator.AdvanceTo(scenario.fed * 0.9)

    def value(name: str) -> Array:
        return np.asarray(diagram.GetOutputPort(name).Eval(context))

    assert value("state")[0] in (ContactState.TWO_POINT, ContactState.SEATED)
    wrench, drives, joints = value("wrench"), value("drives"), value("joints")
    np.testing.assert_allclose(wrench[3:5], -drives[:2], atol=0.05)
    centre = joints[:2]
    turning = wrench[2] - (centre[0] * wrench[4] - centre[1] * wrench[3])
    assert turning == pytest.approx(-drives[3], abs=2e-3)
    assert abs(drives[3]) > 0.02
    assert value("depth")[0] == pytest.approx(
        joints[0] + scenario.support.centre_distance * math.cos(joints[3])
    )


def test_seated_by_depth() -> None:
    scenario = PegInsertionScenario(lateral=0.0, tilt=0.0, depth=0.006, gap=0.001, speed=0.1)
    diagram = make_peg_insertion_diagram(resolve_peg_insertion(scenario))
    simulator = Simulator(diagram)
    port = diagram.GetOutputPort("state")
    said = []
    for time in (0.03, 0.066):  # 2 and 5.6 of 6 mm deep
        simulator.AdvanceTo(time)
        said.append(port.Eval(simulator.get_context())[0])
    assert said == [ContactState.NONE, ContactState.SEATED]
