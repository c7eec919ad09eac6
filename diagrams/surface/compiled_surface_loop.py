"""The loops of Figs. 5-1 and 5-7 with machine code between the observer's samples.

What the diagrams of :mod:`chamfer.diagrams.surface.surface_estimation` and
:mod:`chamfer.diagrams.surface.surface_tracking` do with their own blocks, at the same times and
with the same seed. The diagrams are the reference. The observer is the block's law; contact, task
and controller are the blocks' own functions. Written a second time is the wiring, what is between
sensor and observer, and in which order things happen at a tick.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import RandomSource

from chamfer.diagrams.surface.surface_estimation import ResolvedEstimationScenario
from chamfer.diagrams.surface.surface_tracking import (
    ResolvedTrackingScenario,
    TrackingScenario,
    always_in_contact,
    surface_motion,
)
from chamfer.models.surfaces.surface import normal
from chamfer.models.surfaces.surface_code import surface_code
from chamfer.systems.compiled import compiled
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator
from chamfer.systems.contact.sliding_contact import next_contact
from chamfer.systems.estimation.surface_observer_law import ObserverObservation, SurfaceObserverLaw
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.force.hybrid_law import HybridCode, HybridMemory, control, hybrid_code
from chamfer.systems.force.surface_motion import SurfaceTask, moved_along
from chamfer.systems.recording import active

Array = NDArray[np.float64]
Scenario = ResolvedEstimationScenario | ResolvedTrackingScenario


class _Loop(NamedTuple):
    """A resolved scenario, in d dimensions, and when something happens.

    The periods are multiples of each other. The times of ticks, which are floating point numbers,
    are not always: of two the one that is earlier by rounding comes first.
    """

    surface: Array  # its code
    friction: Array
    stiffness: Array  # (d, d), N/m
    led: Array  # (events, 2d), m and m/s, of the gripper; none of a manipulator, which has:
    A: Array  # (2d, 2d), of a step
    B: Array  # (2d, d)
    task: SurfaceTask
    force: float  # N, desired
    control: HybridCode
    error: Array  # (samples, 2d), N and N/s, of the sensor
    late: int  # samples
    share: float  # of a step of the force that the filter takes up; 0: its rate is sensed
    period: float  # s, of the sensor
    ticks: NDArray[np.bool_]  # (events,), whether sensor and controller tick
    steps: NDArray[np.bool_]  # (events,), whether contact and manipulator step


class _Now(NamedTuple):
    """What changes."""

    motion: Array  # (2d,), m and m/s, nominal
    contact: Array  # (5d + 1,), of :func:`next_contact`
    before: Array  # the same at the last step
    filtered: Array  # (d,), N
    samples: Array  # (1,), ticks so far
    held: Array  # (d + 1,), of :func:`moved_along`
    memory: HybridMemory


def run_compiled(scenario: Scenario, samples: int, seed: int) -> dict[str, Array] | None:
    """Return what the diagram of a scenario exports, a row a sample of the sensor.

    None while laws are recorded, and where the diagram has to tell why it cannot go on.

    Args:
        scenario: Of either loop.
        samples: Of which there is one more at the start.
        seed: Of the noise.
    """
    d, kept = scenario.dimension, scenario.observer.average - 1
    law, prediction = SurfaceObserverLaw(scenario.observer, scenario.up), None
    if scenario.observer.prediction is not None:
        prediction = scenario.observer.prediction.make()
    clocks = [
        period * np.arange(round(samples * scenario.sensor_period / period) + 1, dtype=np.float64)
        for period in (scenario.sensor_period, scenario.step, law.period)
    ]
    times = np.unique(np.concatenate(clocks))
    loop = None if active() else _loop_of(scenario, clocks, times, seed)
    if loop is None:
        return None
    sizes = {"contact": 3 * d + 1, "contact_force": d, "contact_force_rate": d, "effort": d}
    sizes |= {"position_error": d, "force_error": d, "measured_force": d}
    sizes |= {"measured_force_rate": d, "later": 2 * d, "nominal_motion": 2 * d}
    rows, now = np.zeros((samples + 1, sum(sizes.values()))), _start(scenario)
    states, events = [law.start()], np.append(np.searchsorted(times, clocks[2]), len(times))
    try:
        _go_to(loop, now, 0)
        for first, last in itertools.pairwise(events.tolist()):
            sample = int(now.samples[0])
            past = rows[max(sample - kept, 0) : sample, -4 * d :]
            mean = np.append(_shown(loop, now, rows, sample), now.motion) + past.sum(axis=0)
            force, rate, motion = np.split(mean / (1 + len(past)), [d, 2 * d])
            if not np.isfinite(mean).all():
                return None
            expected = None if prediction is None else normal(prediction, now.motion[:d])
            observation = ObserverObservation(force, rate, motion, expected, None)
            states.append(law.update(states[-1], observation, float(times[first])))
            normals = states[-2].normal, states[-1].normal
            _follow(loop, now, *normals, rows, first, last)
    except ArithmeticError:
        return None
    if not np.isfinite(rows).all():
        return None
    parts = np.split(rows, np.cumsum([*sizes.values()])[:-1], axis=1)
    unseen = {"contact_force_rate", "later"}
    if len(loop.led):
        unseen |= {"effort", "position_error", "force_error"}
    outputs = {name: part for name, part in zip(sizes, parts, strict=True) if name not in unseen}
    held = np.searchsorted(clocks[2], clocks[0])
    for name, signal in law.outputs.items():
        values = np.array([getattr(one, name) for one in states])[held]
        outputs[name] = values if signal.size > 1 else values[:, 0]
    return outputs


def _loop_of(scenario: Scenario, clocks: list[Array], times: Array, seed: int) -> _Loop | None:
    d, period, sensor = scenario.dimension, scenario.sensor_period, scenario.sensor
    code, rate = surface_code(scenario.surface.make()), scenario.force_rate
    if code is None:
        return None
    # Of a gripper that is led nothing makes use of the default controller.
    tracking, led, builder = TrackingScenario(), np.empty((0, 2 * d)), DiagramBuilder()
    if isinstance(scenario, ResolvedTrackingScenario):
        tracking = scenario
    else:
        path = scenario.lead.path(d)
        led = np.vstack([path.vector_values(times), path.MakeDerivative().vector_values(times)]).T
        led[times > path.end_time(), d:] = 0.0
    manipulator = make_cartesian_manipulator(
        tracking.manipulator, start=(0.0,) * d, step=scenario.step
    )
    if not len(led):
        # Drake hands one generator from block to block, also to one whose state has no spread.
        builder.AddSystem(manipulator)
    # One sample of all is the same as one after the other.
    size = 2 * d * (len(clocks[0]) + 1)
    source = builder.AddSystem(RandomSource(RandomDistribution.kGaussian, size, period))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    drawn = source.get_output_port().Eval(source.GetMyContextFromRoot(context)).reshape(-1, 2 * d)
    scale = np.repeat([sensor.force_noise, sensor.force_rate_noise], d) / math.sqrt(3)
    bias = np.append(np.zeros(d) if sensor.bias is None else sensor.bias, np.zeros(d))
    return _Loop(
        code,
        scenario.friction.numbers,
        np.array(scenario.gripper.matrix(d), np.float64),
        np.ascontiguousarray(led),
        np.ascontiguousarray(manipulator.A()),
        np.ascontiguousarray(manipulator.B()),
        surface_motion(tracking).task,
        float(tracking.task.force),
        hybrid_code(always_in_contact(tracking.controller), d),
        bias + scale * drawn,
        round(scenario.force_delay / period),
        0.0 if rate is None else rate.share(period),
        float(period),
        np.isin(times, clocks[0]),
        np.isin(times, clocks[1]),
    )


def _start(scenario: Scenario) -> _Now:
    d = scenario.dimension
    start = np.array(getattr(scenario, "start", (0.0,) * d), np.float64)
    return _Now(
        np.append(start, np.zeros(d)),
        np.zeros(5 * d + 1),
        np.zeros(5 * d + 1),
        np.zeros(d),
        np.zeros(1),
        np.append(start, 0.0),
        HybridMemory(*(np.zeros(size) for size in (d, d, d, d, 1, 1, d, d))),
    )


@compiled
def _go_to(loop: _Loop, now: _Now, event: int) -> None:
    """Let the gripper be where it is at an event."""
    if len(loop.led):
        now.motion[:] = loop.led[event]
    now.contact[:] = next_contact(
        loop.surface, loop.friction, loop.stiffness, now.before, now.motion
    )


@compiled
def _shown(loop: _Loop, now: _Now, rows: Array, drawn: int) -> Array:
    """Return force and rate as those who use them see them, shape (2d,), with a sample of noise.

    That is the present tick's, and the next one's for averages and filters, which tick after it.
    """
    d, past = len(now.filtered), int(now.samples[0]) - loop.late
    if not loop.late:
        shown = loop.error[drawn] - now.contact[3 * d + 1 :]
    elif past < 0:
        shown = np.zeros(2 * d)
    else:
        shown = loop.error[past + 1] - rows[past, 3 * d + 1 : 5 * d + 1]
    if loop.share > 0.0:
        shown[d:] = loop.share * (shown[:d] - now.filtered) / loop.period
    return shown  # type: ignore[no-any-return]


@compiled
def _command(loop: _Loop, now: _Now, normal: Array, measured_force: Array) -> None:
    """Let task and controller make an effort of what they see."""
    d = len(normal)
    n, x, v = normal / math.sqrt(normal @ normal), now.motion[:d].copy(), now.motion[d:].copy()
    now.held[:] = moved_along(loop.task, n, x, now.held, True)
    J, none, memory = np.eye(d), np.zeros(d), now.memory
    desired = now.held[:d].copy(), none, -loop.force * n
    across, mode = J - np.outer(n, n), float(CONTACT)
    arm, model = (v, x, J), (J, none)
    found, _ = control(loop.control, memory, arm, desired, measured_force, across, mode, model)
    for kept, new in zip(memory, found):  # noqa: B905 - strict is not for machine code
        kept[:] = new


@compiled
def _follow(
    loop: _Loop, now: _Now, before: Array, normal: Array, rows: Array, first: int, last: int
) -> None:
    """Go from the observer's tick, the first event, to its next one, the last event.

    A controller that ticks at once with the observer sees the normal of before.
    """
    d, memory = len(now.filtered), now.memory
    for event in range(first, last):
        if loop.ticks[event]:
            sample = int(now.samples[0])
            shown = _shown(loop, now, rows, sample)
            later = _shown(loop, now, rows, sample + 1)
            efforts = np.concatenate((memory.torque, memory.position_error, memory.force_error))
            rows[sample] = np.concatenate((now.contact, efforts, shown, later, now.motion))
            if not len(loop.led):
                _command(loop, now, before if event == first else normal, shown[:d].copy())
            now.filtered[:] += loop.share * (later[:d] - now.filtered)
            now.samples[0] += 1.0
        if loop.steps[event]:
            now.before[:] = now.contact
            if not len(loop.led):
                force = memory.torque + now.contact[3 * d + 1 : 4 * d + 1]
                now.motion[:] = loop.A @ now.motion + loop.B @ force
        if event + 1 < len(loop.ticks):
            _go_to(loop, now, event + 1)
