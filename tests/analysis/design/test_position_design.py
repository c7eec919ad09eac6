"""The design of a cell whose arm takes positions: errors, first touch, way in, search."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.design.changes import CHOICES, FIELDS, has_field
from chamfer.analysis.design.design import assess
from chamfer.analysis.design.design_scenario import (
    DesignScenario,
    ResolvedDesignScenario,
    drawn_design,
    resolve_design,
)
from chamfer.analysis.design.insertion_links import Starts
from chamfer.analysis.design.position_errors import drawn_touches, hanging, unrest_of
from chamfer.analysis.design.position_links import (
    MODEL_ERROR,
    attempts_of,
    search_links,
    search_time,
    touch_force,
    way_in,
)
from chamfer.analysis.design.remaining_errors import HELD_OUT
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.contact_loop import contact_loop
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.trajectory_primitives import Spiral


def cell(name: str, *settings: str) -> ResolvedDesignScenario:
    given = [f"cell={name}", "draws=80", *settings]
    return resolve_design(make_scenario(DesignScenario(), settings=given))


RCC = cell("scara-rcc")
UR5E = cell("ur5e-fixture", "search.kind=none")


def test_a_scara_with_an_rcc_is_certain() -> None:
    found = assess(RCC)
    assert found.verdict == "certain"
    assert found.limiting_link in ("chamfer", "push")
    names = ["lateral", "tilt", "time", "push", "force", "depth", "attempts"]
    assert list(found.bounds) == names
    # What the impedance chain alone has is not there.
    links = {link.name for link in found.links}
    assert not links & {"settling", "start.force", "loop", "sight", "loop.contact"}


def test_the_touch_is_off_by_fixture_repeatability_and_a_feed_that_is_off_itself() -> None:
    found = drawn_touches(RCC, 3, 2)
    for k in range(2):
        _, y, z, _, pitch, yaw = drawn_design(RCC, 3, HELD_OUT + k).initial_error
        off = math.hypot(y + RCC.gap * yaw, z - RCC.gap * pitch)
        assert found.lateral[k] == pytest.approx(off, rel=1e-9)
        assert abs(found.tilt[k]) == pytest.approx(math.hypot(pitch, yaw), rel=1e-9)
    still = replace(RCC, arm=replace(RCC.arm, servo=replace(RCC.arm.servo, repeatability=0.0)))
    assert not np.array_equal(drawn_touches(still, 3, 2).lateral, found.lateral)


def test_a_tip_hangs_on_its_springs_across_a_horizontal_axis_alone() -> None:
    level = replace(RCC, axis="horizontal")
    x, y, z, roll, pitch, yaw = hanging(level, np.zeros(1))[0]
    own, wrist = RCC.compliance.resolved(), RCC.wrist
    weight = 9.81 * wrist.mass
    assert z == pytest.approx(-weight / own.lateral)
    # The load is behind the tip: the peg's tip goes up as its tail goes down.
    assert pitch == pytest.approx(-weight * wrist.centre_of_mass / own.angular)
    assert [x, y, roll, yaw] == pytest.approx([0.0] * 4, abs=1e-12)
    down = hanging(RCC, np.zeros(1))[0]
    assert down == pytest.approx([weight / own.axial, 0, 0, 0, 0, 0], abs=1e-12)


def test_the_unrest_of_an_admittance_is_that_of_its_readings() -> None:
    """The variance of x in D x' + K x = F, F with a noise, a zero and a drift, by drawing it."""
    since, h, sensor = 2.0, UR5E.arm.servo.period, UR5E.sensor
    generator, runs = np.random.default_rng(1), 4000
    D, K = (getattr(UR5E.admittance, name)[4] for name in ("damping", "spring"))
    zero = sensor.noise / math.sqrt(3 * UR5E.begin / h) * generator.standard_normal(runs)
    x, drift = np.zeros(runs), np.zeros(runs)
    for _ in range(round(since / h)):
        drift += sensor.drift * math.sqrt(h) * generator.standard_normal(runs)
        noise = sensor.noise * generator.uniform(-1, 1, runs)
        x += h * (noise + drift - zero - K * x) / D
    assert unrest_of(UR5E, since)[0] == pytest.approx(x.std(), rel=0.05)
    assert not unrest_of(RCC, since).any()


