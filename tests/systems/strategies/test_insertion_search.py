"""The search by touch in the insertion's chart, in a world of springs, friction and one hole."""

import math
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import pytest

from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.peg.support import Support
from chamfer.models.validation import ParameterError
from chamfer.systems.statechart.chart import Snapshot
from chamfer.systems.strategies.insertion_decision import DecisionParams, InsertionRegion
from chamfer.systems.strategies.insertion_law import (
    InsertionInputs,
    InsertionMemory,
    InsertionTaskParams,
    InsertionTrouble,
    ResolvedInsertParams,
    make_insertion_chart,
)
from chamfer.systems.strategies.insertion_search import STILL, SearchParams, TouchSearch

PERIOD, GAP, SPRING, FRICTION = 1 / 80, 0.01, 400.0, 0.3
PARTS = PegAndHole(peg_radius=0.004, hole_radius=0.00405, friction=FRICTION, chamfer_width=0.001)
CAPTURE = PARTS.chamfer_limit
OVER: dict[str, Any] = {"error": 0.003, "push": 8.0, "reach": 0.001, "attempts": 3}


@cache
def region() -> InsertionRegion:
    return InsertionRegion(PARTS, Support(centre_distance=0.006))


def task(**search: Any) -> InsertionTaskParams:
    params = SearchParams(**search).over(PARTS, **OVER)
    stiff: dict[str, float] = {"axial": SPRING, "stiffness": SPRING, "drag": FRICTION * 3.0}
    touch = None
    if params.kind != "none":
        touch = TouchSearch(params, **stiff, tip=PARTS.leading(params.angle), turn=0.05)
    return InsertionTaskParams(
        decide=DecisionParams(kind="at_once"),
        insert=ResolvedInsertParams(speed=0.02, depth=0.02, feed=0.06, rest=0.05),
        region=region(),
        chamfer_height=PARTS.chamfer_height,
        gap=GAP,
        begin=0.05,
        search=touch,
    )


@dataclass
class World:
    """A peg on springs; on the face it slides against friction, over the hole it goes in.

    A peg that leans has its rim lower, and ahead by the radius: in the mouth, that is at the wall.
    """

    hole: tuple[float, float]
    leads: float = 0.0  # m, of the face above where it is believed
    tip: tuple[float, float] = (0.0, 0.0)
    depth: float = -GAP
    edge: float = math.inf  # m, along y, beyond which there is no face, and nothing beside
    tilt: tuple[float, float] | None = None  # rad, near which alone it goes in further
    mouth: float = 0.002  # m, than that
    log: list[tuple[float, str, InsertionMemory, tuple[float, float]]] = field(
        default_factory=list
    )

    def read(self, now: float, memory: InsertionMemory) -> InsertionInputs:
        time = now - memory.time
        y, z, *lean = (
            was + rate * time for was, rate in zip(memory.offset, memory.offset_rate, strict=True)
        )
        lean = [round(angle, 9) for angle in lean]
        sticks = self.tilt is not None and math.dist(lean, self.tilt) > 0.012
        lean = lean if self.tilt is None else [0.0, 0.0]
        free = memory.feed + memory.rate * time - GAP
        ahead = PARTS.leading(math.hypot(*lean))
        face = -self.leads - ahead
        inside, beside = self._inside(lean), self.tip[0] > self.edge
        deepest = self.mouth if sticks and self.depth <= self.mouth else 0.03
        self.depth = min(free, face + deepest if (inside and ahead == 0) or beside else face)
        push = SPRING * (free - self.depth)
        away = y - self.tip[0], z - self.tip[1]
        drag, pull = FRICTION * max(push, 0.0) / SPRING, math.hypot(*away)
        if pull > drag:
            step = (pull - drag) / pull
            moved = self.tip[0] + step * away[0], self.tip[1] + step * away[1]
            self.tip = self._kept(moved, lean) if inside and self.depth >= face else moved
        if beside:
            self.tip = y, z
        load = push, SPRING * (y - self.tip[0]), SPRING * (z - self.tip[1])
        return InsertionInputs(
            error=(0.0,) * 6,
            valid=(1.0,),
            blind=(0.0,),
            diverged=(0.0,),
            compensation=(0.0,) * 6,
            force=(load[0] + 0.7, load[1] - 0.4, load[2] + 0.2),
            advance=(self.depth + 0.002,),
            peg_saturated=(0.0,) * 7,
            hole_saturated=None,
        )

    def _beyond(self, lean: list[float]) -> tuple[float, float]:
        """Return where the tip is from where its rim would be in the middle of the hole."""
        length = math.hypot(*lean)
        rim = (-lean[1], lean[0]) if length else (0.0, 0.0)
        y, z = (r / length * PARTS.peg_radius if length else 0.0 for r in rim)
        return self.tip[0] + y - self.hole[0], self.tip[1] + z - self.hole[1]

    def _inside(self, lean: list[float]) -> bool:
        within = PARTS.hole_radius + 1e-9 if any(lean) else CAPTURE
        return math.hypot(*self._beyond(lean)) <= within

    def _kept(self, moved: tuple[float, float], lean: list[float]) -> tuple[float, float]:
        """Return a place that the hole's wall keeps the peg at."""
        before, self.tip = self.tip, moved
        y, z = self._beyond(lean)
        most = PARTS.hole_radius if any(lean) else PARTS.clearance
        if (out := math.hypot(y, z)) > most:
            moved = moved[0] - (1 - most / out) * y, moved[1] - (1 - most / out) * z
        self.tip = before
        return moved


