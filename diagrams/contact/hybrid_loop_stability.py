"""A hybrid position/force loop as linear sampled systems, one for each mode it may be in.

Each is the whole loop about a pose: arm, contact, sensors and law. The arm is that of
:class:`chamfer.systems.contact.arm_in_contact.ArmInContact`, by differences of its equations of
motion: inertia, viscous friction, gravity, the gripper, and what the contact force does as the arm
turns and the surface bends. A surface on which the tip slides drags at it by Coulomb's friction.
Left out are dry friction of joints and of a tip that sticks, the noise and coarseness of sensors,
the jitter of the torque's delay, and what a change of mode does: a loop that is stable in each
mode may still bounce or hunt.
"""

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.contact.hybrid_scenario import (
    HybridScenario,
    HybridScenarioT,
    SlidingTask,
    fill,
)
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError, known
from chamfer.systems.contact.arm_dynamics import ArmState
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
from chamfer.systems.force.hybrid_linear import Pose, linear_law
from chamfer.systems.force.projection import position_selection
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
from chamfer.systems.sensing.encoders import linear_encoders
from chamfer.systems.sensing.force_sensor import LoadCellParams, gauges

Array = NDArray[np.float64]

_STEP: Final = 1e-6  # rad or m, of the differences
_TURNS: Final = 4  # of the search for where the arm is with a gripper that gives
_TIP_TURNS: Final = 8  # of that for where a stretched gripper's tip is
_FOLLOWS: Final = 1e-5  # s, in which a tip without mass and damping comes to rest


class LinearLoop(NamedTuple):
    """A loop in one of its modes."""

    name: str  # mode and place
    mode: int
    arm: Plant  # with the force sensor's filter
    law: Sampled  # with the computer's processing of the encoders
    period: float  # s
    delay: float = 0.0  # s, of the torque

    def period_map(self, factor: float = 1.0, delay: float = 0.0) -> Array:
        """Return the one-period map of the states, with a factor and further delay of the torque.

        The delay is in s.
        """
        arm = held(self.arm, period=self.period, delay=self.delay + delay)
        return closed(arm, self.law, factor)

    def growth_rate(self, factor: float = 1.0, delay: float = 0.0) -> float:
        """Return the loop's growth rate, 1/s; infinite where numbers overflow."""
        with np.errstate(all="ignore"):
            return growth_rate(self.period_map(factor, delay), self.period)

    def gain_margin(self) -> float | None:
        """Return :func:`chamfer.systems.force.sampled_loop.gain_margin`."""
        return gain_margin(self.growth_rate)

    def delay_margin(self) -> float | None:
        """Return :func:`chamfer.systems.force.sampled_loop.delay_margin`, s."""
        return delay_margin(lambda delay: self.growth_rate(delay=delay), self.period)


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
    """Return a resolved scenario's loop in a mode with the arm at an endpoint, shape (m,)."""
    return _Linearised(scenario).loop(name, mode, endpoint)


def _slope(function: Callable[[Array], Array], x: Array) -> Array:
    """Return a function's derivative by central differences, a column for each entry of x."""
    steps = _STEP * np.eye(len(x))
    return np.column_stack(
        [(function(x + axis) - function(x - axis)) / (2 * _STEP) for axis in steps]
    )


