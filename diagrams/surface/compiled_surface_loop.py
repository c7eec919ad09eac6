"""The loop of Fig. 5-7 with machine code between the observer's samples: for runs and sweeps.

What :func:`chamfer.diagrams.surface.surface_tracking.make_tracking_diagram` does with its own
blocks, at the same times and with the same seed. The diagram is the reference. The observer is the
block's law; contact, task and controller are the blocks' own functions. Written a second time is
the wiring, what is between sensor and observer, and in which order things happen at a tick.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution

from chamfer.diagrams.surface.surface_tracking import (
    ResolvedTrackingScenario,
    always_in_contact,
    surface_motion,
)
from chamfer.models.arms.cartesian_manipulator import cartesian_kinematics
from chamfer.models.surfaces.surface import normal
from chamfer.models.surfaces.surface_code import surface_code
from chamfer.systems.compiled import compiled
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator
from chamfer.systems.contact.sliding_contact import next_contact
from chamfer.systems.estimation.surface_observer_law import ObserverObservation, SurfaceObserverLaw
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.force.hybrid_law import HybridCode, HybridLaw, HybridMemory, control
from chamfer.systems.force.surface_motion import SurfaceTask, moved_along
from chamfer.systems.recording import active
from chamfer.systems.sensing.drawn_noise import drawn_noise

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class _Loop(NamedTuple):
    """A resolved scenario, in d dimensions."""

    contact: tuple[Array, Array, Array]  # surface, friction, stiffness of :func:`next_contact`
    plant: tuple[Array, Array]  # A and B of the manipulator's step
    task: SurfaceTask
    force: float  # N, desired
    control: HybridCode
    error: Array  # (samples, 2d), N and N/s, of the sensor
    late: int  # samples
    share: float  # of a step of the force after one period of the filter; 0: its rate is sensed
    events: tuple[Flags, Flags]  # whether sensor and controller tick, contact and plant step


class _Now(NamedTuple):
    """The changing state of the loop."""

    motion: Array  # (2d,), m and m/s, nominal
    contact: Array  # (5d + 1,), of :func:`next_contact`
    filtered: Array  # (d,), N
    samples: Array  # (1,), ticks so far
    held: Array  # (d + 1,), of :func:`moved_along`
    memory: HybridMemory


def run_compiled(
    scenario: ResolvedTrackingScenario, samples: int, seed: int
) -> dict[str, Array] | None:
    """Return the diagram's exports, one row each controller period, and one at the start.

    None while laws are recorded, and where the diagram has to tell why it cannot go on.
    """
    d, period, observer = scenario.dimension, scenario.controller.period, scenario.observer
    code, law = surface_code(scenario.surface.make()), SurfaceObserverLaw(observer, scenario.up)
    if code is None or active():
        return None
    seen = None if observer.prediction is None else observer.prediction.make()
    # The periods are multiples of each other, the times of the ticks, as floating point numbers,
    # not always: of two the one that is earlier by rounding comes first.
    ticks, steps, looks = (
        one * np.arange(round(samples * period / one) + 1, dtype=np.float64)
        for one in (period, scenario.step, observer.period)
    )
    times = np.unique(np.concatenate([ticks, steps, looks]))
    start, law_of = np.array(scenario.start, np.float64), always_in_contact(scenario.controller)
    controller = HybridLaw(cartesian_kinematics(d), law_of)
    plant = make_cartesian_manipulator(
        scenario.manipulator, start=scenario.start, step=scenario.step
    )
    rate, sensor, normals = scenario.force_rate, scenario.sensor, RandomDistribution.kGaussian
    (errors,) = drawn_noise((normals, (samples + 2, 2 * d)), after=plant, seed=seed)
    errors *= np.repeat([sensor.force_noise, sensor.force_rate_noise], d) / math.sqrt(3)
    errors[:, :d] += 0.0 if sensor.bias is None else sensor.bias
    loop = _Loop(
        (code, scenario.friction.numbers, np.array(scenario.gripper.matrix(d), np.float64)),
        (np.ascontiguousarray(plant.A()), np.ascontiguousarray(plant.B())),
        surface_motion(scenario).task,
        float(scenario.task.force),
        controller.code,
        errors,
        round(scenario.force_delay / period),
        0.0 if rate is None else rate.share(period),
        (np.isin(times, ticks), np.isin(times, steps)),
    )
    now = _Now(
        np.append(start, np.zeros(d)),
        np.zeros(5 * d + 1),
        np.zeros(d),
        np.zeros(1),
        np.append(start, 0.0),
        HybridMemory(*(one.copy() for one in controller.start())),
    )
    sizes = {"contact": 3 * d + 1, "contact_force": d, "contact_force_rate": d, "effort": d}
    sizes |= {"position_error": d, "force_error": d, "measured_force": d}
    sizes |= {"measured_force_rate": d, "later": 2 * d, "nominal_motion": 2 * d}
    rows, states = np.zeros((samples + 1, sum(sizes.values()))), [law.start()]
    try:
        now.contact[:] = next_contact(*loop.contact, now.contact, now.motion)
        for first, last in itertools.pairwise([*np.searchsorted(times, looks), len(times)]):
            sample = int(now.samples[0])
            past = rows[max(sample + 1 - observer.average, 0) : sample, -4 * d :]
            mean = np.append(_shown(loop, now, rows, sample), now.motion) + past.sum(axis=0)
            force, force_rate, motion = np.split(mean / (1 + len(past)), [d, 2 * d])
            if not np.isfinite(mean).all():
                return None
            expected = None if seen is None else normal(seen, now.motion[:d])
            observation = ObserverObservation(force, force_rate, motion, expected, None)
            states.append(law.update(states[-1], observation, float(times[first])))
            _follow(loop, now, states[-2].normal, states[-1].normal, rows, int(first), int(last))
    except ArithmeticError:
        return None
    if not np.isfinite(rows).all():
        return None
    parts = np.split(rows, np.cumsum([*sizes.values()])[:-1], axis=1)
    outputs = dict(zip(sizes, parts, strict=True))
    del outputs["contact_force_rate"], outputs["later"]
    for name, signal in law.outputs.items():
        held = np.array([getattr(one, name) for one in states])[np.searchsorted(looks, ticks)]
        outputs[name] = held if signal.size > 1 else held[:, 0]
    return outputs


@compiled
def _shown(loop: _Loop, now: _Now, rows: Array, drawn: int) -> Array:
    """Return force and rate at their users' inputs, shape (2d,), with a sample of noise.

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
        shown[d:] = loop.share * (shown[:d] - now.filtered) / loop.control.period
    return shown  # type: ignore[no-any-return]


