"""The insertion's chart: approach, align, decide, insert, seated; and what to do if it is not.

Source: Ruybal, Lumia and Wood, section 5, proposes to stop the compensation as soon as the errors
are inside the wedging limits and to insert then. States and rules around that are our own.
"""

import math
from collections.abc import Callable
from typing import Final

from chamfer.systems.contact.peg_hole_contact_monitor import SEATED
from chamfer.systems.statechart.chart import ANY, TIME_TOLERANCE, Chart, State, Tick, Transition
from chamfer.systems.strategies.insertion_memory import (
    InsertionInputs,
    InsertionMemory,
    InsertionTaskParams,
    Trouble,
    errors_across,
)

InsertionTick = Tick[InsertionInputs, InsertionMemory]
InsertionChart = Chart[InsertionInputs, InsertionMemory]
_Guard = Callable[[InsertionTick], bool]
_Action = Callable[[InsertionTick], InsertionMemory]

STOPPED: Final = ("blind", "overloaded", "saturated", "limit_reached", "diverging")

_SLIPS: Final = 0.001  # m, that a peg moves out by if nothing but the push holds it
_BEFORE: Final = -0.002  # m, of depth, above which the peg is at the mouth
_GATE: Final = -0.004  # m, of depth, from where on the lateral error decides whether it goes on


def make_insertion_chart(params: InsertionTaskParams) -> InsertionChart:
    """Return the chart; a peg that is not seated at last ends in a state that says why."""
    guards, actions = _Guards(params), _Actions(params)
    decide, insert = params.decide, params.insert

    def go(
        source: str, target: str, label: str, guard: _Guard, action: _Action | None = None
    ) -> Transition[InsertionInputs, InsertionMemory]:
        return Transition(source=source, target=target, label=label, guard=guard, action=action)

    begins = {
        "margin": f"errors inside, margin {decide.margin:g}",
        "wait": f"after {params.wait:g} s",
        "at_once": "at once",
    }[decide.kind]
    return Chart(
        "insertion",
        states=[
            State(name="approach", during=actions.look, note="on the way to the gap"),
            State(name="align", entry=actions.begin, during=actions.look, note="compensates"),
            State(name="decide", during=actions.look, note="compensates"),
            State(name="insert", during=actions.advance, note="feeds along the hole's axis"),
            State(name="check", during=actions.rest, note="at rest: how deep is it?"),
            State(name="release", during=actions.withdraw, note="takes the push away"),
            State(name="back_off", during=actions.withdraw, note="back to the gap"),
            State(name="seated", during=actions.rest, outcome="done"),
            *(
                State(name=name, during=actions.stop, outcome="failed")
                for name in ("gave_up", *STOPPED)
            ),
        ],
        transitions=[
            go(ANY, "blind", "the cameras see no parts", guards.blind),
            go(ANY, "overloaded", f"force above {insert.force_limit:g} N", guards.overloaded),
            go(ANY, "saturated", "a joint at its torque limit", guards.saturated),
            go(ANY, "diverging", "compensated, the error grows", guards.diverges),
            go("align", "limit_reached", "compensation at its limit", guards.at_limit),
            go("decide", "limit_reached", "compensation at its limit", guards.at_limit),
            go("insert", "limit_reached", "compensation at its limit", guards.at_limit),
            go("approach", "align", "there, cameras count", guards.is_there),
            go("align", "gave_up", "not aligned in time", guards.late, actions.late),
            go("align", "decide", "enough frames", guards.measured),
            go("decide", "insert", begins, guards.decided, actions.tare),
            go("decide", "gave_up", "not aligned in time", guards.late, actions.late),
            go("decide", "align", "a frame is missing", guards.unmeasured),
            go("insert", "check", "deep enough", guards.deep),
            go("insert", "check", "on the bottom", guards.on_bottom),
            go("insert", "back_off", "would miss the mouth", guards.beside, actions.miss),
            go("insert", "release", f"stuck, {insert.push:g} N", guards.stuck, actions.note_stop),
            go("insert", "check", "end of the feed", guards.fed),
            go("check", "seated", f"{100 * SEATED:g} % of the depth", guards.seated),
            go("check", "release", "not deep enough", guards.rested, actions.note_stop),
            go("release", "back_off", "push is gone", guards.released, actions.note_release),
            go("back_off", "gave_up", "can't be pulled out", guards.held, actions.hold),
            go("back_off", "gave_up", "last attempt", guards.last, actions.judge),
            go("back_off", "align", "back at the gap", guards.back, actions.judge),
        ],
        memory=InsertionMemory(),
    )


