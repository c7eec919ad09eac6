"""What a hybrid loop's scenario allows, and what is filled in where it leaves something open."""

import math
import warnings
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.diagrams.contact import contact_scenarios
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    ADEPT_ROLLER_MOTION,
    PLANAR_HOLD,
    PUMA_ROLLER_HOLD,
    PUMA_ROLLER_MOTION,
    AdeptLoop,
    PlanarLoop,
    PlanarScenario,
    PumaLoop,
)
from chamfer.diagrams.contact.hybrid_loop_stability import linear_loops, resolve, stability
from chamfer.diagrams.contact.hybrid_scenario import (
    HybridScenario,
    fill,
    require_steps,
    updates_of,
)
from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.sensing.force_sensor import ForceSensorParams

ALL = [one for one in vars(contact_scenarios).values() if isinstance(one, HybridScenario)]


def changed(scenario: HybridScenario, part: str, **values: Any) -> HybridScenario:
    """The scenario with other values in one of its parts."""
    return replace(scenario, **{part: replace(getattr(scenario, part), **values)})  # type: ignore[arg-type]


def refusal(make: Callable[[], HybridScenario]) -> str:
    """What is said when a scenario is made, resolved and wired; one line."""
    with pytest.raises(ParameterError) as caught:
        resolve(make())
    message = str(caught.value)
    assert "\n" not in message
    assert ", allowed: " in message
    return message


@pytest.mark.parametrize("scenario", ALL)
def test_defaults_resolve_and_are_stable(scenario: HybridScenario) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        resolved = resolve(scenario)
        assert resolve(resolved) == resolved
    # What was given stays.
    for part in ("controller", "sensor", "encoders", "detection", "surface"):
        before, after = getattr(scenario, part), getattr(resolved, part)
        given = [one.name for one in fields(before) if getattr(before, one.name) is not None]
        assert replace(before, **{name: getattr(after, name) for name in given}) == before
        resolved = replace(resolved, **{part: before})
    assert resolved == scenario


PLANAR, PUMA, ADEPT = PLANAR_HOLD, PUMA_ROLLER_HOLD, ADEPT_NUGGET_HOLD
SPATIAL = {"direction": (0.0, -1.0, 0.0), "along": (1.0, 0.0, 0.0)}
ONE_JOINT = JointFrictionParams(coulomb=(1.0,), viscous=(1.0,))
ADEPT_REACH, PUMA_REACH = "0.05 m and less than 0.8 m", "0.1368 m and less than 0.5432 m"


@pytest.mark.parametrize(
    ("scenario", "part", "values", "name", "allowed"),
    [
        (PLANAR, None, {"step": 3e-5}, "step", "a whole part of the period"),
        (PLANAR, None, {"step": 0.01}, "step", "a whole part of the period"),
        (PLANAR, None, {"duration": 0.049}, "duration", "10 to 1000000 periods"),
        (PLANAR, None, {"duration": 5001.0}, "duration", "10 to 1000000 periods"),
        (PLANAR, None, {"trials": 1001}, "trials", "1 to 1000"),
        (PLANAR, "task", {"start": (1.0, 0.0, 0.0), **SPATIAL}, "task.start", "2 numbers"),
        (PLANAR, "arm", {"elbow": "up"}, "elbow", "negative, positive"),
        (PLANAR, "arm", {"joint_friction": ONE_JOINT}, "arm.joint_friction.coulomb", "2 numbers"),
        (PLANAR, "controller", {"stiffness": (1.0,)}, "controller.stiffness", "2 numbers"),
        (PLANAR, "controller", {"held_integrators": (2,)}, "controller.held_integrators", "indic"),
        (ADEPT, "surface", {"tilt": 2.0}, "tilt", "less than"),
        (ADEPT, "task", {"along": (1.0, 0.0, 0.0, 0.0)}, "along", "at right angles to (-1.0, -0"),
        (ADEPT, "task", {"start": (0.9, 0.0, 0.3, 0.0)}, "endpoint", f"more than {ADEPT_REACH}"),
        (PUMA, "task", {"start": (2.0, 0.0, 0.0)}, "endpoint", f"more than {PUMA_REACH}"),
        (PUMA, "task", {"start": (0.005, 0.0, 0.3)}, "endpoint", "more than 0.011 m from the wai"),
    ],
)
def test_bad_values_are_named(
    scenario: HybridScenario, part: str | None, values: dict[str, Any], name: str, allowed: str
) -> None:
    def make() -> HybridScenario:
        return changed(scenario, part, **values) if part else replace(scenario, **values)

    message = refusal(make)
    assert message.startswith(f"{name} is ")
    assert f", allowed: {allowed}" in message


POSITIVE = changed(PLANAR_HOLD, "arm", elbow="positive")


