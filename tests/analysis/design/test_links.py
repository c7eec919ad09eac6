import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.design.design_scenario import DesignScenario, resolve_design
from chamfer.analysis.design.detection import Sight
from chamfer.analysis.design.drawn_errors import first_inside
from chamfer.analysis.design.insertion_links import Starts, edge_force, region_links, stiffened
from chamfer.analysis.design.link import at_least, at_most, tightest
from chamfer.analysis.design.settling import arm_at_tool, loops, start_error
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.systems.strategies.insertion_decision import InsertionRegion
from chamfer.systems.vision.image_plane_error import AXES

CELL = resolve_design(DesignScenario())


def test_the_tightest_link_is_the_one_with_the_least_share_left() -> None:
    push = at_most("push", 6.0, 8.0, "N", "")
    tilt = at_most("tilt", 0.009, 0.01, "rad", "")
    size = at_least("sight", 3.0, 1.0, "", "")
    kept = at_most("settling", 0.999, 1.0, "", "", by_design=True)
    assert tightest([push, tilt, size, kept]) is tilt
    assert tilt.margin == pytest.approx(0.001)
    assert tilt.share == pytest.approx(0.1)
    assert size.margin == 2.0
    never = at_most("time", math.inf, 8.0, "s", "")
    assert tightest([tilt, never]) is never
    assert never.margin == -math.inf


def test_a_bound_without_end_is_said_to_follow_from_a_link_before_it_that_is_not_kept() -> None:
    rest = at_most("settled.tilt", 0.014, 0.005, "rad", "s")
    near = at_most("settled.lateral", 0.9, 1.0, "m", "s")
    late = at_most("time", math.inf, 8.0, "s", "s")
    edge = at_most("edge", 80.0, 8.0, "N", "s")
    assert tightest([near, rest, late, edge]) is rest
    assert tightest([near, late, rest, edge]) is late


def sees(*way: float) -> bool:
    return Sight(np.zeros(6), np.zeros(6), 4, 4, way).seen


def test_cameras_are_blind_where_two_places_in_a_row_are_mostly_lost() -> None:
    assert sees(1.0, 0.75, 1.0, 0.25, 1.0)
    assert not sees(1.0, 0.25, 0.25, 1.0)
    assert not sees(0.0, 1.0, 1.0)


def test_the_rule_decides_as_the_chart_does() -> None:
    region = InsertionRegion(PegHoleGeometry(), Support())
    errors = np.zeros((12, 4, 2))
    errors[:, 0, 0] = 0.5 * region.lateral_limit
    errors[:, 3, 1] = 2 * region.rotation_limit
    errors[6:, 3, 1] = 0.0
    # Of the second draw the window has to be free of the jump, whose spread makes it unsure.
    assert first_inside(region, errors, 4, 0.3).tolist() == [3.0, 9.0]
    assert np.isinf(first_inside(region, errors, 4, 0.6)[0])
    assert np.isinf(first_inside(region, errors[:3], 4, 0.3)).all()


def test_wedging_is_that_of_the_draw_closest_to_its_limit() -> None:
    starts = Starts(np.array([1e-4, 2e-3]), np.array([0.02, -0.03]))
    links = {link.name: link for link in region_links(CELL, starts)}
    lower, _ = rotation_bounds(CELL.parts, CELL.wedging_support, 2e-3)
    assert links["wedging"].bound == 0.03
    assert links["wedging"].allowed == pytest.approx(-float(lower), rel=1e-3)
    assert links["chamfer"].bound == 2e-3
    assert links["chamfer"].allowed == CELL.parts.chamfer_limit


def test_a_rim_that_may_sit_on_the_edge_takes_a_push() -> None:
    upright = Starts(np.array([3e-3]), np.array([0.06]))  # errors that add
    assert edge_force(CELL, upright) == 0.0
    assert edge_force(CELL, Starts(upright.lateral, -upright.tilt)) > 0.0


def test_friction_stiffens_small_errors_more() -> None:
    support = CELL.wedging_support
    near, far = (stiffened(CELL, support, one, one) for one in (1e-3, 1e-2))
    assert near.angular_stiffness > far.angular_stiffness > support.angular_stiffness
    smooth = replace(
        CELL,
        peg=replace(CELL.peg, joint_friction=(0.0,) * 7),
        hole=replace(CELL.hole, joint_friction=(0.0,) * 7),
    )
    assert stiffened(smooth, support, 1e-3, 1e-3) == support


def test_an_unknown_payload_sags_by_its_weight_over_the_stiffness() -> None:
    at_tool = arm_at_tool(CELL, "peg")
    weight = 9.81 * CELL.peg.payload_error
    assert at_tool.payload[AXES.index("z")] == pytest.approx(-weight / 400)
    # Behind the tip, it tips the peg up: about -Y by 0.07 m times its weight.
    assert at_tool.payload[AXES.index("pitch")] == pytest.approx(-0.07 * weight / 5)


def test_a_base_that_is_elsewhere_is_an_error_of_the_start() -> None:
    moved = replace(CELL.peg.base_error, position=(0.0, 0.002, 0.0))
    off = replace(CELL, peg=replace(CELL.peg, base_error=moved))
    assert start_error(off)[AXES.index("y")] == pytest.approx(-0.002)
    assert loops(off)["y"].middle - loops(CELL)["y"].middle == pytest.approx(-0.002)
