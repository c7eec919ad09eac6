"""The closed loop of Fig. 5-7: its wiring, and its runs against an independent simulation."""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, Diagram, LeafSystem
from scipy.optimize import brentq

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.surface.unknown_surface import run_surface
from chamfer.diagrams.surface.surface_estimation import EstimationScenario
from chamfer.diagrams.surface.surface_scenario import (
    THESIS,
    ObserverSettings,
    SurfaceSettings,
    SurfaceShape,
)
from chamfer.diagrams.surface.surface_tracking import (
    SURFACE_CONTROL_ADAPTIVE,
    SURFACE_CONTROL_NOISE_FREE,
    TrackingScenario,
    TrackingTask,
    make_tracking_diagram,
    resolve_tracking,
    tracking_loop,
)
from chamfer.models.arms.cartesian_manipulator import CartesianManipulatorParams
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.force.surface_motion import SurfaceMotion

Array = NDArray[np.float64]
Wire = tuple[str, str, str, str]

ARM, CONTACT, SENSOR, OBSERVER = (
    "manipulator dynamics",
    "contact model",
    "force sensor",
    "surface estimator",
)
TASK, CONTROL, SUM, MODE = "task", "hybrid controller", "sum of forces", "in contact"
PREDICTION = "predicted surface"
QUIET = SURFACE_CONTROL_NOISE_FREE
GAINS = QUIET.controller


def wires(diagram: Diagram) -> set[Wire]:
    return {
        (
            source.get_name(),
            source.get_output_port(output).get_name(),
            target.get_name(),
            target.get_input_port(entrance).get_name(),
        )
        for (target, entrance), (source, output) in diagram.connection_map().items()
    }


def reached(wiring: Iterable[Wire], start: str) -> set[str]:
    """The blocks that a block acts on, directly or through others."""
    following: dict[str, set[str]] = {}
    for source, _, target, _ in wiring:
        following.setdefault(source, set()).add(target)
    found: set[str] = set()
    front = [start]
    while front:
        more = following.get(front.pop(), set()) - found
        found |= more
        front += more
    return found


# The mechanics: what acts on the arm and on the gripper without being measured.
PHYSICS = {
    (ARM, "y0", CONTACT, "nominal_motion"),
    (CONTACT, "contact_force", SUM, "u1"),
    (SUM, "sum", ARM, "u0"),
}
SENSED = {
    (CONTACT, "contact_force", SENSOR, "contact_force"),
    (CONTACT, "contact_force_rate", SENSOR, "contact_force_rate"),
}
ENCODERS = {
    (ARM, "y0", OBSERVER, "nominal_motion"),
    (ARM, "y0", TASK, "endpoint_motion"),
    (ARM, "y0", CONTROL, "encoders"),
}
KNOWN = {
    (SENSOR, "measured_force", OBSERVER, "measured_force"),
    (SENSOR, "measured_force_rate", OBSERVER, "measured_force_rate"),
    (SENSOR, "measured_force", CONTROL, "measured_force"),
    (OBSERVER, "normal", TASK, "normal"),
    (TASK, "selection", CONTROL, "selection"),
    (TASK, "desired_force", CONTROL, "desired_force"),
    (TASK, "desired_position", CONTROL, "desired_position"),
    (MODE, "y0", CONTROL, "mode"),
    (CONTROL, "torque", SUM, "u0"),
}
NOISY = {("sensor noise", "output", SENSOR, "noise")}
PREDICTED = {
    (ARM, "y0", PREDICTION, "nominal_motion"),
    (PREDICTION, "predicted_normal", OBSERVER, "predicted_normal"),
}
LOOP = PHYSICS | SENSED | ENCODERS | KNOWN


@pytest.mark.parametrize("shape", ["parabola", "sphere"])
def test_the_controller_knows_encoders_and_force_sensor_only(shape: SurfaceShape) -> None:
    surface = SurfaceSettings(shape=shape)
    scenario = TrackingScenario(surface=surface)
    wiring = wires(make_tracking_diagram(resolve_tracking(scenario)))
    assert wiring == LOOP | NOISY
    assert (
        wires(make_tracking_diagram(resolve_tracking(replace(scenario, sensor=QUIET.sensor))))
        == LOOP
    )
    seen = replace(scenario, observer=replace(THESIS, prediction=surface))
    assert wires(make_tracking_diagram(resolve_tracking(seen))) == LOOP | NOISY | PREDICTED
    # With the sensors' wires cut, only the mechanics are left of what the contact acts on.
    cut = wiring - SENSED - ENCODERS
    assert reached(cut, CONTACT) == {SUM, ARM, CONTACT}
    assert reached(wiring, CONTACT) >= {OBSERVER, TASK, CONTROL}


