"""The strategies of the connectors and the peg, driven without Drake."""

import math
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.connectors.rj45_connector import Rj45Connector
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.systems.primitives.force_primitives import GuardedMove, Obstructed
from chamfer.systems.primitives.position_primitives import Way
from chamfer.systems.primitives.primitive import STILL, Primitive
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE, FAILED, RETRACT, Retry, Skill
from chamfer.systems.primitives.skill_law import targets
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.strategies.bnc_strategy import BncConnectorSkillParams
from chamfer.systems.strategies.d_strategy import DConnectorSkillParams
from chamfer.systems.strategies.face_and_search import TiltSearchParams
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams
from chamfer.systems.strategies.rj45_strategy import Rj45ConnectorSkillParams

D_PARAMS, BNC_PARAMS = DConnectorSkillParams(), BncConnectorSkillParams()
RJ45_PARAMS, PEG_PARAMS = Rj45ConnectorSkillParams(), PegInHoleSkillParams()
TILTING = PegInHoleSkillParams(search="tilt")
D, BNC, PEG, RJ45 = DConnector(), BncConnector(), RoundPeg(), Rj45Connector()
PERIOD: Final = 0.05  # s, that of the drives
# From "tare" on, where the plug is held.
TO_D_PUSH: Final = ("done", "done", "contact", "done", "done", "done", "lost", "done", "done")
TO_SEARCH: Final = ("done", "done", "contact", "done", "done", "done", "contact")


FACE = [
    *[("tare", "done"), ("beside", "done"), ("touch", "contact"), ("lie", "done")],
    *[("above", "done"), ("tare again", "done")],
]
GRASP = [
    *[("reach", "done"), ("close in", "done"), ("grasp", "done"), ("lift", "done")],
    ("transport", "done"),
]
D_WAY = [
    *[("search", "lost"), ("settle", "done"), ("feel", "done"), ("push", "done")],
    *[("lay", "done"), ("rest", "done"), ("verify", "hindered"), ("pull", "contact")],
]
BNC_WAY = [
    *[("enter", "lost"), ("to the studs", "contact"), ("at the studs", "done")],
    *[
        ("feel", "jammed"),
        ("upright", "done"),
        ("find slots", "lost"),
        ("compress", "done"),
        ("turn", "done"),
    ],
    *[("click", "done"), ("turns back", "contact"), ("depth", "done"), ("pull", "contact")],
]
RJ45_WAY = [
    *[("down", "contact"), ("search", "lost"), ("settle", "done"), ("push", "done")],
    *[("depth", "done"), ("pull", "contact"), ("rest", "done")],
]
PEG_WAY = [("down", "contact"), ("search", "lost"), ("insert", "done"), ("depth", "done")]
# What states tell: a velocity, and the damping of accommodation; None: not asked.
Told = tuple[tuple[float, ...] | None, tuple[float, ...] | None]
INF: Final = math.inf
TILTS = 2 * math.pi * D_PARAMS.settle_amplitude
D_TOLD: dict[str, Told] = {
    "lie": (None, (INF, 0.0, INF, INF, INF, 0.0)),
    "settle": ((TILTS, TILTS, 0, 0, 0, -D_PARAMS.maintained), None),
    "feel": ((0, 0, 0, 0, 0, -D_PARAMS.maintained), None),
    "push": ((0, 0, 0, 2 * math.pi * 6.25 * D_PARAMS.push_dither, 0, -Seat().speed), None),
    "pull": ((0, 0, 0, 0, 0, D_PARAMS.pull_speed), None),
}
SLOW, FAST = (
    2 * math.pi * share * BNC_PARAMS.search_frequency * BNC_PARAMS.search_amplitude
    for share in (1, 7 / 6)
)
BNC_TOLD: dict[str, Told] = {
    "tare": (STILL, (INF,) * 6),
    "touch": ((0, 0, 0, 0, 0, -BNC_PARAMS.approach_speed), (*[INF] * 5, 0.0)),
    "lie": ((0, 0, 0, 0, 0, -BNC_PARAMS.maintained), None),
    "enter": ((0, 0, 0, SLOW, FAST, -BNC_PARAMS.search_press), STILL),
    "to the studs": ((0, 0, 0, 0, 0, -BNC_PARAMS.approach_speed), None),
    "find slots": ((0, 0, 2 * math.pi * 0.05 * math.pi / 2, 0, 0, -BNC_PARAMS.maintained), None),
    "click": (STILL, None),
    "pull": ((0, 0, 0, 0, 0, BNC_PARAMS.pull_speed), None),
}
LAID_FLAT: dict[str, Told] = {"lie": (None, STILL), "down": (None, (INF, INF, INF, 0.0, 0.0, 0.0))}
PEG_TOLD = LAID_FLAT | {"search": (None, (INF, INF, INF, 1500.0, 1500.0, 0.0))}
TILT_WAY = [
    *[("lean", "done"), ("lower", "contact"), ("slide", "contact"), ("across", "done")],
    *[("stand", "done"), ("sink", "done"), ("insert", "done"), ("depth", "done")],
]


