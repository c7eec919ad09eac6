import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.design.changes import FIELDS
from chamfer.analysis.design.design import Design, assess, contradiction, interval
from chamfer.analysis.design.design_scenario import DesignScenario, drawn_design, resolve_design
from chamfer.analysis.design.detection import Sight
from chamfer.analysis.design.insertion_links import (
    Starts,
    edge_forces,
    region_links,
    stiffened,
    turn_link,
)
from chamfer.analysis.design.link import Link, at_least, at_most, supposed, tightest
from chamfer.analysis.design.remaining_errors import DrawnErrors, loop_links, start_error
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.systems.vision.cell_error import AXES

USUAL = DesignScenario(draws=80, pictures=2)


def assessed(scenario: DesignScenario) -> Design:
    return assess(resolve_design(scenario))


def test_the_papers_cell_is_certain() -> None:
    found = assessed(USUAL)
    assert found.verdict == "certain"
    assert found.share == 1.0
    assert found.share_low > 0.95
    assert all(link.margin >= 0 for link in found.links)
    assert found.limiting_link != "settling"  # which is kept by design
    # The worst of n draws is above a share p of all cells with 95 %, p^n = 5 %.
    assert {one.coverage for one in found.bounds.values()} == {0.05 ** (1 / 80)}
    assert found.bounds["attempts"].bound == 1


def test_arms_too_stiff_for_the_largest_start_are_stopped_by_their_own_springs() -> None:
    stiff = FIELDS["impedance.stiffness"].set(USUAL, 3000.0)
    found = assessed(stiff)
    start = next(link for link in found.links if link.name == "start.force")
    assert start.bound == pytest.approx(3000 * 0.01 * 2**0.5)
    assert start.margin < 0
    assert found.verdict == "likely"
    assert 0.1 < found.share < 0.5  # pi (15 N / 3000 N/m)^2 / (20 mm)^2 = 0.196


def test_parts_that_are_not_found_are_not_inserted() -> None:
    small = replace(
        USUAL,
        parts=replace(
            USUAL.parts,
            hole_radius=0.002,
            peg_radius=0.00195,
            outer_radius=0.0028,
            chamfer_width=0.0008,
            peg_length=0.012,
            hole_length=0.008,
        ),
        insert=replace(USUAL.insert, depth=0.007),
    )
    found = assessed(small)
    assert found.verdict == "no"
    assert found.limiting_link == "sight"


def test_draws_are_those_of_the_simulated_trials() -> None:
    scenario = resolve_design(replace(USUAL, spread=replace(USUAL.spread, cameras=0.5)))
    one, again, other = (drawn_design(scenario, 3, trial) for trial in (0, 0, 1))
    assert one == again != other
    assert one.initial_error != scenario.initial_error
    assert one.cameras.xz.true != scenario.cameras.xz.true
    assert one.compensator == scenario.compensator


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
    rest = at_most("settled.tilt", 0.014, 0.005, "rad", "s")
    edge = at_most("edge", 80.0, 8.0, "N", "s")
    # A bound without end is said to follow from a link before it that is not kept.
    assert tightest([tilt, rest, never, edge]) is rest
    assert tightest([tilt, never, rest, edge]) is never
    # Nothing is said of the way in by an arm that does not get there.
    (straight,) = supposed([at_least("posture", 0.0, 0.05, "", "")])
    assert tightest([straight, never, rest, edge]) is straight


def sees(*way: float) -> bool:
    return seen(*way).seen


def seen(*way: float) -> Sight:
    return Sight(np.zeros(6), np.zeros(6), 4, 4, way)


def test_cameras_are_blind_where_two_places_in_a_row_are_mostly_lost() -> None:
    assert sees(1.0, 0.75, 1.0, 0.25, 1.0)
    assert not sees(1.0, 0.25, 0.25, 1.0)
    assert not sees(0.0, 1.0, 1.0)
    assert seen(1.0, 0.5, 0.75, 0.0).share == 0.375


