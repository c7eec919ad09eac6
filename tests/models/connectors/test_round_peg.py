"""The round peg: its pieces against round parts, and pushes in line and beside."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from scipy.optimize import brentq

from chamfer.models.arms.wrist import WristParams
from chamfer.models.connectors.connector import ContactMaterial
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.peg.peg_and_hole import PRESETS, PegAndHole

TOLERANCES = ("nominal", "worst")


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_play_is_the_clearance_whatever_the_peg_is_turned_by(geometry_of, tolerance, turn):
    peg = RoundPeg(tolerance=tolerance)
    geometry = geometry_of(peg)
    for eighth, largest in ((0.0, 1.0), (0.5, 1 / math.cos(math.pi / 8)), (3.0, 1.0)):
        angle = eighth * math.pi / 4
        direction = np.array([math.cos(angle), math.sin(angle)])
        free = geometry.free(RotationMatrix(), 5e-3, direction)
        assert peg.clearance - 1e-7 < free < largest * peg.clearance + 1e-6
    # As the skill's grasp turns it: pieces are placed without the turn.
    turned = RigidTransform(RotationMatrix.MakeZRotation(turn), np.zeros(3))
    held = geometry_of(Turned(peg, turned))
    assert held.free(RotationMatrix(), 5e-3, (1.0, 0.0)) == pytest.approx(peg.clearance, abs=1e-7)


def test_the_holes_edge_is_closed_between_two_directions(geometry_of):
    peg = RoundPeg()
    edge, eighth = peg.lead_in, math.pi / 8
    beside = 0.5 * edge  # of a sphere of the rim that leans into a corner of the edge, inwards
    x = peg.hole_radius + edge - beside
    lowest = RotationMatrix.MakeYRotation(0.1)
    sphere = lowest @ np.array([peg.peg_radius - edge, 0.0, edge])
    geometry = geometry_of(peg)

    def meets(depth):
        centre = np.array([x, x * math.tan(eighth), edge - depth])
        return geometry.meet(RigidTransform(lowest, centre - sphere))

    depth = 2 * edge - math.sqrt((2 * edge) ** 2 - beside**2)  # of two round edges that touch
    assert not meets(depth - 1e-5)
    assert meets(depth + 1e-5)


@pytest.mark.parametrize("name", RoundPeg.PRESETS)
def test_parts_by_name_are_those_of_the_other_experiments(name):
    parts, peg = PegAndHole(**PRESETS[name]), RoundPeg(**RoundPeg.PRESETS[name])
    assert (peg.peg_radius, peg.hole_radius) == (parts.peg_radius, parts.hole_radius)
    assert (peg.material.friction, peg.outer_radius) == (parts.friction, parts.outer_radius)
    assert peg.lead_in == pytest.approx(0.0005)
    # As tight as the paper's may be, in shares of the play; as long as the gripper's.
    paper = RoundPeg(tolerance="worst").clearance / RoundPeg().clearance
    assert replace(peg, tolerance="worst").clearance == pytest.approx(paper * peg.clearance)
    assert (peg.depth, peg.peg_length) == (RoundPeg.depth, RoundPeg.peg_length)


def test_square_parts_are_no_round_ones_and_the_papers_are_the_default():
    assert set(RoundPeg.PRESETS) == set(PRESETS) - {"nist-16mm-square"}
    assert RoundPeg(**RoundPeg.PRESETS["paper"]) == RoundPeg()


class Turned:
    """A peg that is held with a turn."""

    def __init__(self, peg, X_BP):
        self.peg, self.X_BP = peg, X_BP

    def add_socket(self, plant, X_WS):
        self.peg.add_socket(plant, X_WS)

    def add_plug(self, plant, body, X_WP):
        self.peg.add_plug(plant, body, X_WP @ self.X_BP)


@pytest.mark.parametrize("depth", [6e-3, 12e-3])
def test_tilted_peg_fits_as_deep_as_two_round_edges_say(geometry_of, depth):
    peg = RoundPeg()
    geometry = geometry_of(peg)

    def fits(tilt):
        R = RotationMatrix.MakeYRotation(tilt)
        places = np.linspace(-1e-3, 1e-3, 400)
        return any(not geometry.meet(RigidTransform(R, [x, 0.0, -depth])) for x in places)

    low, high = 0.0, 0.3
    while high - low > 1e-5:
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    # One side of the rim lies against the wall, the side opposite against the hole's edge.
    bore, e, across = peg.hole_radius, peg.lead_in, peg.peg_radius - peg.lead_in

    def gap(tilt):
        sine, cosine = math.sin(tilt), math.cos(tilt)
        beside = (2 * bore - across * cosine + e * sine) * cosine - (depth - e) * sine
        return beside - peg.peg_radius - e

    assert low == pytest.approx(brentq(gap, 1e-3, 0.3), rel=0.01)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_peg_in_line_meets_nothing_until_the_bottom(insert, tolerance):
    peg = RoundPeg(tolerance=tolerance)
    run = insert(peg, [0, 0, 0, 0, 0, 1e-3], -peg.depth - 0.3e-3, 0.4)
    assert np.abs(run.wrench[:5]).max() < 1e-6
    assert (
        run.push[run.depth < peg.depth - 0.1e-3][-1] < 2.0
    )  # N, of the wrist's mass as it starts
    assert run.depth[-1] == pytest.approx(peg.mated_depth, abs=2e-6)
    assert run.push[-1] == pytest.approx(2e4 * 0.3e-3, rel=0.05)


def test_round_edges_guide_as_far_as_they_reach_and_no_further(insert):
    peg = RoundPeg(material=ContactMaterial(friction=0.0))
    reach = peg.clearance + 2 * peg.lead_in
    soft = WristParams(stiffness=(20.0, 20.0, 20.0, 2e3, 2e3, 2e4))
    depths = [
        insert(peg, [0, 0, 0, x, 0, 0.2e-3], -2e-3, 0.2, wrist=soft).depth[-1]
        for x in (reach - 0.1e-3, reach + 0.1e-3)
    ]
    assert depths[0] > 1.5e-3
    assert depths[1] < 0.3e-3
