"""The block that runs a law in a Drake diagram."""

from collections.abc import Mapping
from typing import Any, Final, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DependencyTicket,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)
from pydrake.systems.framework import State as DrakeState

from chamfer.systems.law import Array, HeldLaw, Law
from chamfer.systems.recording import Record, active

LawT = TypeVar("LawT", bound=Law[Any, Any, Any])
Updates = Literal["unrestricted", "discrete"]


class Frozen(NamedTuple):
    """A law's state in a context. It is never changed, so contexts share it without copying."""

    state: Any
    command: Any  # of that state, None of a law whose command is not held

    def __deepcopy__(self, memo: object) -> "Frozen":
        return self


class LawBlock(LeafSystem, Generic[LawT]):
    """Runs a :class:`~chamfer.systems.law.Law` once a period.

    .. pydrake_system::

        name: LawBlock
        input_ports:
        - (one per input of the law)
        output_ports:
        - (one per output of the law)

    The block holds the command of a :class:`~chamfer.systems.law.HeldLaw` between steps. Any other
    law's command follows the inputs at once, with the state of the last step.

    The step is an ``unrestricted`` update by default. Drake runs those before the discrete updates
    of the same instant. So a discrete plant that steps at the tick already receives the new
    command: the loop has the delay of a zero-order hold and nothing more.

    A plant with sampled outputs steps by an unrestricted update itself. A law whose step has to
    come after that of the same instant ``updates`` by a discrete one. ``at_start`` it steps before
    the time begins too.

    State: the law's. A named tuple of arrays is a discrete state each, anything else one abstract
    state.
    """

    def __init__(
        self,
        law: LawT,
        *,
        updates: Updates = "unrestricted",
        at_start: bool = False,
    ) -> None:
        super().__init__()
        self.law = law
        self.period = law.period
        self.at_start = at_start
        self._inputs = {
            name: self.DeclareVectorInputPort(name, signal.size)
            for name, signal in law.inputs.items()
        }
        start: Any = law.start()
        self._kind: Final = type(start)
        self._groups = {
            name: self.DeclareDiscreteState(value) for name, value in _arrays(start).items()
        }
        if not self._groups:
            held = Frozen(start, law.command(start) if isinstance(law, HeldLaw) else None)
            self._held = self.DeclareAbstractState(Value[object](held))
        self._declare_outputs()
        if not isinstance(law, HeldLaw):
            # An output and the update of the same instant are of one step.
            self._stepped = self.DeclareCacheEntry(
                "step", ValueProducer(lambda: Value[object](), self._calc_step)
            )
        if updates == "unrestricted":
            self.DeclarePeriodicUnrestrictedUpdateEvent(law.period, 0.0, self._update)
            return
        if at_start:
            self.DeclareInitializationDiscreteUpdateEvent(self._update_discrete)
        self.DeclarePeriodicDiscreteUpdateEvent(law.period, 0.0, self._update_discrete)

    @property
    def path(self) -> str:
        """The block's place in its diagram; a root without a name is left out."""
        path: str = self.GetSystemPathname()
        return path.strip(":").removeprefix("_::")

    def state(self, context: Context) -> Any:
        """Return the law's state."""
        if not self._groups:
            return self._frozen(context).state
        values = context.get_discrete_state()
        return self._kind(*(values.value(group) for group in self._groups.values()))

    def _declare_outputs(self) -> None:
        law = self.law
        tickets: set[DependencyTicket] = (
            {self.discrete_state_ticket(group) for group in self._groups.values()}
            if self._groups
            else {self.abstract_state_ticket(self._held)}
        )
        if not isinstance(law, HeldLaw):
            tickets |= {port.ticket() for port in self._inputs.values()}
        for name, signal in law.outputs.items():
            if name in self._groups and isinstance(law, HeldLaw):
                self.DeclareStateOutputPort(name, self._groups[name])
                continue

            def calc(context: Context, vector: BasicVector, name: str = name) -> None:
                vector.SetFromVector(getattr(self._command(context), name))

            self.DeclareVectorOutputPort(name, signal.size, calc, tickets)

    def _frozen(self, context: Context) -> Frozen:
        frozen: Frozen = context.get_abstract_state(self._held).get_value()
        return frozen

    def _command(self, context: Context) -> Any:
        law = self.law
        if not isinstance(law, HeldLaw):
            return self._stepped.Eval(context)[1][1]
        return law.command(self.state(context)) if self._groups else self._frozen(context).command

    def _values(self, context: Context) -> Mapping[str, Array | None]:
        inputs = self.law.inputs
        return {
            name: None
            if inputs[name].optional and not port.HasValue(context)
            else port.Eval(context)
            for name, port in self._inputs.items()
        }

    def _calc_step(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self._made(context))

    def _made(self, context: Context) -> tuple[Mapping[str, Array | None], tuple[Any, Any]]:
        """Return the observation of a step, and its result."""
        values, time = self._values(context), context.get_time()
        return values, self.law.step(self.state(context), self.law.observe(values), time)

    def _step(self, context: Context) -> tuple[Any, Any]:
        time, is_held = context.get_time(), isinstance(self.law, HeldLaw)
        values, stepped = self._made(context) if is_held else self._stepped.Eval(context)
        if (recorder := active()) is not None:
            recorder.note(self, Record(time, values, stepped[1]._asdict()))
        return stepped

    def _update(self, context: Context, changed: DrakeState) -> None:
        state, command = self._step(context)
        if self._groups:
            self._set(changed.get_mutable_discrete_state(), state)
        else:
            held = Frozen(state, command if isinstance(self.law, HeldLaw) else None)
            changed.get_mutable_abstract_state().get_mutable_value(0).set_value(held)

    def _update_discrete(self, context: Context, changed: DiscreteValues) -> None:
        self._set(changed, self._step(context)[0])

    def _set(self, values: DiscreteValues, state: Any) -> None:
        for group, value in zip(self._groups.values(), state, strict=True):
            values.set_value(group, value)


def _arrays(state: Any) -> dict[str, Array]:
    """Return the arrays of a state by name, none of them if it is anything but arrays."""
    named: dict[str, Any] = state._asdict() if hasattr(state, "_asdict") else {}
    return named if all(isinstance(one, np.ndarray) for one in named.values()) else {}
