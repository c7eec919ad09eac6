"""Many alignments by vision at once, compiled: the arms linear about their rest posture.

Each arm is its joints: the simulated mass with payload and rotors, dry friction joint by joint as
the plant has it, and the impedance law as its controller samples and limits it, with what it
believes of the arm. The compensator, its cameras' period, age, bias and noise, the decision and
the feed up to the mouth are those of the diagram. Left out are contact, images, and what changes
with the posture. The oracle is the diagram itself, trial by trial.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant

from chamfer.diagrams.cell.alignment import SHARES, divergence_params
from chamfer.diagrams.cell.cell_vision import VIEWS
from chamfer.diagrams.cell.work_cell import (
    STICKING,
    ArmName,
    CellArmSettings,
    WorkCellScenario,
    add_simulated_arm,
)
from chamfer.diagrams.insertion.insertion import ResolvedInsertionScenario, task_params
from chamfer.diagrams.servo.compiled_loop import compensate as fsm_step
from chamfer.models.arms.serial_arm import SerialArm
from chamfer.systems.compiled import compiled
from chamfer.systems.force.impedance_controller import make_impedance_law
from chamfer.systems.force.tool_pose import compensate
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.divergence_law import TAKES_BACK
from chamfer.systems.servo.pid_law import pid_step
from chamfer.systems.strategies.insertion_decision import SURE
from chamfer.systems.vision.cell_error import AXES, ImageClock

Array = NDArray[np.float64]

_STEP: Final = 1e-6  # rad, rad/s and m, of the finite differences
_NO_LIMIT: Final = 1e9  # N m
_SWEEPS: Final = 30  # of the friction's projected Gauss-Seidel iterations, at most
_NEAR_ENOUGH: Final = 1e-5  # N m, by which they still change it
_TOUCH: Final = 20  # ticks, that a touch may be late
_FREE: Final = 1e-7  # from 1, of an eigenvalue: what nothing brings back, as the elbow may be
_KINDS: Final = ("margin", "wait", "at_once")  # of a decision, by number
_OF_LAW: Final = ((0,), (0, 1), (0, 1), (0,), (0,), (1,))  # axes of joints in an ArmLaw
_OF_PLANT: Final = ((1, 2), (1,), (1, 2), (1,), (0,))  # likewise in an ArmPlant
_SEEN_IN: Final = {"x": "xz", "z": "xz", "pitch": "xz", "roll": "xz", "y": "xy", "yaw": "xy"}

_pid_step = compiled(pid_step)


class ArmLaw(NamedTuple):
    """An arm's impedance law about its rest posture: torques of n joints, limited afterwards."""

    rest: Array  # N m, at rest, shape (n,)
    q: Array  # N m/rad, shape (n, n)
    v: Array  # N m s/rad, shape (n, n)
    command: Array  # N m per m and rad along and about the hole's axes, shape (n, 6)
    rate: Array  # N m per m/s and rad/s, of the desired velocity, likewise
    jacobian: Array  # of the tool, m and rad in AXES' order, shape (6, n)


class ArmMass(NamedTuple):
    """The part of an arm's plant that is linear in links' scale and payload: bare, scale, kg."""

    mass: Array  # kg m^2, shape (3, n, n)
    gravity: Array  # N m, that holds it, shape (3, n)
    stiffness: Array  # N m/rad, its derivative, shape (3, n, n)
    damping: Array  # N m s/rad, of the joints, shape (n,)


class Draws(NamedTuple):
    """The variation from trial to trial; D draws, arms in the scenario's order."""

    commanded: Array  # m and rad, the error of the peg's command, shape (D, 6)
    payload: Array  # kg, shape (D, arms)
    link_mass: Array  # scale, likewise
    friction: Array  # scale, likewise
    bias: Array  # measured minus true, m and rad, shape (D, 6)


