"""State charts: pure, typed, testable and drawable without Drake.

Semantics of one tick, in this order:

1. On the first tick the initial state is entered (its *entry* action runs).
2. The guards of the current state are evaluated in the order in which the transitions were
   given; the first that is true wins. If it leads from :data:`ANY` to the current state, the state
   is kept and what has a lower priority is not taken. Only where no transition is taken, a
   *timeout* counts.
3. If there is a winner: *exit* of the old state, the transition's *action*, *entry* of the new
   one. A transition from a state to itself leaves and enters it.
4. The *during* action of the state that is now current runs, on every tick, so that a sampled
   controller computes its output in the tick in which it enters a state.

At most one transition is taken in a tick. A state with an outcome is final: it is never left.

A tick can *abort*: regardless of the guards, the chart then goes to its abort state as by any
other transition, and stays there. A final state is kept.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Generic, Literal, NamedTuple, TypeAlias, TypeVar

Inputs = TypeVar("Inputs")
Memory = TypeVar("Memory")

ANY: Final = "*"  # as a transition's source: every state that is not final
TIME_TOLERANCE: Final = 1e-9  # s, periods such as 1/80 s don't add up to a time exactly


@dataclass(slots=True)
class Tick(Generic[Inputs, Memory]):
    """Input of guards and actions: the time, the inputs and the chart's memory."""

    time: float  # s
    time_in_state: float  # s
    inputs: Inputs
    memory: Memory


@dataclass(frozen=True, kw_only=True)
class State(Generic[Inputs, Memory]):
    """A state; its actions take a :class:`Tick` and return the new memory."""

    name: str
    entry: Callable[[Tick[Inputs, Memory]], Memory] | None = None
    during: Callable[[Tick[Inputs, Memory]], Memory] | None = None
    exit: Callable[[Tick[Inputs, Memory]], Memory] | None = None
    timeout: float | None = None  # s, after which the state is left for on_timeout
    on_timeout: str | None = None
    outcome: Literal["done", "failed"] | None = None  # set: the state is final
    note: str = ""  # action in the state, for the drawing


@dataclass(frozen=True, kw_only=True)
class Transition(Generic[Inputs, Memory]):
    """A guarded transition; the order in the chart is the priority."""

    source: str  # a state's name, or ANY
    target: str
    guard: Callable[[Tick[Inputs, Memory]], bool]
    label: str  # meaning of the guard, for the log and the drawing
    action: Callable[[Tick[Inputs, Memory]], Memory] | None = None
    history: bool = False
    # whether it is one of the ways back to the state before; drawings show them as one


class Snapshot(NamedTuple, Generic[Memory]):
    """The state of a chart between two ticks."""

    state: str
    entered_at: float  # s
    memory: Memory
    started: bool  # False until the initial state has been entered
    aborted: bool = False  # True: the state is kept


class TransitionRecord(NamedTuple):
    """A transition that was taken."""

    time: float  # s
    source: str
    target: str
    label: str
    inputs: object
    also_true: tuple[str, ...]  # labels of the guards of lower priority that were true as well


# Target, label, action, and the labels of other guards that were true.
_Way: TypeAlias = tuple[str, str, Callable[[Tick[Inputs, Memory]], Memory] | None, tuple[str, ...]]


class ChartError(ValueError):
    """A chart that can't be run; the message names the state or transition."""


