"""The insertion's chart: approach, align, decide, insert, seated; and the recovery from failures.

Source: Ruybal, Lumia and Wood, section 5, proposes to stop the compensation as soon as the errors
are inside the wedging limits and to insert then. States and rules around that are added.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Literal, NamedTuple, get_args

from chamfer.models.peg.peg_and_hole import SEATED
from chamfer.models.validation import (
    ParameterError,
    known,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.law import Signal
from chamfer.systems.statechart.chart import ANY, TIME_TOLERANCE, Chart, State, Tick, Transition
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput, number
from chamfer.systems.strategies.insertion_decision import (
    DecisionParams,
    InsertionRegion,
    MeasuredErrors,
    measured_errors,
)
from chamfer.systems.strategies.insertion_search import STILL, Offset, SearchMemory, TouchSearch

Compensation = Literal["running", "frozen"]
Vector3 = tuple[float, float, float]
Frame = tuple[float, ...]

_MOST_ATTEMPTS: Final = 100


class InsertionTrouble(IntEnum):
    """The cause that stopped an attempt, as far as the chart can tell."""

    NONE = 0
    WEDGED = 1  # in the bore, held when the push was taken away
    JAMMED = 2  # in the bore, held by the push alone
    AT_MOUTH = 3  # pushed as hard as it may, not beyond the chamfers
    BEFORE_MOUTH = 4  # it did not get to the mouth
    SHORT = 5  # the feed ended before the depth
    BESIDE = 6  # on its way to miss the mouth
    HELD = 7  # it can't be pulled out of the hole
    NOT_ALIGNED = 8  # the errors did not become small enough in time
    NOT_FOUND = 9  # searched for by touch, in vain


WORDS: Final = (  # of each trouble, in the order of the numbers
    "",
    "wedged",
    "jammed",
    "stuck at the mouth, the peg does not enter: too thick, or on an edge",
    "the arm did not get to the mouth",
    "not deep enough at the end of the feed",
    "on its way to miss the mouth",
    "held in the hole, could not be pulled out",
    "not aligned in time",
    "the search by contact did not find the hole",
)


@dataclass(frozen=True, kw_only=True)
class InsertParams:
    """How the peg is inserted, and the limits that end an attempt.

    Forces are those of the arm's own springs, by command and encoders, tared where the peg begins
    to advance; the joints' dry friction makes them uncertain by 1 N, in the worst of 50 runs by
    1.7 N.
    """

    compensation: Compensation = "running"
    # running: errors are compensated during the advance too; frozen: stopped before it, as section
    # 5 proposes
    freeze_depth: float | None = None
    # m, of the tip below the mouth, from which a running one is frozen; None: never
    pause: float = 0.0  # s, from the decision to the advance
    speed: float | None = None
    # m/s, of the feed; None: derived, 0.02, assumed, or slower as the clearance requires
    depth: float | None = None
    # m, commanded, of the tip below the mouth; None: derived, to where the bore ends
    feed: float | None = None  # m, most; None: derived, enough for the push at the mouth
    push: float = 8.0  # N, along the axis, at which the peg counts as stuck; assumed
    pull: float = 12.0  # N, along the axis, largest that pulls the peg out; assumed
    force_limit: float = 15.0  # N, in any direction, at which everything stops; assumed
    hold_force: float = 2.0  # N, in any direction, beyond which the compensation waits; assumed
    bottom_force: float = 2.0
    # N, along the axis, that detects the bottom of a blind hole; assumed
    held_force: float = 1.5  # N, of a pull, beyond the arms' own friction: wedged; assumed
    rest: float = 0.2  # s, before the place of the peg is judged; assumed
    attempts: int = 3  # before it gives up; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "compensation", get_args(Compensation))
        require_positive(self, "speed", "depth", "feed", "push", "pull", "force_limit")
        require_positive(self, "hold_force", "bottom_force", "held_force")
        require_not_negative(self, "rest", "pause")
        if self.freeze_depth is not None and not (
            self.compensation == "running" and math.isfinite(self.freeze_depth)
        ):
            allowed = "a finite number if insert.compensation is running, else null"
            raise ParameterError("freeze_depth", self.freeze_depth, allowed)
        for name in ("push", "pull"):
            if not (value := getattr(self, name)) < self.force_limit:
                allowed = f"less than force_limit, {self.force_limit:g} N"
                raise ParameterError(name, value, allowed)
        if not 1 <= self.attempts <= _MOST_ATTEMPTS:
            raise ParameterError("attempts", self.attempts, f"1 to {_MOST_ATTEMPTS}")


@dataclass(frozen=True, kw_only=True)
class ResolvedInsertParams(InsertParams):
    """The same parameters with nothing left open."""

    speed: float
    depth: float
    feed: float


@dataclass(frozen=True, kw_only=True)
class InsertionTaskParams:
    """Parameters of :class:`InsertionTask`."""

    decide: DecisionParams
    insert: ResolvedInsertParams
    region: InsertionRegion
    chamfer_height: float  # m, of both chamfers: above it the peg is at the mouth
    bottom: float = math.inf  # m, of a blind hole, below its mouth
    gap: float = 0.03  # m, from tip to mouth of the aligned peg
    pixel_size: float = 0.0005  # m
    sight: tuple[float, float] = (0.0, 0.0)  # m and rad, calibration error of every frame
    begin: float = 1.5  # s, from when the cameras count
    wait: float = 2.5  # s, of decide.kind wait; section 5
    limits: tuple[float, ...] = (math.inf,) * 6  # m and rad, of the compensation
    most_saturated: float = 0.5  # s, longest time of a joint at its torque limit; assumed
    period: float = 1 / 80  # s, section 4
    search: TouchSearch | None = None

    @property
    def target(self) -> float:
        """Reference depth of the tip, m."""
        return min(self.insert.depth, self.bottom)


class InsertionInputs(NamedTuple):
    """Inputs of the chart; a real cell measures each of them."""

    error: Frame  # pixels and rad, by the cameras
    valid: Frame
    blind: Frame
    diverged: Frame
    compensation: Frame  # m and rad, so far
    force: Vector3  # N, of the arm's springs along the hole's axes
    advance: Frame  # m, of the tip beyond the mouth, by the encoders
    peg_saturated: Frame  # of each joint
    hole_saturated: Frame | None  # None: the hole is no arm's


class InsertionMemory(NamedTuple):
    """The memory of the chart from tick to tick."""

    feed: float = 0.0  # m, at that time
    rate: float = 0.0  # m/s
    time: float = 0.0  # s
    compensates: bool = True
    tares: bool = True  # whether a sensor may be tared: it is in free space, at rest
    along: bool = True  # the error along the axis too
    attempts: int = 0
    frames: tuple[Frame, ...] = ()  # the last valid ones
    began: float = 0.0  # s, to align
    saturated_since: float = math.inf  # s
    zero: Vector3 = (0.0, 0.0, 0.0)  # N, tare
    mouth: float = 0.0  # m, advance by the encoders at which the tip is at the mouth
    stopped: float = 0.0  # m, depth at which the attempt stopped
    came_out: float = 0.0  # m, displacement when the push was removed
    pull: float = 0.0  # N, largest during the withdrawal
    trouble: InsertionTrouble = InsertionTrouble.NONE
    sensed_force: Vector3 = (0.0, 0.0, 0.0)  # N, tared, along the hole's axes
    sensed_depth: float = 0.0  # m, of the tip below the mouth
    errors: MeasuredErrors = MeasuredErrors(0.0, 0.0, 0.0, 0.0)
    offset: Offset = STILL  # at that time, of a search
    offset_rate: Offset = STILL
    search: SearchMemory = SearchMemory()

    def window(self, inputs: InsertionInputs, count: int) -> tuple[Frame, ...]:
        """Return the last valid frames with the present one, none if that is not valid."""
        if not inputs.valid[0] >= 0.5:
            return ()
        return (*self.frames, inputs.error)[-count:]

    def depth(self, inputs: InsertionInputs) -> float:
        """Return the depth of the tip below the mouth, m."""
        return inputs.advance[0] - self.mouth

    @property
    def searched(self) -> bool:
        """Whether the attempt has begun to search."""
        return self.search.began < math.inf

    def load(self, inputs: InsertionInputs) -> Vector3:
        """Return the push of the arm along the hole's axes, N, tared."""
        x, y, z = (force - zero for force, zero in zip(inputs.force, self.zero, strict=True))
        return x, y, z


