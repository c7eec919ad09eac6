"""The charging cycle as a law: the thesis' modes for each nugget, and the faults that stop them.

Source: Fig. 1-3 and sections 1.1.2 and 6.2 name the modes and their limits. The states within a
mode, the halt at any instant and the safe stop are this project's. At each change of state the
command continues from its present value. A halt keeps it at rest on its path, and keeps the force.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np

from chamfer.systems.charging.charging_motions import ChargingMotions, Motion
from chamfer.systems.charging.charging_params import (
    LEVEL,
    ON_BOTH,
    ON_LAYER,
    ChargingBeliefs,
    ChargingInputs,
    ChargingMemory,
    ChargingTrouble,
    ResolvedChargingParams,
)
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
from chamfer.systems.force.projection import position_selection
from chamfer.systems.law import Signal
from chamfer.systems.statechart.chart import ANY, TIME_TOLERANCE, Chart, State, Tick, Transition
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput, number
from chamfer.systems.trajectory.segment import (
    COORDINATES,
    POSITION,
    SEGMENT,
    SIZE,
    VELOCITY,
    Vector3,
    hold,
)

ChargingTick = Tick[ChargingInputs, ChargingMemory]
Guard = Callable[[ChargingTick], bool]

_ARRIVED: Final = 1 - 1e-9  # of the progress
_HOMING: Final = 2.0  # s, in which the encoders' zeros settle behind the last mark
_AT_REST: Final = 1e-9  # m/s and rad/s, of the command
_SWINGING: Final = 0.1  # s, for which a nugget swings on in the gripper
_MORE: Final = 2.0  # by which what the nugget's inertia shows at most is exceeded


class _Guards:
    """The guards of the chart at a tick.

    Troubles are counted, and the mean of the last readings shows contact, so that noise alone
    decides nothing.
    """

    def __init__(self, params: ResolvedChargingParams, motions: ChargingMotions) -> None:
        self._params, self._motions = params, motions
        self._detect, self._release = params.detection.detect, params.detection.release
        self._speeding_up = params.seek_speed / params.acceleration + _SWINGING

    def count(self, tick: ChargingTick) -> ChargingMemory:
        memory, inputs, params = tick.memory, tick.inputs, self._params
        acquires = (memory.left or memory.at).startswith("acquire")
        limit = params.grip_limit if acquires else params.force_limit
        alive = inputs.alive is None or inputs.alive[0] > 0.5
        gone = memory.carries and not inputs.held[0] > 0.5
        off = self._off(memory, inputs) > params.position_limit
        return memory._replace(
            above_limit=_next(memory.above_limit, math.hypot(*inputs.measured_force) > limit),
            dead=not alive,
            dropped=_next(memory.dropped, gone),
            off_path=_next(memory.off_path, off),
        )

    def at_wall(self, tick: ChargingTick) -> bool:
        least = self._detect
        if not tick.memory.mode and tick.time_in_state < self._speeding_up:
            # Meanwhile the sensor feels the nugget's inertia.
            least += _MORE * self._params.acceleration * self._motions.mass(tick.memory.item)
        return self._push(tick) > least

    def off_wall(self, tick: ChargingTick) -> bool:
        return self._push(tick) <= self._release

    def on_below(self, tick: ChargingTick) -> bool:
        down = -tick.inputs.mean_force[2]
        if not tick.memory.carries:
            return down > self._params.touch_force
        # Sliding down, the wall holds the nugget up.
        friction = self._params.wall_friction * max(self._push(tick), 0.0)
        return down - friction > max(self._params.layer_touch, self._detect)

    def on_nugget(self, tick: ChargingTick) -> bool:
        return self._motions.followed(tick.memory.item) is not None and self.on_below(tick)

    def _push(self, tick: ChargingTick) -> float:
        x, y, _ = tick.inputs.mean_force
        return x * tick.memory.normal[0] + y * tick.memory.normal[1]

    def _off(self, memory: ChargingMemory, inputs: ChargingInputs) -> float:
        """Return how far the arm is from its command, m, outside of the force domain."""
        pairs = zip(inputs.endpoint_motion[:3], inputs.desired_position[:3], strict=True)
        error = [arm - command for arm, command in pairs]
        for normal in memory.pressed:
            along = sum(n * e for n, e in zip(normal, error, strict=True))
            error = [e - along * n for n, e in zip(normal, error, strict=True)]
        return math.hypot(*error)

    def arrived(self, tick: ChargingTick) -> bool:
        """Whether the goal of the present segment is reached, not that of the one before."""
        late = tick.time_in_state >= 1.5 * self._params.period
        return late and tick.inputs.progress[0] >= _ARRIVED

    def stands(self, tick: ChargingTick) -> bool:
        return all(abs(one) < _AT_REST for one in tick.inputs.desired_velocity)

    def stays(self, tick: ChargingTick) -> bool:
        """Whether the arm must stay: halted by the operator, or with an unexplained error.

        After a dead sensor or too much force the arm backs off.
        """
        unsure = tick.memory.trouble in (ChargingTrouble.OFF_PATH, ChargingTrouble.LATE)
        return (unsure or self.stop_asked(tick)) and self.stands(tick)

    def rested(self, tick: ChargingTick) -> bool:
        return tick.time_in_state >= self._params.rest - TIME_TOLERANCE

    def late(self, tick: ChargingTick) -> bool:
        return tick.time_in_state > self._params.patience

    def homed(self, tick: ChargingTick) -> bool:
        return tick.inputs.homed is None or tick.inputs.homed[0] > 0.5

    def never_homed(self, tick: ChargingTick) -> bool:
        return tick.time_in_state >= _HOMING and not self.homed(tick)

    def held(self, tick: ChargingTick) -> bool:
        return self.rested(tick) and tick.inputs.held[0] > 0.5

    def not_held(self, tick: ChargingTick) -> bool:
        return self.rested(tick) and not tick.inputs.held[0] > 0.5

    def is_kind(self, kind: str) -> Guard:
        return lambda tick: self.arrived(tick) and self._motions.kind(tick.memory.item) == kind

    def weighed_bulk(self, tick: ChargingTick) -> bool:
        """Whether the bulk filler, which is not scanned, is picked up."""
        return self.rested(tick) and self._motions.kind(tick.memory.item) == "bulk"

    def last(self, tick: ChargingTick) -> bool:
        return self.arrived(tick) and tick.memory.item + 1 >= self._motions.items

    def back_to(self, state: str) -> Guard:
        return lambda tick: tick.memory.lost_from == state and self.at_wall(tick)

    def lost_for_long(self, tick: ChargingTick) -> bool:
        return tick.time_in_state >= self._params.most_lost - TIME_TOLERANCE

    def lost_often(self, tick: ChargingTick) -> bool:
        return tick.memory.losses > self._params.most_losses

    def stop_asked(self, tick: ChargingTick) -> bool:
        return tick.inputs.halt is not None and tick.inputs.halt[0] > 0.5

    def halted(self, tick: ChargingTick) -> bool:
        """Whether the cycle must halt; a cycle that a failure stopped stays stopped."""
        return self.stop_asked(tick) and not tick.memory.trouble

    def resumed(self, state: str) -> Guard:
        return lambda tick: tick.memory.left == state and not self.stop_asked(tick)

    def trouble(self, tick: ChargingTick) -> ChargingTrouble:
        """Return a trouble that can occur in any state; NONE once the cycle is stopping."""
        memory = tick.memory
        if memory.trouble:
            return ChargingTrouble.NONE
        if memory.dead:
            return ChargingTrouble.SENSOR_DEAD
        for trouble, count in (
            (ChargingTrouble.TOO_MUCH_FORCE, memory.above_limit),
            (ChargingTrouble.DROPPED, memory.dropped),
            (ChargingTrouble.OFF_PATH, memory.off_path),
        ):
            if count >= self._params.trouble_readings:
                return trouble
        if not memory.left and self.late(tick):
            return ChargingTrouble.LATE
        return ChargingTrouble.NONE

    def has(self, trouble: ChargingTrouble) -> Guard:
        return lambda tick: self.trouble(tick) is trouble


def _next(count: int, again: bool) -> int:
    return count + 1 if again else 0


ChargingChart = Chart[ChargingInputs, ChargingMemory]
_Step = Transition[ChargingInputs, ChargingMemory]

HALTED: Final = "halted"
BRAKE: Final = "back_off.brake"
AWAY: Final = "back_off.away"
DONE: Final = "done"
STOPPED: Final = "stopped"


# What is done where something is met that is looked for: source, target, label and guard.
_Touch = tuple[str, str, str, Guard, Motion]

# Of each state the hybrid controller's mode; halted has that of the state before.
MODE_OF: Final = dict.fromkeys(
    (
        *("home.out", "home.settle"),
        *("acquire.above", "acquire.zero", "acquire.descend", "acquire.touch"),
        *("acquire.grip", "acquire.lift", "acquire.weigh"),
        *("scan.run_in", "scan.pass", "slew.over"),
        *("wall.lower", "wall.zero", "wall.approach", "wall.seek", "wall.press", "wall.slide"),
        *("wall.land", "wall.lost", "wall.follow", "wall.set_down"),
        *("crown.lower", "crown.zero", "crown.descend", "crown.land", "crown.follow"),
        "crown.set_down",
        *("bulk.lower", "bulk.pour", "release.open", "retreat.up", "return.over"),
        *(BRAKE, AWAY, DONE, STOPPED),
    ),
    APPROACH,
) | {
    "wall.press": CONTACT,
    "wall.slide": CONTACT,
    "wall.land": CONTACT,
    "wall.lost": LOST,
    "wall.follow": ON_BOTH,
    "wall.set_down": ON_BOTH,
    "crown.follow": ON_LAYER,
    "crown.set_down": ON_LAYER,
}

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
    "wall.follow": "force on wall and nugget, along both to the place",
    "wall.set_down": "force on wall and layer",
    "crown.follow": "force on the nugget below, along it to the place",
    "crown.set_down": "force on the layer",
    HALTED: "on the path, at rest",
    BRAKE: "stops on the path",
    STOPPED: "safe, with a reason",
}


def tares(state: str) -> bool:
    """Return whether the force sensor's zero is taken in a state."""
    return state in ("acquire.zero", "acquire.weigh", "wall.zero", "crown.zero")