def primitive_of(skill: Skill, state: str, kind: type[Primitive]) -> Any:
    """The first primitive of a kind in a state."""
    return next(
        one
        for here in skill.states
        if here.name == state
        for one in here.run
        if isinstance(one, kind)
    )


@pytest.mark.parametrize(
    ("params", "part", "way", "give_up", "told", "longest"),
    [
        (D_PARAMS, D, D_WAY, "push", D_TOLD, 345.381),
        (BNC_PARAMS, BNC, BNC_WAY, "compress", BNC_TOLD, 433.199),
        (RJ45_PARAMS, RJ45, RJ45_WAY, "push", LAID_FLAT, 265.735),
        (PEG_PARAMS, PEG, PEG_WAY, "insert", PEG_TOLD, 239.394),
        (TILTING, PEG, TILT_WAY, "insert", {}, 215.241),
    ],
)
def test_a_strategy_takes_its_recorded_way_and_leaves_every_state(
    params: Any,
    part: Any,
    way: Any,
    give_up: str,
    told: dict[str, Told],
    longest: float,
    grasp_states: Any,
    make_drive: Any,
) -> None:
    skill = params.make_skill(part, period=PERIOD, before=grasp_states("tare"))
    drive = make_drive(skill)
    for state, outcome in (*GRASP, *FACE, *way):
        assert drive.state == state
        velocity, damping = told.get(state, (None, None))
        if velocity is not None:
            np.testing.assert_allclose(drive.memory.velocity, velocity, atol=1e-12)
        assert damping is None or drive.memory.damping == damping
        assert drive.memory.tares == (state in ("tare", "tare again"))
        drive.make(outcome)
    assert (drive.state, drive.memory.retries, drive.memory.reason) == (DONE, (), "")
    assert drive.memory.velocity == STILL
    # The chart refuses states that can't be reached or left; here, each is left by retracting too.
    chart = drive.chart
    retracting = {one.source for one in chart.transitions if one.target == RETRACT}
    assert retracting == set(chart.state_names) - {RETRACT, DONE, FAILED}
    for state in skill.states:
        assert 0 < state.timeout < math.inf
        if any(isinstance(one, Seat) for one in state.run):  # that a dither ends is no end of it
            dithers = [one.duration for one in state.run if isinstance(one, Dither)]
            assert min(dithers, default=math.inf) > state.timeout
        for answer in state.on.values():
            if isinstance(answer, Retry):
                assert answer.at_most <= params.retries or state.name == "grasp"
    assert sum(state.timeout for state in skill.states) == pytest.approx(longest, abs=1e-3)
    # What jams is tried again from out of the socket.
    answers = {state.name: state.on for state in skill.states}
    assert not {"out", "off"}.isdisjoint(targets(answers[give_up]["jammed"]))
    assert answers["out"] == {"done": "tare again"}


@pytest.mark.parametrize("turn", ["-rz", "+rz"])
def test_a_bayonet_that_is_not_locked_is_turned_back(turn: Any, make_drive: Any) -> None:
    params = BncConnectorSkillParams(turn=turn)
    drive = make_drive(params.make_skill(BNC, period=PERIOD))
    locks = BNC_PARAMS.turn_speed * (1 if turn == "+rz" else -1)
    for state, outcome in (*FACE, *BNC_WAY[:-1]):
        if state == "turn":
            assert drive.memory.velocity[:5] == (0, 0, locks, 0, 0)
        drive.make(outcome)
    assert [drive.make(outcome) for outcome in ("lost", "done")] == ["compress again", "turn back"]
    assert drive.memory.velocity[2] == -locks


def held_d(make_drive: Any, *outcomes: str, **changes: Any) -> Any:
    """Drive a plug that is held from the begin through outcomes."""
    params = DConnectorSkillParams(**changes)
    drive = make_drive(params.make_skill(D, period=PERIOD))
    for outcome in outcomes:
        drive.make(outcome)
    return drive


@pytest.mark.parametrize("retries", [1, 2])
def test_d_retries_are_those_of_the_parameters(retries: int, make_drive: Any) -> None:
    drive = held_d(make_drive, *TO_D_PUSH, retries=retries)
    assert drive.make("jammed") == "back off"
    np.testing.assert_allclose(way_of(drive)[5], D_PARAMS.back_off, atol=1e-12)
    wriggles = 2 * math.pi * D_PARAMS.search_amplitude / 4
    assert drive.memory.velocity == pytest.approx(
        (0, 0, 0, wriggles, wriggles, -D_PARAMS.maintained)
    )
    assert (drive.state, drive.make("done")) == ("free", "push")
    for _ in range(retries):
        assert drive.make("jammed") == "out"
        for outcome in ("done", "done", "lost", "done", "done"):
            drive.make(outcome)
    assert drive.make("jammed") == RETRACT
    assert drive.memory.reason == "push: jammed"
    assert drive.end() == FAILED


