"""The chart of the charging cycle: the thesis' modes, nugget by nugget, and what stops them.

Source: Fig. 1-3 and sections 1.1.2 and 6.2 name the modes and their limits. The states within a
mode, the halt at any instant and the safe stop are our own. The command goes on from where it is
at each change of state; a halt keeps it on its path, at rest, and what was pressed on stays
pressed on.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

from chamfer.systems.charging.charging_guards import ChargingTick, Guard, Guards, Readings
from chamfer.systems.charging.charging_memory import (
    WORDS,
    ChargingInputs,
    ChargingMemory,
    Trouble,
)
from chamfer.systems.charging.charging_motions import Motions
from chamfer.systems.charging.charging_params import ChargingBeliefs, ChargingParams
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST
from chamfer.systems.statechart.chart import ANY, Chart, State, Transition
from chamfer.systems.trajectory.segment import Segment, hold

ChargingChart = Chart[ChargingInputs, ChargingMemory]
_Plan = Callable[[ChargingMemory, ChargingInputs], Segment]
_Step = Transition[ChargingInputs, ChargingMemory]

HALTED: Final = "halted"
BRAKE: Final = "back_off.brake"
AWAY: Final = "back_off.away"
DONE: Final = "done"
STOPPED: Final = "stopped"


class _Touch(NamedTuple):
    """What is done where something is met that is looked for, halted or not."""

    source: str
    target: str
    label: str
    guard: Guard
    plan: _Plan


# Of each state the hybrid controller's mode; halted has that of the state before.
MODE_OF: Final = {
    "home.out": APPROACH,
    "home.settle": APPROACH,
    "acquire.above": APPROACH,
    "acquire.zero": APPROACH,
    "acquire.descend": APPROACH,
    "acquire.touch": APPROACH,
    "acquire.grip": APPROACH,
    "acquire.lift": APPROACH,
    "acquire.weigh": APPROACH,
    "scan.run_in": APPROACH,
    "scan.pass": APPROACH,
    "slew.over": APPROACH,
    "wall.lower": APPROACH,
    "wall.zero": APPROACH,
    "wall.approach": APPROACH,
    "wall.seek": APPROACH,
    "wall.press": CONTACT,
    "wall.slide": CONTACT,
    "wall.land": CONTACT,
    "wall.lost": LOST,
    "wall.touch": CONTACT,
    "wall.set_down": CONTACT,
    "crown.lower": APPROACH,
    "crown.zero": APPROACH,
    "crown.descend": APPROACH,
    "crown.land": APPROACH,
    "crown.set_down": APPROACH,
    "bulk.lower": APPROACH,
    "bulk.pour": APPROACH,
    "release.open": APPROACH,
    "retreat.up": APPROACH,
    "return.over": APPROACH,
    BRAKE: APPROACH,
    AWAY: APPROACH,
    DONE: APPROACH,
    STOPPED: APPROACH,
}

_TARES: Final = ("acquire.zero", "acquire.weigh", "wall.zero", "crown.zero")
_OPENS: Final = ("release.open", "bulk.pour")

_NOTES: Final = {
    "home.out": "each joint passes its index mark",
    "acquire.zero": "tare, empty",
    "acquire.weigh": "tare, the weight goes",
    "wall.zero": "tare, as it is turned here",
    "crown.zero": "tare, as it is turned here",
    "scan.pass": "constant speed",
    "wall.press": "force on the wall, until it has settled",
    "wall.slide": "the same, down",
    "wall.land": "the same, slowly",
    "wall.lost": "creeps to the wall",
    "wall.set_down": "the same, at rest",
    HALTED: "on the path, at rest",
    BRAKE: "stops on the path",
    STOPPED: "safe, with a reason",
}


def tares(state: str) -> bool:
    """Return whether the force sensor's zero is taken in a state."""
    return state in _TARES


