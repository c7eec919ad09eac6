"""A hybrid position/force loop as linear sampled systems, one for each mode it may be in.

Each is the whole loop about a pose: arm, contact, sensors and law. Left out are dry friction of
joints and of a tip that sticks, the noise and coarseness of sensors, the jitter of the torque's
delay, and what a change of mode does: a loop that is stable in each mode may still bounce or hunt.
"""

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, SlidingTask, fill
from chamfer.models.validation import ParameterError, known
from chamfer.systems.contact.linear_arm import LinearArm, Touch, linear_arm, rest_stretch
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST
from chamfer.systems.force.hybrid_controller import Pose, linear_law
from chamfer.systems.force.sampled_loop import (
    NEUTRAL,
    Plant,
    Sampled,
    closed,
    delay_margin,
    gain_margin,
    growth_rate,
    held,
    parallel,
    series,
)
from chamfer.systems.force.selection import position_selection
from chamfer.systems.sensing.encoders import linear_encoders
from chamfer.systems.sensing.force_sensor import LoadCellParams, gauges

Array = NDArray[np.float64]

_STEP = 1e-6  # rad or m, of the differences
_TURNS = 4  # of the search for where the arm is with a gripper that gives


class LinearLoop(NamedTuple):
    """A loop in one of its modes."""

    name: str  # what it does where
    mode: int
    arm: Plant  # with the force sensor's filter
    law: Sampled  # with what the computer makes of the encoders
    period: float  # s
    delay: float = 0.0  # s, of the torque

    def sampled_arm(self, delay: float = 0.0) -> Sampled:
        """Return the arm as the computer meets it, with a further delay of the torque, s."""
        return held(self.arm, period=self.period, delay=self.delay + delay)

    def period_map(self) -> Array:
        """Return what a period does to the loop's states."""
        return closed(self.sampled_arm(), self.law)

    def growth_rate(self) -> float:
        """Return how fast the loop grows, 1/s; infinite where numbers overflow."""
        with np.errstate(all="ignore"):
            return growth_rate(self.period_map(), self.period)

    def gain_margin(self) -> float | None:
        """Return :func:`chamfer.systems.force.sampled_loop.gain_margin`."""
        with np.errstate(all="ignore"):
            arm = self.sampled_arm()
            return gain_margin(
                lambda factor: growth_rate(closed(arm, self.law, factor), self.period)
            )

    def delay_margin(self) -> float | None:
        """Return :func:`chamfer.systems.force.sampled_loop.delay_margin`, s."""

        def grows(delay: float) -> float:
            return growth_rate(closed(self.sampled_arm(delay), self.law), self.period)

        with np.errstate(all="ignore"):
            return delay_margin(grows, self.period)


def linear_loops(scenario: HybridScenario) -> tuple[LinearLoop, ...]:
    """Return the loop in the approach, in contact and while that is lost.

    In contact it is looked at where it should touch, at rest and sliding as the task wants it, and
    at the ends of its motion; with a gripper where the arm is when that gives. The scenario is
    filled in, stable or not.

    Raises:
        ParameterError: If a point is out of reach.
    """
    start, touching = np.array(scenario.task.start), scenario.touching
    linear = _Linearised(scenario)
    loops = [
        linear.loop("the approach's start", APPROACH, start),
        linear.loop("the approach's end", APPROACH, touching),
        linear.loop("lost contact", LOST, touching),
        linear.touching_loop("contact", touching),
    ]
    for way in scenario.task.ways:
        name = f"sliding {'ahead' if way > 0 else 'back'}"
        loops.append(linear.touching_loop(name, touching, way))
    if isinstance(scenario.task, SlidingTask) and scenario.task.amplitude:
        swing = scenario.task.amplitude * scenario.along
        try:
            loops.append(linear.touching_loop("contact, one end", touching + swing))
            loops.append(linear.touching_loop("contact, other end", touching - swing))
        except ParameterError as error:
            amplitude, allowed = scenario.task.amplitude, f"ends with {error.allowed}"
            raise ParameterError("task.amplitude", amplitude, allowed) from error
    return tuple(loops)


def linear_loop(scenario: HybridScenario, name: str, mode: int, endpoint: Array) -> LinearLoop:
    """Return a resolved scenario's loop in a mode with the arm at an endpoint, shape (m,).

    Raises:
        ParameterError: If the point is out of reach.
    """
    return _Linearised(scenario).loop(name, mode, endpoint)


