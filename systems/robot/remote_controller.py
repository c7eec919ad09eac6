"""A simulated robot's end of the connection to its controller, as a block."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from chamfer.systems.law import HeldLaw, vectors
from chamfer.systems.law_block import Frozen
from chamfer.systems.robot.link import Link, Message

Array = NDArray[np.float64]


class RemoteController(LeafSystem):
    """Connects a simulated robot to a controller in another process, as a robot's driver does.

    .. pydrake_system::

        name: RemoteController
        input_ports:
        - (one per input of the law)
        output_ports:
        - (one per output of the law)

    Once a period of the law it sends the measurements, the time, and the poses that it is
    commanded. Then it ``waits`` for the answer, s in real time, or None, indefinitely. A later
    answer counts from the next period on.

    ``<name>_pose``, (7,), continues with the linear part of ``<name>_velocity``, (6,), for at most
    the ``timeout``, s, and then stays. It also stays once the controller sends ``stop``, after
    which no message counts. Before the first answer the law's start counts.

    Abstract state: the last command, and its time, s.
    """

    def __init__(
        self, law: HeldLaw[Any, Any, Any], link: Link, *, waits: float | None, timeout: float
    ) -> None:
        super().__init__()
        self._law, self._link, self._waits, self._timeout = law, link, waits, timeout
        self.ended = False  # the controller said stop
        moved = [name.removesuffix("_velocity") for name in law.outputs if "_velocity" in name]
        self._moved = {f"{name}_velocity": f"{name}_pose" for name in moved}
        self._seen = {
            name: self.DeclareVectorInputPort(name, signal.size)
            for name, signal in law.inputs.items()
        }
        first = {name: np.array(one) for name, one in law.command(law.start())._asdict().items()}
        self._told = self.DeclareAbstractState(Value[object](Frozen(0.0, first)))
        depends = {self.time_ticket(), self.abstract_state_ticket(self._told)}
        for name, signal in law.outputs.items():

            def calc(context: Context, vector: BasicVector, name: str = name) -> None:
                vector.SetFromVector(self._now(context)[name])

            self.DeclareVectorOutputPort(name, signal.size, calc, depends)
        self.DeclarePeriodicUnrestrictedUpdateEvent(law.period, 0.0, self._exchange)

    def _now(self, context: Context) -> dict[str, Array]:
        """Return the command at this time."""
        told: Frozen = context.get_abstract_state(self._told).get_value()
        since, command = context.get_time() - told.state, dict(told.command)
        for velocity, pose in self._moved.items():
            way = min(since, self._timeout) * command[velocity][3:]
            command[pose] = np.concatenate([command[pose][:4], command[pose][4:] + way])
            if since > self._timeout:
                command[velocity] = np.zeros(6)
        return command

    def _exchange(self, context: Context, state: State) -> None:
        now, command = context.get_time(), self._now(context)
        seen = {n: port.Eval(context) for n, port in self._seen.items() if port.HasValue(context)}
        seen |= {name: one for name, one in command.items() if name.endswith("_pose")}
        named = {name: one.tolist() for name, one in seen.items()}
        self._link.send({"time": [now], "sent": [time.monotonic()], **named})
        until = None if self._waits is None else time.monotonic() + self._waits

        def answer() -> Message | None:
            return self._link.receive(until and max(until - time.monotonic(), 0.0))

        while not self.ended and (message := answer()) is not None:
            self.ended = "stop" in message
            if self.ended:
                told = Frozen(now, command | dict.fromkeys(self._moved, np.zeros(6)))
            else:
                told_now: Any = vectors(self._law.outputs, message)
                told = Frozen(message["time"][0], dict(zip(command, told_now, strict=True)))
            state.get_mutable_abstract_state().get_mutable_value(self._told).set_value(told)
            # An answer to what was measured before is no answer to this.
            if told.state >= now:
                break