def test_blocks_and_exported_signals() -> None:
    for shape, d in (("parabola", 2), ("sphere", 3)):
        scenario = TrackingScenario(surface=SurfaceSettings(shape=shape))  # type: ignore[arg-type]
        diagram = make_tracking_diagram(resolve_tracking(scenario))
        sizes = {
            port.get_name(): port.size()
            for port in map(diagram.get_output_port, range(diagram.num_output_ports()))
        }
        assert sizes == {
            "normal": d,
            "covariance": d * d,
            "deviation": 1,
            "status": 1,
            "measured_force": d,
            "measured_force_rate": d,
            "contact": 3 * d + 1,
            "contact_force": d,
            "nominal_motion": 2 * d,
            "effort": d,
            "position_error": d,
            "force_error": d,
        }
        assert diagram.num_input_ports() == 0
        assert isinstance(diagram.GetSubsystemByName(TASK), SurfaceMotion)
        assert isinstance(diagram.GetSubsystemByName(CONTROL), HybridController)


# The noise-free loop, from the equations alone.


class Plan(NamedTuple):
    """A loop on y = a x^2 with gripper stiffness 100 N/m."""

    a: float = 0.05
    mu: float = 1.0
    mass: float = 0.5
    damping: float = 10.0
    gain: float = 100.0
    integral: float = 1.0
    force: float = 5.0
    speed: float = 0.5


def contact_point(plan: Plan, x: Array, before: float) -> float:
    """Where the contact point is, at rest where friction holds and else dragged to +x."""
    a, mu = plan.a, plan.mu

    def excess(s: float) -> float:  # F . (t + mu n), < 0 where it has to slide on
        return (s - x[0]) * (1 - 2 * a * mu * s) + (a * s * s - x[1]) * (2 * a * s + mu)

    return before if excess(before) >= 0 else float(brentq(excess, before, x[0], xtol=1e-14))


def frame(plan: Plan, s: float) -> Array:
    """The true normal."""
    n = np.array([-2 * plan.a * s, 1.0])
    return np.asarray(n / np.linalg.norm(n))


def independent(plan: Plan, duration: float) -> tuple[Array, Array, Array]:
    """Time, normal force and contact point, by Runge-Kutta steps of half a millisecond.

    Without noise the observer's normal is the true one at each of its samples while the point
    slides, and the first one as long as it has not slid.
    """
    x, v, s = np.array([0.0, -0.1]), np.zeros(2), 0.0
    desired, integral = x.copy(), np.zeros(2)
    n = np.array([0.0, 1.0])
    rows = []
    h = 5e-4

    def force(position: Array) -> Array:
        point = contact_point(plan, position, s)
        return np.asarray(100.0 * (np.array([point, plan.a * point**2]) - position))

    def rate(state: Array, effort: Array) -> Array:
        position, velocity = state[:2], state[2:]
        push = effort - plan.damping * velocity + force(position)
        return np.concatenate([velocity, push / plan.mass])

    for k in range(round(duration / 0.005)):
        touching = force(x)
        rows.append((0.005 * k, touching @ frame(plan, s), s))
        P = np.eye(2) - np.outer(n, n)
        desired = desired + plan.speed * 0.005 * np.array([n[1], -n[0]])
        error = P @ (desired - x)
        desired = x + error
        integral = integral + plan.integral * 0.005 * (
            (np.eye(2) - P) @ (touching - plan.force * n)
        )
        effort = plan.gain * error - plan.force * n + integral
        if k % 10 == 0 and s > 0:
            n = frame(plan, s)  # it is used from the next period on
        state = np.concatenate([x, v])
        for _ in range(10):
            k1 = rate(state, effort)
            k2 = rate(state + h / 2 * k1, effort)
            k3 = rate(state + h / 2 * k2, effort)
            k4 = rate(state + h * k3, effort)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            s = contact_point(plan, state[:2], s)
        x, v = state[:2], state[2:]
    time, normal_force, point = np.array(rows).T
    return time, normal_force, point


def test_the_noise_free_loop_agrees_with_an_independent_simulation() -> None:
    plan = Plan(
        a=0.1, mu=0.5, mass=1.0, damping=15.0, gain=150.0, integral=2.0, force=4.0, speed=0.3
    )
    scenario = replace(
        QUIET,
        surface=SurfaceSettings(coefficients=(plan.a,)),
        friction=SurfaceFriction(coefficient=plan.mu),
        manipulator=CartesianManipulatorParams(mass=plan.mass, damping=plan.damping),
        controller=replace(GAINS, stiffness=plan.gain, force_integral=plan.integral),
        task=TrackingTask(force=plan.force, speed=plan.speed),
        duration=3.0,
    )
    traces = run_surface(resolve_tracking(scenario), 0)
    time, force, point = independent(plan, 3.0)
    assert point[-1] > 0.7  # it slides
    rows = len(time)
    np.testing.assert_allclose(traces["time"][:rows], time, atol=1e-9)
    np.testing.assert_allclose(traces["force"][:rows], force, rtol=0.01)
    np.testing.assert_allclose(traces["point_x"][:rows], point, atol=2e-3)