@pytest.mark.parametrize("damping", [0.7, 1.0, 2.0, 5.0])
@pytest.mark.parametrize("mass", [0.3, 2.0])
def test_no_first_touch_is_harder_than_its_bound(damping: float, mass: float) -> None:
    """A tool on its springs meets a stiff face, and the admittance answers after its lag."""
    loop, own = contact_loop(UR5E), UR5E.compliance.resolved()
    k, D = 3 * UR5E.contact.stiffness / 2, damping * own.axial * loop.lag
    scenario = replace(
        UR5E,
        peg=replace(UR5E.peg, tool=replace(UR5E.peg.tool, mass=mass)),
        admittance=replace(UR5E.admittance, damping=(4.0,) * 3 + (D,) * 3),
    )
    v, m, h = scenario.insert.speed, scenario.wrist.mass, 1e-5
    c, late = 2 * own.damping_ratio * math.sqrt(own.axial * m), round(loop.lag / h)
    x = flange = peak = 0.0
    speed, answers = v, [0.0] * late  # of the displacement that is asked for
    for i in range(10 * late):
        rate = v - answers[i % late]
        flange += h * rate
        spring, face = own.axial * (flange - x) + c * (rate - speed), k * max(x, 0.0)
        speed += h * (spring - face) / m
        x += h * speed
        answers[i % late] = max(spring, 0.0) / D
        peak = max(peak, face)
    bound = touch_force(scenario, beside=True)
    assert 0.4 * bound < peak <= bound


def test_pushes_of_the_way_in_are_those_of_simulated_insertions() -> None:
    """Starts, pushes in N and lags in s of simulated trials of seed 5."""
    simulated = np.array([8.2, 7.1, 17.9, 16.3, 9.2])
    lateral = 1e-3 * np.array([0.329, 0.204, 0.588, 0.548, 0.478])
    tilt = -1e-3 * np.array([9.22, 8.93, 11.75, 12.78, 9.84])
    found = way_in(RCC, Starts(lateral, tilt))
    assert found.push == pytest.approx(simulated, rel=0.3)
    assert (MODEL_ERROR * found.push > simulated).all()
    assert (found.deflection < 1).all()
    assert (found.lag == 0).all()
    lateral, tilt = 1e-3 * np.array([0.41, 0.31, 0.74]), -1e-3 * np.array([18.4, 17.9, 25.6])
    stiffer = "admittance.spring=[3,3,3,1000,400,400]"
    damped = "admittance.damping=[4,4,4,1000,1000,1000]"
    own = cell("ur5e-fixture", "search.kind=none", stiffer, damped)
    found = way_in(own, Starts(lateral, tilt))
    assert found.lag == pytest.approx(np.array([0.74, 0.73, 1.63]), rel=0.25)
    assert (MODEL_ERROR * found.push > [5.97, 6.05, 12.8]).all()


def test_a_search_reaches_as_far_as_its_spiral_and_takes_its_time() -> None:
    searching = cell("ur5e-fixture", "search.kind=spiral", "search.radius=0.002")
    starts = Starts(np.array([0.001, 0.0033]), np.zeros(2))
    reach, pitch = search_links(searching, starts)
    assert reach.allowed == pytest.approx(0.002 + searching.parts.chamfer_limit)
    assert reach.margin < 0  # the next spiral is wider by a quarter
    assert attempts_of(searching, starts) == 2
    assert pitch.allowed == searching.parts.chamfer_limit
    step, speed = searching.search.pitch, searching.search.speed
    assert step is not None
    spiral = Spiral(speed=speed, pitch=step, radius=0.0033)
    assert search_time(searching, starts.lateral)[1] == pytest.approx(
        1.5 * spiral.duration, rel=0.1
    )
    assert not search_links(UR5E, starts)


def test_each_kind_of_cell_has_its_own_fields_to_change() -> None:
    asked = {path for path in FIELDS if has_field(UR5E, path)}
    assert {"admittance.spring", "compliance.centre_distance", "insert.speed"} <= asked
    assert not any(one.startswith(("impedance.", "compensator.", "cameras.")) for one in asked)
    given = make_scenario(DesignScenario(), settings=["cell=ur5e-fixture"])
    damping = FIELDS["admittance.damping"]  # derived in the scenario as it is given
    more = damping.set(given, 2 * damping.get(UR5E)).admittance.damping
    assert more == pytest.approx([2 * one for one in UR5E.admittance.damping or ()])
    assert CHOICES["search.kind"].others(UR5E) == ["spiral", "tilt"]
    assert FIELDS["search.radius"].get(UR5E) == 0  # there is none


def test_a_camera_in_the_hand_takes_off_what_the_decision_asks_for() -> None:
    hand = cell("ur5e-fixture", "cameras.kind=hand", "gap=0.03", "search.kind=none")
    blind, seen = drawn_touches(UR5E, 0, 80), drawn_touches(hand, 0, 80)
    most = (1 - hand.decide.margin) * hand.parts.chamfer_limit
    assert blind.lateral.max() > most
    # What is left of calibration, the unrest, and the feed along an axis that is off.
    assert seen.lateral.max() < most + 5 * 6e-5 + 5 * 1e-4 + hand.gap * np.abs(seen.tilt).max()
    assert (seen.time > blind.time).all()
    links = {link.name for link in assess(hand).links}
    assert {"detection", "repeatability", "chamfer"} <= links
    with pytest.raises(ParameterError, match="a pair is not predicted yet"):
        cell("ur5e-fixture", "cameras.kind=pair")