def make_charging_chart(params: ResolvedChargingParams, beliefs: ChargingBeliefs) -> ChargingChart:
    """Return the chart; a cycle that can't continue ends in ``stopped`` with a reason."""
    motions = ChargingMotions(params, beliefs)
    guards = _Guards(params, motions)
    below: tuple[tuple[str, str, Guard, Motion], ...] = (
        ("follow", "nugget", guards.on_nugget, "follow"),
        ("set_down", "layer", guards.on_below, "stay"),
    )
    touches: tuple[_Touch, ...] = (
        ("acquire.descend", "acquire.touch", "touched", guards.on_below, "stay"),
        ("wall.approach", "wall.press", "wall", guards.at_wall, "stay"),
        ("wall.seek", "wall.press", "wall", guards.at_wall, "stay"),
        *(
            (source, f"{source.partition('.')[0]}.{target}", label, guard, motion)
            for source in ("wall.slide", "wall.land", "crown.descend", "crown.land")
            for target, label, guard, motion in below
        ),
    )
    actions = _Actions(guards, motions, touches)
    running = [name for name in MODE_OF if name not in (BRAKE, AWAY, DONE, STOPPED)]
    start = ChargingMemory(hold(beliefs.start, 0.0), "home.out", normal=motions.normal(0))

    def go(
        source: str, target: str, label: str, guard: Guard, motion: Motion | None = None
    ) -> _Step:
        action = actions.enter(target, motion)
        return Transition(source=source, target=target, label=label, guard=guard, action=action)

    def fail(source: str, label: str, guard: Guard, trouble: ChargingTrouble) -> _Step:
        action = actions.stop(trouble)
        return Transition(source=source, target=BRAKE, label=label, guard=guard, action=action)

    troubles = [
        fail(ANY, trouble.words, guards.has(trouble), trouble)
        for trouble in (
            ChargingTrouble.SENSOR_DEAD,
            ChargingTrouble.TOO_MUCH_FORCE,
            ChargingTrouble.DROPPED,
            ChargingTrouble.OFF_PATH,
            ChargingTrouble.LATE,
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
            *(
                State(
                    name=name,
                    entry=actions.begin if name == "home.out" else None,
                    during=actions.sense,
                    note=_NOTES.get(name, ""),
                )
                for name in (*running, BRAKE, AWAY)
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
            go("home.out", "home.settle", arrived, guards.arrived, "stay"),
            go("home.settle", "acquire.above", "homed", guards.homed, "above"),
            fail("home.settle", "not homed", guards.never_homed, ChargingTrouble.NOT_HOMED),
            go("acquire.above", "acquire.zero", arrived, guards.arrived),
            go("acquire.zero", "acquire.descend", rested, guards.rested, "descend"),
            fail("acquire.descend", "nothing there", guards.arrived, ChargingTrouble.NO_PART),
            go("acquire.touch", "acquire.grip", "at rest", guards.arrived),
            go("acquire.grip", "acquire.lift", held, guards.held, "lift"),
            fail("acquire.grip", "not held", guards.not_held, ChargingTrouble.NO_PART),
            go("acquire.lift", "acquire.weigh", arrived, guards.arrived),
            go("acquire.weigh", "slew.over", "bulk", guards.weighed_bulk, "slew"),
            go("acquire.weigh", "scan.run_in", rested, guards.rested, "run_in"),
            go("scan.run_in", "scan.pass", arrived, guards.arrived, "scan"),
            go("scan.pass", "slew.over", arrived, guards.arrived, "slew"),
            *(
                go("slew.over", f"{kind}.lower", kind, guards.is_kind(kind), "lower")
                for kind in ("wall", "crown", "bulk")
            ),
            go("wall.lower", "wall.zero", arrived, guards.arrived),
            go("wall.zero", "wall.approach", rested, guards.rested, "approach"),
            go("wall.approach", "wall.seek", arrived, guards.arrived, "seek_wall"),
            fail("wall.seek", "no wall", guards.arrived, ChargingTrouble.NO_WALL),
            go("wall.press", "wall.slide", rested, guards.rested, "slide"),
            go("wall.slide", "wall.lost", "wall lost", guards.off_wall),
            go("wall.slide", "wall.land", "near the layer", guards.arrived, "seek_layer"),
            go("wall.land", "wall.lost", "wall lost", guards.off_wall),
            fail("wall.land", "no layer", guards.arrived, ChargingTrouble.NO_LAYER),
            fail("wall.lost", "lost too often", guards.lost_often, ChargingTrouble.LOST_OFTEN),
            *(
                go("wall.lost", name, f"wall, {name}", guards.back_to(name))
                for name in ("wall.slide", "wall.land")
            ),
            fail("wall.lost", "lost too long", guards.lost_for_long, ChargingTrouble.CONTACT_LOST),
            go("wall.follow", "wall.set_down", "at its place", guards.arrived, "stay"),
            go("crown.follow", "crown.set_down", "at its place", guards.arrived, "stay"),
            go("wall.set_down", "release.open", rested, guards.rested, "stay"),
            go("crown.lower", "crown.zero", arrived, guards.arrived),
            go("crown.zero", "crown.descend", rested, guards.rested, "descend_to_layer"),
            go("crown.descend", "crown.land", arrived, guards.arrived, "seek_layer"),
            fail("crown.land", "no layer", guards.arrived, ChargingTrouble.NO_LAYER),
            go("crown.set_down", "release.open", rested, guards.rested, "stay"),
            go("bulk.lower", "bulk.pour", arrived, guards.arrived),
            go("bulk.pour", "retreat.up", "empty", guards.not_held, "retreat"),
            go("release.open", "retreat.up", "let go", guards.not_held, "retreat"),
            go("retreat.up", "return.over", arrived, guards.arrived, "back"),
            go("return.over", DONE, "last item", guards.last),
            go("return.over", "acquire.above", "next item", guards.arrived, "above"),
            go(BRAKE, STOPPED, "at rest, not to be moved", guards.stays, "stay"),
            go(BRAKE, AWAY, "at rest", guards.stands, "away"),
            go(BRAKE, STOPPED, "timed out", guards.late, "stay"),
            go(AWAY, BRAKE, "operator's halt", guards.stop_asked),
            go(AWAY, STOPPED, arrived, guards.arrived),
            go(AWAY, STOPPED, "timed out", guards.late, "stay"),
        ],
        memory=start,
        on_abort=BRAKE,
        abort_action=actions.abort,
    )


class _Actions:
    """The actions of the chart."""

    def __init__(
        self, guards: _Guards, motions: ChargingMotions, touches: tuple[_Touch, ...]
    ) -> None:
        self._guards, self._motions, self._touches = guards, motions, touches
        self._sensitive = {source for source, *_ in touches}

    def _moving(
        self, motion: Motion, memory: ChargingMemory, tick: ChargingTick
    ) -> ChargingMemory:
        segment = self._motions.segment(motion, memory, tick.inputs)
        return memory._replace(segment=segment)

    def begin(self, tick: ChargingTick) -> ChargingMemory:
        return self._moving("home", tick.memory, tick)

    def sense(self, tick: ChargingTick) -> ChargingMemory:
        memory, normal = self._guards.count(tick), tick.inputs.layer_normal
        if normal is None or not memory.on_layer or not self._motions.followed(memory.item):
            return memory
        return memory._replace(below=memory.into_layer(normal))

    def wait(self, tick: ChargingTick) -> ChargingMemory:
        """Stand still, and notice a contact made on the last segment or lost meanwhile."""
        memory = tick.memory
        for source, target, _, guard, _ in self._touches:
            if source == memory.left and guard(tick):
                tick.memory = self.enter(target, "stay")(tick)
                return self.halt(tick)
        memory = self._guards.count(tick)
        if memory.mode == CONTACT and self._guards.off_wall(tick):
            return memory._replace(mode=LOST)
        if memory.mode == LOST and self._guards.at_wall(tick):
            return memory._replace(mode=CONTACT)
        return memory

    def enter(
        self, target: str, motion: Motion | None
    ) -> Callable[[ChargingTick], ChargingMemory]:
        """Return the action at the entry to a state, with a new motion or without."""

        def entered(tick: ChargingTick) -> ChargingMemory:
            memory = tick.memory
            if target == "acquire.above" and memory.at == "return.over":
                item = memory.item + 1
                normal = self._motions.normal(item)
                memory = memory._replace(item=item, losses=0, normal=normal, below=LEVEL)
            if motion is not None:
                # With the mode before: what was under force control goes on where the arm is.
                memory = self._moving(motion, memory, tick)
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

    def stop(self, trouble: ChargingTrouble) -> Callable[[ChargingTick], ChargingMemory]:
        """Return the action of a failure.

        The command stops on its path, or at once where something may be near; what was under
        force control stays where it is.
        """

        def stopped(tick: ChargingTick) -> ChargingMemory:
            memory = tick.memory
            at = memory.left or memory.at
            quick = memory.mode != APPROACH or at in self._sensitive
            if quick:
                memory = self._moving("stay", memory, tick)
            return memory._replace(
                at=BRAKE,
                left="",
                mode=MODE_OF[BRAKE],
                hold=not quick,
                trouble=trouble,
                trouble_at=at,
            )

        return stopped

    def abort(self, state: str, tick: ChargingTick) -> ChargingMemory:
        """Stop as after a failure; an earlier failure keeps its reason."""
        trouble = tick.memory.trouble
        stopped = self.stop(trouble or ChargingTrouble.ABORTED)(tick)
        return stopped._replace(trouble_at=tick.memory.trouble_at) if trouble else stopped


_FORCE: Final = ("N",) * 3 + ("N m",) * 4
_INPUTS: Final = {
    "endpoint_motion": Signal(2 * COORDINATES, POSITION + VELOCITY),
    "desired_position": Signal(COORDINATES, POSITION),
    "desired_velocity": Signal(COORDINATES, VELOCITY),
    "progress": Signal(),
    "measured_force": Signal(3, "N"),
    "mean_force": Signal(3, "N"),
    "held": Signal(),
    "homed": Signal(optional=True),
    "alive": Signal(optional=True),
    "halt": Signal(optional=True),
    "layer_normal": Signal(3, optional=True),
}


class ChargingLaw(ChartLaw[ChargingInputs, ChargingMemory]):
    """Charges a crucible, nugget by nugget, with its parameters and its beliefs of the cell."""

    def __init__(self, params: ResolvedChargingParams, beliefs: ChargingBeliefs) -> None:
        ends = {DONE: 1.0, STOPPED: 2.0}
        super().__init__(
            make_charging_chart(params, beliefs),
            observation=ChargingInputs,
            inputs=_INPUTS,
            outputs={
                "segment": MachineOutput(
                    size=SIZE, unit=SEGMENT, read=lambda memory: memory.segment.vector()
                ),
                "hold": number("hold"),
                "mode": number("mode"),
                "desired_force": MachineOutput(
                    size=COORDINATES, unit=_FORCE, read=lambda memory: memory.desired_force(params)
                ),
                "selection": MachineOutput(
                    size=COORDINATES**2, read=lambda memory: _selection(memory.pressed)
                ),
                "grip": number("grip"),
                "tare": MachineOutput(read=lambda memory: (float(tares(memory.at)),)),
                "below": MachineOutput(size=3, read=lambda memory: memory.below),
                "restart": MachineOutput(read=lambda memory: (float(not memory.on_layer),)),
                "wall": MachineOutput(size=3, read=lambda memory: memory.wall),
                "item": number("item"),
                "finished": MachineOutput(read=lambda memory: (ends.get(memory.at, 0.0),)),
                "trouble": number("trouble"),
            },
            period=params.period,
        )


@lru_cache(maxsize=64)
def _selection(pressed: tuple[Vector3, ...]) -> tuple[float, ...]:
    """Return the position domain, row by row: all but the directions under force control."""
    domain = np.eye(COORDINATES)
    for normal in pressed:
        domain = domain @ position_selection(np.array([*normal, *[0.0] * (COORDINATES - 3)]))
    return tuple(domain.ravel().tolist())
