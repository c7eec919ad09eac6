"""Many alignments by sight at once, compiled: the arms linear about their rest posture.

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
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant

from chamfer.diagrams.cell.alignment import SHARES
from chamfer.diagrams.cell.cell_vision import VIEWS
from chamfer.diagrams.cell.work_cell import (
    STICKING,
    ArmName,
    CellArmSettings,
    WorkCellScenario,
    add_simulated_arm,
)
from chamfer.diagrams.insertion.insertion import ResolvedInsertionScenario
from chamfer.diagrams.servo.compiled_loop import compensate as fsm_step
from chamfer.systems.compiled import compiled
from chamfer.systems.force.desired_pose import compensate
from chamfer.systems.force.impedance_controller import ImpedanceController
from chamfer.systems.pose import pose_vector
from chamfer.systems.strategies.insertion_decision import SURE, InsertionRegion
from chamfer.systems.vision.cell_error import AXES, ImageClock

Array = NDArray[np.float64]

_STEP: Final = 1e-6  # rad, rad/s and m, of the finite differences
_NO_LIMIT: Final = 1e9  # N m
_SWEEPS: Final = 30  # of the friction's projected Gauss-Seidel iterations, at most
_NEAR_ENOUGH: Final = 1e-9  # N m, by which they still change it


class ArmLaw(NamedTuple):
    """An arm's impedance law about its rest posture: torques of n joints, limited afterwards."""

    rest: Array  # N m, at rest, shape (n,)
    q: Array  # N m/rad, shape (n, n)
    v: Array  # N m s/rad, shape (n, n)
    command: Array  # N m per m and rad along and about the hole's axes, shape (n, 6)
    rate: Array  # N m per m/s and rad/s, of the desired velocity, likewise
    jacobian: Array  # of the tool, m and rad in AXES' order, shape (6, n)


class ArmMass(NamedTuple):
    """What of an arm's plant is linear in the links' scale and the payload: bare, scale, kg."""

    mass: Array  # kg m^2, shape (3, n, n)
    gravity: Array  # N m, that holds it, shape (3, n)
    stiffness: Array  # N m/rad, its derivative, shape (3, n, n)
    damping: Array  # N m s/rad, of the joints, shape (n,)


@lru_cache(maxsize=64)
def arm_law(scenario: WorkCellScenario, arm: ArmName) -> ArmLaw:
    """Return the law's derivatives, by central differences."""
    settings: CellArmSettings = getattr(scenario, arm)
    n = settings.arm.num_joints
    params = replace(scenario.impedance, torque_limits=(_NO_LIMIT,) * n)
    posture = scenario.rest_posture(arm)
    model = settings.known_arm()
    controller = ImpedanceController(model, posture, params)
    pose = pose_vector(scenario.nominal_pose(arm))
    # A displacement along above one about the hole's axes, in the world's; spatial vectors have
    # their angular part first.
    axes = np.kron(np.eye(2), scenario.hole_axes.matrix())
    spatial = np.roll(axes, 3, axis=0)

    def torque(q: Array, v: Array, command: Array, rate: Array) -> Array:
        encoders = np.concatenate([posture + q, v])
        to = compensate(pose, axes @ command)
        found: Array = controller.step(pose, encoders, to, spatial @ rate)[:n]
        return found

    still = np.zeros(n), np.zeros(n), np.zeros(6), np.zeros(6)

    def derivative(which: int) -> Array:
        def along(moved: Array) -> Array:
            return torque(*still[:which], moved, *still[which + 1 :])

        return _jacobian(along, len(still[which]))

    J = np.roll(model.evaluate(posture).J_V_WT, 3, axis=0)
    return ArmLaw(torque(*still), *map(derivative, range(4)), axes.T @ J)