def test_the_other_way_round_it_goes_to_the_other_side() -> None:
    ahead, back = (
        run_surface(
            resolve_tracking(replace(QUIET, task=TrackingTask(speed=speed), duration=1.0)), 0
        )
        for speed in (0.5, -0.5)
    )
    assert ahead["point_x"][-1] > 0.1
    np.testing.assert_allclose(back["point_x"], -ahead["point_x"], atol=1e-9)
    np.testing.assert_allclose(back["force"], ahead["force"], atol=1e-8)


def test_the_loop_runs_in_space() -> None:
    quiet = replace(QUIET, surface=SurfaceSettings(shape="sphere"), duration=2.0)
    traces = run_surface(resolve_tracking(quiet), 0)
    late = traces["time"] > 1.0
    np.testing.assert_allclose(traces["force"][late], 5.0, atol=0.25)
    # At the observer's samples, which rounding of their time may put a step of 2.5 ms later.
    assert traces["error"][200::10].max() < 0.05
    assert np.median(traces["error"][200::10]) < 1e-9
    # n x z in the plane is n x y in space: both go to +x.
    assert traces["travel"][-1] > 0.5
    np.testing.assert_allclose(traces["point_y"], 0, atol=1e-9)


def test_the_observer_may_be_given_means() -> None:
    scenario = SURFACE_CONTROL_ADAPTIVE
    diagram = make_tracking_diagram(resolve_tracking(scenario))
    names = {system.get_name() for system in diagram.GetSystems()}
    assert {"mean measured force", "mean measured force rate", "mean nominal motion"} <= names
    for average in (0, 11):
        with pytest.raises(ParameterError, match=rf"^observer.average is {average}, "):
            replace(scenario, observer=replace(scenario.observer, average=average))
    with pytest.raises(ParameterError, match=r"^observer.average is 2, allowed: 1, as"):
        EstimationScenario(observer=ObserverSettings(average=2))


def flat(force_integral: float, *, allow: bool = False) -> TrackingScenario:
    scenario = replace(QUIET, duration=3.0, surface=SurfaceSettings(coefficients=(1e-6,)))
    control = replace(scenario.controller, force_integral=force_integral, allow_unstable=allow)
    return replace(scenario, controller=control)


@pytest.mark.parametrize(("force_integral", "late"), [(20.0, 0.0), (10.0, 0.04)])
def test_the_force_swings_as_the_poles_say(force_integral: float, late: float) -> None:
    scenario = replace(flat(force_integral, allow=True), force_delay=late)
    period = scenario.controller.period
    poles = np.linalg.eigvals(tracking_loop(scenario).period_map())
    rate = max(math.log(abs(pole)) for pole in poles if abs(pole.imag) > 1e-6) / period
    run = simulate(
        make_tracking_diagram(resolve_tracking(scenario)), duration=2.0, step=period, seed=0
    )
    off = np.abs(run.outputs["contact_force"][:, 1] - scenario.task.force)
    early, late = (off[(run.time >= t) & (run.time < t + 0.5)].max() for t in (0.5, 1.5))
    assert math.log(late / early) == pytest.approx(rate, abs=0.25)


def test_a_force_integral_that_swings_is_refused() -> None:
    message = (
        r"controller\.force_integral is 50\.0, allowed: a lower one, or other gains: "
        r"the loop is unstable in contact, it grows at 3\.\d* 1/s"
    )
    with pytest.raises(ParameterError, match=message):
        resolve_tracking(flat(50.0))
    with pytest.warns(UserWarning, match="unstable in contact"):
        resolve_tracking(flat(50.0, allow=True))


class Push(LeafSystem):
    """A user's own law: pushes with the desired force, and goes ahead with no more than that."""

    def __init__(self, d: int, *, selection: int | None = None) -> None:
        super().__init__()
        force = self.DeclareVectorInputPort("desired_force", d)
        for name, size in (
            ("encoders", 2 * d),
            ("desired_position", d),
            ("measured_force", d),
            ("selection", d * d if selection is None else selection),
            ("mode", 1),
        ):
            self.DeclareVectorInputPort(name, size)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(force.Eval(context))

        self.DeclareVectorOutputPort("torque", d, calc, {force.ticket()})
        for name in ("position_error", "force_error"):
            self.DeclareVectorOutputPort(name, d, lambda _, vector: vector.SetZero())


def test_a_users_own_controller_takes_the_hybrid_laws_place() -> None:
    scenario = resolve_tracking(replace(QUIET, duration=3.0))
    diagram = make_tracking_diagram(scenario, controller=Push(2))
    assert wires(diagram) == wires(make_tracking_diagram(scenario))
    run = simulate(diagram, duration=3.0, step=0.005)
    # It stands still and pushes with 5 N downwards, which the gripper's spring takes up.
    np.testing.assert_allclose(run.outputs["contact_force"][-1], [0.0, 5.0], atol=1e-3)
    with pytest.raises(
        ParameterError, match=r"^controller is 'Push', .* selection of size 4; its"
    ):
        make_tracking_diagram(scenario, controller=Push(2, selection=2))