def make_charging_chart(params: ChargingParams, beliefs: ChargingBeliefs) -> ChargingChart:
    """Return the chart; a cycle that can't go on ends in ``stopped`` with a reason."""
    motions = Motions(params, beliefs)
    guards = Guards(params, motions)
    touches = (
        _Touch("acquire.descend", "acquire.touch", "touched", guards.on_below, motions.stay),
        _Touch("wall.approach", "wall.press", "wall", guards.at_wall, motions.stay),
        _Touch("wall.seek", "wall.press", "wall", guards.at_wall, motions.stay),
        _Touch("wall.slide", "wall.touch", "layer", guards.on_below, motions.stay),
        _Touch("wall.land", "wall.touch", "layer", guards.on_below, motions.stay),
        _Touch("crown.descend", "crown.set_down", "layer", guards.on_below, motions.stay),
        _Touch("crown.land", "crown.set_down", "layer", guards.on_below, motions.stay),
    )
    actions = _Actions(params, motions, touches)
    running = [name for name in MODE_OF if name not in (BRAKE, AWAY, DONE, STOPPED)]
    start = ChargingMemory(hold(beliefs.start, 0.0), "home.out", normal=motions.normal(0))

    def go(source: str, target: str, label: str, guard: Guard, plan: _Plan | None = None) -> _Step:
        action = actions.enter(target, plan)
        return Transition(source=source, target=target, label=label, guard=guard, action=action)

    def fail(source: str, label: str, guard: Guard, trouble: Trouble) -> _Step:
        action = actions.stop(trouble)
        return Transition(source=source, target=BRAKE, label=label, guard=guard, action=action)

    troubles = [
        fail(ANY, WORDS[trouble], guards.has(trouble), trouble)
        for trouble in (
            Trouble.SENSOR_DEAD,
            Trouble.TOO_MUCH_FORCE,
            Trouble.DROPPED,
            Trouble.OFF_PATH,
            Trouble.LATE,
        )
    ]
    resumed = [
        Transition(
            source=HALTED,
            target=name,
            label=f"go on with {name}",
            guard=guards.resumed(name),
            action=actions.resume,
            history=True,
        )
        for name in running
    ]
    arrived, rested, held = "there", f"after {params.rest:g} s", "held"
    return Chart(
        "charging",
        states=[
            State(
                name="home.out",
                entry=actions.begin,
                during=actions.sense,
                note=_NOTES["home.out"],
            ),
            *(
                State(name=name, during=actions.sense, note=_NOTES.get(name, ""))
                for name in (*running[1:], BRAKE, AWAY)
            ),
            State(name=HALTED, during=actions.wait, note=_NOTES[HALTED]),
            State(name=DONE, outcome="done"),
            State(name=STOPPED, outcome="failed", note=_NOTES[STOPPED]),
        ],
        transitions=[
            *troubles,
            Transition(
                source=ANY,
                target=HALTED,
                label="operator's halt",
                guard=guards.halted,
                action=actions.halt,
            ),
            *resumed,
            *(go(*touch) for touch in touches),
            go("home.out", "home.settle", arrived, guards.arrived, motions.stay),
            go("home.settle", "acquire.above", "homed", guards.homed, motions.above),
            fail("home.settle", "not homed", guards.never_homed, Trouble.NOT_HOMED),
            go("acquire.above", "acquire.zero", arrived, guards.arrived),
            go("acquire.zero", "acquire.descend", rested, guards.rested, motions.descend),
            fail("acquire.descend", "nothing there", guards.arrived, Trouble.NO_PART),
            go("acquire.touch", "acquire.grip", "at rest", guards.arrived),
            go("acquire.grip", "acquire.lift", held, guards.held, motions.lift),
            fail("acquire.grip", "not held", guards.not_held, Trouble.NO_PART),
            go("acquire.lift", "acquire.weigh", arrived, guards.arrived),
            go("acquire.weigh", "slew.over", "bulk", guards.weighed_bulk, motions.slew),
            go("acquire.weigh", "scan.run_in", rested, guards.rested, motions.run_in),
            go("scan.run_in", "scan.pass", arrived, guards.arrived, motions.scan),
            go("scan.pass", "slew.over", arrived, guards.arrived, motions.slew),
            *(
                go("slew.over", f"{kind}.lower", kind, guards.is_kind(kind), motions.lower)
                for kind in ("wall", "crown", "bulk")
            ),
            go("wall.lower", "wall.zero", arrived, guards.arrived),
            go("wall.zero", "wall.approach", rested, guards.rested, motions.approach),
            go("wall.approach", "wall.seek", arrived, guards.arrived, motions.seek_wall),
            fail("wall.seek", "no wall", guards.arrived, Trouble.NO_WALL),
            go("wall.press", "wall.slide", rested, guards.rested, motions.slide),
            go("wall.slide", "wall.lost", "wall lost", guards.off_wall),
            go("wall.slide", "wall.land", "near the layer", guards.arrived, motions.seek_layer),
            go("wall.land", "wall.lost", "wall lost", guards.off_wall),
            fail("wall.land", "no layer", guards.arrived, Trouble.NO_LAYER),
            fail("wall.lost", "lost too often", guards.lost_often, Trouble.LOST_OFTEN),
            *(
                go("wall.lost", name, f"wall, {name}", guards.back_to(name))
                for name in ("wall.slide", "wall.land")
            ),
            fail("wall.lost", "lost too long", guards.lost_for_long, Trouble.CONTACT_LOST),
            go("wall.touch", "wall.set_down", "at rest", guards.arrived, motions.stay),
            go("wall.set_down", "release.open", rested, guards.rested, motions.stay),
            go("crown.lower", "crown.zero", arrived, guards.arrived),
            go("crown.zero", "crown.descend", rested, guards.rested, motions.descend_to_layer),
            go("crown.descend", "crown.land", arrived, guards.arrived, motions.seek_layer),
            fail("crown.land", "no layer", guards.arrived, Trouble.NO_LAYER),
            go("crown.set_down", "release.open", rested, guards.rested),
            go("bulk.lower", "bulk.pour", arrived, guards.arrived),
            go("bulk.pour", "retreat.up", "empty", guards.not_held, motions.retreat),
            go("release.open", "retreat.up", "let go", guards.not_held, motions.retreat),
            go("retreat.up", "return.over", arrived, guards.arrived, motions.back),
            go("return.over", DONE, "last item", guards.last),
            go("return.over", "acquire.above", "next item", guards.arrived, motions.above),
            go(BRAKE, STOPPED, "at rest, not to be moved", guards.stays, motions.stay),
            go(BRAKE, AWAY, "at rest", guards.stands, motions.away),
            go(BRAKE, STOPPED, "timed out", guards.late, motions.stay),
            go(AWAY, BRAKE, "operator's halt", guards.stop_asked),
            go(AWAY, STOPPED, arrived, guards.arrived),
            go(AWAY, STOPPED, "timed out", guards.late, motions.stay),
        ],
        memory=start,
    )


