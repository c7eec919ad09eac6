"""Everything that an insertion has between cameras, encoders and arms, as one law."""

import math
from collections import namedtuple
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.force.tool_pose import (
    POSE,
    StraightMotion,
    advance_of,
    advanced,
    compensate,
    feed_velocity,
    share_of_compensation,
    spring_force,
)
from chamfer.systems.law import HeldLaw, Signal
from chamfer.systems.recording import Record
from chamfer.systems.servo.divergence_law import DivergenceState
from chamfer.systems.statechart.chart_law import ChartState
from chamfer.systems.strategies.insertion_law import InsertionMemory

Array = NDArray[np.float64]

TASK = "insertion task"


@dataclass(frozen=True, kw_only=True)
class InsertionControllerParams:
    """Parameters of :class:`InsertionController`; poses are quaternion and position, m, (7,)."""

    stiffness: Array  # N/m, (3,), of the peg's arm along its command's axes
    R_WH: Array  # axes of the errors, x into the hole
    peg_pose: Array  # of the peg at the gap
    hole_pose: Array  # commanded of the hole, or its fixed one on a fixture
    shares: Mapping[str, float]  # of the compensation, by arm; without "hole" it is on a fixture
    motion: StraightMotion | None = None  # of the peg to the gap; None: it is there at the start
    initial_error: tuple[float, ...] = (0.0,) * 6  # m and rad, of the peg's commanded pose


class ControllerState(NamedTuple):
    """The state of the law between two steps."""

    watch: DivergenceState
    compensator: Any
    task: ChartState[InsertionMemory]
    stopped: float = math.inf  # s, time at which the desired motion stopped
    time: float = 0.0  # s, of the step


class ControllerObservation(NamedTuple):
    """The measurements of cameras and encoders."""

    error: Array  # pixels and rad
    valid: Array
    blind: Array
    peg_saturated: Array
    hole_saturated: Array | None  # None: on a fixture
    peg_tool_pose: Array
    hole_tool_pose: Array | None


class InsertionController(HeldLaw[ControllerState, ControllerObservation, Any]):
    """Combines the compensation from cameras with the task's chart, and commands the arms.

    It reads the cameras and encoders of
    :func:`chamfer.diagrams.insertion.insertion.make_insertion_diagram`. Its outputs:

    - ``peg_pose`` and ``hole_pose``, (7,): quaternion w, x, y, z and position, m.
    - ``peg_velocity``, (6,), rad/s and m/s: the peg's pose continues with it until the next step;
      the hole's does not.
    - ``peg_command``: the pose before the feed.
    - ``compensation``, m and rad, ``diverged``, and the outputs of the task.

    Its ``laws`` are those of the measurement selector, the divergence watch, the compensation and
    the task, in this order, by the names of their blocks in the diagram.
    """

    observation = ControllerObservation

    def __init__(self, params: InsertionControllerParams, laws: Mapping[str, Any]) -> None:
        self.params, self.laws = params, laws
        _, self.watch, self.compensator, self.task = laws.values()
        self.period = self.task.period
        seen, pose = self.task.inputs, POSE._replace(finite=True)
        measured = {"peg_tool_pose": pose, "hole_tool_pose": pose._replace(optional=True)}
        self.inputs = {one: (seen | measured)[one] for one in ControllerObservation._fields}
        self.outputs = {
            "peg_pose": POSE,
            "peg_velocity": Signal(6, ("rad/s",) * 3 + ("m/s",) * 3),
            "hole_pose": POSE,
            "peg_command": POSE,
            "compensation": seen["compensation"],
            "diverged": Signal(),
            **self.task.outputs,
        }
        self._command: Any = namedtuple("Command", self.outputs)  # type: ignore[misc]
        self._shares = {
            arm: share_of_compensation(share, params.R_WH) for arm, share in params.shares.items()
        }
        self._error = None
        if any(params.initial_error):
            self._error = share_of_compensation(1.0, params.R_WH) @ np.array(params.initial_error)

    def start(self) -> ControllerState:
        """Return the state before the first step."""
        return ControllerState(self.watch.start(), self.compensator.start(), self.task.start())

    def update(
        self, state: ControllerState, observation: ControllerObservation, time: float
    ) -> ControllerState:
        """Return the state after a step."""
        return self.steps(state, observation, time)[0]

    def steps(
        self, state: ControllerState, seen: ControllerObservation, time: float
    ) -> tuple[ControllerState, dict[str, Record]]:
        """Return the state after a step, with the input and output of each law in it.

        All laws step at once: each sees the outputs that the others held before.
        """
        records: dict[str, Record] = {}

        def step(name: str, before: Any, values: Mapping[str, Any]) -> tuple[Any, Any]:
            law = self.laws[name]
            after, command = law.step(before, law.observe(values), time)
            records[name] = Record(time, values, command._asdict())
            return after, command

        selecting, watching, compensating, inserting = self.laws
        held, measured = self.command(state._replace(time=time)), seen._asdict()
        hole = self.params.hole_pose if seen.hole_tool_pose is None else seen.hole_tool_pose
        _, through = step(selecting, None, {**measured, "open": held.compensates})
        watch, told = step(watching, state.watch, {**measured, **through._asdict()})
        compensated = {"error": through.error, "valid": told.valid}
        compensator, _ = step(compensating, state.compensator, compensated)
        pushed = self.params.stiffness, held.peg_pose, seen.peg_tool_pose, hole
        of_task = {
            **measured,
            "diverged": told.diverged,
            "compensation": held.compensation,
            "force": spring_force(*pushed),
            "advance": [advance_of(seen.peg_tool_pose, hole)],
        }
        task, _ = step(inserting, state.task, of_task)
        stopped = min(state.stopped, time) if told.stop[0] >= 0.5 else state.stopped
        return ControllerState(watch, compensator, task, stopped, time), records

    def abort(
        self, state: ControllerState, observation: ControllerObservation, time: float
    ) -> ControllerState:
        """Return the state after a step that aborts the task."""
        after, records = self.steps(state, observation, time)
        seen = self.task.observe(records[TASK].observation)
        return after._replace(task=self.task.abort(state.task, seen, time))

    def command(self, state: ControllerState) -> Any:
        """Return the command at the time of a state, a named tuple."""
        params, told = self.params, self.task.command(state.task)
        compensation = np.array(self.compensator.command(state.compensator).compensation)
        pose, hole, velocity = params.peg_pose, params.hole_pose, np.zeros(6)
        if params.motion is not None:
            position, velocity[3:] = params.motion.at(state.time, state.stopped)
            pose = np.concatenate([pose[:4], position])
        if self._error is not None:
            pose = compensate(pose, self._error)
        pose = compensate(pose, self._shares["peg"] @ compensation)
        if "hole" in self._shares:
            hole = compensate(hole, self._shares["hole"] @ compensation)
        feed, offset = np.array(told.feed), np.array(told.offset)
        return self._command(
            peg_pose=advanced(pose, hole, feed, state.time, offset),
            peg_velocity=velocity + feed_velocity(hole, feed, offset),
            hole_pose=hole,
            peg_command=pose,
            compensation=compensation,
            diverged=state.watch.diverged,
            **told._asdict(),
        )