class ArmPlant(NamedTuple):
    """One arm's drawn plants, of n joints."""

    mobility: Array  # 1/(kg m^2), inverse of the mass with the damping of a step, (D, n, n)
    gravity: Array  # N m, with what friction always takes, shape (D, n)
    stiffness: Array  # N m/rad, of gravity, shape (D, n, n)
    friction: Array  # N m, shape (D, n)
    damping: Array  # N m s/rad, shape (n,)


class Alignments(NamedTuple):
    """The results of the draws."""

    decided: Array  # s, from the compensation's begin; infinite: there is no decision
    touch: Array  # true error, m and rad, as the tip comes to the mouth, shape (D, 6); else NaN
    sure: Array  # lateral error, m, and tilt, rad, as sure as they were by the rule, (D, 2)
    reach: Array  # largest compensation, m and rad, shape (D, 2)
    force: Array  # N, most that the peg's springs pull with before the decision, (D,)
    push: Array  # N, most that they push with along the feed up to the mouth, tared, (D,)
    saturated: Array  # s, longest that a joint was at its torque limit
    course: Array  # true error at the controller's ticks, shape (D, ticks, 6)


@lru_cache(maxsize=64)
def arm_law(scenario: WorkCellScenario, arm: ArmName) -> ArmLaw:
    """Return the law's derivatives, by central differences."""
    settings: CellArmSettings = getattr(scenario, arm)
    n = settings.arm.num_joints
    params = replace(scenario.impedance, torque_limits=(_NO_LIMIT,) * n)
    posture = scenario.rest_posture(arm)
    model = settings.known_arm()
    law = make_impedance_law(model, posture, params)
    pose = pose_vector(scenario.nominal_pose(arm))
    # Displacements have their part along the hole's axes first, spatial vectors that about them.
    axes = np.kron(np.eye(2), scenario.hole_axes.matrix())
    spatial = np.roll(axes, 3, axis=0)

    def torque(q: Array, v: Array, command: Array, rate: Array) -> Array:
        encoders = np.concatenate([posture + q, v])
        to = compensate(pose, axes @ command)
        found: Array = law.torque(pose, encoders, to, spatial @ rate)[:n]
        return found

    rest, still = np.zeros(n), np.zeros(6)
    J = np.roll(model.evaluate(posture).J_V_WT, 3, axis=0)
    return ArmLaw(
        rest=torque(rest, rest, still, still),
        q=_jacobian(lambda q: torque(q, rest, still, still), n),
        v=_jacobian(lambda v: torque(rest, v, still, still), n),
        command=_jacobian(lambda command: torque(rest, rest, command, still), 6),
        rate=_jacobian(lambda rate: torque(rest, rest, still, rate), 6),
        jacobian=axes.T @ J,
    )


@lru_cache(maxsize=64)
def arm_mass(scenario: WorkCellScenario, arm: ArmName) -> ArmMass:
    """Return the simulated arm's mass, gravity and damping about its rest posture."""
    settings: CellArmSettings = getattr(scenario, arm)
    posture = scenario.rest_posture(arm)
    n = len(posture)
    smooth = replace(settings.with_friction(0.0), base_error=type(settings.base)())
    found = []
    for scale, payload in ((1.0, 0.0), (2.0, 0.0), (1.0, 1.0)):
        plant = MultibodyPlant(0.0)
        add_simulated_arm(plant, arm, replace(smooth, mass_scale=scale, payload_error=payload))
        plant.Finalize()
        context = plant.CreateDefaultContext()

        def gravity(moved: Array, plant: MultibodyPlant = plant, context: Any = context) -> Array:
            plant.SetPositions(context, posture + moved)
            return np.asarray(-plant.CalcGravityGeneralizedForces(context))

        stiffness, torque = _jacobian(gravity, n), gravity(np.zeros(n))  # there at last
        found.append((np.asarray(plant.CalcMassMatrix(context)), torque, stiffness))
        damping = [
            plant.get_joint(one).default_damping_vector() for one in plant.GetJointIndices()
        ]
    bare, heavy, loaded = found
    # Of the scale and the kilogram: the differences.
    parts = (
        np.stack([2 * a - b, b - a, c - a]) for a, b, c in zip(bare, heavy, loaded, strict=True)
    )
    return ArmMass._make((*parts, np.concatenate(damping)))