class _Actions:
    """What the chart does."""

    def __init__(
        self, params: ChargingParams, motions: Motions, touches: tuple["_Touch", ...]
    ) -> None:
        self._motions = motions
        self._readings = Readings(params, motions)
        self._touches = touches
        self._sensitive = {touch.source for touch in touches}

    def begin(self, tick: ChargingTick) -> ChargingMemory:
        return tick.memory._replace(segment=self._motions.home(tick.memory, tick.inputs))

    def sense(self, tick: ChargingTick) -> ChargingMemory:
        return self._readings.count(tick)

    def wait(self, tick: ChargingTick) -> ChargingMemory:
        """Stand still; what is touched on the last way, or lost meanwhile, is not overlooked."""
        memory = tick.memory
        for touch in self._touches:
            if touch.source == memory.left and touch.guard(tick):
                tick.memory = self.enter(touch.target, touch.plan)(tick)
                return self.halt(tick)
        memory = self._readings.count(tick)
        if memory.mode == CONTACT and self._readings.off_wall(tick):
            return memory._replace(mode=LOST)
        if memory.mode == LOST and self._readings.at_wall(tick):
            return memory._replace(mode=CONTACT)
        return memory

    def enter(self, target: str, plan: _Plan | None) -> Callable[[ChargingTick], ChargingMemory]:
        """Return the action of a way into a state, with a new motion or without."""

        def entered(tick: ChargingTick) -> ChargingMemory:
            memory = tick.memory
            if target == "acquire.above" and memory.at == "return.over":
                item = memory.item + 1
                memory = memory._replace(item=item, losses=0, normal=self._motions.normal(item))
            if plan is not None:
                # With the mode before: what was under force control goes on where the arm is.
                memory = memory._replace(segment=plan(memory, tick.inputs))
            lost, opens = target == "wall.lost", target in _OPENS
            return memory._replace(
                at=target,
                mode=MODE_OF[target],
                hold=lost or target == BRAKE,
                lost_from=memory.at if lost else memory.lost_from,
                losses=memory.losses + lost,
                grip=not opens and (memory.grip or target == "acquire.grip"),
                carries=not opens and (memory.carries or target == "acquire.lift"),
            )

        return entered

    def halt(self, tick: ChargingTick) -> ChargingMemory:
        return tick.memory._replace(at=HALTED, left=tick.memory.at, hold=True)

    def resume(self, tick: ChargingTick) -> ChargingMemory:
        memory = tick.memory
        state = memory.left
        return memory._replace(at=state, left="", mode=MODE_OF[state], hold=state == "wall.lost")

    def stop(self, trouble: Trouble) -> Callable[[ChargingTick], ChargingMemory]:
        """Return the action of a failure.

        The command stops on its path, or at once where something may be near; what was under
        force control stays where it is.
        """

        def stopped(tick: ChargingTick) -> ChargingMemory:
            memory = tick.memory
            at = memory.left or memory.at
            quick = memory.mode != APPROACH or at in self._sensitive
            if quick:
                memory = memory._replace(segment=self._motions.stay(memory, tick.inputs))
            return memory._replace(
                at=BRAKE,
                left="",
                mode=MODE_OF[BRAKE],
                hold=not quick,
                trouble=trouble,
                trouble_at=at,
            )

        return stopped
