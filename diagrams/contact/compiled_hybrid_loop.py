"""The hybrid loop of Fig. 2-4 as machine code: for runs, sweeps and campaigns.

What :func:`chamfer.diagrams.contact.hybrid_loop.make_hybrid_diagram` does with its own controller,
at the same times and with the same seed. The diagram is the reference. Controller, detection,
motion, sensors, delay and arm are the blocks' own functions, compiled; written a second time is
the wiring, and in which order things happen at a tick.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution as Random

from chamfer.diagrams.contact.hybrid_loop import kick_of
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.models.validation import known
from chamfer.systems.compiled import add_product, compiled
from chamfer.systems.contact.arm_dynamics import Chain, bias, mass_matrix, pose
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.contact.arm_motion import (
    Contacts,
    Tool,
    advance,
    fill_patch,
    make_room,
    roughen,
)
from chamfer.systems.contact.stick_slip import Material
from chamfer.systems.exact_discretisation import count_samples
from chamfer.systems.force.arm_kinematics import arm_index, kinematics
from chamfer.systems.force.contact_detection_law import (
    APPROACH,
    CONTACT,
    LOST,
    is_beyond,
    push_along,
)
from chamfer.systems.force.friction_compensation import friction_estimate
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.force.hybrid_law import HybridCode, HybridMemory, control
from chamfer.systems.force.projection import position_selection, unit
from chamfer.systems.force.surface_motion import GuardedCode, guarded_position
from chamfer.systems.recording import active
from chamfer.systems.sensing.computation_delay import delayed
from chamfer.systems.sensing.drawn_noise import drawn_noise
from chamfer.systems.sensing.encoders import EncoderCode, counted, encoder_code, read_encoders
from chamfer.systems.sensing.force_sensor import (
    ForceSensorParams,
    LoadCellParams,
    SensorCode,
    converted,
    filtered,
    force_in_world,
    gauges,
    sensor_code,
)

Array = NDArray[np.float64]

_is_beyond = compiled(is_beyond)


class _Loop(NamedTuple):
    """A resolved scenario with an arm of n joints, and a sensor of k channels."""

    arm: int  # of :func:`kinematics`
    body: tuple[Chain, Material, Tool, Contacts]  # of :func:`update`
    start: tuple[Array, Array]  # its state and outputs at rest
    encoders: EncoderCode
    sensor: SensorCode
    cell: bool  # True: the sensor is a load cell
    undoing: Array  # (3, k) of a wrist sensor; (n, 1) of a load cell, its push
    task: GuardedCode
    domains: tuple[Array, Array]  # (n, n) each, of positions before and in contact
    force: Array  # (n,), N, desired
    ahead: Array  # (n,), unit, of the push
    thresholds: tuple[float, float]  # N, of contact and of its loss
    samples: int  # beyond them
    control: HybridCode
    memory: HybridMemory
    follow: Array  # (n,), of the friction compensation; 0 for none
    delay: tuple[float, float]  # s, of the computer, and its jitter
    kick: tuple[int, Array]  # in which update, -1 for none, and N, (3,)
    times: tuple[float, float]  # s, of an update and a step
    counts: tuple[int, int]  # steps in an update, updates in a period


# Samples of friction, before each update, and of jitter, sensor noise and drift, before each tick,
# and of each one more, shape (., channels); zeros where there is no noise.
_Noise = tuple[Array, Array, Array, Array]


def run_compiled(scenario: HybridScenario, seed: int) -> dict[str, Array] | None:
    """Return the exports of a resolved scenario's diagram, one row each period.

    None if only the diagram can do it: with another arm or surface than the built-in ones, while
    laws are recorded, and if the run ends early: the diagram says why.
    """
    loop = None if active() else _loop_of(scenario)
    if loop is None:
        return None
    rows = count_samples(scenario.duration, scenario.controller.period)
    log, complete = _run(loop, _noise_of(scenario, loop, rows, seed), rows)
    n = scenario.ARM.num_joints
    sizes = {"encoders": 2 * n, "measured_encoders": 2 * n, "contact_force": 3, "contact": 6}
    sizes |= {"torque": n, "position_error": n, "force_error": n}
    parts = np.split(log, np.cumsum([*sizes.values()]), axis=1)
    return {**dict(zip(sizes, parts, strict=False)), "mode": log[:, -1]} if complete else None


def _loop_of(scenario: HybridScenario) -> _Loop | None:
    arm, task, control = scenario.ARM, scenario.task, scenario.controller
    n, plant, given, period = arm.num_joints, scenario.plant, scenario.sensor, control.period
    q, ahead = scenario.joint_positions(np.array(task.start)), scenario.direction
    world, state, outputs = ArmInContact(arm, scenario.make_surface(), plant, q).start()
    index, contacts = arm_index(arm), world.contacts
    if index is None or contacts is None:
        return None
    model = scenario.dynamics() if control.full_dynamics else None
    law = HybridController(arm, control, dynamics=model).law
    felt, undoing = gauges(given, scenario.arm.contact_offset), ahead[:, np.newaxis]
    if isinstance(given, ForceSensorParams):
        undoing = np.array(given.undoing, np.float64)
    follow, first = np.zeros(n), -1
    if (compensation := scenario.friction_compensation) is not None:
        follow = compensation.follow(period) * compensation.compensated(n)
    if (kick := kick_of(scenario)) is not None:
        near = round(kick[0] / plant.period)
        first = next(j for j in range(near - 1, near + 2) if j * plant.period >= kick[0])

    def number(params: object, name: str) -> float:
        return float(known(name, getattr(params, name)))

    return _Loop(
        index,
        (world.chain, world.material, world.tool, contacts),
        (state, outputs),
        encoder_code(scenario.encoders, n, period=period),
        sensor_code(given, felt, step=plant.period, period=period),
        isinstance(given, LoadCellParams),
        undoing,
        task.code,
        (np.eye(n), position_selection(ahead)),
        task.force * ahead,
        unit(ahead),
        (number(scenario.detection, "detect"), number(scenario.detection, "release")),
        known("samples", scenario.detection.samples),
        law.code,
        law.start(),
        follow,
        (number(control, "computation_delay"), number(control, "computation_jitter")),
        (first, np.zeros(3) if kick is None else kick[1]),
        (plant.period, plant.step),
        (plant.held, plant.window),
    )


def _noise_of(scenario: HybridScenario, loop: _Loop, rows: int, seed: int) -> _Noise:
    """Return the outputs of the diagram's noise sources, in its order."""
    sensor, updates = loop.sensor, (rows - 1) * loop.counts[1]
    normal, uniform, channels = Random.kGaussian, Random.kUniform, len(sensor.bias)
    rough, jitter, scatter, drift = drawn_noise(
        (normal if scenario.surface.friction_noise else None, (updates + 1, 1)),
        (uniform if loop.delay[1] else None, (rows, 1)),
        (uniform if sensor.noise.any() else None, (rows, channels)),
        (normal if sensor.walk.any() else None, (rows, channels)),
        seed=seed,
    )
    return rough, jitter, scatter, drift