def test_wedging_is_that_of_the_draw_closest_to_its_limit() -> None:
    starts = Starts(np.array([1e-4, 2e-3]), np.array([0.02, -0.03]))
    links = {link.name: link for link in region_links(CELL, starts)}
    lower, _ = rotation_bounds(CELL.parts, CELL.wedging_support, 2e-3)
    assert links["wedging"].bound == 0.03
    assert links["wedging"].allowed == pytest.approx(-float(lower), rel=1e-3)
    assert links["chamfer"].bound == 2e-3
    assert links["chamfer"].allowed == CELL.parts.chamfer_limit


def test_square_parts_are_turned_by_their_chamfers_to_where_they_fit() -> None:
    def turn(angle: float) -> Link:
        drawn = DrawnErrors(*np.zeros((len(DrawnErrors._fields), 1)))
        (link,) = turn_link(square, drawn._replace(turn=np.array([angle / 1.1])))
        return link

    assert turn_link(CELL, DrawnErrors(*np.zeros((len(DrawnErrors._fields), 1)))) == []
    square = replace(CELL, parts=replace(CELL.parts, section="square"))
    r, R, friction = CELL.parts.peg_radius, CELL.parts.hole_radius, CELL.parts.friction
    fits = R / r - 1  # small angles
    assert turn(0.95 * fits).bound == 0
    # Both arms' 2.5 N m/rad at a lever of half a diagonal, up a chamfer of 45 degrees.
    force = 2.5 * 0.02 / (math.sqrt(2) * r) * (1 + friction) / (1 - friction)
    assert turn(fits + 0.02).bound == pytest.approx(force, rel=0.03)


def test_a_loop_decays_by_its_largest_eigenvalue_a_period() -> None:
    drawn = DrawnErrors(*np.zeros((len(DrawnErrors._fields), 1)))
    calm, growing = (loop_links(CELL, drawn._replace(growth=one))[0] for one in (0.99, 1.01))
    assert calm.bound == pytest.approx(0.01 / CELL.impedance.period, rel=0.01)
    assert calm.margin > 0 > growing.margin


def test_a_rim_that_may_sit_on_the_edge_takes_a_push() -> None:
    upright = Starts(np.array([3e-3]), np.array([0.06]))  # errors that add
    assert edge_forces(CELL, upright) == [0.0]
    # 2.5 N m/rad of both arms by their lever, a radius less friction on a chamfer of 45 degrees.
    lever = CELL.parts.peg_radius * (1 - 0.45) / (1 + 0.45)
    against = Starts(upright.lateral, -upright.tilt)
    assert edge_forces(CELL, against) == pytest.approx(2.5 * 0.06 / lever, rel=0.01)


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


def test_a_base_that_is_elsewhere_is_an_error_of_the_start() -> None:
    moved = replace(CELL.peg.base_error, position=(0.0, 0.002, 0.0))
    off = replace(CELL, peg=replace(CELL.peg, base_error=moved))
    assert start_error(off)[AXES.index("y")] == pytest.approx(-0.002)


def design(verdict: str, low: float = 0.0, high: float = 1.0) -> Design:
    link = at_most("one", 1.0, 2.0, "", "")
    return Design(
        links=(link,),
        verdict=verdict,  # type: ignore[arg-type]
        share=0.5,
        share_low=low,
        share_high=high,
        draws=10,
    )


def test_interval_is_that_of_clopper_and_pearson() -> None:
    # All of n: the lower end p has p^n = 2.5 %.
    low, high = interval(20, 20)
    assert (low, high) == (pytest.approx(0.025 ** (1 / 20)), 1.0)
    low, high = interval(0, 20)
    assert (low, high) == (0.0, pytest.approx(1 - 0.025 ** (1 / 20)))


@pytest.mark.parametrize(
    ("design", "seated", "said"),
    [
        (design("certain"), 20, ""),
        (design("certain"), 19, "called 'certain', but 1 of 20"),
        (design("no"), 0, ""),
        (design("no"), 1, "called 'no', but 1 of 20"),
        (design("likely", 0.4, 0.8), 19, ""),
        (design("likely", 0.4, 0.6), 20, "40 to 60 % of the errors inside"),
        (design("likely", 0.4, 0.6), 2, "40 to 60 % of the errors inside"),
    ],
)
def test_a_single_insertion_contradicts_what_is_sure_and_an_interval_what_is_likely(
    design: Design, seated: int, said: str
) -> None:
    found = contradiction(design, seated, 20)
    assert bool(found) == bool(said)
    assert said in found
