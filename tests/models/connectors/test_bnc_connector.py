"""The BNC connector: scripted motions of the carriage, everything else out of contact."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.arms.wrist import WristParams
from chamfer.models.connectors.bnc_connector import BncConnector

TOLERANCES = ("nominal", "worst")
BEST = BncConnector(stud_diameter=(1.91e-3, 1.91e-3), slot_width=(2.46e-3, 2.46e-3))
STIFFNESS = WristParams().stiffness


class Motion(NamedTuple):
    depth: np.ndarray  # mm
    turn: np.ndarray  # degrees
    displacement: np.ndarray  # rad above m
    wrench: np.ndarray  # N m above N

    def at(self, time: float) -> "Motion":
        return Motion(*(signal[..., round(1000 * time)] for signal in self))


def tip(depth: float, turn: float = 0.0, x: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    """From mm and degrees."""
    angles = [math.radians(tilt), 0.0, math.radians(turn)]
    return np.array([*angles, 1e-3 * x, 0.0, -1e-3 * depth])


@pytest.fixture
def move(follow: Any) -> Any:
    def moved(connector: BncConnector, *way: tuple[float, np.ndarray], **fields: Any) -> Motion:
        run = follow(connector, way, **fields)
        return Motion(1e3 * run.depth, np.degrees(run.displacement[2]), *run[2:0:-1])

    return moved


def depths(connector: BncConnector) -> tuple[float, float, float]:
    """Mated, from which it turns, and fully compressed, mm."""
    d = connector.mated_depth, connector.turning_depth, connector.overlap
    return d[0] * 1e3, d[1] * 1e3, d[2] * 1e3


def clocking_tolerance(connector: BncConnector) -> float:
    """By how much a plug may be turned for its studs to enter the slots, degrees, either way."""
    play = connector.slot / 2 - connector.stud_radius
    return math.degrees(math.asin(play / connector.stud_distance))


def test_dimensions_of_the_reference_table() -> None:
    nominal, worst = (BncConnector(tolerance=t) for t in TOLERANCES)  # type: ignore[arg-type]
    assert clocking_tolerance(worst) == pytest.approx(1.4, abs=0.05)
    assert clocking_tolerance(nominal) == pytest.approx(2.2, abs=0.05)
    assert clocking_tolerance(BEST) == pytest.approx(3.0, abs=0.1)
    assert nominal.slot_depth == pytest.approx(5.2e-3, abs=0.02e-3)
    assert nominal.barrel_radius == pytest.approx(4.825e-3)
    assert (worst.barrel_radius, worst.stud_radius) == pytest.approx((4.85e-3, 1.03e-3))
    assert worst.bore_radius - worst.barrel_radius == pytest.approx(0.04e-3)
    # In the detent the studs' far side is on the notch's floor.
    floor = nominal.slot_depth - nominal.slot - nominal.detent
    far_side = nominal.setback + 2 * nominal.stud_radius
    assert nominal.mated_depth == pytest.approx(floor + far_side)
    assert (nominal.mating_force, nominal.name) == (13.0, "bnc")


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_locks_by_push_turn_and_release(move: Any, tolerance: Any) -> None:
    connector = BncConnector(tolerance=tolerance)
    mated, _, full = depths(connector)
    turn = -90.0
    motion = move(
        connector,
        (0.0, tip(-0.5, x=0.3)),
        (0.3, tip(9.3, x=0.3)),
        (0.4, tip(9.3, x=0.3)),
        (0.6, tip(9.3, turn, x=0.3)),
        (0.65, tip(9.3, turn, x=0.3)),
        (0.8, tip(mated, turn, x=0.3)),
        (0.85, tip(mated, turn, x=0.3)),
        (0.9, tip(mated - 0.8, turn, x=0.3)),  # pulls with 16 N
        (1.0, tip(mated - 0.8, turn, x=0.3)),
        (1.05, tip(mated - 0.8, turn + 4.5, x=0.3)),
        (1.15, tip(mated - 0.8, turn + 4.5, x=0.3)),
    )
    compressed, turned = motion.at(0.4), motion.at(0.65)
    assert compressed.depth == pytest.approx(full, abs=0.01)
    # The ceiling of the slots takes what the spring leaves.
    assert compressed.wrench[5] == pytest.approx(STIFFNESS[5] * (9.3e-3 - full * 1e-3), rel=0.03)
    assert 13.0 < compressed.wrench[5] < 1.5 * connector.mating_force
    assert turned.depth == pytest.approx(full, abs=0.01)
    assert np.abs(motion.wrench[2, 450:600]).max() < 0.05  # it turns freely
    released = motion.at(0.85)
    assert released.depth == pytest.approx(mated, abs=0.01)
    pulled = motion.at(1.0)
    assert pulled.wrench[5] < -15.0
    assert pulled.depth == pytest.approx(mated, abs=0.02)
    held = motion.at(1.15)
    play = clocking_tolerance(connector)
    assert held.turn == pytest.approx(turn + play, abs=0.9)
    assert held.wrench[2] < -0.45
    assert held.depth == pytest.approx(mated, abs=0.05)


def test_spring_lifts_a_released_sleeve_until_the_studs_are_in_the_notches(move: Any) -> None:
    connector = BncConnector()
    mated, _, _ = depths(connector)
    # The wrist's spring is slack a little above the notches: nothing but the plug's spring pulls.
    rise = [move(connector, (0.0, tip(8.3, -90)), (0.2, tip(7.9, -90)), (0.3, tip(mated, -90)))]
    rise.append(
        move(connector, (0.0, tip(8.3, -45)), (0.2, tip(7.9, -45)), (0.3, tip(mated, -45)))
    )
    assert rise[0].depth[-1] == pytest.approx(mated, abs=0.02)
    assert rise[1].depth[-1] > mated + 0.7  # the lip holds it


def test_spring_is_as_stiff_as_stated(move: Any) -> None:
    connector = BncConnector()
    motion = move(connector, (0.0, tip(5.0)), (0.3, tip(7.5)), (0.4, tip(7.5)))
    _, _, full = depths(connector)
    expected = 13.0 * (motion.depth[-1] - (full - 3.0)) / 3.0
    assert motion.wrench[5, -1] == pytest.approx(expected, rel=0.01)
    assert motion.wrench[5, 40] == pytest.approx(0.0, abs=0.05)  # not yet touched


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("turn", [-60.0, 30.0])
def test_rests_on_the_studs_and_drops_when_turned_to_the_slots(
    move: Any, tolerance: Any, turn: float
) -> None:
    motion = move(
        BncConnector(tolerance=tolerance),
        (0.0, tip(3.0, turn)),
        (0.05, tip(3.7, turn)),
        (0.1, tip(3.7, turn)),
        (0.25, tip(3.7)),
        (0.3, tip(3.7)),
    )
    assert motion.at(0.1).depth == pytest.approx(3.25, abs=0.01)
    assert motion.at(0.1).wrench[5] == pytest.approx(STIFFNESS[5] * 0.45e-3, rel=0.03)
    assert motion.depth[-1] == pytest.approx(3.7, abs=0.01)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_turns_when_compressed_only_and_only_one_way(move: Any, tolerance: Any) -> None:
    connector = BncConnector(tolerance=tolerance)
    play = clocking_tolerance(connector)

    def turned(depth: float, turn: float) -> float:
        way = (0.0, tip(depth)), (0.1, tip(depth, turn)), (0.15, tip(depth, turn))
        return float(move(connector, *way).turn[-1])

    assert turned(6.0, -play - 2.0) == pytest.approx(-play, abs=0.5)
    assert turned(6.0, play + 2.0) == pytest.approx(play, abs=0.5)
    assert turned(9.2, -20.0) == pytest.approx(-20.0, abs=0.3)
    assert turned(9.2, play + 2.0) == pytest.approx(play, abs=0.5)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_tilt_in_the_bore_is_what_the_clearance_leaves(move: Any, tolerance: Any) -> None:
    connector = BncConnector(tolerance=tolerance)
    lead_in = 1e3 * connector.lead_in
    # The rim's spheres touch at their middle, the barrel's rim half a lead-in below its face.
    length = 6.0 - lead_in - lead_in / 2
    clearance = 2e3 * (connector.bore_radius - connector.barrel_radius)
    free = math.degrees(clearance / length)
    way = (0.0, tip(6.0)), (0.1, tip(6.0, tilt=free + 0.5)), (0.15, tip(6.0, tilt=free + 0.5))
    tilt = math.degrees(move(connector, *way).displacement[0, -1])
    assert tilt == pytest.approx(free, abs=0.25)


@pytest.mark.parametrize(
    ("x", "depth"), [(0.0, 2.0), (0.6, 2.0), (-0.6, 2.0), (1.2, 0.0), (2.0, 0.0), (-3.0, 0.0)]
)
def test_lead_in_catches_what_is_less_than_it_to_the_side(
    move: Any, x: float, depth: float
) -> None:
    motion = move(BncConnector(), (0.0, tip(-0.5, x=x)), (0.2, tip(2.0 if depth else 0.6, x=x)))
    assert motion.depth[-1] == pytest.approx(depth, abs=0.15)


def test_goes_where_the_socket_is_and_the_grasp_leaves_it(move: Any) -> None:
    turned = RotationMatrix.MakeZRotation(math.radians(40))
    place = RigidTransform(turned, [4e-3, 0.0, -2e-3])
    grasp = RigidTransform([0.5e-3, 0.0, 1e-3])
    # The tool turns by 40 degrees about its tip, half a millimetre beside the plug.
    p_ST = turned @ [-0.5e-3, 0.0, -1e-3]
    goal = tip(4.0, 40.0)
    goal[3:] += place.translation() + p_ST
    up = goal + tip(-4.5)
    down = goal + tip(1.0)
    motion = move(BncConnector(), (0.0, up), (0.2, down), (0.25, down), X_WS=place, X_TP=grasp)
    assert motion.depth[-1] == pytest.approx(-1e3 * down[5], abs=0.02)  # in the slots
    assert np.abs(motion.wrench[3:5]).max() < 0.1
