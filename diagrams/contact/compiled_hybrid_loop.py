"""The hybrid loop of Fig. 2-4 as machine code: for runs, sweeps and campaigns.

What :func:`chamfer.diagrams.contact.hybrid_loop.make_hybrid_diagram` does with its own controller,
at the same times and with the same seed. The diagram is the reference. Controller, detection,
motion, sensors, delay and arm are the blocks' own functions, compiled; written a second time is
the wiring, and in which order things happen at a tick.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import RandomSource

from chamfer.diagrams.contact.hybrid_loop import kick_of
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.models.validation import known
from chamfer.systems.compiled import add_product, compiled
from chamfer.systems.contact.arm_dynamics import Chain, bias, mass_matrix, pose
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.contact.arm_motion import Contacts, Tool, roughen, update
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
from chamfer.systems.force.hybrid_law import HybridCode, HybridLaw, HybridMemory, control
from chamfer.systems.force.projection import position_selection, unit
from chamfer.systems.force.surface_motion import GuardedCode, guarded_position
from chamfer.systems.recording import active
from chamfer.systems.sensing.computation_delay import delayed
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

_push_along = compiled(push_along)
_is_beyond = compiled(is_beyond)


class _Loop(NamedTuple):
    """A resolved scenario with an arm of n joints, and a sensor of k channels."""

    arm: int  # of :func:`kinematics`
    chain: Chain
    material: Material
    tool: Tool
    contacts: Contacts
    state: Array  # of :func:`update`, as are the outputs, both at rest
    outputs: Array
    encoders: EncoderCode
    sensor: SensorCode
    cell: bool  # True: a load cell
    undoing: Array  # (3, k) of a wrist sensor; (n, 1) of a load cell, its push
    task: GuardedCode
    touching: Array  # (n, n), position domain in contact
    force: Array  # (n,), N, desired
    ahead: Array  # (n,), unit, of the push
    detect: float  # N
    release: float  # N
    samples: int
    control: HybridCode
    memory: HybridMemory
    follow: Array  # (n,), of the friction compensation; 0 for none
    delay: float  # s
    jitter: float  # s
    kicked: int  # the update in which the arm is pushed; -1 for none
    kick: Array  # (3,), N
    update: float  # s, of the arm
    step: float  # s, in it
    held: int  # steps in an update
    window: int  # updates in a period


class _Noise(NamedTuple):
    """Samples, before each tick or, of friction, each update, and the one after the last."""

    friction: Array  # (updates + 1, 1), as long as there are no such samples zeros
    jitter: Array  # (ticks + 1, 1)
    sensor: Array  # (ticks + 1, k)
    drift: Array  # (ticks + 1, k)


def run_compiled(scenario: HybridScenario, seed: int) -> dict[str, Array] | None:
    """Return what the diagram of a resolved scenario exports, a row a period.

    None if only the diagram can do it: with another arm or surface than the built-in ones or while
    laws are recorded, and if the run ends early: the diagram says why.
    """
    loop = None if active() else _loop_of(scenario)
    if loop is None:
        return None
    rows = count_samples(scenario.duration, scenario.controller.period)
    log, complete = _run(loop, _noise_of(scenario, loop, rows, seed), rows)
    if not complete:
        return None
    n = scenario.ARM.num_joints
    sizes = {"encoders": 2 * n, "measured_encoders": 2 * n, "contact_force": 3, "contact": 6}
    sizes |= {"torque": n, "position_error": n, "force_error": n, "mode": 1}
    parts = np.split(log, np.cumsum([*sizes.values()])[:-1], axis=1)
    outputs = dict(zip(sizes, parts, strict=True))
    return outputs | {"mode": log[:, -1]}


def _loop_of(scenario: HybridScenario) -> _Loop | None:
    arm, task, settings = scenario.ARM, scenario.task, scenario.controller
    n, plant, period = arm.num_joints, scenario.plant, settings.period
    start = scenario.joint_positions(np.array(task.start))
    world, state, outputs = ArmInContact(arm, scenario.make_surface(), plant, start).start()
    index, detection, given = arm_index(arm), scenario.detection, scenario.sensor
    if index is None or world.contacts is None:
        return None
    law = HybridLaw(
        arm, settings, dynamics=scenario.dynamics().evaluate if settings.full_dynamics else None
    )
    felt = gauges(given, scenario.arm.contact_offset)
    cell, compensation = isinstance(given, LoadCellParams), scenario.friction_compensation
    undoing = scenario.direction[:, np.newaxis]
    if isinstance(given, ForceSensorParams):
        undoing = np.array(given.undoing, np.float64)
    follow, kick = np.zeros(n), kick_of(scenario)
    if compensation is not None:
        follow = compensation.follow(period) * compensation.compensated(n)
    first = -1
    if kick is not None:
        near = round(kick[0] / plant.period)
        first = next(j for j in range(near - 1, near + 2) if j * plant.period >= kick[0])
    return _Loop(
        index,
        world.chain,
        world.material,
        world.tool,
        world.contacts,
        state,
        outputs,
        encoder_code(scenario.encoders, n, period=period),
        sensor_code(given, felt, step=plant.period, period=period),
        cell,
        undoing,
        task.code,
        position_selection(scenario.direction),
        task.force * scenario.direction,
        unit(scenario.direction),
        float(known("detect", detection.detect)),
        float(known("release", detection.release)),
        known("samples", detection.samples),
        law.code,
        law.start(),
        follow,
        float(known("computation_delay", settings.computation_delay)),
        float(known("computation_jitter", settings.computation_jitter)),
        first,
        np.zeros(3) if kick is None else kick[1],
        plant.period,
        plant.step,
        plant.held,
        plant.window,
    )


def _noise_of(scenario: HybridScenario, loop: _Loop, rows: int, seed: int) -> _Noise:
    """Return what the diagram's noise sources show."""
    k, normal = len(loop.sensor.bias), RandomDistribution.kGaussian
    uniform = RandomDistribution.kUniform
    builder, updates = DiagramBuilder(), (rows - 1) * loop.window
    # Drake hands one generator from source to source, of which each takes a seed of its own; one
    # that draws all its samples at once draws the same ones. In the order of the diagram:
    sources = [
        (bool(scenario.surface.friction_noise), normal, updates + 1, 1),
        (loop.jitter > 0, uniform, rows, 1),
        (bool(loop.sensor.noise.any()), uniform, rows, k),
        (bool(loop.sensor.walk.any()), normal, rows, k),
    ]
    found = [
        builder.AddSystem(RandomSource(kind, count * size, 1.0)) if there else None
        for there, kind, count, size in sources
    ]
    if not any(found):
        return _Noise(*(np.zeros((count, size)) for *_, count, size in sources))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    return _Noise(
        *(
            np.zeros((count, size))
            if source is None
            else source.get_output_port()
            .Eval(source.GetMyContextFromRoot(context))
            .reshape(count, size)
            .copy()
            for source, (*_, count, size) in zip(found, sources, strict=True)
        )
    )