def _jacobian(function: Callable[[Array], Array], size: int) -> Array:
    steps = _STEP * np.eye(size)
    columns = [(function(step) - function(-step)) / (2 * _STEP) for step in steps]
    return np.column_stack(columns)


def arm_plant(scenario: ResolvedInsertionScenario, arm: ArmName, draws: Draws) -> ArmPlant:
    """Return the drawn plants of one arm."""
    own, k = arm_mass(arms_alone(scenario), arm), scenario.arms.index(arm)
    scales = np.column_stack(
        [np.ones(len(draws.payload)), draws.link_mass[:, k], draws.payload[:, k]]
    )
    mass = np.tensordot(scales, own.mass, 1) + scenario.step * np.diag(own.damping)
    one: SerialArm = getattr(scenario, arm).arm
    return ArmPlant(
        np.asarray(np.linalg.inv(mass), np.float64),
        scales @ own.gravity + np.outer(draws.friction[:, k], one.friction_bias),
        np.tensordot(scales, own.stiffness, 1),
        np.outer(draws.friction[:, k], one.dry_friction),
        own.damping,
    )


def arms_alone(scenario: ResolvedInsertionScenario) -> WorkCellScenario:
    """Return the part of a scenario that determines the arms and their controllers."""
    names = ("peg", "hole", "impedance", "axis", "gap", "step")
    own: dict[str, Any] = {name: getattr(scenario, name) for name in names}
    return WorkCellScenario(**own, meeting_point=scenario.mouth)


def growth(scenario: ResolvedInsertionScenario, draws: Draws, *, late: bool = False) -> float:
    """Return the largest eigenvalue's modulus of the sampled impedance loops, a period, at rest.

    Without dry friction, which holds a joint up to some kick; of all drawn plants and arms, but
    for what nothing brings back. The torque is held over the period; ``late``: one period longer.
    """
    impedance, largest = scenario.impedance, 0.0
    for arm in scenario.arms:
        law, plant = arm_law(arms_alone(scenario), arm), arm_plant(scenario, arm, draws)
        count, n = plant.gravity.shape
        h, steps = scenario.step, round(impedance.period / scenario.step)
        # A step of [q, v, torque]: v before q.
        step = np.zeros((count, 3 * n, 3 * n))
        step[:, n : 2 * n, :n] = -h * plant.mobility @ plant.stiffness
        step[:, n : 2 * n, n : 2 * n] = np.eye(n) - h * plant.mobility @ np.diag(plant.damping)
        step[:, n : 2 * n, 2 * n :] = h * plant.mobility
        step[:, :n] = np.eye(n, 3 * n) + h * step[:, n : 2 * n]
        step[:, 2 * n :, 2 * n :] = np.eye(n)
        law_of_state = np.hstack([law.q, law.v, np.zeros((n, n))])
        period = np.linalg.matrix_power(step, steps)
        if late:
            period[:, 2 * n :] = law_of_state
        else:
            period = period[:, : 2 * n] @ np.vstack([np.eye(2 * n, 3 * n), law_of_state])
            period = period[:, :, : 2 * n]
        size = np.abs(np.linalg.eigvals(period))
        largest = max(largest, float(size[np.abs(size - 1) > _FREE].max(initial=0.0)))
    return largest


class _Laws(NamedTuple):
    """The arms' laws, one behind the other, with joints that never move where one has fewer."""

    rest: Array
    q: Array
    v: Array
    command: Array
    rate: Array
    jacobian: Array
    limits: Array  # N m, shape (arms, n)
    sign: Array  # of the tool's motion in minus the error, shape (arms,)
    share: Array  # of the compensation