@lru_cache(maxsize=64)
def arm_mass(scenario: WorkCellScenario, arm: ArmName) -> ArmMass:
    """Return the simulated arm's mass, gravity and damping about its rest posture."""
    settings: CellArmSettings = getattr(scenario, arm)
    posture = scenario.rest_posture(arm)
    n = len(posture)
    smooth = replace(settings, joint_friction=(0.0,) * n, base_error=type(settings.base)())
    found = []
    for scale, payload in ((1.0, 0.0), (2.0, 0.0), (1.0, 1.0)):
        plant = MultibodyPlant(0.0)
        add_simulated_arm(plant, arm, replace(smooth, mass_scale=scale, payload_error=payload))
        plant.Finalize()
        context = plant.CreateDefaultContext()

        def gravity(
            moved: Array, plant: MultibodyPlant = plant, context: object = context
        ) -> Array:
            plant.SetPositions(context, posture + moved)
            return np.asarray(-plant.CalcGravityGeneralizedForces(context))

        stiffness, torque = _jacobian(gravity, n), gravity(np.zeros(n))
        found.append((plant.CalcMassMatrix(context), torque, stiffness))
        damping = [plant.get_joint(one).default_damping_vector() for one in plant.GetJointIndices()]
    both = [np.array(values) for values in zip(*found, strict=True)]
    # Of the scale and the kilogram: the differences.
    parts = [np.stack([2 * one[0] - one[1], one[1] - one[0], one[2] - one[0]]) for one in both]
    return ArmMass(*parts, np.concatenate(damping))


def _jacobian(function: Callable[[Array], Array], size: int) -> Array:
    steps = _STEP * np.eye(size)
    columns = [(function(step) - function(-step)) / (2 * _STEP) for step in steps]
    return np.column_stack(columns)


class Draws(NamedTuple):
    """What differs from trial to trial; D draws, arms in the scenario's order."""

    commanded: Array  # m and rad, the error of the peg's command, shape (D, 6)
    payload: Array  # kg, shape (D, arms)
    link_mass: Array  # scale, likewise
    friction: Array  # scale, likewise
    bias: Array  # measured minus true, m and rad, shape (D, 6)


class Alignments(NamedTuple):
    """What became of the draws."""

    decided: Array  # s, from the compensation's begin; infinite: there is no decision
    touch: Array  # true error, m and rad, as the tip comes to the mouth, shape (D, 6); else NaN
    force: Array  # N, most that the peg's springs pull with before the decision, then beyond it
    saturated: Array  # s, longest that a joint was at its torque limit
    course: Array  # true error at the controller's ticks, shape (D, ticks, 6)


@compiled
def pid_law(
    integral: float, last: float, error: float, gains: Array, period: float
) -> tuple[float, float]:
    """Return total and integral part of :func:`chamfer.systems.servo.sampled_pid.pid_step`."""
    proportional, per_second, derivative, limit = gains[0], gains[1], gains[2], gains[3]
    change = 0.0 if math.isnan(last) else (error - last) / period
    more = integral + per_second * error * period
    rest = proportional * error + derivative * change
    total = more + rest
    if abs(total) > limit and (more - integral) * total > 0:
        more = integral
    kept = max(-limit, min(limit, more))
    return max(-limit, min(limit, kept + rest)), kept


@compiled
def friction_torque(
    speed: Array, torque: Array, mobility: Array, most: Array, sticking: float, step: float
) -> None:
    """Add to joint speeds, (n,), what dry friction takes in a step; ``torque`` begins as the last.

    Each joint is held by a damper of ``sticking``, N m s/rad, up to its friction, by projected
    Gauss-Seidel iterations; ``mobility`` is the inverse mass, (n, n).
    """
    n = len(speed)
    for i in range(n):
        for k in range(n):
            speed[i] += step * mobility[i, k] * torque[k]
    for _ in range(30):
        change = 0.0
        for i in range(n):
            if most[i] == 0.0:
                continue
            own = step * mobility[i, i]
            free = speed[i] - own * torque[i]
            new = -sticking * free / (1.0 + sticking * own)
            new = max(-most[i], min(most[i], new))
            more = new - torque[i]
            if more != 0.0:
                torque[i] = new
                for k in range(n):
                    speed[k] += step * mobility[k, i] * more
                change = max(change, abs(more))
        if change < 1e-9:
            break


@compiled
def sure_margin(
    frames: Array, lateral: Array, tilt: Array, lateral_limit: float, tilt_limit: float
) -> float:
    """Return :meth:`InsertionRegion.sure_margin` of frames in m and rad, shape (k, 6)."""
    n = len(frames)
    size = np.zeros(2)
    spread = np.zeros(2)
    for group in range(2):
        for k in range(2):
            axis = 3 * group + 1 + k
            mean = 0.0
            for j in range(n):
                mean += frames[j, axis] / n
            size[group] += mean * mean
            for j in range(n):
                spread[group] += (frames[j, axis] - mean) ** 2 / max(n - 1, 1)
        size[group] = math.sqrt(size[group]) + 2.0 * math.sqrt(spread[group])
    allowed = np.interp(size[0], lateral, tilt)
    return min(1.0 - size[0] / lateral_limit, (allowed - size[1]) / tilt_limit)


