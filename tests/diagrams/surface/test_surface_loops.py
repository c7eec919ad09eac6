"""The open loop of Fig. 5-1: its wiring, its contact in closed form, and what observers make."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.framework import LeafSystem
from scipy.optimize import brentq

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.surface.unknown_surface import run_surface
from chamfer.diagrams.surface.surface_estimation import (
    NOISE_FREE,
    EstimationScenario,
    LeadSettings,
    make_estimation_diagram,
    resolve_estimation,
)
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
from chamfer.models.arms.cartesian_manipulator import (
    CartesianManipulatorParams,
    cartesian_kinematics,
)
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.normal_filter import ObserverKind, Sample
from chamfer.systems.estimation.surface_observer_law import make_filter
from chamfer.systems.sensing.force_rate import ForceRateParams, ForceRateSensorParams

Array = NDArray[np.float64]
CONTACT, SENSOR = "contact model", "force sensor"
ARM, SUM = "manipulator dynamics", "sum of forces"
QUIET, STEADY = NOISE_FREE, SURFACE_CONTROL_NOISE_FREE
GAINS = STEADY.controller


@pytest.mark.parametrize("shape", ["parabola", "sphere"])
@pytest.mark.parametrize("predicts", [False, True])
def test_controller_and_observer_know_encoders_and_force_sensor_only(
    wires: Any, known_to: Any, shape: SurfaceShape, predicts: bool
) -> None:
    surface = SurfaceSettings(shape=shape)
    told = replace(THESIS, prediction=surface if predicts else None)
    estimation = EstimationScenario(surface=surface, observer=told)
    led = wires(make_estimation_diagram(resolve_estimation(estimation)))
    assert {wire[2] for wire in led if wire[0] == CONTACT} == {SENSOR}
    assert CONTACT in known_to(led, "surface estimator")
    tracking = TrackingScenario(surface=surface, observer=told)
    controlled = wires(make_tracking_diagram(resolve_tracking(tracking)))
    # Beside the sensor, what the contact acts on is mechanics alone.
    assert {wire[::2] for wire in controlled if wire[0] in (CONTACT, SUM)} == {
        *((CONTACT, SENSOR), (CONTACT, SUM), (SUM, ARM))
    }
    for block in ("surface estimator", "task", "hybrid controller"):
        assert CONTACT in known_to(controlled, block)


def outputs(scenario: EstimationScenario, duration: float, step: float) -> dict[str, Array]:
    diagram = make_estimation_diagram(resolve_estimation(scenario))
    run = simulate(diagram, duration=duration, step=step)
    return {"time": run.time, **run.outputs}


@pytest.mark.parametrize("shape", ["parabola", "paraboloid"])
@pytest.mark.parametrize("speed", [0.2, -0.3])
def test_the_gripper_is_led_and_halts(shape: SurfaceShape, speed: float) -> None:
    sideways = 0.3 if shape == "paraboloid" else 0.0
    lead = LeadSettings(depth=0.15, speed=speed, halt=0.5, sideways=sideways)
    scenario = replace(QUIET, surface=SurfaceSettings(shape=shape), lead=lead)
    found = outputs(scenario, 1.5, 0.05)
    time, motion = found["time"], found["nominal_motion"]
    middle = [[sideways] * len(time)] if sideways else []
    expected = [speed * np.minimum(time, 0.5), *middle, [-0.15] * len(time)]
    np.testing.assert_allclose(motion[:, : len(expected)], np.transpose(expected), atol=1e-12)
    moving = np.where(time < 0.5 - 1e-9, speed, 0.0)
    np.testing.assert_allclose(motion[:, len(expected)], moving, atol=1e-12)
    np.testing.assert_array_equal(motion[:, len(expected) + 1 :], 0)


def test_the_end_of_the_slide_is_where_the_reference_has_it() -> None:
    found = outputs(QUIET, 15.0, 0.05)
    x, y, _, _, n_x, n_y, mode = found["contact"][-1]
    assert (x, y) == (pytest.approx(2.378, abs=1e-3), pytest.approx(0.283, abs=1e-3))
    assert math.degrees(math.atan2(n_y, n_x)) == pytest.approx(103.38, abs=0.01)
    np.testing.assert_allclose(found["contact_force"][-1], [-62.2, 38.3], atol=0.05)
    assert mode == 1  # at rest


def test_noise_is_of_its_length_and_fresh_with_every_sample() -> None:
    sensor = ForceRateSensorParams(force_noise=2.0, force_rate_noise=7.0)
    loud = EstimationScenario(sensor=sensor)
    found = outputs(loud, 20.0, 0.05)
    quiet = outputs(replace(loud, sensor=QUIET.sensor), 20.0, 0.05)
    for name, length in (("measured_force", 2.0), ("measured_force_rate", 7.0)):
        noise = found[name] - quiet[name]
        np.testing.assert_allclose(noise.std(axis=0), length / math.sqrt(3), rtol=0.1)
        for i in range(2):
            assert abs(np.corrcoef(noise[1:, i], noise[:-1, i])[0, 1]) < 0.2
    force, rate = (found[n] - quiet[n] for n in ("measured_force", "measured_force_rate"))
    across = np.corrcoef(np.hstack([force, rate]).T) - np.eye(4)
    assert np.abs(across).max() < 0.2
    np.testing.assert_array_equal(found["contact"], quiet["contact"])


@pytest.mark.parametrize(("kind", "shape"), [("thesis", "parabola"), ("adaptive", "paraboloid")])
def test_the_loop_gives_the_filter_each_sample_once_and_in_its_order(
    kind: ObserverKind, shape: SurfaceShape
) -> None:
    coefficients = (0.04,) if shape == "parabola" else (0.04, 0.03)  # not quite the surface's own
    seen = SurfaceSettings(shape=shape, coefficients=coefficients)
    scenario = resolve_estimation(
        EstimationScenario(
            surface=SurfaceSettings(shape=shape),
            observer=ObserverSettings(kind=kind, prediction=seen),
        )
    )
    d = scenario.dimension
    diagram = make_estimation_diagram(scenario)
    found = simulate(diagram, duration=2.0, step=0.05, seed=5).outputs
    surface, observer = seen.make(), make_filter(scenario.observer)
    memory = observer.start(scenario.up)
    rows = (
        np.ascontiguousarray(found[name])
        for name in ("measured_force", "measured_force_rate", "nominal_motion")
    )
    for k, (force, rate, motion) in enumerate(zip(*rows, strict=True)):
        if k == 40:
            break
        gradient = surface.gradient(motion[:d])
        predicted = gradient / np.linalg.norm(gradient)
        sample = Sample(-force, -rate, motion[:d], motion[d:], predicted)
        estimate = observer.update(memory, sample)
        memory = estimate.memory
        np.testing.assert_allclose(found["normal"][k + 1], estimate.normal, atol=1e-12)
        np.testing.assert_allclose(
            found["covariance"][k + 1], estimate.covariance.ravel(), atol=1e-12
        )
        assert found["status"][k + 1] == estimate.status


def test_gripper_may_hover_and_be_pressed_before() -> None:
    lead = LeadSettings(depth=0.1, speed=0.2, halt=2.0, hover=1.0, press=2.0)
    path = lead.path(3)
    for t, expected in (
        (0.0, [0, 0, 0.1]),
        (1.0, [0, 0, 0.1]),
        (2.5, [0, 0, -0.2]),
        (3.0, [0, 0, -0.1]),
        (4.0, [0.2, 0, -0.1]),
        (5.5, [0.4, 0, -0.1]),
    ):
        np.testing.assert_allclose(path.value(t).ravel(), expected, rtol=0, atol=1e-12)
    assert lead.begins == 3.0
    with pytest.raises(ParameterError, match=r"^press is 0.0, allowed: more than 0 with a hover"):
        LeadSettings(hover=1.0)


def test_force_may_be_biased_and_late_and_its_rate_differenced() -> None:
    scenario = EstimationScenario(
        sensor=ForceRateSensorParams(force_noise=0.0, bias=(1.0, -2.0)),
        force_delay=0.1,
        force_rate=ForceRateParams(time_constant=0.2),
        observer=ObserverSettings(),
        duration=2.0,
    )
    told = resolve_estimation(scenario).observer
    assert (told.rate_lag, told.force_rate_noise) == (0.2, 0.0)
    run = simulate(make_estimation_diagram(resolve_estimation(scenario)), duration=2.0, step=0.05)
    true, shown = run.outputs["contact_force"], run.outputs["measured_force"]
    np.testing.assert_allclose(shown[3:], [1.0, -2.0] - true[1:-2], rtol=0, atol=1e-12)
    share, filtered = 1 - math.exp(-0.25), np.zeros(2)
    for force, rate in zip(shown, run.outputs["measured_force_rate"], strict=True):
        np.testing.assert_allclose(rate, share * (force - filtered) / 0.05, rtol=0, atol=1e-9)
        filtered = filtered + share * (force - filtered)


class Silent(LeafSystem):
    """A user's own observer: whatever it is given, the normal is the first one."""

    def __init__(self) -> None:
        super().__init__()
        for name, size in (("force", 2), ("force_rate", 2)):
            self.DeclareVectorInputPort(f"measured_{name}", size)
        self.DeclareVectorInputPort("nominal_motion", 4)
        self.DeclareVectorOutputPort("normal", 2, lambda _, normal: normal.SetFromVector([0, 1]))
        for name, size in (("covariance", 4), ("deviation", 1), ("status", 1)):
            self.DeclareVectorOutputPort(name, size, lambda _, vector: vector.SetZero())