def run(params: InsertionTaskParams, world: World, *, longest: float = 60.0) -> list[str]:
    chart = make_insertion_chart(params)
    snapshot: Snapshot[InsertionMemory] = chart.start()
    path = [snapshot.state]
    for k in range(round(longest / PERIOD)):
        seen = world.read(k * PERIOD, snapshot.memory)
        snapshot, record = chart.step(snapshot, seen, k * PERIOD)
        world.log.append((k * PERIOD, snapshot.state, snapshot.memory, world.tip))
        if record is not None:
            path.append(record.target)
        if chart.state(snapshot.state).outcome is not None:
            break
    return path


BEGIN = ["approach", "align", "decide", "insert"]


@pytest.mark.parametrize("hole", [(0.0019, -0.0012), (-0.0005, 0.0027), (0.0011, 0.0)])
def test_a_peg_beside_its_hole_finds_it_on_a_spiral_with_the_press_kept(
    hole: tuple[float, float],
) -> None:
    world = World(hole)
    found = ["spiral", "insert", "check", "prove", "seated"]
    assert run(task(kind="spiral"), world) == [*BEGIN, *found]
    loads = [memory.sensed_force[0] for _, state, memory, _ in world.log if state == "spiral"]
    assert min(loads[:-8]) > 1.5
    assert max(loads) < 6.0
    assert math.dist(world.tip, hole) <= CAPTURE
    *_, last = (memory for _, state, memory, _ in world.log if state == "check")
    assert math.hypot(*last.sensed_force[1:]) < 0.6  # no load across is left
    seated = world.log[-1][2]  # nor of what proved that it is held
    pairs = zip(seated.offset_rate[:2], seated.sensed_force[1:], strict=True)
    assert all(rate * load < 0 for rate, load in pairs)
    took = sum(PERIOD for _, state, *_ in world.log if state == "spiral")
    spiral = task(kind="spiral").search.spiral(1)  # type: ignore[union-attr]
    assert took < spiral.duration


def test_the_face_is_where_it_was_touched() -> None:
    world = World((0.002, 0.0), leads=0.0008)
    assert run(task(kind="spiral"), world)[-1] == "seated"
    assert world.depth + world.leads == pytest.approx(0.02, abs=4e-4)


def test_what_is_not_found_is_given_up_after_wider_and_turned_spirals() -> None:
    world, params = World((0.02, 0.0)), task(kind="spiral", widen=0.25)
    path = run(params, world)
    again = ["spiral", "release", "back_off"]
    assert path == [*BEGIN, *again, *BEGIN[1:], *again, *BEGIN[1:], *again, "gave_up"]
    *_, (_, _, last, _) = world.log
    assert last.trouble is InsertionTrouble.NOT_FOUND
    assert last.offset == STILL
    reached = [
        max(math.hypot(*tip) for _, s, m, tip in world.log if s == "spiral" and m.attempts == k)
        for k in (1, 2, 3)
    ]
    assert reached == pytest.approx([0.003, 0.00375, 0.0045], rel=0.06)
    assert params.search is not None
    first, second = (params.search.on_spiral(k, 0.5) for k in (1, 2))
    turn = math.atan2(second[1], second[0]) - math.atan2(first[1], first[0])
    assert turn % (2 * math.pi) == pytest.approx(math.pi * (3 - math.sqrt(5)))


def test_the_command_goes_on_between_ticks_and_is_still_in_the_end() -> None:
    world = World((0.0019, -0.0012))
    run(task(kind="spiral"), world)
    for (_, _, a, _), (_, _, b, _) in zip(world.log, world.log[1:], strict=False):
        moved = [x + v * PERIOD for x, v in zip(a.offset, a.offset_rate, strict=True)]
        assert b.offset == pytest.approx(moved, abs=1e-12)
    fastest = max(math.hypot(*m.offset_rate[:2]) for _, s, m, _ in world.log if s == "spiral")
    assert fastest < 4 * 0.008  # with the lead


