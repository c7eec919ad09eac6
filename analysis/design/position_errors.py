"""Errors at the touch of random cells whose arm is position-controlled.

No model of the arm is run. Without cameras nothing corrects the errors. They come from fixture and
repeatability, the tip's sag on its springs, and the feed along a misaligned axis. Noise and drift
of the sensor since its zero was taken also move the admittance.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.cell.alignment_runs import draw_errors
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario
from chamfer.analysis.design.feed_path import GRAVITY
from chamfer.analysis.design.remaining_errors import HELD_OUT, DrawnErrors, in_one_plane
from chamfer.diagrams.insertion.insertion import region_of
from chamfer.models.arms.wrist import SIZE
from chamfer.systems.force.wrist_wrench import WRIST_AXES

Array = NDArray[np.float64]

_ACROSS: Final = [1, 2, 4, 5]  # y, z, pitch and yaw in AXES
_SEEN: Final = 0.15  # of the gap, fed until the peg may hide some of the mouth
_UNIFORM: Final = 3**-0.5  # standard deviation of a uniform noise, over its half-width
_SLOWEST: Final = 1e-3  # 1/s, of an admittance's return, below which it has none


def drawn_touches(scenario: ResolvedDesignScenario, seed: int, draws: int) -> DrawnErrors:
    """Return the errors of random cells at the touch; same law as the trials, other draws."""
    insert, decide, spread = scenario.insert, scenario.decide, scenario.spread
    middle, off = scenario.initial_error, scenario.repeatability
    trials = [
        draw_errors(middle, spread, len(scenario.arms), seed, HELD_OUT + k, off)
        for k in range(draws)
    ]
    error = np.array([one.error for one in trials])
    payload = scenario.peg.payload_error * np.array([one.arms[0][0] for one in trials])
    generator, seeks = np.random.default_rng([seed, HELD_OUT]), np.zeros(draws)
    if scenario.cameras.kind == "hand":
        seeks = align_by_hand(scenario, error, generator)
    error += hanging(scenario, payload)
    since = insert.pause + scenario.gap / insert.speed
    error[:, _ACROSS] += unrest_of(scenario, since) * generator.standard_normal((draws, 4))
    # Fed along the peg's own axis, which is off as the peg is.
    error[:, 1] += scenario.gap * error[:, 5]
    error[:, 2] -= scenario.gap * error[:, 4]
    lateral, tilt, turn = in_one_plane(error)
    frame = scenario.cameras.frames.period
    waits = {"margin": decide.frames * frame, "wait": scenario.compensation_time}
    none, pairs = np.zeros(draws), np.zeros((draws, 2))
    return DrawnErrors(
        force=none,
        push=none,
        time=waits.get(decide.kind, frame) + seeks,
        lateral=lateral,
        tilt=tilt,
        turn=turn,
        sure=pairs,
        reach=pairs,
        saturated=none,
        exact=True,
    )


def align_by_hand(
    scenario: ResolvedDesignScenario, error: Array, generator: np.random.Generator
) -> Array:
    """Remove from errors, (n, 6), what a camera in the hand corrects; return its time, s.

    The feed begins with the errors that the decision accepts. They are compensated further, to the
    dead zone, until the peg hides the mouth. The calibration error of the camera's pose adds.
    """
    region, margin, hand = region_of(scenario), scenario.decide.margin, scenario.cameras.hand
    own, period = scenario.compensator, scenario.cameras.frames.period
    rates = np.repeat([own.lateral.closed.increment, own.rotational.closed.increment], 2) / period
    takes: Array = (np.abs(error[:, _ACROSS]) / rates).max(axis=1)
    if scenario.decide.kind == "margin":
        most = (1 - margin) * region.lateral_limit
        error[:, 1:3] *= np.minimum(1.0, most / np.hypot(*error[:, 1:3].T))[:, np.newaxis]
        tilts = region.tilts_at(np.hypot(*error[:, 1:3].T)) - margin * region.rotation_limit
        error[:, 4:] *= np.minimum(1.0, tilts / np.hypot(*error[:, 4:].T))[:, np.newaxis]
    if scenario.insert.compensation == "running":
        lateral = scenario.cameras.pixel_size * own.lateral.closed.dead_zone
        size, ends = (
            np.abs(error[:, _ACROSS]),
            np.repeat([lateral, own.rotational.closed.dead_zone], 2),
        )
        after = size - rates * _SEEN * scenario.gap / scenario.insert.speed
        error[:, _ACROSS] = np.copysign(
            np.maximum(after, np.minimum(size, ends)), error[:, _ACROSS]
        )
    left = np.repeat(hand.deviations, 2)
    error[:, _ACROSS] += left * generator.standard_normal((len(error), 4))
    return takes


def hanging(scenario: ResolvedDesignScenario, payload: Array) -> Array:
    """Return how far tips sag on their springs, m and rad in AXES' order, shape (n, 6).

    The tools weigh more than in the scenario by these masses, kg, shape (n,).
    """
    R_TS = WRIST_AXES.rotation().matrix()
    to_wrist = R_TS.T @ scenario.hole_axes.matrix().T
    down = to_wrist @ np.array([0.0, 0.0, -GRAVITY])
    mass = scenario.wrist.mass + payload
    above = np.array([0.0, 0.0, scenario.wrist.centre_of_mass])
    load = np.outer(mass, np.concatenate([np.cross(above, down), down]))
    moved = load @ scenario.wrist.compliance
    turned = moved.reshape(len(mass), 2, 3) @ R_TS.T
    return np.roll(turned.reshape(len(mass), SIZE), 3, axis=1)


def unrest_of(scenario: ResolvedDesignScenario, since: float) -> Array:
    """Return the standard deviation of y, z, pitch and yaw by the sensor, m and rad.

    An admittance ``D x' + K x = F`` is driven by a white noise F, by a zero that is the mean of n
    readings, and by a random walk. A time T after the zero was taken, with D / K = tau, its
    variance is::

        s^2 h / (2 D K) (1 - e^(-2 T / tau)) + s^2 / (n K^2) (1 - e^(-T / tau))^2
        + d^2 / K^2 (T - 2 tau (1 - e^(-T / tau)) + tau / 2 (1 - e^(-2 T / tau)))
    """
    admittance, sensor = scenario.admittance, scenario.sensor
    if admittance.kind == "none":
        return np.zeros(4)
    D = np.array(admittance.damping)[[4, 5, 1, 2]]
    K = np.maximum(np.array(admittance.spring)[[4, 5, 1, 2]], _SLOWEST * D)
    # Moments at the tip are those at the sensor's origin less what the force there turns.
    arm = np.hypot(sensor.radius, np.linalg.norm(sensor.origin or (0.0,)))
    at_tip = np.array([1.0, 1.0, arm, arm])
    noise, drift = _UNIFORM * sensor.noise * at_tip, sensor.drift * at_tip
    period, tau = scenario.arm.servo.period, D / K
    readings = max(scenario.begin / period, 1.0)
    once, twice = -np.expm1(-since / tau), -np.expm1(-2 * since / tau)
    variance = noise**2 * (period / (2 * D * K) * twice + (once / K) ** 2 / readings)
    variance += (drift / K) ** 2 * (since - 2 * tau * once + tau / 2 * twice)
    found: Array = np.sqrt(np.maximum(variance, 0.0))
    return found
