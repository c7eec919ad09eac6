"""Prediction of the force along an unknown surface, before the run.

The contact point goes along the true surface at the task's speed, and the observer is given what
the sensors would show of that, with noise, a few times. By noise and lag, and since its estimate
is held over its period, the estimated normal is off by an angle e. With the arm's mass m and
damping b, gripper stiffness k along the normal, friction f = mu F_d, speed V and a normal that
turns at w, what pushes the arm off is, to first order::

    -(f + b V) e - (b f w + m (f w)') / k - m w (V + F_d w / k)

and the force that is integrated is off by ``-f e`` and by noise. The linear loop
(:func:`chamfer.diagrams.surface.surface_tracking.tracking_loop`) makes of that the force's error.
Friction is that of the start. Until it slides the estimate is taken to be the first one, and
what acts along the surface to grow steadily. The effect of the arm's oscillation on the
observer is left out, as is a delay that its settings lack. Compared with simulated runs the error
is right within half a per cent of the force; a warning comes earlier by that.
"""

import math
import warnings
from itertools import chain, combinations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.analysis.surface.normal_metrics import FORCE_FROM, TOLERANCE
from chamfer.diagrams.surface.surface_tracking import (
    ResolvedTrackingScenario,
    TrackingScenario,
    resolve_tracking,
    tracking_loop,
)
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.normal_filter import Sample
from chamfer.systems.estimation.surface_observer_law import make_filter
from chamfer.systems.force.sampled_loop import held

Array = NDArray[np.float64]

_RUNS: Final = 20  # of the observer
_ONE_IN_20: Final = 1.645  # standard deviations that 95 % of normal values stay below
_OFF: Final = 0.5  # %, the error of a prediction
_LIMIT: Final = 100 * TOLERANCE - _OFF  # %, beyond which it is warned of
_LONGEST: Final = 20.0  # s, that are looked at
_MARGIN: Final = 3.0  # gain margin of the force integral that is proposed
_DERIVED: Final = [
    f"observer.{name}=null"
    for name in ("stiffness", "force_noise", "force_rate_noise", "rate_lag")
]  # anew, where a proposal changes what the observer is told


class ForceError(NamedTuple):
    """Predicted error of the settled force, relative to the desired one."""

    likely: float  # %, 95 % of the runs stay within
    turning: float  # %, the same in all runs: the normal turns and its estimate lags
    turns: float  # rad/s, the normal at most
    estimate: float  # rad, rms error of the normal that the controller has


class _Way:
    """Path of the contact point, a row for each period of the controller."""

    def __init__(self, scenario: ResolvedTrackingScenario) -> None:
        task, period, d = scenario.task, scenario.controller.period, scenario.dimension
        surface, speed = scenario.surface.make(), abs(task.speed)
        K = np.array(scenario.gripper.matrix(d))
        friction = scenario.friction.at(np.array(scenario.start)) * task.force
        drag = friction + scenario.manipulator.damping * speed
        # Before it slides the arm goes ahead by what gripper and position control give.
        lead = friction / K[0, 0] + drag / (scenario.controller.for_joints(d)[0][0] or 1e-9)
        self.time = np.arange(0.0, min(scenario.duration, _LONGEST) + period / 2, period)
        self.slides = self.time * speed > lead
        share = np.minimum(self.time * speed / lead, 1.0) if lead else np.ones_like(self.time)
        self.friction, self.drag = share * friction, share * drag
        turn = np.zeros((d, d))  # n to n x z, in space to n x -y
        turn[0, -1], turn[-1, 0] = np.sign(task.speed), -np.sign(task.speed)
        p, points, normals = np.array(scenario.start), [], []
        for slides in self.slides:
            found = locate(surface, p)
            p = p - found.gap * found.normal
            points.append(p)
            normals.append(found.normal)
            for part in (0.5, 1.0) if slides else ():  # the midpoint rule
                ahead = turn @ found.normal
                p = points[-1] + part * period * speed * ahead / np.linalg.norm(ahead)
                found = locate(surface, p)
        self.normal = np.array(normals)
        along = self.normal @ turn.T
        self.along = along / np.linalg.norm(along, axis=1, keepdims=True)
        self.turning = -np.sum(np.gradient(self.normal, period, axis=0) * self.along, axis=1)
        self.force = task.force * self.normal - self.friction[:, None] * self.along
        self.rate = np.gradient(self.force, period, axis=0)
        self.nominal = np.array(points) - np.linalg.solve(K, self.force.T).T
        self.velocity = speed * self.along - np.linalg.solve(K, self.rate.T).T