def test_a_users_own_observer_takes_the_observers_place() -> None:
    diagram = make_estimation_diagram(resolve_estimation(EstimationScenario()), observer=Silent())
    found = simulate(diagram, duration=1.0, step=0.05).outputs
    np.testing.assert_array_equal(found["normal"], np.tile([0.0, 1.0], (21, 1)))


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
        STEADY,
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


def test_the_loop_runs_in_space() -> None:
    quiet = replace(STEADY, surface=SurfaceSettings(shape="sphere"), duration=2.0)
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
    scenario = replace(STEADY, duration=3.0, surface=SurfaceSettings(coefficients=(1e-6,)))
    control = replace(scenario.controller, force_integral=force_integral, allow_unstable=allow)
    return replace(scenario, controller=control, task=TrackingTask(depth=0.098))


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


@pytest.mark.parametrize(
    ("stiffness", "force_integral", "depth"), [(100.0, 1.0, 0.397), (1000.0, 1.0, 0.0146)]
)
def test_a_start_is_refused_from_where_the_contact_is_lost(
    stiffness: float, force_integral: float, depth: float
) -> None:
    scenario = replace(
        flat(force_integral), gripper=GripperCompliance(stiffness=stiffness), duration=1.0
    )

    def deep(share: float) -> TrackingScenario:
        return replace(scenario, task=TrackingTask(depth=share * depth))

    largest = rf"{depth:.3g} m, {stiffness * depth:.3g}\d* N; from {stiffness * 2 * depth:.3g} N"
    with pytest.raises(ParameterError, match=rf"^task\.depth is .*, allowed: at most {largest}"):
        resolve_tracking(deep(2.0))
    # The simulation has no limit of its own: the force of contact just stays, or falls to 0.
    resolved = resolve_tracking(deep(0.9))
    assert run_surface(resolved, 0)["force"].min() > 0
    lost = replace(resolved, task=TrackingTask(depth=1.1 * depth))
    assert run_surface(lost, 0)["force"].min() == 0


def test_a_users_own_controller_takes_the_hybrid_laws_place(push: Any) -> None:
    scenario, arm = resolve_tracking(replace(STEADY, duration=3.0)), cartesian_kinematics(2)
    diagram = make_tracking_diagram(scenario, controller=push(arm))
    run = simulate(diagram, duration=3.0, step=0.005)
    # It stands still and pushes with 5 N downwards, which the gripper's spring takes up.
    np.testing.assert_allclose(run.outputs["contact_force"][-1], [0.0, 5.0], atol=1e-3)
    message = r"^controller is 'Push', .* selection of size 4; its"
    with pytest.raises(ParameterError, match=message):
        make_tracking_diagram(scenario, controller=push(arm, selection=2))