class _Linearised:
    """A scenario with all that does not depend on the mode."""

    def __init__(self, scenario: HybridScenario) -> None:
        self._scenario = scenario
        self._dynamics = scenario.dynamics()
        self._viscous = np.array(scenario.arm.joint_friction.viscous)
        self._surface = scenario.make_surface()

    def touching_loop(self, name: str, place: Array, way: float = 0.0) -> LinearLoop:
        """Return the loop in contact with the tip at a place, shape (m,), sliding or not."""
        scenario, endpoint = self._scenario, place
        if scenario.gripper is None:
            return self.loop(name, CONTACT, endpoint, way)
        for turn in range(_TURNS):
            try:
                q = scenario.joint_positions(endpoint)
            except ParameterError as error:
                if not turn:
                    raise
                allowed = f"more, so that the arm at rest is {error.allowed}"
                raise ParameterError(
                    "gripper.stiffness", scenario.gripper.stiffness, allowed
                ) from error
            state = self._dynamics.evaluate(q, np.zeros(len(q)))
            stretch = rest_stretch(self._touching(state.p_WC, way), state)
            endpoint = place - np.eye(len(place), 3) @ stretch
        return self.loop(name, CONTACT, endpoint, way)

    def loop(self, name: str, mode: int, endpoint: Array, way: float = 0.0) -> LinearLoop:
        """Return the loop in a mode, at an endpoint, shape (m,), sliding along by +-1, or not."""
        scenario = self._scenario
        control, q = scenario.controller, scenario.joint_positions(endpoint)
        n, m = len(q), len(endpoint)
        state = self._dynamics.evaluate(q, np.zeros(n))
        touch = self._touching(state.p_WC, way) if mode == CONTACT else None
        arm = linear_arm(self._dynamics, q, self._viscous, touch)
        law = linear_law(
            self._pose(q, mode),
            np.eye(m) if mode == APPROACH else position_selection(scenario.direction),
            control,
            mode,
        )
        law = series(linear_encoders(scenario.encoders, n, period=control.period, beside=m), law)
        if scenario.friction_compensation is not None:
            follow = scenario.friction_compensation.follow(control.period)
            viscous = scenario.friction_compensation.compensated(n) * self._viscous
            seen = np.hstack([np.zeros((n, n)), np.diag(viscous), np.zeros((n, m))])
            lag = (1 - follow) * np.eye(n)
            law = parallel(law, Sampled(lag, follow * seen, lag, follow * seen))
        return LinearLoop(
            name,
            mode,
            self._sensed(arm, self._reading(state.R_WE)),
            law,
            control.period,
            known("computation_delay", control.computation_delay),
        )

    def _touching(self, p_WC: Array, way: float) -> Touch:
        """Return the contact at a point, m, shape (3,)."""
        material, task = self._scenario.surface, self._scenario.task
        along = np.array([*self._scenario.along, 0.0, 0.0])[:3]
        x, y, z = (-way * material.friction.at(p_WC) * along).tolist()
        gripper = self._scenario.gripper
        return Touch(
            self._surface, material.stiffness, material.damping, task.force, gripper, (x, y, z)
        )

    def _sensed(self, arm: LinearArm, reading: Array) -> Plant:
        """Return the arm with its force sensor, whose filter is as if in continuous time."""
        sensor, n = self._scenario.sensor, arm.drive.shape[1]
        bandwidth, late = known("bandwidth", sensor.bandwidth), known("delay", sensor.delay)
        measured = reading @ arm.force
        motion = np.eye(2 * n, len(arm.flow))
        if not bandwidth:
            return Plant(arm.flow, arm.drive, motion, measured, late)
        m, fast = len(measured), 2 * math.pi * bandwidth
        filtered = np.hstack([fast * measured, -fast * np.eye(m)])
        flow = np.vstack([np.pad(arm.flow, ((0, 0), (0, m))), filtered])
        return Plant(
            flow,
            np.pad(arm.drive, ((0, m), (0, 0))),
            np.pad(motion, ((0, 0), (0, m))),
            np.eye(m, len(flow), len(arm.flow)),
            late,
        )

    def _pose(self, q: Array, mode: int) -> Pose:
        """Return what the controller knows of the arm at q."""
        scenario, n = self._scenario, len(q)
        jacobian, still = scenario.ARM.jacobian, np.zeros(len(q))
        # At rest in contact the force integral has undone the offset of the switch. Out of it
        # nothing holds the push, and the arm is not at rest.
        pushes = (mode == CONTACT) * (2.0 if scenario.controller.bumpless else 1.0)
        push = pushes * scenario.task.force * scenario.direction
        turning, sinking = np.empty((n, n)), np.zeros((n, n))
        for j, axis in enumerate(_STEP * np.eye(n)):
            turning[:, j] = (jacobian(q + axis) - jacobian(q - axis)).T @ push / (2 * _STEP)
            if scenario.controller.full_dynamics:
                ahead, behind = (
                    self._dynamics.evaluate(q + sign * axis, still).bias for sign in (1, -1)
                )
                sinking[:, j] = (ahead - behind) / (2 * _STEP)
        return Pose(self._dynamics.evaluate(q, still).mass, jacobian(q), turning, sinking)

    def _reading(self, R_WE: Array) -> Array:
        """Return what the force sensor makes of a force on the tip, shape (m, 3)."""
        scenario, sensor = self._scenario, self._scenario.sensor
        felt: Array = gauges(sensor, scenario.arm.contact_offset).pick_up @ R_WE.T
        if isinstance(sensor, LoadCellParams):
            return -scenario.direction[:, np.newaxis] @ felt
        return -np.eye(scenario.ARM.num_coordinates, 3) @ R_WE @ sensor.undoing @ felt


