"""Pegs that are fed without looking: on a spring support, and by an arm of the cell."""

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.cell.work_cell import support_at
from chamfer.diagrams.insertion.blind_feed import (
    BlindFeedScenario,
    Plane,
    make_blind_feed_diagram,
    resolve_fed_cell,
)
from chamfer.diagrams.insertion.peg_insertion import (
    PegInsertionScenario,
    make_peg_insertion_diagram,
    resolve_peg_insertion,
)
from chamfer.models.peg.support import OpenSupport

SCENARIO = PegInsertionScenario()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("gap=-0.01", "gap is -0.01, allowed: a finite number > 0"),
        ("gap=0.0001", "gap is 0.0001, allowed: > 0.000171 m, so that peg and hole do not over"),
        ("depth=0.07", "depth is 0.07, allowed: at most the peg's length, 0.06 m"),
        ("parts.peg_radius=0.0101", "parts.peg_radius is 0.0101, allowed: less than the hole's"),
        ("support.angular_stiffness=0.01", "support.angular_stiffness is 0.01, allowed: > 0.017"),
        ("tilt=0.9", "tilt is 0.9, allowed: between -pi/4 and pi/4"),
        ("force_cap=0", "force_cap is 0.0, allowed: a finite number > 0"),
        ("step=0.03", "step is 0.03, allowed: at most 0.0256 s: a feed by the clearance"),
        (
            "speed=5",
            "step is 0.001, allowed: at most 0.0001024 s: a feed by the clearance",
        ),
        ("approximation=tamsi", "approximation is 'tamsi', allowed: lagged, similar, sap"),
    ],
)
def test_mistakes_are_said_in_one_line(setting: str, message: str) -> None:
    with pytest.raises(UserError) as caught:
        make_scenario(SCENARIO, settings=[setting])
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_the_peg_starts_in_front_of_the_mouth_as_it_is_off() -> None:
    diagram = make_peg_insertion_diagram(resolve_peg_insertion(SCENARIO))
    context = diagram.CreateDefaultContext()
    x, y, z, rz, ry = diagram.GetOutputPort("joints").Eval(context)[:5]
    L_g = SCENARIO.support.centre_distance
    assert (z, ry, rz) == (0.0, 0.0, -SCENARIO.tilt)
    assert x + L_g * math.cos(rz) == pytest.approx(-SCENARIO.gap)
    assert y + L_g * math.sin(rz) == pytest.approx(SCENARIO.lateral)  # the tip's


def run_to(scenario: PegInsertionScenario, time: float) -> dict[str, Any]:
    diagram = make_peg_insertion_diagram(resolve_peg_insertion(scenario))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(time)
    return {
        name: np.array(diagram.GetOutputPort(name).Eval(simulator.get_context()))
        for name in ("joints", "drives", "depth", "wrench")
    }


def test_free_of_contact_it_is_fed_at_its_speed_without_force() -> None:
    free = replace(SCENARIO, lateral=0.0, tilt=0.0, speed=0.05, gap=0.001)
    found = run_to(free, 0.1)
    assert found["depth"][0] == pytest.approx(0.05 * 0.1 - 0.001, abs=2e-4)
    np.testing.assert_allclose(found["drives"], 0.0, atol=0.05)
    assert not found["wrench"].any()


def test_the_push_has_a_cap() -> None:
    beside = replace(SCENARIO, lateral=0.008, tilt=0.0, force_cap=12.0, speed=0.1, gap=0.001)
    found = run_to(beside, beside.released)
    assert found["drives"][0] == pytest.approx(12.0, rel=1e-3)
    assert found["wrench"][3] == pytest.approx(-12.0, rel=1e-2)
    assert found["depth"][0] == pytest.approx(0.0, abs=1e-4)  # on the face


def test_mirrored_errors_give_the_mirrored_motion() -> None:
    short = replace(SCENARIO, speed=0.1, gap=0.001, step=0.002)
    here = run_to(short, 0.12)
    there = run_to(replace(short, lateral=-short.lateral, tilt=-short.tilt), 0.12)
    np.testing.assert_allclose(here["wrench"][4], -there["wrench"][4], rtol=1e-3)
    np.testing.assert_allclose(here["joints"][1], -there["joints"][1], atol=2e-6)


SCENARIO_BLIND_FEED = BlindFeedScenario()