@compiled
def _run(loop: _Loop, noise: _Noise, rows: int) -> tuple[Array, bool]:
    """Return the loop's rows, one before each tick, and whether it runs to the end.

    At a tick controller, detection, compensation and delay act first, on what was before it and
    the noise of before; then arm, sensor and encoders go on, also from what was before it, with
    the torque and the noise of after.
    """
    sensor, chain, (update_time, step), (held, window) = (
        loop.sensor,
        loop.body[0],
        loop.times,
        loop.counts,
    )
    rough, jitter, scatter, drift = noise
    n, k = len(loop.ahead), len(sensor.bias)
    state, outputs, uneven = loop.start[0].copy(), loop.start[1].copy(), np.zeros(1)
    q, v, felt, base = state[:n], state[n : 2 * n], outputs[3:6], outputs[6 : 6 + n]
    still, none, walk, tare = np.zeros(n), np.zeros(3), np.zeros(k), np.zeros(k)
    before, line = counted(loop.encoders.quanta, q), np.zeros(k * sensor.rows)
    tracked, velocity, memory, estimate = before, still, loop.memory, still
    detect, release = loop.thresholds
    mode, beyond, contact_time, model = APPROACH, 0, -1.0, (np.zeros((n, n)), still)
    chain, material, tool, contacts = loop.body
    room = make_room(chain, material, tool, step)
    log = np.empty((rows, 7 * n + 10))
    for row in range(rows):
        time, reading, measured = row * loop.control.period, np.zeros(k), np.zeros(n)
        before, tracked, velocity = read_encoders(
            loop.encoders, q.copy(), v.copy(), before, tracked, velocity
        )
        if row >= sensor.tares:
            reading = converted(sensor, felt, line, walk, scatter[row]) - tare
        if loop.cell:
            add_product(loop.undoing, reading, measured)
        else:
            measured = force_in_world(chain, loop.undoing, reading, before, n)
        seen, touch, now = (before, velocity), outputs[6 + n : 12 + n], np.array([float(mode)])
        commanded = memory.torque, memory.position_error, memory.force_error, now
        log[row] = np.concatenate((q, v, *seen, outputs[:3], touch, *commanded))
        if row == rows - 1:
            break
        x, J = kinematics(loop.arm, before)
        if loop.control.full_dynamics:
            at = pose(chain, before)
            model = mass_matrix(chain, at), bias(chain, at, velocity)
        earlier = memory.torque + estimate
        estimate = friction_estimate(estimate, memory.torque, base, loop.follow)
        desired = guarded_position(loop.task, time, contact_time), still, loop.force
        P = loop.domains[0] if mode == APPROACH else loop.domains[1]
        memory, regular = control(
            loop.control, memory, (velocity, x, J), desired, measured, P, float(mode), model
        )
        if not (regular and np.isfinite(memory.torque).all() and np.isfinite(reading).all()):
            return log, False
        ends = _is_beyond(mode, push_along(loop.ahead, measured), detect, release)
        beyond = beyond + 1 if ends else 0
        if beyond == loop.samples:
            contact_time, beyond = time if mode == APPROACH else contact_time, 0
            mode = LOST if mode == CONTACT else CONTACT
        if row < sensor.tares:
            raw = converted(sensor, felt, line, walk, scatter[row + 1])
            tare = tare + (raw - tare) / (row + 1)
        walk = walk + sensor.walk * drift[row + 1]
        late = loop.delay[0] + loop.delay[1] * (2.0 * jitter[row + 1, 0] - 1.0)
        for part in range(window):
            count = row * window + part
            since = update_time * part
            torque = delayed(memory.torque + estimate, earlier, late, since, update_time)
            if sensor.rows:
                line = filtered(sensor, felt, line)[: len(line)]
            roughen(uneven, rough[count + 1], outputs, n, update_time)
            push = loop.kick[1] if count == loop.kick[0] else none
            fill_patch(contacts, outputs, uneven, n, update_time, room.patch)
            going = torque, push, part > 0, step, held
            _, unsolved = advance(chain, material, tool, room, state, outputs, *going)
            if unsolved:
                return log, False
    return log, True