class _Guards:
    """When the chart goes on."""

    def __init__(self, params: InsertionTaskParams) -> None:
        self._params = params

    def blind(self, tick: InsertionTick) -> bool:
        return tick.inputs.blind[0] >= 0.5

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

    def unmeasured(self, tick: InsertionTick) -> bool:
        return not self.measured(tick)

    def decided(self, tick: InsertionTick) -> bool:
        params, decide = self._params, self._params.decide
        if self.unmeasured(tick):
            return False
        if decide.kind == "margin":
            window = tick.memory.window(tick.inputs, decide.frames)
            errors = errors_across(window, params.pixel_size)
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
        return _GATE <= tick.memory.depth(tick.inputs) < 0 and self.off_mouth(tick)

    def off_mouth(self, tick: InsertionTick) -> bool:
        """Whether the cameras say for sure that the tip is beside the mouth."""
        params = self._params
        window = tick.memory.window(tick.inputs, params.decide.frames)
        if not window:
            return False
        errors = errors_across(window, params.pixel_size)
        return errors.lateral - errors.lateral_uncertainty > params.region.lateral_limit

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
        return memory.feed == 0 and memory.depth(tick.inputs) <= 0 and self.rested(tick)

    def held(self, tick: InsertionTick) -> bool:
        pulls = -tick.memory.load(tick.inputs)[0] >= self._params.insert.pull
        return pulls and tick.memory.depth(tick.inputs) > 0

    def last(self, tick: InsertionTick) -> bool:
        return self.back(tick) and tick.memory.attempts >= self._params.insert.attempts