def test_d_what_is_tilted_is_straightened_before_it_is_pushed_again(make_drive: Any) -> None:
    drive = held_d(make_drive, *TO_D_PUSH)
    assert [drive.make(end) for end in ("tilted", "done", "done")] == [
        "loosen",
        "straighten",
        "push",
    ]
    assert drive.make("tilted") == "out"
    drive = held_d(make_drive, *TO_D_PUSH, retries=1)
    for outcome in ("tilted", "done", "done", "tilted", *TO_D_PUSH[4:]):
        drive.make(outcome)
    assert drive.make("tilted") == RETRACT
    assert drive.memory.reason.startswith("push: tilted")


def test_d_a_lost_face_is_found_again_once(make_drive: Any) -> None:
    drive = held_d(make_drive, *TO_D_PUSH[:3])
    begun = drive.memory.mark.carriage
    assert drive.make("lost") == "feel again"
    assert drive.memory.velocity[1] == pytest.approx(-0.55)  # turned back
    assert drive.make("done") == "touch"
    np.testing.assert_allclose(drive.carriage[3:], begun[3:], atol=1e-9)
    drive.make("contact")
    assert drive.make("lost") == RETRACT
    assert drive.memory.reason.startswith("lie: lost")


def test_d_depths_count_from_the_face_of_the_believed_connector() -> None:
    skill = D_PARAMS.make_skill(D)
    feel, rest = (primitive_of(skill, state, Way) for state in ("feel", "rest"))
    assert feel.least == pytest.approx(D.pin_depth - D_PARAMS.entry)
    assert rest.least == pytest.approx(D.mated_depth - D_PARAMS.short)
    rim = -(D.plug_section.height / 2 + D.lead_in)
    assert feel.beside == rest.beside == (0.0, rim)
    push = primitive_of(skill, "push", Seat)
    assert push.limit == pytest.approx(D_PARAMS.limit_share * D.mating_force)
    # Where it is hardest it is not seated yet.
    hardest = D.pin_depth + np.linspace(0, 1e-3, 101)
    assert push.distance > hardest[D.pin_force(hardest).argmax()] + 3e-4


def test_d_dithers_are_watched_over_whole_cycles() -> None:
    params = DConnectorSkillParams(search_frequency=0.8)
    skill = params.make_skill(D, period=0.005)
    for state, cycle in (("search", (1.25, 1.07)), ("verify", (1.43, 1.43))):
        assert primitive_of(skill, state, Obstructed).cycle == pytest.approx(cycle)
    assert primitive_of(skill, "verify", Obstructed).threshold == D_PARAMS.verify_threshold
    twist = [
        one
        for state in skill.states
        if state.name == "rotary search"
        for one in state.run
        if isinstance(one, Dither) and one.kind == "rotary"
    ]
    assert [(one.axis, one.amplitude, one.frequency) for one in twist] == [("z", 0.06, 0.12)]


def test_bnc_depths_count_from_the_face_of_the_believed_connector() -> None:
    skill = BNC_PARAMS.make_skill(BNC)
    rim = (0.0, -(BNC.bore_radius + BNC.lead_in))
    at, feel, depth = (
        primitive_of(skill, state, Way) for state in ("at the studs", "feel", "depth")
    )
    assert 2 * BNC_PARAMS.drop < at.least < BNC.setback
    assert BNC.setback < feel.least < BNC.setback + BNC_PARAMS.drop
    assert (depth.least + depth.most) / 2 == pytest.approx(BNC.mated_depth)
    assert at.beside == feel.beside == depth.beside == rim
    # What lies on the studs' lips has not clicked, whatever the fit.
    rise = BNC.turning_depth - BNC.mated_depth
    assert depth.most < BNC.turning_depth
    back = primitive_of(skill, "turns back", GuardedMove)
    assert back.direction == "+rz"
    assert back.limit < BNC_PARAMS.turn_distance
    again = primitive_of(skill, "compress again", Seat)
    assert 0 < again.distance < rise  # out of the detents
    compress = primitive_of(skill, "compress", Seat)
    assert BNC.mated_depth < compress.distance < BNC.turning_depth
    assert compress.limit == BNC_PARAMS.limit_share * BNC.mating_force