# What a loop may be unstable by alone, and the settings without it.
_BLAMED: Final[Mapping[str, dict[str, Any]]] = {
    "force_integral": {"force_integral": 0.0},
    "force_damping": {"force_damping": 0.0},
    "creep_damping": {"creep_damping": 1e-6},
    "computation_delay": {"computation_delay": 0.0, "computation_jitter": 0.0},
}


class MayBeUnstable(Protocol):
    """A controller's settings."""

    @property
    def allow_unstable(self) -> bool:
        """Return whether a loop may run that is unstable."""


class Stability(NamedTuple):
    """How a loop's small motions grow, and what it bears; the worst of its modes."""

    growth: float | None  # 1/s, out of contact; None: it never is
    growth_contact: float  # 1/s
    gain_margin: float | None  # a factor on the torque; None: none up to a thousand
    delay_margin: float | None  # s, of the torque; None: none up to 10 periods
    least_gain: str  # the mode with that gain margin
    least_delay: str  # and the one with that delay margin


def stability(scenario: HybridScenario) -> Stability:
    """Return growth and margins of a resolved scenario's loop."""
    return stability_of(linear_loops(scenario))


def stability_of(loops: tuple[LinearLoop, ...]) -> Stability:
    """Return growth and margins of a loop in its modes."""
    free = any(loop.mode != CONTACT for loop in loops)
    gains = {loop.name: loop.gain_margin() for loop in loops}
    delays = {loop.name: loop.delay_margin() for loop in loops}
    gain, delay = _least(gains), _least(delays)
    return Stability(
        growth=largest_growth(loops, contact=False) if free else None,
        growth_contact=largest_growth(loops, contact=True),
        gain_margin=gains.get(gain),
        delay_margin=delays.get(delay),
        least_gain=gain,
        least_delay=delay,
    )


def _least(margins: dict[str, float | None]) -> str:
    """Return the mode with the smallest margin, or nothing if none has one."""
    known = {name: margin for name, margin in margins.items() if margin is not None}
    return min(known, key=lambda name: known[name], default="")


def require_stable(scenario: HybridScenario) -> None:
    """Refuse a loop that is unstable, or warn of it with ``controller.allow_unstable``.

    Raises:
        ParameterError: If the loop would be unstable and may not be.
    """
    control = scenario.controller
    loops = {loop.name: loop for loop in linear_loops(scenario)}
    grows = {name: loop.growth_rate() for name, loop in loops.items()}
    unstable = [name for name, growth in grows.items() if growth > NEUTRAL]
    if not unstable:
        return
    free = [name for name in unstable if loops[name].mode != CONTACT]
    worst = max(free or unstable, key=lambda name: grows[name])
    where = "out of contact" if free else "in contact"
    if worst.startswith("sliding"):
        where = f"{where}, {worst}"
    found = f"the loop is unstable {where}, it grows at {grows[worst]:.3g} 1/s"
    for name, less in _BLAMED.items():
        calm = linear_loops(replace(scenario, controller=replace(control, **less)))
        if all(loop.growth_rate() <= NEUTRAL for loop in calm):
            refuse_or_warn(found, name, control, "a lower one")
            return
    refuse_or_warn(found, "law", control, "projected, transpose or other gains")


def refuse_or_warn(found: str, name: str, control: MayBeUnstable, remedy: str) -> None:
    """Refuse a controller's setting for what was found, or warn with ``allow_unstable``.

    Raises:
        ParameterError: Unless ``allow_unstable`` is set; it names the setting and the remedy.
    """
    if not control.allow_unstable:
        allowed = f"{remedy}: {found} (or controller.allow_unstable=true)"
        raise ParameterError(f"controller.{name}", getattr(control, name), allowed)
    warnings.warn(found, stacklevel=1)


def largest_growth(loops: tuple[LinearLoop, ...], *, contact: bool) -> float:
    """Return the largest growth of a loop's modes in contact, or of those out of it, 1/s."""
    return max(loop.growth_rate() for loop in loops if (loop.mode == CONTACT) is contact)


HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


def resolve(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return the scenario with what it leaves open filled in, and checked.

    Raises:
        ParameterError: If blocks refuse their parameters, the arm can't reach the task, or the
            loop would be unstable and ``controller.allow_unstable`` is not set.
    """
    scenario = fill(scenario)
    scenario.make_surface()
    scenario.plant  # noqa: B018 - checks
    require_stable(scenario)
    return scenario