def errors_across(frames: tuple[Frame, ...], pixel_size: float) -> MeasuredErrors:
    """Return the errors that matter for an insertion, over frames of six axes."""
    return measured_errors([(e[1], e[2], e[4], e[5]) for e in frames], pixel_size)


InsertionTick = Tick[InsertionInputs, InsertionMemory]
InsertionChart = Chart[InsertionInputs, InsertionMemory]
_Guard = Callable[[InsertionTick], bool]
_Action = Callable[[InsertionTick], InsertionMemory]

STOPPED: Final = ("blind", "overloaded", "saturated", "limit_reached", "diverging")

SEARCHES: Final = ("spiral", "lean", "slide", "stand")

_SLIPS: Final = 0.001  # m, that a peg moves out by if nothing but the push holds it
_BEFORE: Final = -0.002  # m, of depth, above which the peg is at the mouth
_NONE: Final = 1e-12  # m and rad, of an offset that is back
_THERE: Final = 1e-6  # m and rad, from an offset that is gone to
_CATCHES_UP: Final = 4.0  # times the search's speed, of an offset that is behind; assumed
_RESTS: Final = 3.0  # times the press, with which what is held is pushed; assumed
_FREED: Final = 0.0003  # m, that a peg goes in by as it is turned; assumed
_SETTLES: Final = 1.0  # s, in which a peg that was stood up goes in; assumed
_GATE: Final = -0.004  # m, of depth, from where on the lateral error decides whether it goes on