@pytest.mark.parametrize("search", ["dithers", "spiral"])
def test_peg_it_searches_about_the_middle(search: Any, make_drive: Any) -> None:
    params = PegInHoleSkillParams(search=search)
    drive = make_drive(params.make_skill(PEG))
    for outcome in TO_SEARCH:
        drive.make(outcome)
    way = np.zeros(6)
    furthest = 0.0
    while drive.state == "search":
        way = drive.way()
        furthest = max(furthest, math.hypot(*way[3:5]))
        drive.tick()
    assert drive.state == "out"
    reach = math.sqrt(2) * params.amplitude if search == "dithers" else params.spiral.radius
    assert furthest == pytest.approx(reach, rel=0.1)


def test_peg_depths_and_limit_are_those_of_the_peg_as_it_is_believed() -> None:
    params = PegInHoleSkillParams()
    skill = params.make_skill(RoundPeg(depth=0.012, seating_force=8.0))
    beside = (0.0, 0.0, 0.0, 0.0, params.beside, 0.0)
    assert primitive_of(skill, "beside", MoveDx).displacement == beside
    seat: Seat = primitive_of(skill, "insert", Seat)
    assert (seat.distance, seat.limit) == pytest.approx((0.012 - params.end, 10.0))
    assert seat.free == pytest.approx(params.free_share * 8.0)
    assert primitive_of(skill, "depth", Way).least == pytest.approx(0.012 - params.short)


def test_rj45_depths_and_forces_fit_the_plug_as_it_is_believed() -> None:
    weak = RJ45.with_mating_force(RJ45.mating_force / 2)
    skill = RJ45_PARAMS.make_skill(weak)
    seat: Seat = primitive_of(skill, "push", Seat)
    assert seat.distance == pytest.approx(RJ45.mated_depth - RJ45_PARAMS.end)
    assert seat.limit == pytest.approx(RJ45_PARAMS.limit_share * weak.mating_force)
    assert seat.free == pytest.approx(RJ45_PARAMS.free_share * weak.mating_force)
    depth: Way = primitive_of(skill, "depth", Way)
    # An obstacle half a millimetre short of the stop is not taken for it.
    assert RJ45.mated_depth - 0.0005 < depth.least < RJ45.mated_depth
    pull: GuardedMove = primitive_of(skill, "pull", GuardedMove)
    assert pull.threshold < weak.retention
    assert pull.limit > RJ45.latch_play


TO_LEAN: Final = ("done", "done", "contact", "done", "done", "done")


@pytest.fixture
def leaning_drive(make_drive: Any) -> Any:
    """A drive of a skill that leans, at the begin of the leaning."""
    leaning = make_drive(TILTING.make_skill(PEG))
    for outcome in TO_LEAN:
        leaning.make(outcome)
    assert leaning.state == "lean"
    return leaning


def way_of(drive: Any) -> np.ndarray:
    """Return what it commands until the state is left, rad above m."""
    way = np.zeros(6)
    state = drive.state
    while drive.state == state:
        drive.tick()
        way = drive.way() if drive.state == state else way
    return way


def test_tilt_it_leans_away_from_where_it_comes_from_at_the_same_height_and_stands_up_again(
    leaning_drive: Any,
) -> None:
    drive, tilt = leaning_drive, TiltSearchParams()
    angle, low = tilt.angle, PEG.peg_radius * math.sin(tilt.angle)
    way = way_of(drive)
    np.testing.assert_allclose(way, [angle, 0, 0, 0, tilt.back, low], rtol=0.05, atol=1e-9)
    # A turn by +angle about x lowers the rim on the side of -y, which is where it slides to.
    for outcome in ("contact", "contact", "done"):
        drive.make(outcome)
    assert drive.state == "stand"
    way = way_of(drive)
    np.testing.assert_allclose(way[:3], [-angle, 0, 0], rtol=0.05, atol=1e-9)
    assert way[4] < 0
    assert way[5] < 0


def test_tilt_its_point_is_in_the_hole_wherever_the_hole_may_be() -> None:
    # The lowest point of the rim, with the axis ``back`` off, and 2 mm more either way.
    tilt = TiltSearchParams()
    foremost = PEG.peg_radius * math.cos(tilt.angle) - tilt.back
    for x in (-0.002, 0.002):
        for y in (-0.002, 0.002):
            assert math.hypot(x, foremost + y) < PEG.hole_radius - PEG.lead_in
    # So deep that a round edge does not take it for the wall.
    assert PEG.peg_radius * math.sin(tilt.angle) > 2 * PEG.lead_in


def test_tilt_friction_is_not_taken_for_the_wall() -> None:
    # Pressed with D v on the face, at twice the friction of the parts.
    tilt, params = TiltSearchParams(), PegInHoleSkillParams()
    assert tilt.threshold > 2 * PEG.material.friction * 800.0 * params.maintained