def force_error(scenario: ResolvedTrackingScenario) -> ForceError:
    """Predict the force of a scenario's runs; the task's speed is not 0."""
    way, loop, normal = _Way(scenario), tracking_loop(scenario), scenario.up
    random, d = np.random.default_rng(1), scenario.dimension
    noise = random.standard_normal((_RUNS, *way.force.shape)) / math.sqrt(3)
    noise *= scenario.sensor.force_noise
    bias = np.array(scenario.sensor.bias or np.zeros(d))
    off = _errors(scenario, way, noise - bias, random)
    mass, damping = scenario.manipulator.mass, scenario.manipulator.damping
    force, speed, f, w = scenario.task.force, abs(scenario.task.speed), way.friction, way.turning
    stiffness = float(normal @ loop.arm.late[:, :d] @ normal)
    pushed = -f * (damping * w + mass * np.gradient(w, loop.period)) / stiffness
    pushed -= mass * w * (speed + force * w / stiffness)
    drive = pushed[:, None] - way.drag[:, None] * off
    read = f[:, None] * off - np.sum((noise - bias) * way.normal, axis=2).T
    arm, law = held(loop.arm, period=loop.period), loop.law
    z, memory = np.zeros((len(arm.A), _RUNS)), np.zeros((len(law.A), _RUNS))
    z[:d] = (normal * (force / stiffness - scenario.task.depth))[:, None]
    errors = np.empty_like(off)
    for k in range(len(off)):
        errors[k] = -normal @ loop.arm.late @ z[: 2 * d] * 100 / force
        seen = arm.C @ z
        seen[2 * d :] += np.outer(normal, read[k])
        torque = law.C @ memory + law.D @ seen + np.outer(normal, drive[k])
        memory = law.A @ memory + law.B @ seen
        z = arm.A @ z + arm.B @ torque
    settled = way.time > FORCE_FROM - 1e-9
    errors = errors[settled]
    largest = np.abs(errors).max(axis=0, initial=0.0)
    return ForceError(
        likely=float(largest.mean() + _ONE_IN_20 * largest.std(ddof=1)),
        turning=float(np.abs(errors.mean(axis=1)).max(initial=0.0)),
        turns=float(np.abs(w).max()),
        estimate=float(np.linalg.norm(off[settled])) / math.sqrt(max(errors.size, 1)),
    )


def _errors(
    scenario: ResolvedTrackingScenario, way: _Way, noise: Array, random: np.random.Generator
) -> Array:
    """Return the angular errors of the estimates in each period, rad, shape (n, runs).

    The force that is sensed is off by the ``noise``, N, shape (runs, n, d).
    """
    settings, period = scenario.observer, scenario.controller.period
    before = np.maximum(np.arange(len(way.time)) - round(scenario.force_delay / period), 0)
    force = way.force[before] + noise
    if scenario.force_rate is None:
        rate = way.rate[before] + random.standard_normal(noise.shape) * (
            scenario.sensor.force_rate_noise / math.sqrt(3)
        )
    else:
        share = scenario.force_rate.share(period)
        gain = share / period
        rate = lfilter([gain, -gain], [1.0, share - 1.0], force - force[:, :1], axis=1)
    seen = None if settings.prediction is None else settings.prediction.make()
    observer = make_filter(settings)
    memories, estimates = [observer.start(scenario.up)] * _RUNS, [scenario.up] * _RUNS
    every = round(settings.period / period)
    used = np.empty_like(force)
    for k in range(0, len(way.time), every):
        used[:, k] = estimates
        mean = slice(max(k - settings.average + 1, 0), k + 1)
        if way.slides[before[mean.start]]:
            predicted = None if seen is None else locate(seen, way.nominal[k]).normal
            moves = [values[mean].mean(axis=0) for values in (way.nominal, way.velocity)]
            felt = zip(force[:, mean].mean(axis=1), rate[:, mean].mean(axis=1), strict=True)
            for i, (one, its_rate) in enumerate(felt):
                sample = Sample(one, its_rate, moves[0], moves[1], predicted)
                memories[i], estimates[i] = observer.update(memories[i], sample)[:2]
        # A sample's estimate is used from the controller's next period on.
        used[:, k + 1 : k + 1 + every] = np.array(estimates)[:, None]
    return np.asarray(np.sum(used * way.along, axis=2).T, dtype=np.float64)


def warn_of_force(scenario: ResolvedTrackingScenario) -> None:
    """Warn if fewer than 95 % of the runs will keep the force within 10 %, and name remedies.

    It predicts each proposal in the same way, and names the first that helps.
    """
    task, observer, control = scenario.task, scenario.observer, scenario.controller
    if not task.speed:
        return
    with np.errstate(all="ignore"):  # a loop may run though it is unstable
        found = force_error(scenario)
    if not found.likely > _LIMIT:
        return
    text = (
        f"task.force is {task.force:g} N, in one of 20 runs it will be off by {found.likely:.3g} "
        f"+- {_OFF:g} %, allowed: {100 * TOLERANCE:g} %; {found.turning:.2g} % as normals turn "
        f"({found.turns:.2g} rad/s at task.speed={task.speed:g}), the rest as its estimate errs "
        f"({math.degrees(found.estimate):.2g} deg rms, observer.kind={observer.kind})"
    )
    stiffness = 10 * float(np.array(scenario.gripper.matrix(scenario.dimension))[0, 0])
    margin = tracking_loop(scenario).gain_margin() or _MARGIN
    samples = round(observer.period / control.period)
    single = (
        ["observer.kind=adaptive", f"observer.average={samples}"],
        [f"controller.force_integral={control.force_integral * margin / _MARGIN:.2g}"],
        [f"task.speed={task.speed / 2:g}"],
        [f"gripper.stiffness={stiffness:g}", f"task.depth={task.force / stiffness:.2g}"],
    )
    for some in chain(combinations(single, 1), combinations(single, 2)):
        change = [setting for settings in some for setting in settings]
        opened = TrackingScenario(**vars(scenario))
        try:
            changed = resolve_tracking(make_scenario(opened, settings=[*_DERIVED, *change]))
        except (ParameterError, UserError):
            continue
        if (less := force_error(changed).likely) <= _LIMIT:
            text += f"; {less:.2g} % with {' '.join(change)}"
            break
    warnings.warn(text, stacklevel=2)