def make_insertion_chart(params: InsertionTaskParams) -> InsertionChart:
    """Return the chart; a peg that is not seated ends in a state that names the reason."""
    rules, decide, insert = _Rules(params), params.decide, params.insert

    def go(
        source: str, target: str, label: str, guard: _Guard, action: _Action | None = None
    ) -> Transition[InsertionInputs, InsertionMemory]:
        return Transition(source=source, target=target, label=label, guard=guard, action=action)

    begins = {
        "margin": f"errors inside, margin {decide.margin:g}",
        "wait": f"after {params.wait:g} s",
        "at_once": "at once",
    }[decide.kind]
    held, late = _blamed(InsertionTrouble.HELD), _blamed(InsertionTrouble.NOT_ALIGNED)
    not_aligned = "gave_up", "not aligned in time", rules.late, late
    at_limit = "limit_reached", "compensation at its limit", rules.at_limit
    searching, ways = _search_states(rules, go)
    proves = "seated" if params.search is None else "prove"
    return Chart(
        "insertion",
        states=[
            State(name="approach", during=rules.look, note="on the way to the gap"),
            State(name="align", entry=rules.begin, during=rules.look, note="compensates"),
            State(name="decide", during=rules.look, note="compensates"),
            State(name="insert", during=rules.advance, note="feeds along the hole's axis"),
            State(name="check", during=rules.rest, note="at rest: how deep is it?"),
            State(name="release", during=rules.withdraw, note="removes the push"),
            State(name="back_off", during=rules.withdraw, note="back to the gap"),
            State(name="seated", during=rules.rest, outcome="done"),
            *(
                State(name=name, during=rules.stop, outcome="failed")
                for name in ("gave_up", *STOPPED)
            ),
            *searching,
        ],
        transitions=[
            go(ANY, "blind", "the cameras see no parts", lambda tick: tick.inputs.blind[0] >= 0.5),
            go(ANY, "overloaded", f"force above {insert.force_limit:g} N", rules.overloaded),
            go(ANY, "saturated", "a joint at its torque limit", rules.saturated),
            go(ANY, "diverging", "compensated, the error grows", rules.diverges),
            *(go(source, *at_limit) for source in ("align", "decide", "insert")),
            go("approach", "align", "there, cameras count", rules.is_there),
            go("align", *not_aligned),
            go("align", "decide", "enough frames", rules.measured),
            go("decide", "insert", begins, rules.decided, rules.tare),
            go("decide", *not_aligned),
            go("decide", "align", "a frame is missing", lambda tick: not rules.measured(tick)),
            go("insert", "check", "deep enough", rules.deep),
            go("insert", "check", "on the bottom", rules.on_bottom),
            go("insert", "back_off", "would miss the mouth", rules.beside, rules.miss),
            *ways,
            go("insert", "release", f"stuck, {insert.push:g} N", rules.stuck, rules.note_stop),
            go("insert", "check", "end of the feed", rules.fed),
            go("check", proves, f"{100 * SEATED:g} % of the depth", rules.seated),
            go("check", "release", "not deep enough", rules.rested, rules.note_stop),
            go("release", "back_off", "push is gone", rules.released, rules.note_release),
            go("back_off", "gave_up", "can't be pulled out", rules.held, held),
            go("back_off", "gave_up", "last attempt", rules.last, rules.judge),
            go("back_off", "align", "back at the gap", rules.back, rules.judge),
        ],
        memory=InsertionMemory(),
    )


_Go = Callable[..., Transition[InsertionInputs, InsertionMemory]]
_Part = tuple[
    list[State[InsertionInputs, InsertionMemory]],
    list[Transition[InsertionInputs, InsertionMemory]],
]