class _Linearised:
    """A scenario with all quantities that do not depend on the mode."""

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
            state = self._at_rest(q)
            stretch = self._stretch(state, self._drag(state, way))
            endpoint = place - np.eye(len(place), 3) @ stretch
        return self.loop(name, CONTACT, endpoint, way)

    def loop(self, name: str, mode: int, endpoint: Array, way: float = 0.0) -> LinearLoop:
        """Return the loop in a mode, at an endpoint, shape (m,), sliding along by +-1, or not."""
        scenario = self._scenario
        control, q = scenario.controller, scenario.joint_positions(endpoint)
        n, m = len(q), len(endpoint)
        P = np.eye(m) if mode == APPROACH else position_selection(scenario.direction)
        law = linear_law(self._pose(q, mode), P, control, mode)
        law = series(linear_encoders(scenario.encoders, n, period=control.period, beside=m), law)
        if scenario.friction_compensation is not None:
            follow = scenario.friction_compensation.follow(control.period)
            viscous = scenario.friction_compensation.compensated(n) * self._viscous
            seen = np.hstack([np.zeros((n, n)), np.diag(viscous), np.zeros((n, m))])
            lag = (1 - follow) * np.eye(n)
            law = parallel(law, Sampled(lag, follow * seen, lag, follow * seen))
        delay = known("computation_delay", control.computation_delay)
        arm = self._arm(q, way if mode == CONTACT else None)
        return LinearLoop(name, mode, arm, law, control.period, delay)

    def _at_rest(self, q: Array) -> ArmState:
        return self._dynamics.evaluate(q, np.zeros(len(q)))

    def _drag(self, state: ArmState, way: float) -> Array:
        """Return the sliding surface's force on the tip by the normal one, world frame, (3,)."""
        along = np.array([*self._scenario.along, 0.0, 0.0])[:3]
        return np.asarray(-way * self._scenario.surface.friction.at(state.p_WC) * along)

    def _stretch(self, state: ArmState, drag: Array) -> Array:
        """Return the gripper's deflection at rest, m, shape (3,), world frame; rigid: 0."""
        stretch, gripper = np.zeros(3), self._scenario.gripper
        if gripper is None:
            return stretch
        stiffness = state.R_WE @ np.array(gripper.matrix(3)) @ state.R_WE.T
        for _ in range(_TIP_TURNS):
            normal = locate(self._surface, state.p_WC + stretch).normal
            stretch = np.linalg.solve(stiffness, self._scenario.task.force * (normal + drag))
        return stretch

    def _arm(self, q: Array, way: float | None) -> Plant:
        """Return the arm at rest at q, shape (n,), with its force sensor's filter.

        ``way`` is that of the sliding tip, 0 if it sticks, None out of contact. States are the
        joints' positions and velocities, with a gripper in contact the tip's place in the world,
        shape (3,), less those at rest, and the filter's.
        """
        scenario, n = self._scenario, len(q)
        rest = self._at_rest(q)
        place, K, rest_force = rest.p_WC, None, np.zeros(3)
        springs, slows = np.zeros((3, 3)), np.zeros((3, 3))
        if way is not None:
            material, force, drag = scenario.surface, scenario.task.force, self._drag(rest, way)
            place = rest.p_WC + self._stretch(rest, drag)
            begin = locate(self._surface, place)
            rest_force = force * (begin.normal + drag)
            slows = material.damping * np.outer(begin.normal + drag, begin.normal)

            def pushed(p: Array) -> Array:
                gap, normal = locate(self._surface, p)
                load: Array = (force + material.stiffness * (begin.gap - gap)) * (normal + drag)
                return load

            springs = _slope(pushed, place)
            K = None if scenario.gripper is None else np.array(scenario.gripper.matrix(3))

        def loads(at: Array) -> Array:
            """Return the joints' load, and the gripper's force on the arm while the tip stays."""
            state, pull = self._at_rest(at), np.zeros(3)
            if K is not None:
                pull = state.R_WE @ K @ state.R_WE.T @ (place - state.p_WC)
            return np.concatenate([state.J_v_WC.T @ rest_force - state.bias, pull])

        changes, J = _slope(loads, q), rest.J_v_WC
        turning, moved = changes[:n], changes[n:]
        tip: Array = np.zeros((0, 2 * n))
        surface_force = np.hstack([springs @ J, -slows @ J])
        if K is not None and scenario.gripper is not None:
            D = np.array(scenario.gripper.damping_matrix(3)) + _FOLLOWS * K
            K, D = (rest.R_WE @ matrix @ rest.R_WE.T for matrix in (K, D))
            # Without mass the tip feels as much from the surface as from the gripper.
            gives = np.hstack([-moved, D @ J, springs - K])
            tip = np.asarray(np.linalg.solve(D + slows, gives), dtype=np.float64)
            surface_force = np.hstack([np.zeros((3, 2 * n)), springs]) - slows @ tip
        load = J.T @ surface_force
        load[:, :n] += turning
        load[:, n : 2 * n] -= np.diag(self._viscous)
        flow = np.vstack([np.eye(n, len(load.T), n), np.linalg.solve(rest.mass, load), tip])
        drive = np.zeros((len(flow), n))
        drive[n : 2 * n] = np.linalg.inv(rest.mass)
        # The sensor's filter is as if in continuous time.
        sensor, measured = scenario.sensor, self._reading(rest.R_WE) @ surface_force
        bandwidth, late = known("bandwidth", sensor.bandwidth), known("delay", sensor.delay)
        motion, states = np.eye(2 * n, len(flow)), len(flow)
        if not bandwidth:
            return Plant(flow, drive, motion, measured, late)
        m, fast = len(measured), 2 * math.pi * bandwidth
        filtered = np.hstack([fast * measured, -fast * np.eye(m)])
        flow = np.vstack([np.pad(flow, ((0, 0), (0, m))), filtered])
        drive, motion = np.pad(drive, ((0, m), (0, 0))), np.pad(motion, ((0, 0), (0, m)))
        return Plant(flow, drive, motion, np.eye(m, len(flow), states), late)

    def _pose(self, q: Array, mode: int) -> Pose:
        """Return the controller's knowledge of the arm at q."""
        scenario, n = self._scenario, len(q)
        jacobian = scenario.ARM.jacobian
        # At rest in contact the force integral has undone the offset of the switch. Out of it
        # nothing holds the push, and the arm is not at rest.
        pushes = (mode == CONTACT) * (2.0 if scenario.controller.bumpless else 1.0)
        push = pushes * scenario.task.force * scenario.direction
        turning, sinking = np.empty((n, n)), np.zeros((n, n))
        for j, axis in enumerate(_STEP * np.eye(n)):
            turning[:, j] = (jacobian(q + axis) - jacobian(q - axis)).T @ push / (2 * _STEP)
        if scenario.controller.full_dynamics:
            sinking = _slope(lambda at: self._at_rest(at).bias, q)
        return Pose(self._at_rest(q).mass, jacobian(q), turning, sinking)

    def _reading(self, R_WE: Array) -> Array:
        """Return the map from a force on the tip to the sensor's reading, shape (m, 3)."""
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