@pytest.mark.parametrize("hole", [(0.0, 0.0), (0.002, 0.0), (-0.0015, 0.001)])
def test_a_peg_that_leans_slides_to_the_wall_stands_up_and_goes_in(
    hole: tuple[float, float],
) -> None:
    world, params = World(hole), task(kind="tilt")
    if hole == (0.0, 0.0):
        world.tip = (-0.0015, 0.0)  # else it goes in at once
    path = run(params, world)
    if "lean" in path:
        found = ["lean", "slide", "stand", "insert", "check", "prove", "seated"]
        assert path == [*BEGIN, *found]
        leant = [m for _, s, m, _ in world.log if s == "slide"]
        assert math.hypot(*leant[1].offset[2:]) == pytest.approx(math.radians(10))
    assert path[-1] == "seated"
    assert math.dist(world.tip, hole) <= CAPTURE


def test_a_peg_that_sticks_in_the_mouth_is_turned_until_it_goes_in() -> None:
    tilt = (0.02, -0.025)
    world = World((0.0019, -0.0012), tilt=tilt)
    path = run(task(kind="spiral"), world)
    assert path == [*BEGIN, "spiral", "insert", "turn", "insert", "check", "prove", "seated"]
    assert math.dist(world.log[-1][2].offset[2:], tilt) < 0.012
    assert max(m.sensed_force[0] for _, s, m, _ in world.log if s == "turn") < 10.0


def test_a_peg_that_sticks_without_a_search_is_turned_too() -> None:
    world = World((0.0, 0.0), tilt=(0.02, -0.025), mouth=0.004)  # deeper than what a face can be
    path = run(task(kind="spiral"), world)
    assert path == [*BEGIN, "turn", "insert", "check", "prove", "seated"]


def test_a_peg_that_no_tilt_frees_is_said_to_be_jammed() -> None:
    world = World((0.0019, -0.0012), tilt=(1.0, 0.0))
    assert run(task(kind="spiral"), world)[-3:] == ["release", "back_off", "gave_up"]
    assert world.log[-1][2].trouble is InsertionTrouble.JAMMED
    assert world.log[-1][2].offset == STILL


@pytest.mark.parametrize("edge", [0.001, -0.001])
def test_a_peg_that_fell_beside_the_part_is_not_seated(edge: float) -> None:
    world = World((0.02, 0.02), edge=edge)  # beyond it from the begin, or once on the spiral
    path = run(task(kind="spiral"), world)
    assert "prove" in path
    assert path[-1] == "gave_up"
    assert world.log[-1][2].trouble is InsertionTrouble.BESIDE


def test_a_peg_that_leans_and_meets_no_wall_says_so() -> None:
    world = World((0.02, 0.02))
    path = run(task(kind="tilt"), world)
    assert path[4:8] == ["lean", "slide", "release", "back_off"]
    assert path[-1] == "gave_up"
    assert world.log[-1][2].trouble is InsertionTrouble.NOT_FOUND


def test_without_a_search_there_is_nothing_of_it_and_the_sensor_is_tared_in_free_space() -> None:
    params = task()
    names = make_insertion_chart(params).state_names
    assert not {"spiral", "lean", "slide", "stand"} & set(names)
    world = World((0.0, 0.0))
    run(params, world)
    assert {s for _, s, m, _ in world.log if m.tares} == {"approach", "align", "decide"}
    assert {m.offset for _, _, m, _ in world.log} == {STILL}
    assert {s for _, s, m, _ in world.log if not m.tares} == {"insert", "check", "seated"}


def test_what_is_open_follows_from_parts_and_error() -> None:
    spiral = SearchParams(kind="spiral").over(PARTS, **OVER)
    assert spiral.pitch == pytest.approx(0.001 + 0.00005)  # half of a capture of 2.1 mm
    assert spiral.radius == 0.003
    assert spiral.drop == pytest.approx(0.001 + 0.0005)
    tilt = SearchParams(kind="tilt").over(PARTS, **OVER)
    assert tilt.wall == pytest.approx(0.3 * 3.0 + 3.0)
    assert (tilt.back, tilt.radius, tilt.pitch) == (0.004, None, None)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"kind": "spin"}, r"kind is 'spin', allowed: none, spiral, tilt"),
        ({"press": 2.0}, r"search.press is 2.0, allowed: 3.0, search.kind is none"),
        ({"kind": "tilt", "pitch": 1e-3}, r"search.pitch is 0.001, .*search.kind is tilt"),
        ({"kind": "spiral", "press": 9.0}, r"search.press is 9.0, .*insert.push, 8 N"),
        ({"kind": "spiral", "pitch": 0.0022}, r"search.pitch is 0.0022, .*at most 0.0021 m"),
        ({"kind": "spiral", "radius": 0.008}, r"search.radius .*at most 0.007333 m: the face"),
        ({"kind": "tilt", "back": 0.02}, r"search.back .*at most 0.011 m: the face"),
        ({"kind": "tilt", "angle": 0.6}, r"angle is 0.6, allowed: 0 < angle < pi/6 rad"),
    ],
)
def test_a_search_without_sense_is_refused_in_a_line(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        SearchParams(**given).over(PARTS, **OVER)