@compiled
def run_draw(
    rest: Array,
    law_q: Array,
    law_v: Array,
    law_command: Array,
    law_rate: Array,
    jacobian: Array,
    limits: Array,
    mobility: Array,
    gravity: Array,
    gravity_slope: Array,
    damping: Array,
    friction: Array,
    sign: Array,
    share: Array,
    commanded: Array,
    start: Array,
    bias: Array,
    noise: Array,
    ages: Array,
    is_fsm: bool,
    gains: Array,
    springs: Array,
    lateral: Array,
    tilt: Array,
    numbers: Array,
    course: Array,
) -> Array:
    """Run one draw; see :func:`run_alignments` for what goes in."""
    (
        period, plant_step, tick, begin, sticking, frames_needed, margin, wait, timeout,
        pause, feed_speed, gap, frozen, lateral_limit, tilt_limit, kind,
    ) = numbers  # fmt: skip
    arms, n = rest.shape
    substeps = int(round(period / plant_step))
    ticks = len(noise)
    count = int(frames_needed)
    steps = int(math.ceil((begin + ticks * tick) / period)) + 1
    q, v, held = np.zeros((arms, n)), np.zeros((arms, n)), np.zeros((arms, n))
    torque, moved = np.zeros((arms, n)), np.zeros((arms, 6))
    at_limit, longest = 0.0, 0.0
    history = np.zeros((steps, 6))
    compensation, integral, last = np.zeros(6), np.zeros(6), np.full(6, np.nan)
    window, filled = np.zeros((count, 6)), 0
    decided, touched, done = math.inf, math.inf, 0
    tare, strongest, after = np.zeros(3), 0.0, 0.0
    result = np.full(10, np.nan)
    u, w, f = np.zeros(6), np.zeros(6), np.zeros(n)
    for i in range(steps):
        time = i * period
        for axis in range(6):
            history[i, axis] = start[axis]
            for arm in range(arms):
                history[i, axis] -= sign[arm] * moved[arm, axis]
        # The controller's ticks since the last step of the law, which reads them a step later.
        while done < ticks and begin + done * tick < time - 1e-9:
            now = begin + done * tick
            error = np.zeros(6)
            for axis in range(6):
                at = min(max((now - ages[done, axis]) / period, 0.0), float(i))
                low = min(int(at), i)
                high = min(low + 1, i)
                error[axis] = history[low, axis] + (at - low) * (
                    history[high, axis] - history[low, axis]
                )
                course[done, axis] = history[i, axis]
                error[axis] += bias[axis] + noise[done, axis]
            error[3] = 0.0
            feeding = decided < math.inf
            if not feeding:
                for k in range(count - 1):
                    window[k] = window[k + 1]
                window[count - 1] = error
                filled += 1
                if filled > count or (kind == 2.0 and filled > 1):
                    if kind == 0.0:
                        if (
                            sure_margin(window, lateral, tilt, lateral_limit, tilt_limit)
                            >= margin
                        ):
                            decided = now
                    elif kind == 2.0 or now - begin >= wait - 1e-9:
                        decided = now
                    if decided < math.inf:
                        touched = decided + pause + gap / feed_speed
                if decided == math.inf and now - begin > timeout:
                    result[0] = math.inf
                    break
            if not (feeding and frozen > 0.0):
                for axis in range(6):
                    if axis == 3 or (axis == 0 and feeding):
                        continue
                    if is_fsm:
                        compensation[axis] = fsm_step(
                            compensation[axis],
                            error[axis],
                            gains[axis, 0],
                            gains[axis, 1],
                            gains[axis, 2],
                            gains[axis, 3],
                            gains[axis, 4],
                        )[0]
                    else:
                        compensation[axis], integral[axis] = pid_law(
                            integral[axis], last[axis], error[axis], gains[axis], tick
                        )
                        last[axis] = error[axis]
            done += 1
        if result[0] == math.inf or time >= touched or done >= ticks:
            break
        fed = 0.0
        w[0] = 0.0
        if time > decided + pause:
            fed = feed_speed * (time - decided - pause)
            w[0] = feed_speed
        limited = False
        for arm in range(arms):
            for axis in range(6):
                u[axis] = share[arm] * compensation[axis]
                if arm == 0:
                    u[axis] += commanded[axis]
            if arm == 0:
                u[0] += fed
                load = 0.0
                for axis in range(3):
                    pull = springs[axis] * (u[axis] - moved[0, axis])
                    if decided == math.inf:
                        tare[axis] = pull
                    else:
                        pull -= tare[axis]
                    load += pull * pull
                if decided == math.inf:
                    strongest = max(strongest, math.sqrt(load))
                else:
                    after = max(after, math.sqrt(load))
            for j in range(n):
                value = rest[arm, j]
                for k in range(n):
                    value += law_q[arm, j, k] * q[arm, k] + law_v[arm, j, k] * v[arm, k]
                for k in range(6):
                    value += law_command[arm, j, k] * u[k]
                    if arm == 0:
                        value += law_rate[arm, j, k] * w[k]
                if abs(value) > limits[arm, j]:
                    value = math.copysign(limits[arm, j], value)
                    limited = True
                torque[arm, j] = value
        at_limit = at_limit + period if limited else 0.0
        longest = max(longest, at_limit)
        for arm in range(arms):
            for _ in range(substeps):
                for j in range(n):
                    f[j] = torque[arm, j] - gravity[arm, j] - damping[arm, j] * v[arm, j]
                    for k in range(n):
                        f[j] -= gravity_slope[arm, j, k] * q[arm, k]
                for j in range(n):
                    for k in range(n):
                        v[arm, j] += plant_step * mobility[arm, j, k] * f[k]
                friction_torque(
                    v[arm], held[arm], mobility[arm], friction[arm], sticking, plant_step
                )
                for j in range(n):
                    q[arm, j] += plant_step * v[arm, j]
            for axis in range(6):
                moved[arm, axis] = 0.0
                for j in range(n):
                    moved[arm, axis] += jacobian[arm, axis, j] * q[arm, j]
    result[0] = decided - begin
    result[1] = strongest
    result[2] = after
    result[3] = longest
    if touched < math.inf and done < ticks:
        result[4:] = history[i]
    return result