class Stability(NamedTuple):
    """Growth and margins of a loop's small motions; the worst of its modes."""

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
    free = [loop.growth_rate() for loop in loops if loop.mode != CONTACT]
    gains = {loop.name: loop.gain_margin() for loop in loops}
    delays = {loop.name: loop.delay_margin() for loop in loops}
    gain, delay = _least(gains), _least(delays)
    return Stability(
        growth=max(free, default=None),
        growth_contact=max(loop.growth_rate() for loop in loops if loop.mode == CONTACT),
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


def refuse_or_warn(found: str, name: str, control: Any, remedy: str) -> None:
    """Refuse a controller's setting for a reason, or warn with ``allow_unstable``."""
    if not control.allow_unstable:
        allowed = f"{remedy}: {found} (or controller.allow_unstable=true)"
        raise ParameterError(f"controller.{name}", getattr(control, name), allowed)
    warnings.warn(found, stacklevel=1)


def resolve(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return the scenario with its open fields filled in, and checked.

    Raises:
        ParameterError: If blocks refuse their parameters, the arm can't reach the task, or the
            loop would be unstable and ``controller.allow_unstable`` is not set.
    """
    scenario = fill(scenario)
    scenario.make_surface()
    scenario.plant  # noqa: B018 - checks
    require_stable(scenario)
    return scenario