@pytest.mark.parametrize(("plane", "k"), [("xy", 1), ("xz", 2)])
def test_the_peg_starts_with_errors_of_which_equal_signs_add(plane: Plane, k: int) -> None:
    scenario = BlindFeedScenario(plane=plane, lateral=0.002, tilt=0.03)
    X_MT = scenario.nominal_pose("hole").inverse() @ scenario.start()
    tip = X_MT.translation()
    assert tip[0] == pytest.approx(-scenario.gap)
    assert tip[k] == pytest.approx(0.002)
    assert tip[3 - k] == pytest.approx(0.0)
    far_end = X_MT.multiply(np.array([-0.06, 0.0, 0.0]))
    assert far_end[k] == pytest.approx(0.002 + 0.06 * math.sin(0.03))
    assert far_end[3 - k] == pytest.approx(0.0)


def test_the_arm_starts_there_at_rest_and_is_fed_along_the_axis() -> None:
    scenario = BlindFeedScenario(gap=0.02, lateral=0.003, tilt=0.02)
    diagram = make_blind_feed_diagram(resolve_fed_cell(scenario))
    simulator = Simulator(diagram)
    port, depth = (diagram.GetOutputPort(name) for name in ("peg.true_pose", "contact.depth"))
    simulator.Initialize()
    p = port.Eval(simulator.get_context())[4:]
    np.testing.assert_allclose(p, scenario.start().translation(), atol=1e-9)
    simulator.AdvanceTo(0.3)
    moved = port.Eval(simulator.get_context())[4:] - p
    assert moved[0] == pytest.approx(0.3 * scenario.speed, abs=2e-3)  # friction
    np.testing.assert_allclose(moved[1:], 0.0, atol=5e-4)
    assert depth.Eval(simulator.get_context())[0] == pytest.approx(-0.014, abs=2e-3)


@pytest.mark.parametrize("plane", get_args(Plane))
def test_theory_goes_by_the_support_of_the_arms_unless_it_is_said(plane: Plane) -> None:
    assert SCENARIO_BLIND_FEED.support_at(0.02, plane) == support_at(
        SCENARIO_BLIND_FEED, 0.02, plane
    )
    remote = replace(SCENARIO_BLIND_FEED, support=OpenSupport(centre_distance=0.2))
    expected = replace(SCENARIO_BLIND_FEED.support_at(0.02, plane), centre_distance=0.2)
    assert remote.support_at(0.02, plane) == expected


@pytest.mark.parametrize(("plane", "k"), [("xy", 1), ("xz", 2)])
def test_downwards_the_peg_is_off_along_the_axes_of_the_hole(plane: Plane, k: int) -> None:
    hole = replace(SCENARIO_BLIND_FEED.hole, kind="fixture")
    scenario = BlindFeedScenario(
        axis="downwards", hole=hole, plane=plane, lateral=0.002, tilt=0.03
    )
    X_MT = scenario.nominal_pose("hole").inverse() @ scenario.start()
    assert X_MT.translation()[k] == pytest.approx(0.002)
    above = scenario.start().translation()[2] - scenario.mouth[2]
    assert above == pytest.approx(scenario.gap)
    diagram = make_blind_feed_diagram(resolve_fed_cell(scenario))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.3)
    read = diagram.GetOutputPort("contact.depth").Eval(simulator.get_context())
    assert read[0] > -scenario.gap + 0.003  # it is fed downwards


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("feed=0.04", "feed is 0.04, allowed: more than gap + depth, 0.046 m"),
        ("step=0.05", "step is 0.05, allowed: "),
        (
            "speed=0.6",
            "step is 0.001, allowed: at most 0.000853333 s: a feed by the clearance of both sides",
        ),
        ("gap=-0.01", "gap is -0.01, allowed: a finite number > 0"),
        ("tilt=0.9", "tilt is 0.9, allowed: between -pi/4 and pi/4"),
        (
            "gap=0.0001",
            "gap is 0.0001, allowed: > 0.000233 m, so that peg and hole",
        ),
        ("parts.peg_colour=[0,200,0]", "parts.peg_colour is (0, 200, 0), allowed: (205, 40, 40)"),
        ("plane=yz", "plane is 'yz', allowed: xy, xz"),
        ("rest=-1", "rest is -1.0, allowed: "),
    ],
)
def test_mistakes_are_said_in_one_line_blind_feed(setting: str, message: str) -> None:
    with pytest.raises(UserError) as caught:
        make_scenario(SCENARIO_BLIND_FEED, settings=[setting])
    assert str(caught.value).startswith(message)