class _Actions:
    """What the chart does."""

    def __init__(self, params: InsertionTaskParams) -> None:
        self._params = params
        self._guards = _Guards(params)

    def _observe(self, tick: InsertionTick, rate: float) -> InsertionMemory:
        """Go on with the feed and remember what the sensors say."""
        memory, inputs, params = tick.memory, tick.inputs, self._params
        limited = any(inputs.peg_saturated) or any(inputs.hole_saturated or ())
        return memory._replace(
            feed=_fed(tick),
            rate=rate,
            time=tick.time,
            frames=memory.window(inputs, params.decide.frames),
            saturated_since=min(memory.saturated_since, tick.time) if limited else math.inf,
            sensed_force=memory.load(inputs),
            sensed_depth=memory.depth(inputs),
        )

    def look(self, tick: InsertionTick) -> InsertionMemory:
        memory = self._observe(tick, 0.0)
        if len(memory.frames) < self._params.decide.frames:
            return memory._replace(compensates=True, along=True)
        errors = errors_across(memory.frames, self._params.pixel_size)
        return memory._replace(compensates=True, along=True, errors=errors)

    def begin(self, tick: InsertionTick) -> InsertionMemory:
        return tick.memory._replace(frames=(), began=tick.time, errors=InsertionMemory().errors)

    def tare(self, tick: InsertionTick) -> InsertionMemory:
        """Take the force for zero and the gap for what the cameras say that it is."""
        memory, inputs, params = tick.memory, tick.inputs, self._params
        window = memory.window(inputs, params.decide.frames)
        along = math.fsum(error[0] for error in window) / len(window)
        return memory._replace(
            attempts=memory.attempts + 1,
            zero=inputs.force,
            mouth=inputs.advance[0] + params.gap + params.pixel_size * along,
            pull=0.0,
            came_out=0.0,
            errors=errors_across(window, params.pixel_size),
        )

    def advance(self, tick: InsertionTick) -> InsertionMemory:
        insert, memory = self._params.insert, tick.memory
        freeze = math.inf if insert.freeze_depth is None else insert.freeze_depth
        waits = tick.time_in_state < insert.pause - TIME_TOLERANCE
        return self._observe(tick, 0.0 if waits else self._params.insert.speed)._replace(
            compensates=(
                insert.compensation == "running"
                and memory.depth(tick.inputs) < freeze
                and math.hypot(*memory.load(tick.inputs)) < insert.hold_force
            ),
            along=False,
        )

    def rest(self, tick: InsertionTick) -> InsertionMemory:
        return self._observe(tick, 0.0)._replace(compensates=False)

    def withdraw(self, tick: InsertionTick) -> InsertionMemory:
        """Go back to where the feed began, and further as long as the hole holds the peg."""
        memory, insert, fed = tick.memory, self._params.insert, _fed(tick)
        speed = self._params.insert.speed
        pull = -memory.load(tick.inputs)[0]
        if memory.depth(tick.inputs) > 0:
            rate = -speed if pull < insert.pull else 0.0
        else:
            if fed * memory.feed <= 0:
                fed = 0.0
            rate = math.copysign(speed, -fed) if fed else 0.0
        return self._observe(tick, rate)._replace(
            feed=fed, compensates=False, pull=max(memory.pull, pull)
        )

    def stop(self, tick: InsertionTick) -> InsertionMemory:
        """Stop, but take a push or a pull away."""
        insert, load = self._params.insert, tick.memory.load(tick.inputs)[0]
        rate = (
            math.copysign(self._params.insert.speed, -load)
            if abs(load) > insert.hold_force
            else 0.0
        )
        return self._observe(tick, rate)._replace(compensates=False)

    def note_stop(self, tick: InsertionTick) -> InsertionMemory:
        stuck = tick.memory.load(tick.inputs)[0] >= self._params.insert.push
        trouble = Trouble.JAMMED if stuck else Trouble.SHORT
        if self._guards.off_mouth(tick):
            trouble = Trouble.BESIDE
        return tick.memory._replace(stopped=tick.memory.depth(tick.inputs), trouble=trouble)

    def note_release(self, tick: InsertionTick) -> InsertionMemory:
        came_out = tick.memory.stopped - tick.memory.depth(tick.inputs)
        return tick.memory._replace(came_out=came_out, pull=0.0)

    def miss(self, tick: InsertionTick) -> InsertionMemory:
        stopped = tick.memory.depth(tick.inputs)
        return tick.memory._replace(stopped=stopped, trouble=Trouble.BESIDE)

    def judge(self, tick: InsertionTick) -> InsertionMemory:
        """Say what held the peg, now that it is known how hard it came out."""
        memory, params = tick.memory, self._params
        trouble = memory.trouble
        if trouble is not Trouble.BESIDE:
            if memory.stopped < _BEFORE:
                trouble = Trouble.BEFORE_MOUTH
            elif memory.came_out < _SLIPS and memory.pull > params.insert.held_force:
                trouble = Trouble.WEDGED
            elif memory.stopped < params.chamfer_height + _SLIPS:
                trouble = Trouble.AT_MOUTH
        return memory._replace(trouble=trouble)

    def hold(self, tick: InsertionTick) -> InsertionMemory:
        return tick.memory._replace(trouble=Trouble.HELD)

    def late(self, tick: InsertionTick) -> InsertionMemory:
        return tick.memory._replace(trouble=Trouble.NOT_ALIGNED)


def _fed(tick: InsertionTick) -> float:
    """Return how far the feed is now, m."""
    return tick.memory.feed + tick.memory.rate * (tick.time - tick.memory.time)