class _Compensator(NamedTuple):
    is_fsm: bool
    gains: Array  # of each axis, for errors in m and rad, shape (5, 6) or (4, 6)
    limits: Array  # m and rad, of the compensation, shape (6,)
    ages: Array  # s, of the image of each axis at each tick, shape (ticks, 6)
    springs: Array  # N/m, of the peg's arm, shape (3,)
    lateral: Array  # m, of the region
    tilt: Array  # rad, allowed there
    grows_from: Array  # m and rad, the least starts of the divergence watch, shape (2,)


class _Numbers(NamedTuple):
    period: float  # s, of the impedance law
    step: float  # s
    tick: float  # s, of the cameras and the compensator
    begin: float  # s
    kind: int  # of the decision
    frames: int
    margin: float
    wait: float  # s
    timeout: float  # s
    pause: float  # s
    speed: float  # m/s
    gap: float  # m
    frozen: bool
    hold: float  # N, beyond which nothing is compensated
    push: float  # N, with which the peg is stuck
    most_force: float  # N, with which all stops
    most_saturated: float  # s
    grows: float  # of its start, beyond which an error has grown
    grown_frames: int  # that have to say so
    lateral_limit: float  # m
    tilt_limit: float  # rad


@compiled
def friction_torque(
    speed: Array, torque: Array, mobility: Array, most: Array, sticking: float, step: float
) -> None:
    """Apply a step's dry friction to joint speeds, (n,); ``torque`` begins as the last.

    Each joint is held by a damper of ``sticking``, N m s/rad, up to its friction, by projected
    Gauss-Seidel iterations; ``mobility`` is the inverse mass, (n, n).
    """
    n = len(speed)
    for i in range(n):
        for k in range(n):
            speed[i] += step * mobility[i, k] * torque[k]
    for _ in range(_SWEEPS):
        change = 0.0
        for i in range(n):
            if most[i] == 0.0:
                continue
            own = step * mobility[i, i]
            free = speed[i] - own * torque[i]
            new = max(-most[i], min(most[i], -sticking * free / (1.0 + sticking * own)))
            more = new - torque[i]
            if more != 0.0:
                torque[i] = new
                for k in range(n):
                    speed[k] += step * mobility[k, i] * more
                change = max(change, abs(more))
        if change < _NEAR_ENOUGH:
            break


@compiled
def sure_errors(frames: Array) -> tuple[float, float]:
    """Return upper bounds of lateral error and tilt from frames, (k, 6).

    As :func:`chamfer.systems.strategies.insertion_decision.measured_errors`: size of the mean plus
    twice the standard deviation.
    """
    n = len(frames)
    size, spread = np.zeros(2), np.zeros(2)
    for group in range(2):
        for axis in range(3 * group + 1, 3 * group + 3):
            mean = 0.0
            for j in range(n):
                mean += frames[j, axis] / n
            size[group] += mean * mean
            for j in range(n):
                spread[group] += (frames[j, axis] - mean) ** 2 / max(n - 1, 1)
    sure = np.sqrt(size) + SURE * np.sqrt(spread)
    return sure[0], sure[1]


