"""A simulated robot in another process, as a controller sees it."""

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.robot.command_guard import Reading
from chamfer.systems.robot.link import Link, LinkError, Message

Array = NDArray[np.float64]

_PATIENCE: Final = 10.0  # s, for the robot's next message
_STARTING: Final = 120.0  # s, for the same at the start, where it compiles, and at the end


class SimulatedRobot:
    """Reads the measurements of a simulated robot, and sends its commands.

    Its clock is the robot's, which sends the time with each measurement. ``answers`` are the
    times, s, that real time took from each measurement to the command that answers it.
    """

    def __init__(self, link: Link, *, period: float) -> None:
        self.period = period
        self.answers: list[float] = []
        self._link = link
        self._reading = Reading(-math.inf, {})
        self._sent = self._began = 0.0

    @property
    def pace(self) -> float:
        """Seconds that the robot simulated in one."""
        return self._reading.time / (self._sent - self._began)

    def clock(self) -> float:
        """Return the robot's time, s, of its last measurement."""
        if not self._reading.values:
            self._take(_STARTING)
            self._began = self._sent
        return self._reading.time

    def sleep(self, _: float = 0.0) -> None:
        """Wait for the next measurement, however long it takes the robot to get there.

        Raises:
            LinkError: If it does not come, or the robot has ended.
        """
        self._take(_PATIENCE)

    def _take(self, patience: float) -> None:
        values = {name: np.array(one) for name, one in self._message(patience).items()}
        self._sent, at = float(values.pop("sent")[0]), float(values.pop("time")[0])
        self._reading = Reading(at, values)

    def read(self) -> Reading:
        """Return the last measurements, without waiting."""
        return self._reading

    def write(self, command: Mapping[str, Array]) -> None:
        """Answer the last measurement with a command."""
        named = {name: np.asarray(one).tolist() for name, one in command.items()}
        self._link.send({"time": [self._reading.time], **named})
        self.answers.append(time.monotonic() - self._sent)

    def stop(self) -> None:
        """Let the robot stay where it is, which ends the simulation."""
        with suppress(LinkError):  # then it is nowhere
            self._link.send({"stop": []})

    def log(self) -> dict[str, Array]:
        """Return the true values at each step of a simulation that was stopped, by name."""
        while "log" not in (message := self._message(_STARTING)):
            pass
        return {name: np.array(one) for name, one in message.items() if name != "log"}

    def _message(self, patience: float) -> Message:
        if (message := self._link.receive(patience)) is None:
            raise LinkError(f"does not answer for {patience:g} s")
        return message