def run_alignments(
    scenario: ResolvedInsertionScenario,
    draws: Draws,
    *,
    start: Array,
    spread: Array,
    region: InsertionRegion,
    seed: int = 0,
    horizon: float | None = None,
) -> Alignments:
    """Run alignments up to the touch of tip and mouth.

    Args:
        scenario: Resolved.
        draws: What differs.
        start: True error, desired minus actual, that bases make, m and rad, shape (6,).
        spread: Standard deviation of a measurement, m and rad, shape (6,).
        region: Of the decision.
        seed: Of the measurement's noise.
        horizon: s, from the compensation's begin; None: as long as a decision and the feed take.
    """
    arms = scenario.arms
    alone = WorkCellScenario(
        **{name: getattr(scenario, name) for name in _OF_ARMS}, meeting_point=scenario.mouth
    )
    laws = [arm_law(alone, arm) for arm in arms]
    masses = [arm_mass(alone, arm) for arm in arms]
    n = max(len(law.rest) for law in laws)
    tick = scenario.cameras.frames.period
    insert, decide = scenario.insert, scenario.decide
    if horizon is None:
        waits = {"margin": decide.timeout, "wait": scenario.compensation_time, "at_once": 0.0}
        horizon = waits[decide.kind] + insert.pause + scenario.gap / insert.speed + 20 * tick
    ticks = math.ceil(horizon / tick)
    begin = scenario.peg_motion_ends
    begin = tick * math.ceil(begin / tick - 1e-6)
    controller = scenario.compensator if scenario.controller.kind == "fsm" else scenario.pid
    is_fsm = scenario.controller.kind == "fsm"
    names = (
        ("dead_zone", "large_error", "increment", "divider", "limit")
        if is_fsm
        else ("proportional", "integral", "derivative", "limit")
    )
    gains = np.array([[getattr(axis, name) for name in names] for axis in controller.axes])
    pixel = np.array([scenario.cameras.pixel_size] * 3 + [1.0] * 3)
    if is_fsm:
        gains[:, :2] *= pixel[:, np.newaxis]
    else:
        gains[:, :3] /= pixel[:, np.newaxis]
    numbers = np.array([
        scenario.impedance.period, scenario.step, tick, begin, STICKING, decide.frames,
        decide.margin, scenario.compensation_time, decide.timeout, insert.pause, insert.speed,
        scenario.gap, insert.compensation == "frozen", region.lateral_limit,
        region.rotation_limit, ("margin", "wait", "at_once").index(decide.kind),
    ], dtype=np.float64)  # fmt: skip
    shares = SHARES[scenario.compensated]
    generator = np.random.default_rng([seed, 1])
    count = len(draws.commanded)
    noise = generator.standard_normal((count, ticks, 6)) * spread
    fixed = (
        *(
            _padded([getattr(law, name) for law in laws], n, joints)
            for name, joints in zip(ArmLaw._fields, (1, 2, 2, 1, 1, -1), strict=True)
        ),
        _padded([_limits(alone, arm) for arm in arms], n),
    )
    scales = np.stack(
        [np.ones_like(draws.payload), draws.link_mass, draws.payload], axis=-1
    )  # (D, arms, 3)
    mobility = np.zeros((count, len(arms), n, n))
    gravity = np.zeros((count, len(arms), n))
    slope = np.zeros_like(mobility)
    friction = np.zeros_like(gravity)
    damping = _padded([mass.damping for mass in masses], n)
    for k, (arm, mass) in enumerate(zip(arms, masses, strict=True)):
        m = mass.gravity.shape[1]
        full = np.einsum("da,aij->dij", scales[:, k], mass.mass)
        full += scenario.step * np.diag(mass.damping)
        mobility[:, k, :m, :m] = np.linalg.inv(full)
        gravity[:, k, :m] = scales[:, k] @ mass.gravity
        slope[:, k, :m, :m] = np.einsum("da,aij->dij", scales[:, k], mass.stiffness)
        dry = np.array(getattr(scenario, arm).arm.dry_friction)
        friction[:, k, :m] = draws.friction[:, k, np.newaxis] * dry
    course = np.full((count, ticks, 6), np.nan)
    sign = np.array([1.0 if arm == "peg" else -1.0 for arm in arms])
    share = np.array([shares[arm] for arm in arms])
    ages = _ages(scenario, begin, ticks)
    springs = np.array(scenario.impedance.stiffness)
    found = np.array(
        [
            run_draw(
                *fixed,
                mobility[d],
                gravity[d],
                slope[d],
                damping,
                friction[d],
                sign,
                share,
                draws.commanded[d],
                start,
                draws.bias[d],
                noise[d],
                ages,
                is_fsm,
                gains,
                springs,
                region.lateral,
                region.tilt,
                numbers,
                course[d],
            )
            for d in range(count)
        ]
    )
    return Alignments(
        np.where(np.isnan(found[:, 4]), math.inf, found[:, 0]),
        found[:, 4:],
        found[:, 1:3],
        found[:, 3],
        course,
    )