@compiled
def run_draw(
    laws: _Laws,
    law: _Compensator,
    numbers: _Numbers,
    plant: ArmPlant,
    commanded: Array,
    start: Array,
    bias: Array,
    noise: Array,
    course: Array,
) -> Array:
    """Run one draw; :func:`run_alignments` lists inputs and outputs."""
    arms, n = laws.rest.shape
    period, step, tick, begin = numbers.period, numbers.step, numbers.tick, numbers.begin
    ticks, substeps = len(noise), round(period / step)
    steps = math.ceil((begin + ticks * tick) / period) + 1
    q, v, held = np.zeros((arms, n)), np.zeros((arms, n)), np.zeros((arms, n))
    torque, moved, history = np.zeros((arms, n)), np.zeros((arms, 6)), np.zeros((steps, 6))
    compensation, integral, last = np.zeros(6), np.zeros(6), np.full(6, np.nan)
    window, filled, best = np.zeros((numbers.frames, 6)), 0, -math.inf
    decided, touched, over, done = math.inf, math.inf, False, 0
    tare, at_limit, pulled = np.zeros(3), 0.0, 0.0
    grows_from, diverging = np.zeros(2), 0.0
    result = np.full(14, np.nan)
    result[1:6], result[6:8] = 0.0, math.inf
    error, u, w, f = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(n)
    i = 0
    while i < steps:
        time = i * period
        for axis in range(6):
            history[i, axis] = start[axis]
            for arm in range(arms):
                history[i, axis] -= laws.sign[arm] * moved[arm, axis]
        # The controller's ticks since the last step of the law, which reads them a step later.
        while done < ticks and begin + done * tick < time - 1e-9 and not over:
            now = begin + done * tick
            for axis in range(6):
                at = min(max((now - law.ages[done, axis]) / period, 0.0), float(i))
                low = min(int(at), i)
                high = min(low + 1, i)
                seen = history[low, axis] + (at - low) * (history[high, axis] - history[low, axis])
                error[axis] = seen + bias[axis] + noise[done, axis]
                course[done, axis] = history[i, axis]
            error[3] = 0.0
            grown = False
            for group in range(2):
                size = math.hypot(error[3 * group + 1], error[3 * group + 2])
                if done == 0:
                    grows_from[group] = numbers.grows * max(size, law.grows_from[group])
                grown = grown or size > grows_from[group]
            diverging = max(diverging + (1.0 if grown else -TAKES_BACK), 0.0)
            over = over or diverging >= numbers.grown_frames
            feeding = decided < math.inf
            if not feeding:
                window[:-1] = window[1:].copy()
                window[-1] = error
                filled += 1
                if filled > numbers.frames or (numbers.kind == 2 and filled > 1):
                    first = window[-1:] if numbers.kind == 2 else window
                    lateral, tilt = sure_errors(first)
                    allowed = np.interp(lateral, law.lateral, law.tilt)
                    margin = min(
                        1.0 - lateral / numbers.lateral_limit,
                        (allowed - tilt) / numbers.tilt_limit,
                    )
                    late = now - begin >= numbers.wait - 1e-9
                    if (
                        numbers.kind == 2
                        or (numbers.kind == 1 and late)
                        or (numbers.kind == 0 and margin >= numbers.margin)
                    ):
                        decided = now
                        touched = decided + numbers.pause + numbers.gap / numbers.speed
                    if margin > best or decided < math.inf:
                        best = margin
                        result[6], result[7] = lateral, tilt
                over = over or (decided == math.inf and now - begin > numbers.timeout)
            held_back = feeding and (numbers.frozen or pulled >= numbers.hold)
            totals, integrals = compensation, integral
            if not law.is_fsm:
                totals, integrals = _pid_step(integral, last, error, law.gains, tick)
            for axis in range(6):
                if axis == 3 or held_back or (axis == 0 and feeding):
                    continue
                if law.is_fsm:
                    of = law.gains[:, axis]
                    compensation[axis] = fsm_step(
                        compensation[axis], error[axis], of[0], of[1], of[2], of[3], of[4]
                    )[0]
                else:
                    compensation[axis], integral[axis] = totals[axis], integrals[axis]
                    last[axis] = error[axis]
                size = abs(compensation[axis])
                result[4 + axis // 3] = max(result[4 + axis // 3], size)
                over = over or size >= law.limits[axis]
            done += 1
        over = over or at_limit > numbers.most_saturated
        over = over or result[2] >= numbers.push or pulled > numbers.most_force
        if over or time >= touched or done >= ticks:
            break
        fed = max(0.0, numbers.speed * (time - decided - numbers.pause))
        w[0] = numbers.speed if fed > 0.0 else 0.0
        limited = False
        for arm in range(arms):
            for axis in range(6):
                u[axis] = laws.share[arm] * compensation[axis]
                if laws.sign[arm] > 0:
                    u[axis] += commanded[axis]
            if laws.sign[arm] > 0:
                u[0] += fed
                load = 0.0
                for axis in range(3):
                    pull = law.springs[axis] * (u[axis] - moved[arm, axis])
                    if decided == math.inf:
                        tare[axis] = pull
                    else:
                        pull -= tare[axis]
                        if axis == 0:
                            result[2] = max(result[2], pull)
                    load += pull * pull
                pulled = math.sqrt(load)
                if decided == math.inf:
                    result[1] = max(result[1], pulled)
            for j in range(n):
                value = laws.rest[arm, j]
                for k in range(n):
                    value += laws.q[arm, j, k] * q[arm, k] + laws.v[arm, j, k] * v[arm, k]
                for k in range(6):
                    value += laws.command[arm, j, k] * u[k]
                    if laws.sign[arm] > 0:
                        value += laws.rate[arm, j, k] * w[k]
                if abs(value) > laws.limits[arm, j]:
                    value = math.copysign(laws.limits[arm, j], value)
                    limited = True
                torque[arm, j] = value
        at_limit = at_limit + period if limited else 0.0
        result[3] = max(result[3], at_limit)
        for arm in range(arms):
            for _ in range(substeps):
                for j in range(n):
                    f[j] = torque[arm, j] - plant.gravity[arm, j]
                    f[j] -= plant.damping[arm, j] * v[arm, j]
                    for k in range(n):
                        f[j] -= plant.stiffness[arm, j, k] * q[arm, k]
                for j in range(n):
                    for k in range(n):
                        v[arm, j] += step * plant.mobility[arm, j, k] * f[k]
                mobility = plant.mobility[arm]
                friction_torque(v[arm], held[arm], mobility, plant.friction[arm], STICKING, step)
                for j in range(n):
                    q[arm, j] += step * v[arm, j]
            for axis in range(6):
                moved[arm, axis] = 0.0
                for j in range(n):
                    moved[arm, axis] += laws.jacobian[arm, axis, j] * q[arm, j]
        i += 1
    result[0] = math.inf
    if touched < math.inf and not over and done < ticks:
        result[0] = decided - begin
        result[8:] = history[i]
    return result


def run_alignments(
    scenario: ResolvedInsertionScenario,
    draws: Draws,
    *,
    start: Array,
    spread: Array,
    seed: int = 0,
    horizon: float | None = None,
) -> Alignments:
    """Run alignments up to the touch of tip and mouth.

    Args:
        scenario: Resolved.
        draws: What differs.
        start: True error, desired minus actual, that bases make, m and rad, shape (6,).
        spread: Standard deviation of a measurement, m and rad, shape (6,).
        seed: Of the measurement's noise.
        horizon: s, from the compensation's begin; None: as long as a decision and the feed take.
    """
    params, tick = task_params(scenario), scenario.cameras.frames.period
    decide, insert, watch = params.decide, params.insert, divergence_params(scenario)
    if horizon is None:
        waits = {"margin": decide.timeout, "wait": params.wait, "at_once": 0.0}
        horizon = waits[decide.kind] + insert.pause + params.gap / insert.speed + _TOUCH * tick
    ticks = math.ceil(horizon / tick)
    numbers = _Numbers(
        period=scenario.impedance.period,
        step=scenario.step,
        tick=tick,
        begin=tick * math.ceil(params.begin / tick - 1e-6),
        kind=_KINDS.index(decide.kind),
        frames=decide.frames,
        margin=float(decide.margin),
        wait=float(params.wait),
        timeout=float(decide.timeout),
        pause=float(insert.pause),
        speed=float(insert.speed),
        gap=float(params.gap),
        frozen=insert.compensation == "frozen",
        hold=float(insert.hold_force),
        push=float(insert.push),
        most_force=float(insert.force_limit),
        most_saturated=params.most_saturated,
        grows=watch.factor,
        grown_frames=watch.frames,
        lateral_limit=params.region.lateral_limit,
        tilt_limit=params.region.rotation_limit,
    )
    arms, count = scenario.arms, len(draws.commanded)
    plants = [arm_plant(scenario, arm, draws) for arm in arms]
    plant = ArmPlant._make(
        _padded([getattr(one, name) for one in plants], *axes)
        for name, axes in zip(ArmPlant._fields, _OF_PLANT, strict=True)
    )
    noise = np.random.default_rng([seed, 1]).standard_normal((count, ticks, 6)) * spread
    course = np.full((count, ticks, 6), np.nan)
    laws, law = _laws(scenario), _compensator(scenario, numbers.begin, ticks)
    found = np.array(
        [
            run_draw(
                laws,
                law,
                numbers,
                ArmPlant._make((*(one[:, d] for one in plant[:-1]), plant.damping)),
                draws.commanded[d],
                start,
                draws.bias[d],
                noise[d],
                course[d],
            )
            for d in range(count)
        ]
    )
    return Alignments(
        decided=found[:, 0],
        touch=found[:, 8:],
        sure=found[:, 6:8],
        reach=found[:, 4:6],
        force=found[:, 1],
        push=found[:, 2],
        saturated=found[:, 3],
        course=course,
    )


def _laws(scenario: ResolvedInsertionScenario) -> _Laws:
    alone, arms = arms_alone(scenario), scenario.arms
    laws = [arm_law(alone, arm) for arm in arms]
    shares = SHARES[scenario.compensated]
    limits = [scenario.impedance.limits(getattr(scenario, arm).arm.torque_limits) for arm in arms]
    padded = (
        _padded([getattr(law, name) for law in laws], *axes)
        for name, axes in zip(ArmLaw._fields, _OF_LAW, strict=True)
    )
    sign = np.array([1.0 if arm == "peg" else -1.0 for arm in arms])
    return _Laws._make(
        (*padded, _padded(limits, 0), sign, np.array([shares[arm] for arm in arms]))
    )


def _compensator(scenario: ResolvedInsertionScenario, begin: float, ticks: int) -> _Compensator:
    is_fsm, region = scenario.controller.kind == "fsm", task_params(scenario).region
    names = (
        ("dead_zone", "large_error", "increment", "divider", "limit")
        if is_fsm
        else ("proportional", "integral", "derivative", "limit")
    )
    axes = (scenario.compensator if is_fsm else scenario.pid).axes
    gains = np.array([[getattr(axis, name) for axis in axes] for name in names], np.float64)
    pixel = np.array([scenario.cameras.pixel_size] * 3 + [1.0] * 3)
    if is_fsm:
        gains[:2] *= pixel
    else:
        gains[:3] /= pixel
    return _Compensator(
        is_fsm,
        gains,
        gains[-1].copy(),
        _ages(scenario, begin, ticks),
        np.array(scenario.impedance.stiffness, np.float64),
        region.lateral,
        region.tilt,
        np.array([one.least for one in divergence_params(scenario).watched]) * pixel[[0, 3]],
    )


def _ages(scenario: ResolvedInsertionScenario, begin: float, ticks: int) -> Array:
    """Return how old the image is that each axis is measured in at each tick, s, (ticks, 6)."""
    cameras = scenario.cameras
    of_view: dict[str, list[float]] = {}
    for view in VIEWS:
        frames = cameras.frames_of(view)
        clock = ImageClock(frames.period, frames.offset, cameras.delay(view))
        tick = cameras.frames.period
        of_view[view] = [clock.age(begin + k * tick) for k in range(ticks)]
    return np.column_stack([of_view[_SEEN_IN[axis]] for axis in AXES])


def _padded(of_arms: list[Array], *axes: int) -> Array:
    """Stack what arms have; along the axes of joints, those that an arm lacks never move."""
    n = max(one.shape[axes[0]] for one in of_arms)
    found = []
    for one in of_arms:
        pads = np.zeros((one.ndim, 2), dtype=int)
        pads[list(axes), 1] = n - one.shape[axes[0]]
        found.append(np.pad(one, pads))
    return np.array(found)