@compiled
def _run(loop: _Loop, noise: _Noise, rows: int) -> tuple[Array, bool]:
    """Return what the loop does, a row before each tick, and whether it goes on to the end.

    At a tick controller, detection, compensation and delay act first, on what was before it and
    the noise of before; then arm, sensor and encoders go on, also from what was before it, with
    the torque and the noise of after.
    """
    period, n, k = loop.control.period, len(loop.ahead), len(loop.sensor.bias)
    state, outputs, uneven = loop.state.copy(), loop.outputs.copy(), np.zeros(1)
    q, v, base = state[:n], state[n : 2 * n], outputs[6 : 6 + n]
    push, still, free = np.zeros(3), np.zeros(n), np.eye(n)
    before = counted(loop.encoders.quanta, q)
    tracked, velocity = before, still
    line, walk, tare = np.zeros(k * loop.sensor.rows), np.zeros(k), np.zeros(k)
    memory, estimate, earlier = loop.memory, still, still
    mode, beyond, contact_time = APPROACH, 0, -1.0
    mass, slow = np.zeros((n, n)), still
    log = np.empty((rows, 7 * n + 10))
    for row in range(rows):
        time, now = row * period, log[row]
        read = read_encoders(loop.encoders, q, v, before, tracked, velocity)
        shown, speed = read[0].copy(), read[2].copy()
        reading, measured = np.zeros(k), np.zeros(n)
        if row >= loop.sensor.tares:
            reading = converted(loop.sensor, outputs[3:6], line, walk, noise.sensor[row]) - tare
        if loop.cell:
            add_product(loop.undoing, reading, measured)
        else:
            measured = force_in_world(loop.chain, loop.undoing, reading, shown, n)
        now[: 2 * n] = state[: 2 * n]
        now[2 * n : 3 * n], now[3 * n : 4 * n] = shown, speed
        now[4 * n : 4 * n + 3] = outputs[:3]
        now[4 * n + 3 : 4 * n + 9] = outputs[6 + n : 12 + n]
        now[4 * n + 9 : 5 * n + 9] = memory.torque
        now[5 * n + 9 : 6 * n + 9], now[6 * n + 9 : 7 * n + 9] = memory[6], memory[7]
        now[7 * n + 9] = mode
        if row == rows - 1:
            break
        x, J = kinematics(loop.arm, shown)
        if loop.control.full_dynamics:
            at = pose(loop.chain, shown)
            mass, slow = mass_matrix(loop.chain, at), bias(loop.chain, at, speed)
        earlier = memory.torque + estimate
        estimate = friction_estimate(estimate, memory.torque, base, loop.follow)
        desired = guarded_position(loop.task, time, contact_time)
        P = free if mode == APPROACH else loop.touching
        memory, regular = control(
            loop.control,
            memory,
            speed,
            x,
            J,
            desired,
            still,
            loop.force,
            measured,
            P,
            float(mode),
            mass,
            slow,
        )
        if not (regular and np.isfinite(memory.torque).all() and np.isfinite(reading).all()):
            return log, False
        if _is_beyond(mode, _push_along(loop.ahead, measured), loop.detect, loop.release):
            beyond += 1
        else:
            beyond = 0
        if beyond == loop.samples:
            contact_time, beyond = time if mode == APPROACH else contact_time, 0
            mode = LOST if mode == CONTACT else CONTACT
        if row < loop.sensor.tares:
            raw = converted(loop.sensor, outputs[3:6], line, walk, noise.sensor[row + 1])
            tare += (raw - tare) / (row + 1)
        walk = walk + loop.sensor.walk * noise.drift[row + 1]
        before, tracked, velocity = shown, read[1].copy(), speed
        command = memory.torque + estimate
        late = loop.delay + loop.jitter * (2.0 * noise.jitter[row + 1, 0] - 1.0)
        for part in range(loop.window):
            which = row * loop.window + part
            torque = delayed(command, earlier, late, loop.update * part, loop.update)
            line = filtered(loop.sensor, outputs[3:6], line)[: len(line)]
            roughen(uneven, noise.friction[which + 1], outputs, n, loop.update)
            _, unsolved = update(
                loop.chain,
                loop.material,
                loop.tool,
                loop.contacts,
                state,
                outputs,
                uneven,
                torque,
                loop.kick if which == loop.kicked else push,
                part > 0,
                loop.step,
                loop.held,
            )
            if unsolved or not np.isfinite(state).all():
                return log, False
    return log, True