def test_the_unstable_elbow_is_refused_with_its_growth() -> None:
    # reference: the closed loop's eigenvalue at (1, -1.5) with q2 = +51.3 degrees is +33.6 1/s
    # In contact with 10 kN/m; out of it the loss mode's damping would hold it.
    assert stability(fill(POSITIVE)).growth_contact == pytest.approx(31.2, abs=0.5)
    message = refusal(lambda: POSITIVE)
    assert message.startswith(
        "controller.law is 'inverse', allowed: projected, transpose or other gains: the loop is "
        "unstable in contact"
    )
    assert f"it grows at {stability(fill(POSITIVE)).growth_contact:.3g} 1/s" in message
    assert "controller.allow_unstable=true" in message


def slope(scenario: HybridScenario) -> float:
    """Of the surface at the intended contact point, along the motion."""
    surface = scenario.surface
    return math.tan(surface.tilt) + 2 * math.pi * surface.ripple / surface.wavelength


def contact_point(scenario: HybridScenario, endpoint: np.ndarray) -> np.ndarray:
    q = scenario.joint_positions(endpoint)
    return scenario.dynamics().evaluate(q, np.zeros(len(q))).p_WC


def in_space(vector: tuple[float, ...]) -> np.ndarray:
    return np.array([*vector, 0.0, 0.0])[:3]


OFF_AXIS = changed(ADEPT_NUGGET_HOLD, "arm", contact_offset=(0.03, -0.02, 0.01))
OFF_TIP = changed(PUMA_ROLLER_HOLD, "arm", contact_offset=(0.0, 0.01, 0.02))
STEEP = changed(ADEPT_ROLLER_MOTION, "surface", tilt=0.3, ripple=1e-3)


@pytest.mark.parametrize(
    "scenario", [PUMA_ROLLER_MOTION, ADEPT_NUGGET_HOLD, OFF_AXIS, OFF_TIP, STEEP]
)
def test_the_surface_passes_through_the_contact_point(scenario: HybridScenario) -> None:
    surface, at = scenario.make_surface(), contact_point(scenario, scenario.touching)
    gap, normal = locate(surface, at)
    assert gap == pytest.approx(0, abs=1e-12)
    away, along = -in_space(scenario.task.direction), in_space(scenario.task.along)
    level = math.hypot(1, slope(scenario))
    np.testing.assert_allclose(normal, (away - slope(scenario) * along) / level, atol=1e-12)
    # 1 mm off the surface, along its normal.
    assert locate(surface, at + 1e-3 * away).gap == pytest.approx(1e-3 / level, rel=1e-9)


@pytest.mark.parametrize("scenario", [PLANAR_HOLD, PUMA_ROLLER_HOLD, ADEPT_NUGGET_HOLD])
def test_the_controller_knows_gravity_at_the_start(scenario: HybridScenario) -> None:
    q = scenario.joint_positions(np.array(scenario.task.start))
    expected = scenario.dynamics().gravity_torque(q)
    np.testing.assert_allclose(resolve(scenario).controller.feedforward_torque, expected)
    known = changed(scenario, "controller", feedforward_torque=(1.0,) * scenario.ARM.num_joints)
    assert resolve(known).controller.feedforward_torque == known.controller.feedforward_torque
    if scenario is ADEPT_NUGGET_HOLD:  # 6 kg that move vertically; d3 counts downwards
        np.testing.assert_allclose(expected, [0, 0, -6 * 9.81, 0], atol=1e-9)


def test_full_dynamics_brings_the_inertia_at_the_contact_point() -> None:
    scenario = ADEPT_NUGGET_HOLD
    assert resolve(scenario).controller.inertia is None
    full = resolve(changed(scenario, "controller", full_dynamics=True))
    q = scenario.joint_positions(scenario.touching)
    mass = scenario.dynamics().evaluate(q, np.zeros(4)).mass
    np.testing.assert_allclose(full.controller.inertia or (), np.diag(mass))
    assert resolve(full) == full


def test_an_approach_that_its_gains_make_unstable_is_refused() -> None:
    loop = PLANAR_HOLD
    controller = replace(loop.controller, law="transpose", damping=(60.0, 6000.0))
    scenario = replace(loop, controller=controller)
    grows = {loop.mode: loop.growth_rate() for loop in linear_loops(fill(scenario))}
    assert max(grows[CONTACT], grows[LOST]) <= NEUTRAL < grows[APPROACH]  # in contact y is free
    with pytest.raises(ParameterError, match=r"controller\.law is 'transpose'.*grows at"):
        resolve(scenario)


@given(st.integers(1, 5000))
def test_updates_fill_the_period_and_last_a_millisecond_at_most(count: int) -> None:
    step = 0.005 / count
    require_steps(step, 0.005)
    held, window = updates_of(step, 0.005)
    assert held * window == count
    assert held == 1 or held * step <= 1e-3 + step / 2
    longer = (n for n in range(held + 1, count + 1) if count % n == 0)
    assert all(n * step > 1e-3 - step / 2 for n in longer)


LOOPS = [PlanarLoop(), PumaLoop(), AdeptLoop()]