@compiled
def _command(loop: _Loop, now: _Now, normal: Array, measured_force: Array) -> None:
    """Compute the effort of task and controller from their inputs."""
    d, memory = len(normal), now.memory
    n, x, v = normal / math.sqrt(normal @ normal), now.motion[:d].copy(), now.motion[d:].copy()
    now.held[:] = moved_along(loop.task, n, x, now.held, True)
    J, none, mode = np.eye(d), np.zeros(d), float(CONTACT)
    arm, desired, model = (v, x, J), (now.held[:d].copy(), none, -loop.force * n), (J, none)
    across = J - np.outer(n, n)
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
    d, memory, (ticks, steps), (A, B) = len(before), now.memory, loop.events, loop.plant
    for event in range(first, last):
        if ticks[event]:
            sample = int(now.samples[0])
            shown = _shown(loop, now, rows, sample)
            later = _shown(loop, now, rows, sample + 1)
            efforts = np.concatenate((memory.torque, memory.position_error, memory.force_error))
            rows[sample] = np.concatenate((now.contact, efforts, shown, later, now.motion))
            _command(loop, now, before if event == first else normal, shown[:d].copy())
            now.filtered[:] += loop.share * (later[:d] - now.filtered)
            now.samples[0] += 1.0
        if steps[event]:
            force = memory.torque + now.contact[3 * d + 1 : 4 * d + 1]
            now.motion[:] = A @ now.motion + B @ force
            surface, friction, stiffness = loop.contact
            now.contact[:] = next_contact(surface, friction, stiffness, now.contact, now.motion)