class Chart(Generic[Inputs, Memory]):
    """States and guarded transitions, checked at construction.

    The first state is the initial one; transitions are in priority order. The ``memory``, an
    immutable value, is the chart's memory before its first tick. An abort leads to the state
    ``on_abort``, by default the first that is failed, or else the initial one, with an action that
    gets the name of the state before.

    Raises:
        ChartError: If a name is used twice or unknown, a state can't be reached or, not being
            final, can't be left, or a timeout is incomplete.
    """

    def __init__(
        self,
        name: str,
        *,
        states: Sequence[State[Inputs, Memory]],
        transitions: Sequence[Transition[Inputs, Memory]],
        memory: Memory,
        on_abort: str | None = None,
        abort_action: Callable[[str, Tick[Inputs, Memory]], Memory] | None = None,
    ) -> None:
        self.name = name
        self.states = tuple(states)
        self.transitions = tuple(transitions)
        self.memory = memory
        self._check_names()
        self.initial = self.states[0].name
        self.state_names = tuple(state.name for state in self.states)
        failed = (state.name for state in self.states if state.outcome == "failed")
        self.on_abort = next(failed, self.initial) if on_abort is None else on_abort
        self._abort_action = abort_action
        self._states = {state.name: state for state in self.states}
        self._leaving = {
            state.name: tuple(
                transition
                for transition in self.transitions
                if transition.source == state.name
                or (transition.source == ANY and state.outcome is None)
            )
            for state in self.states
        }
        self._check_timeouts()
        self._check_paths()
        if self.on_abort not in self._states:
            valid = ", ".join(self.state_names)
            raise ChartError(f"chart {name!r}: on_abort names {on_abort!r}, valid states: {valid}")

    def start(self) -> Snapshot[Memory]:
        """Return the snapshot before the first tick."""
        return Snapshot(self.initial, 0.0, self.memory, False)

    def state(self, name: str) -> State[Inputs, Memory]:
        """Return the state with that name."""
        return self._states[name]

    def successors(self, name: str) -> frozenset[str]:
        """Return the names of the states that follow directly, timeouts included."""
        following = {
            transition.target for transition in self._leaving[name] if not _keeps(transition, name)
        }
        on_timeout = self._states[name].on_timeout
        return frozenset(following if on_timeout is None else following | {on_timeout})

    def reachable(self, name: str) -> frozenset[str]:
        """Return the names of the states that can follow, directly or not."""
        seen, new = frozenset[str](), self.successors(name)
        while new - seen:
            seen |= new
            new = frozenset().union(*map(self.successors, seen))
        return seen

    def step(
        self, snapshot: Snapshot[Memory], inputs: Inputs, time: float, *, abort: bool = False
    ) -> tuple[Snapshot[Memory], TransitionRecord | None]:
        """Run one tick and return the new snapshot and the transition taken, if any."""
        name, entered_at, memory, started, aborted = snapshot
        state = self._states[name]
        tick = Tick(time, time - entered_at, inputs, memory)
        if not started:
            entered_at = time
            tick.time_in_state = 0.0
            if state.entry is not None:
                tick.memory = state.entry(tick)
        record = None
        chosen = None
        if not aborted:
            chosen = self._abort(state) if abort else self._choose(state, tick)
            aborted = abort and chosen is not None
        if chosen is not None:
            target, label, action, also_true = chosen
            record = TransitionRecord(time, name, target, label, inputs, also_true)
            if state.exit is not None:
                tick.memory = state.exit(tick)
            if action is not None:
                tick.memory = action(tick)
            name, entered_at, state = target, time, self._states[target]
            tick.time_in_state = 0.0
            if state.entry is not None:
                tick.memory = state.entry(tick)
        if state.during is not None:
            tick.memory = state.during(tick)
        return Snapshot(name, entered_at, tick.memory, True, aborted), record

    def _abort(self, state: State[Inputs, Memory]) -> _Way[Inputs, Memory] | None:
        if state.outcome is not None:
            return None
        action = self._abort_action
        return self.on_abort, "abort", action and partial(action, state.name), ()

    def _choose(
        self, state: State[Inputs, Memory], tick: Tick[Inputs, Memory]
    ) -> _Way[Inputs, Memory] | None:
        leaving = self._leaving[state.name]
        for i, transition in enumerate(leaving):
            if transition.guard(tick):
                if _keeps(transition, state.name):
                    break
                also_true = tuple(other.label for other in leaving[i + 1 :] if other.guard(tick))
                return transition.target, transition.label, transition.action, also_true
        if (
            state.timeout is not None
            and state.on_timeout is not None
            and tick.time_in_state >= state.timeout - TIME_TOLERANCE
        ):
            return state.on_timeout, f"after {state.timeout:g} s", None, ()
        return None

    def _check_names(self) -> None:
        if not self.states:
            raise ChartError(f"chart {self.name!r} has no states")
        names = [state.name for state in self.states]
        for name in names:
            if not name or name == ANY:
                raise ChartError(f"chart {self.name!r}: {name!r} can't be a state's name")
            if names.count(name) > 1:
                raise ChartError(f"chart {self.name!r} has the state {name!r} twice")
        valid = ", ".join(names)
        for transition in self.transitions:
            arrow = f"{transition.source} -> {transition.target}"
            if not transition.label:
                raise ChartError(f"chart {self.name!r}: the transition {arrow} has no label")
            for end, known in ((transition.source, [*names, ANY]), (transition.target, names)):
                if end not in known:
                    raise ChartError(
                        f"chart {self.name!r}: the transition {arrow} names {end!r}, "
                        f"valid states: {valid}"
                    )

    def _check_timeouts(self) -> None:
        for state in self.states:
            if (state.timeout is None) != (state.on_timeout is None):
                raise ChartError(
                    f"chart {self.name!r}: state {state.name!r} needs both timeout and on_timeout"
                )
            if state.timeout is not None and not 0 < state.timeout < float("inf"):
                raise ChartError(
                    f"chart {self.name!r}: the timeout of {state.name!r} is {state.timeout!r}, "
                    "allowed: a finite number > 0"
                )
            if state.on_timeout is not None and state.on_timeout not in self._states:
                raise ChartError(
                    f"chart {self.name!r}: on_timeout of {state.name!r} names "
                    f"{state.on_timeout!r}, valid states: {', '.join(self.state_names)}"
                )

    def _check_paths(self) -> None:
        reachable = self.reachable(self.initial)
        for state in self.states:
            if state.name != self.initial and state.name not in reachable:
                raise ChartError(f"chart {self.name!r}: state {state.name!r} can't be reached")
            following = self.successors(state.name) - {state.name}
            if state.outcome is None and not following and len(self.states) > 1:
                raise ChartError(
                    f"chart {self.name!r}: state {state.name!r} can't be left and isn't final"
                )
            if state.outcome is not None and self.successors(state.name):
                raise ChartError(
                    f"chart {self.name!r}: the final state {state.name!r} has a way out"
                )


def _keeps(transition: Transition[Inputs, Memory], state: str) -> bool:
    return transition.source == ANY and transition.target == state