def _search_states(rules: "_Rules", go: _Go) -> _Part:
    """Return the states of the search by contact, if any, and the transitions to and from them."""
    search = rules.search
    if search is None:
        return [], []
    params, lost = search.params, _blamed(InsertionTrouble.NOT_FOUND)
    note, beside = "tests the hold: pushes aside", _blamed(InsertionTrouble.BESIDE)
    states = [State(name="prove", during=rules.prove, note=note)]
    ways = [
        go("prove", "seated", "held on all sides", rules.proven),
        go("prove", "release", "not held aside", rules.slips, beside),
    ]
    if search.turns is not None:
        note = "turns about its tip, pushed on"
        states.append(State(name="turn", during=rules.turn, note=note))
        ways += [
            go("insert", "turn", "held, but not in", rules.sticks, rules.begin_turn),
            go("turn", "insert", f"{1e3 * _FREED:.1g} mm further in", rules.freed),
            go("turn", "release", "turned in vain", rules.turned, rules.note_jam),
        ]
    lies = f"on the face, {params.press:g} N", rules.lies, rules.begin_search
    dropped = "insert", f"{1e3 * search.drop:.2g} mm in", rules.dropped
    if search.leans:
        note = "leans over, off the face"
        return [
            *states,
            State(name="lean", during=rules.lean, note=note),
            State(name="slide", during=rules.slide, note="slides to the hole's wall"),
            State(name="stand", during=rules.stand, note="stands up, pressed to the wall"),
        ], [
            *ways,
            go("insert", "lean", *lies),
            go("lean", "slide", "leans", rules.leant),
            go("slide", "stand", f"wall, {search.wall:.2g} N", rules.at_wall),
            go("slide", "release", f"no wall in {1e3 * search.way:.2g} mm", rules.slid, lost),
            go("stand", *dropped),
            go("stand", "release", "stands, not in", rules.stood, lost),
        ]
    within = f"no hole within {1e3 * search.reaches:.2g} mm"
    note = "slides about, pressed on"
    return [*states, State(name="spiral", during=rules.spiral, note=note)], [
        *ways,
        go("insert", "spiral", *lies),
        go("insert", "spiral", "held, but not in", rules.rests),
        go("spiral", *dropped),
        go("spiral", "insert", f"held, {params.hold:g} N across", rules.caught),
        go("spiral", "release", within, rules.covered, lost),
    ]


def _blamed(trouble: InsertionTrouble) -> _Action:
    return lambda tick: tick.memory._replace(trouble=trouble)