_OF_ARMS: Final = ("peg", "hole", "impedance", "axis", "gap", "step")
_SEEN_BY: Final = {"x": "xz", "z": "xz", "pitch": "xz", "roll": "xz", "y": "xy", "yaw": "xy"}


def _ages(scenario: ResolvedInsertionScenario, begin: float, ticks: int) -> Array:
    """Return how old the image is that each axis is measured in at each tick, s, (ticks, 6)."""
    cameras, tick = scenario.cameras, scenario.cameras.frames.period
    clocks = {
        view: ImageClock(frames.period, frames.offset, cameras.delay(view))
        for view in VIEWS
        for frames in (cameras.frames_of(view),)
    }
    of_view = {
        view: [clock.age(begin + k * tick) for k in range(ticks)] for view, clock in clocks.items()
    }
    return np.array([of_view[_SEEN_BY[axis]] for axis in AXES]).T.copy()


def _limits(scenario: WorkCellScenario, arm: ArmName) -> Array:
    return scenario.impedance.limits(getattr(scenario, arm).arm)


def _padded(of_arms: list[Array], n: int, joints: int = 1) -> Array:
    """Stack what arms have; joints that an arm lacks, on the first or last axes, never move."""
    found = []
    for one in of_arms:
        pads = [(0, 0)] * one.ndim
        for k in range(abs(joints)):
            axis = k if joints > 0 else -1 - k
            pads[axis] = (0, n - one.shape[axis])
        found.append(np.pad(one, pads))
    return np.array(found)