def told(loop: HybridScenario, part: str, **values: Any) -> Any:
    """A part of the loop with other values in it, as it is filled in."""
    changed: Any = {part: replace(getattr(loop, part), **values)}
    return getattr(fill(replace(loop, **changed)), part)


@pytest.mark.parametrize("loop", LOOPS)
def test_ideal_is_the_figure(loop: HybridScenario) -> None:
    found = fill(loop)
    assert found.encoders.exact
    assert found.controller.computation_delay == found.controller.computation_jitter == 0
    assert not any(
        getattr(found.sensor, name)
        for name in ("bias", "drift", "bandwidth", "delay", "resolution", "full_scale", "tare")
    )


@pytest.mark.parametrize("loop", LOOPS)
def test_realistic_is_nowhere_ideal(loop: HybridScenario) -> None:
    found = fill(replace(loop, sensing="realistic"))
    assert not found.encoders.exact
    assert found.encoders.quanta(found.ARM.num_joints).all()
    assert found.controller.computation_delay
    assert found.controller.computation_jitter
    assert found.surface.friction_noise
    sensor = found.sensor
    assert all(
        (sensor.noise, sensor.bias, sensor.drift, sensor.bandwidth, sensor.resolution, sensor.tare)
    )
    if isinstance(sensor, ForceSensorParams):
        assert np.any(sensor.coupling != np.eye(len(sensor.coupling)))
    assert fill(found) == found


def test_what_is_given_stays() -> None:
    real = replace(AdeptLoop(), sensing="realistic")
    assert told(real, "sensor", noise=0.1).noise == 0.1
    assert told(real, "sensor", noise=0.1).bandwidth == fill(real).sensor.bandwidth
    assert told(real, "encoders", counts=1000.0).counts == 1000.0
    assert told(real, "detection", detect=2.0).detect == 2.0
    assert told(real, "controller", computation_delay=0.003).computation_delay == 0.003


def test_a_scalar_cross_talk_has_no_lever() -> None:
    found = told(replace(AdeptLoop(), sensing="realistic"), "sensor", cross_talk=0.2)
    assert isinstance(found, ForceSensorParams)
    assert found.position == (0.0, 0.0, 0.0)
    assert found.coupling.shape == (3, 3)


def test_bandwidths_fit_to_the_velocity() -> None:
    for sensing in ("ideal", "realistic"):
        loop = replace(PumaLoop(), sensing=sensing)
        for velocity, bandwidth in (("exact", 0.0), ("differenced", 0.0), ("tracked", 20.0)):
            assert told(loop, "encoders", velocity=velocity).bandwidth == bandwidth
        assert told(loop, "encoders", velocity="tracked", bandwidth=7.0).bandwidth == 7.0


def test_jitter_leaves_the_delay_within_its_period() -> None:
    real = replace(AdeptLoop(), sensing="realistic")
    for delay, jitter in ((0.0, 0.0), (1e-4, 1e-4), (0.0025, 2e-4), (0.005, 0.0)):
        found = told(real, "controller", computation_delay=delay)
        assert found.computation_jitter == pytest.approx(jitter, abs=1e-12)
    with pytest.raises(ParameterError, match=r"^controller.computation_delay is 0.006, all"):
        told(real, "controller", computation_delay=0.006)
    with pytest.raises(ParameterError, match=r"^encoders.counts is .*, allowed: 4 numbers, or on"):
        told(real, "encoders", counts=(1.0, 2.0))


def test_decoupling_spreads_the_noise_and_the_thresholds_follow() -> None:
    loop = AdeptLoop()
    plain, undone = (told(loop, "sensor", decoupling=on) for on in (False, True))
    assert plain.rest_noise == undone.rest_noise
    changed = fill(replace(loop, sensor=undone)).detection.detect
    row = np.abs(np.linalg.inv(undone.coupling)[0]).sum()  # of the push, along x
    assert changed == pytest.approx(1.6 * 0.5 * row, rel=1e-5)
    assert fill(loop).detection.detect == pytest.approx(0.8)


def test_the_wall_lies_ahead_of_the_start() -> None:
    def starting(*start: float, direction: tuple[float, float] = (0.0, -1.0)) -> PlanarScenario:
        task = replace(PLANAR_HOLD.task, start=start, direction=direction)
        return replace(PLANAR_HOLD, task=task)

    assert starting(1.0, -1.4).distance == pytest.approx(0.1)
    aside = starting(1.2, -0.6, direction=(3.0, -4.0))
    gap = locate(aside.make_surface(), np.array([*aside.touching, 0.0])).gap
    assert gap == pytest.approx(0.0, abs=1e-12)
    assert aside.distance > 0.3
    allowed = r"inside of the circle of 0\.75 m about \(1\.0, -0\.75\)"
    for start in ((1.9, 0.0), (1.0, 0.01), (1.0, -1.5)):
        with pytest.raises(ParameterError, match=rf"^task\.start is \(.*\), allowed: {allowed}$"):
            resolve(starting(*start))