class _Rules:
    """The guards and actions of the chart."""

    def __init__(self, params: InsertionTaskParams) -> None:
        self._params, self.search = params, params.search

    def _errors(self, frames: tuple[Frame, ...]) -> MeasuredErrors:
        """Return the errors over frames, with the uncertainty of scatter and calibration."""
        errors, (lateral, turn) = (
            errors_across(frames, self._params.pixel_size),
            self._params.sight,
        )
        return errors._replace(
            lateral_uncertainty=errors.lateral_uncertainty + lateral,
            rotational_uncertainty=errors.rotational_uncertainty + turn,
        )

    def overloaded(self, tick: InsertionTick) -> bool:
        load = math.hypot(*tick.memory.load(tick.inputs))
        return load > self._params.insert.force_limit

    def saturated(self, tick: InsertionTick) -> bool:
        since = tick.memory.saturated_since
        return tick.time - since > self._params.most_saturated - TIME_TOLERANCE

    def at_limit(self, tick: InsertionTick) -> bool:
        pairs = zip(tick.inputs.compensation, self._params.limits, strict=True)
        return any(abs(total) >= limit for total, limit in pairs)

    def diverges(self, tick: InsertionTick) -> bool:
        return tick.inputs.diverged[0] >= 0.5

    def is_there(self, tick: InsertionTick) -> bool:
        return tick.time >= self._params.begin - TIME_TOLERANCE

    def late(self, tick: InsertionTick) -> bool:
        return tick.time - tick.memory.began > self._params.decide.timeout

    def measured(self, tick: InsertionTick) -> bool:
        count = 1 if self._params.decide.kind == "at_once" else self._params.decide.frames
        return len(tick.memory.window(tick.inputs, count)) >= count

    def decided(self, tick: InsertionTick) -> bool:
        params, decide = self._params, self._params.decide
        if not self.measured(tick):
            return False
        if decide.kind == "margin":
            window = tick.memory.window(tick.inputs, decide.frames)
            errors = self._errors(window)
            return params.region.sure_margin(errors) >= decide.margin
        waited = tick.time - tick.memory.began >= params.wait - TIME_TOLERANCE
        return waited or decide.kind == "at_once"

    def deep(self, tick: InsertionTick) -> bool:
        return tick.memory.depth(tick.inputs) >= self._params.target

    def _seated(self, tick: InsertionTick) -> bool:
        return tick.memory.depth(tick.inputs) >= SEATED * self._params.target

    def on_bottom(self, tick: InsertionTick) -> bool:
        pushes = tick.memory.load(tick.inputs)[0] >= self._params.insert.bottom_force
        return pushes and math.isfinite(self._params.bottom) and self._seated(tick)

    def beside(self, tick: InsertionTick) -> bool:
        further = 0.0 if self.search is None else self.search.reaches
        at_gate = _GATE <= tick.memory.depth(tick.inputs) < 0 and not tick.memory.searched
        return at_gate and self.off_mouth(tick, further)

    def off_mouth(self, tick: InsertionTick, further: float = 0.0) -> bool:
        """Whether the cameras show for sure that the tip is off the mouth by more than that."""
        params = self._params
        window = tick.memory.window(tick.inputs, params.decide.frames)
        if not window:
            return False
        errors = self._errors(window)
        limit = params.region.lateral_limit + further
        return errors.lateral - errors.lateral_uncertainty > limit

    def stuck(self, tick: InsertionTick) -> bool:
        return tick.memory.load(tick.inputs)[0] >= self._params.insert.push

    def fed(self, tick: InsertionTick) -> bool:
        return _fed(tick) >= self._params.insert.feed - TIME_TOLERANCE

    def rested(self, tick: InsertionTick) -> bool:
        return tick.time_in_state >= self._params.insert.rest - TIME_TOLERANCE

    def seated(self, tick: InsertionTick) -> bool:
        return self.rested(tick) and self._seated(tick) and not self.off_mouth(tick)

    def released(self, tick: InsertionTick) -> bool:
        return tick.memory.load(tick.inputs)[0] <= 0 or _fed(tick) <= 0

    def back(self, tick: InsertionTick) -> bool:
        memory = tick.memory
        home = memory.feed == 0 and memory.offset == STILL
        return home and memory.depth(tick.inputs) <= 0 and self.rested(tick)

    def held(self, tick: InsertionTick) -> bool:
        pulls = -tick.memory.load(tick.inputs)[0] >= self._params.insert.pull
        return pulls and tick.memory.depth(tick.inputs) > 0

    def last(self, tick: InsertionTick) -> bool:
        return self.back(tick) and tick.memory.attempts >= self._params.insert.attempts

    def _observe(
        self, tick: InsertionTick, rate: float, offset_rate: Offset = STILL
    ) -> InsertionMemory:
        """Update feed and offset, and store the sensor values."""
        memory, inputs, params = tick.memory, tick.inputs, self._params
        limited = any(inputs.peg_saturated) or any(inputs.hole_saturated or ())
        return memory._replace(
            feed=_fed(tick),
            rate=rate,
            offset=_offset(tick),
            offset_rate=offset_rate,
            time=tick.time,
            frames=memory.window(inputs, params.decide.frames),
            saturated_since=min(memory.saturated_since, tick.time) if limited else math.inf,
            sensed_force=memory.load(inputs),
            sensed_depth=memory.depth(inputs),
        )

    def look(self, tick: InsertionTick) -> InsertionMemory:
        memory = self._observe(tick, 0.0)
        if len(memory.frames) < self._params.decide.frames:
            return memory._replace(compensates=True, along=True, tares=True)
        errors = self._errors(memory.frames)
        return memory._replace(compensates=True, along=True, tares=True, errors=errors)

    def begin(self, tick: InsertionTick) -> InsertionMemory:
        return tick.memory._replace(frames=(), began=tick.time, errors=InsertionMemory().errors)

    def tare(self, tick: InsertionTick) -> InsertionMemory:
        """Tare the force, and set the gap to the cameras' value."""
        memory, inputs, params = tick.memory, tick.inputs, self._params
        window = memory.window(inputs, params.decide.frames)
        along = math.fsum(error[0] for error in window) / len(window)
        return memory._replace(
            attempts=memory.attempts + 1,
            zero=inputs.force,
            tares=False,
            mouth=inputs.advance[0] + params.gap + params.pixel_size * along,
            pull=0.0,
            came_out=0.0,
            errors=self._errors(window),
            search=SearchMemory(),
        )

    def advance(self, tick: InsertionTick) -> InsertionMemory:
        insert, memory = self._params.insert, tick.memory
        freeze = math.inf if insert.freeze_depth is None else insert.freeze_depth
        waits = tick.time_in_state < insert.pause - TIME_TOLERANCE and not memory.searched
        rate, aside = 0.0 if waits else insert.speed, STILL
        if self.search is not None and memory.searched:
            load = memory.load(tick.inputs)
            aside = (*self.search.relax(load), 0.0, 0.0)
            if math.hypot(*load[1:]) > insert.hold_force:  # rubs: not yet pushed
                rate = self.search.press_rate(load[0], insert.speed)
        return self._observe(tick, rate, aside)._replace(
            compensates=(
                insert.compensation == "running"
                and not memory.searched
                and memory.depth(tick.inputs) < freeze
                and math.hypot(*memory.load(tick.inputs)) < insert.hold_force
            ),
            along=False,
        )

    def rest(self, tick: InsertionTick) -> InsertionMemory:
        aside = STILL
        if self.search is not None and tick.memory.search.held:  # pushed aside, and now let go
            aside = (*self.search.relax(tick.memory.load(tick.inputs)), 0.0, 0.0)
        return self._observe(tick, 0.0, aside)._replace(compensates=False)

    def withdraw(self, tick: InsertionTick) -> InsertionMemory:
        """Go back to the start of the feed, and further as long as the hole holds the peg."""
        memory, insert, fed = tick.memory, self._params.insert, _fed(tick)
        speed = self._params.insert.speed
        pull = -memory.load(tick.inputs)[0]
        if memory.depth(tick.inputs) > 0:
            rate = -speed if pull < insert.pull else 0.0
        else:
            if fed * memory.feed <= 0:
                fed = 0.0
            rate = math.copysign(speed, -fed) if fed else 0.0
        return self._observe(tick, rate, self._home(tick))._replace(
            feed=fed, compensates=False, pull=max(memory.pull, pull)
        )

    def _home(self, tick: InsertionTick) -> Offset:
        """Return the rates that undo an offset once the peg is off the face."""
        if tick.memory.depth(tick.inputs) > _BEFORE / 2:
            return STILL
        return self._towards(tick, STILL, self._params.insert.speed)

    def _towards(self, tick: InsertionTick, aim: Offset, fastest: float) -> Offset:
        """Return the rates to an offset, m/s and rad/s; all axes arrive together."""
        if self.search is None:
            return STILL
        period, params = self._params.period, self.search.params
        way = [goal - now for goal, now in zip(aim, _offset(tick), strict=True)]
        turning = params.angle / params.lean_time
        time = max(period, math.hypot(*way[:2]) / fastest, math.hypot(*way[2:]) / turning)
        y, z, about_y, about_z = (one / time for one in way)
        return y, z, about_y, about_z

    @property
    def _touch(self) -> TouchSearch:
        return known("search", self.search)

    def lies(self, tick: InsertionTick) -> bool:
        """Whether the peg lies on the face, or sits on the chamfers, before a search."""
        memory, params, reach = tick.memory, self._touch.params, self._touch.reach
        within = -reach <= memory.depth(tick.inputs) <= self._params.chamfer_height + reach
        return memory.load(tick.inputs)[0] >= params.press and within and not memory.searched

    def begin_search(self, tick: InsertionTick) -> InsertionMemory:
        """Store the place of the peg as that of the face."""
        memory = tick.memory
        mouth = memory.mouth + memory.depth(tick.inputs)
        return memory._replace(mouth=mouth, search=SearchMemory(began=tick.time))

    def spiral(self, tick: InsertionTick) -> InsertionMemory:
        """Go on along the spiral, ahead by as much as friction drags the peg back."""
        memory, search, period = tick.memory, self._touch, self._params.period
        spiral, time = search.spiral(memory.attempts), memory.search.spent
        turning = spiral.angle(time + period) - spiral.angle(time)
        lead = search.lead(memory.search.lead, memory.load(tick.inputs), period, turning)
        y, z = search.on_spiral(memory.attempts, time + period)
        aim = (y + lead[0], z + lead[1], 0.0, 0.0)
        rates = self._towards(tick, aim, _CATCHES_UP * search.params.speed)
        found = memory.search._replace(spent=time + period, lead=lead)
        return self._pressed(tick, rates)._replace(search=found)

    def _pressed(self, tick: InsertionTick, rates: Offset) -> InsertionMemory:
        """Move across with the press kept."""
        load = tick.memory.load(tick.inputs)[0]
        rate = self._touch.press_rate(load, self._params.insert.speed)
        return self._observe(tick, rate, rates)._replace(compensates=False)

    def dropped(self, tick: InsertionTick) -> bool:
        upright = tick.memory.offset[2:] == STILL[2:]
        return upright and tick.memory.depth(tick.inputs) >= self._touch.drop

    def caught(self, tick: InsertionTick) -> bool:
        return math.hypot(*tick.memory.load(tick.inputs)[1:]) >= self._touch.params.hold

    def covered(self, tick: InsertionTick) -> bool:
        lasts = self._touch.spiral(tick.memory.attempts).duration
        return tick.memory.search.spent >= lasts - TIME_TOLERANCE

    def rests(self, tick: InsertionTick) -> bool:
        """Whether a held peg goes in no further, and there is more to search."""
        searches = tick.memory.searched and not self.covered(tick)
        return searches and self._pushed(tick) and not self.dropped(tick)

    def _pushed(self, tick: InsertionTick) -> bool:
        most = min(_RESTS * self._touch.params.press, self._params.insert.push)
        return tick.memory.load(tick.inputs)[0] >= most

    def sticks(self, tick: InsertionTick) -> bool:
        """Whether a peg in the mouth goes in no further."""
        inside = self._params.chamfer_height / 2 + _FREED
        return self._pushed(tick) and tick.memory.depth(tick.inputs) >= inside

    def begin_turn(self, tick: InsertionTick) -> InsertionMemory:
        memory, (_, _, *about) = tick.memory, _offset(tick)
        stuck = memory.depth(tick.inputs)
        search = memory.search._replace(turned=0.0, stuck=stuck, about=(about[0], about[1]))
        return memory._replace(search=search)

    def turn(self, tick: InsertionTick) -> InsertionMemory:
        """Turn about the tip on a spiral of tilts, pushed on, with no load across.

        The skills straighten a plug by two dithers; a spiral begins at the present tilt.
        """
        memory, search, period = tick.memory, self._touch, self._params.period
        load, found = memory.load(tick.inputs), memory.search
        place = known("turns", search.turns).place(found.turned + period)
        tilt = (was + more for was, more in zip(found.about, place, strict=True))
        y, z = ((a - b) / period for a, b in zip(tilt, _offset(tick)[2:], strict=True))
        rate = search.press_rate(load[0], self._params.insert.speed, _RESTS)
        after = self._observe(tick, rate, (*search.relax(load), y, z))
        found = found._replace(turned=found.turned + period)
        return after._replace(compensates=False, search=found)

    def freed(self, tick: InsertionTick) -> bool:
        return tick.memory.depth(tick.inputs) >= tick.memory.search.stuck + _FREED

    def turned(self, tick: InsertionTick) -> bool:
        return tick.memory.search.turned >= known("turns", self._touch.turns).duration

    def note_jam(self, tick: InsertionTick) -> InsertionMemory:
        return self.note_stop(tick)._replace(trouble=InsertionTrouble.JAMMED)

    def prove(self, tick: InsertionTick) -> InsertionMemory:
        """Push the peg aside, one way after the other: only a hole holds it in each."""
        memory, found = tick.memory, tick.memory.search
        (y, z), held = self._touch.proof(found.held, memory.load(tick.inputs))
        slid = 0.0 if held else found.slid + self._params.period * math.hypot(y, z)
        found = found._replace(slid=slid, held=found.held + held)
        after = self._observe(tick, 0.0, (y, z, 0.0, 0.0))
        return after._replace(compensates=False, search=found)

    def proven(self, tick: InsertionTick) -> bool:
        return self._touch.proven(tick.memory.search.held)

    def slips(self, tick: InsertionTick) -> bool:
        return tick.memory.search.slid >= self._touch.aside

    def lean(self, tick: InsertionTick) -> InsertionMemory:
        """Lift the peg off the face, and lean it over as it goes back."""
        memory, search = tick.memory, self._touch
        aim = search.leaning(memory.attempts)
        time = search.params.lean_time
        lifts = tick.time - memory.search.began < time - TIME_TOLERANCE
        rates = self._towards(tick, aim, math.hypot(*aim[:2]) / time)
        return self._observe(tick, -search.lift / time if lifts else 0.0, rates)._replace(
            compensates=False
        )

    def leant(self, tick: InsertionTick) -> bool:
        leaning = self._touch.leaning(tick.memory.attempts)
        return math.dist(_offset(tick), leaning) < _THERE

    def slide(self, tick: InsertionTick) -> InsertionMemory:
        """Slide to the wall of the hole once it is pressed, the press kept."""
        memory, search = tick.memory, self._touch
        y, z = search.slide(memory.attempts, memory.load(tick.inputs))
        found = memory.search
        found = found._replace(slid=found.slid + self._params.period * math.hypot(y, z))
        return self._pressed(tick, (y, z, 0.0, 0.0))._replace(search=found)

    def at_wall(self, tick: InsertionTick) -> bool:
        load = tick.memory.load(tick.inputs)
        return self._touch.pushed(tick.memory.attempts, load) >= self._touch.wall

    def slid(self, tick: InsertionTick) -> bool:
        return tick.memory.search.slid >= self._touch.way

    def stand(self, tick: InsertionTick) -> InsertionMemory:
        """Stand up, pressed to the wall and down; then no more to the wall, where it rubs."""
        if _offset(tick)[2:] == STILL[2:]:
            y, z = self._touch.relax(tick.memory.load(tick.inputs))
            return self._pressed(tick, (y, z, 0.0, 0.0))
        y, z = self._touch.press_to_wall(tick.memory.attempts, tick.memory.load(tick.inputs))
        turning = self._towards(tick, (*_offset(tick)[:2], 0.0, 0.0), math.inf)[2:]
        return self._pressed(tick, (y, z, *turning))

    def stood(self, tick: InsertionTick) -> bool:
        upright = tick.memory.offset[2:] == STILL[2:]
        return upright and tick.time_in_state >= self._touch.params.lean_time + _SETTLES

    def stop(self, tick: InsertionTick) -> InsertionMemory:
        """Stop, but remove a push or a pull."""
        insert, load = self._params.insert, tick.memory.load(tick.inputs)[0]
        rate = (
            math.copysign(self._params.insert.speed, -load)
            if abs(load) > insert.hold_force
            else 0.0
        )
        return self._observe(tick, rate)._replace(compensates=False)

    def note_stop(self, tick: InsertionTick) -> InsertionMemory:
        stuck = tick.memory.load(tick.inputs)[0] >= self._params.insert.push
        trouble = InsertionTrouble.JAMMED if stuck else InsertionTrouble.SHORT
        if self.off_mouth(tick):
            trouble = InsertionTrouble.BESIDE
        return tick.memory._replace(stopped=tick.memory.depth(tick.inputs), trouble=trouble)

    def note_release(self, tick: InsertionTick) -> InsertionMemory:
        came_out = tick.memory.stopped - tick.memory.depth(tick.inputs)
        return tick.memory._replace(came_out=came_out, pull=0.0)

    def miss(self, tick: InsertionTick) -> InsertionMemory:
        stopped = tick.memory.depth(tick.inputs)
        return tick.memory._replace(stopped=stopped, trouble=InsertionTrouble.BESIDE)

    def judge(self, tick: InsertionTick) -> InsertionMemory:
        """Store the cause that held the peg, from the force of its withdrawal."""
        memory, params = tick.memory, self._params
        trouble = memory.trouble
        if trouble not in (InsertionTrouble.BESIDE, InsertionTrouble.NOT_FOUND):
            if memory.stopped < _BEFORE:
                trouble = InsertionTrouble.BEFORE_MOUTH
            elif memory.came_out < _SLIPS and memory.pull > params.insert.held_force:
                trouble = InsertionTrouble.WEDGED
            elif memory.stopped < params.chamfer_height + _SLIPS:
                trouble = InsertionTrouble.AT_MOUTH
        return memory._replace(trouble=trouble)


def _fed(tick: InsertionTick) -> float:
    """Return the feed at this time, m."""
    return tick.memory.feed + tick.memory.rate * (tick.time - tick.memory.time)


def _offset(tick: InsertionTick) -> Offset:
    """Return the offset at this time, m and rad."""
    memory, time = tick.memory, tick.time - tick.memory.time
    if memory.offset_rate == STILL:
        return memory.offset
    moved = (
        was + rate * time for was, rate in zip(memory.offset, memory.offset_rate, strict=True)
    )
    y, z, about_y, about_z = (0.0 if abs(one) < _NONE else one for one in moved)
    return y, z, about_y, about_z


class InsertionLaw(ChartLaw[InsertionInputs, InsertionMemory]):
    """The insertion's chart; its inputs and outputs are those of the block."""

    def __init__(self, params: InsertionTaskParams, *, peg_joints: int, hole_joints: int) -> None:
        super().__init__(
            make_insertion_chart(params),
            observation=InsertionInputs,
            inputs={
                "error": Signal(6, ("pixel",) * 3 + ("rad",) * 3),
                "valid": Signal(),
                "blind": Signal(),
                "diverged": Signal(),
                "compensation": Signal(6, ("m",) * 3 + ("rad",) * 3),
                "force": Signal(3, "N"),
                "advance": Signal(1, "m"),
                "peg_saturated": Signal(peg_joints),
                "hole_saturated": Signal(hole_joints, optional=True),
            },
            outputs={
                "feed": MachineOutput(
                    size=3,
                    unit=("m", "m/s", "s"),
                    read=lambda memory: (memory.feed, memory.rate, memory.time),
                ),
                "offset": MachineOutput(
                    size=8,
                    unit=("m", "m", "rad", "rad", "m/s", "m/s", "rad/s", "rad/s"),
                    read=lambda memory: (*memory.offset, *memory.offset_rate),
                ),
                "compensates": MachineOutput(
                    size=2,
                    read=lambda memory: (float(memory.compensates), float(memory.along)),
                ),
                "tares": number("tares"),
                "attempts": number("attempts"),
                "errors": MachineOutput(
                    size=4,
                    unit=("m", "rad", "m", "rad"),
                    read=lambda memory: tuple(memory.errors),
                ),
                "sensed_force": MachineOutput(
                    size=3, unit="N", read=lambda memory: memory.sensed_force
                ),
                "sensed_depth": number("sensed_depth", "m"),
                "trouble": number("trouble"),
            },
            period=params.period,
        )
