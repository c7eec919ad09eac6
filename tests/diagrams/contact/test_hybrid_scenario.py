import math
import warnings
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from chamfer.diagrams.contact.contact_scenarios import (
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
    PlanarScenario,
    PlanarSlideScenario,
    PumaNuggetHoldScenario,
    PumaNuggetMotionScenario,
    PumaRollerHoldScenario,
    PumaRollerMotionScenario,
    RecoveryScenario,
    WristContentionScenario,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import (
    growth_contact,
    growth_rate,
    linear_loops,
    resolve,
)
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST
from chamfer.systems.force.sampled_loop import NEUTRAL

PLANAR = (PlanarScenario, PlanarSlideScenario, RecoveryScenario)
SPATIAL = (
    PumaRollerHoldScenario,
    PumaRollerMotionScenario,
    PumaNuggetHoldScenario,
    PumaNuggetMotionScenario,
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    WristContentionScenario,
)
Make = Callable[..., HybridScenario]


def changed(scenario: HybridScenario, part: str, **values: Any) -> HybridScenario:
    """The scenario with other values in one of its parts."""
    return replace(scenario, **{part: replace(getattr(scenario, part), **values)})  # type: ignore[arg-type]


def rubbing(scenario: HybridScenario, **values: Any) -> HybridScenario:
    """The scenario with another joint friction."""
    return changed(scenario, "arm", joint_friction=replace(scenario.arm.joint_friction, **values))


def refusal(make: Callable[[], HybridScenario]) -> str:
    """What is said when a scenario is made, resolved and wired; one line."""
    with pytest.raises(ParameterError) as caught:
        make_hybrid_diagram(resolve(make()))
    message = str(caught.value)
    assert "\n" not in message
    assert ", allowed: " in message
    return message


@pytest.mark.parametrize("make", [*PLANAR, *SPATIAL])
def test_defaults_resolve_to_what_is_told_and_are_stable_out_of_contact(make: Make) -> None:
    scenario = make()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        resolved = resolve(scenario)
        assert resolve(resolved) == resolved
    # What was given stays.
    for part in ("controller", "sensor", "encoders", "detection"):
        before, after = getattr(scenario, part), getattr(resolved, part)
        given = [one.name for one in fields(before) if getattr(before, one.name) is not None]
        assert replace(before, **{name: getattr(after, name) for name in given}) == before
        resolved = replace(resolved, **{part: before})
    assert resolved == scenario
    assert growth_rate(scenario) <= NEUTRAL


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"step": 3e-5}, "step is 3e-05, allowed: a whole part of the period, 0.005"),
        ({"step": 0.0026}, "step is 0.0026, allowed: a whole part of the period, 0.005"),
        ({"step": 0.01}, "step is 0.01, allowed: a whole part of the period, 0.005"),
        ({"step": 0.0}, "step is 0.0, allowed: a finite number > 0"),
        ({"step": math.nan}, "step is nan, allowed: a finite number > 0"),
        ({"duration": 0.049}, "duration is 0.049, allowed: 10 to 1000000 periods of 0.005 s"),
        ({"duration": 5001.0}, "duration is 5001.0, allowed: 10 to 1000000 periods"),
        ({"duration": math.inf}, "duration is inf, allowed: a finite number > 0"),
        ({"measure_after": -1.0}, "measure_after is -1.0, allowed: a finite number >= 0"),
        ({"measure_after": math.nan}, "measure_after is nan, allowed: a finite number >= 0"),
        ({"trials": 0}, "trials is 0, allowed: 1 to 1000"),
        ({"trials": 1001}, "trials is 1001, allowed: 1 to 1000"),
    ],
)
def test_bad_values_of_a_run_are_named(values: dict[str, Any], message: str) -> None:
    assert refusal(lambda: PlanarScenario(**values)).startswith(message)


@pytest.mark.parametrize("step", [0.005, 1e-4, 5e-5, 0.005 / 3, 0.005 / 7])
def test_a_step_may_be_any_whole_part_of_the_period(step: float) -> None:
    plant = PlanarScenario(step=step).plant
    assert plant.step == step
    assert plant.period * plant.window == pytest.approx(0.005, rel=1e-12)
    assert plant.period <= max(step, 1e-3 * (1 + 1e-12))
    assert plant.held == {1e-4: 10, 5e-5: 20}.get(step, 1)


def test_ten_periods_are_the_shortest_run() -> None:
    assert PlanarScenario(duration=0.05).duration == 0.05


@pytest.mark.parametrize(
    ("part", "values", "message"),
    [
        ("task", {"start": (1.0, 0.0, 0.0)}, "direction is (0.0, -1.0), allowed: 3 numbers"),
        (
            "task",
            {
                "start": (1.0, 0.0, 0.0),
                "direction": (0.0, -1.0, 0.0),
                "along": (1.0, 0.0, 0.0),
            },
            "task.start is (1.0, 0.0, 0.0), allowed: 2 numbers",
        ),
        ("task", {"start": (math.nan, 0.0)}, "start is (nan, 0.0), allowed: finite numbers"),
        ("task", {"direction": (0.0, 0.0)}, "direction is [0.0, 0.0], allowed: a finite vector"),
        ("task", {"along": (0.0, 0.0)}, "along is [0.0, 0.0], allowed: a finite vector"),
        ("task", {"along": (1.0,)}, "along is (1.0,), allowed: 2 numbers"),
        ("task", {"speed": 0.0}, "speed is 0.0, allowed: a finite number > 0"),
        ("task", {"acceleration": -1.0}, "acceleration is -1.0, allowed: a finite number > 0"),
        ("task", {"force": 0.0}, "force is 0.0, allowed: a finite number > 0"),
        ("task", {"force": math.nan}, "force is nan, allowed: a finite number > 0"),
        ("task", {"amplitude": -0.1}, "amplitude is -0.1, allowed: a finite number >= 0"),
        ("task", {"frequency": 0.0}, "frequency is 0.0, allowed: a finite number > 0"),
        ("task", {"nugget_mass": 0.0}, "nugget_mass is 0.0, allowed: a finite number > 0"),
        ("task", {"kick_time": -1.0}, "kick_time is -1.0, allowed: a finite number > 0"),
        ("task", {"kick_time": math.nan}, "kick_time is nan, allowed: a finite number > 0"),
        ("task", {"kick_speed": 0.0}, "kick_speed is 0.0, allowed: a finite number > 0"),
        ("arm", {"elbow": "up"}, "elbow is 'up', allowed: negative, positive"),
        (
            "arm",
            {"contact_offset": (math.nan, 0.0, 0.0)},
            "contact_offset is (nan, 0.0, 0.0), allowed: three finite numbers",
        ),
        ("surface", {"stiffness": 0.0}, "stiffness is 0.0, allowed: a finite number > 0"),
        ("controller", {"period": 0.0}, "period is 0.0, allowed: a finite number > 0"),
        ("controller", {"law": "magic"}, "law is 'magic', allowed: inverse, transpose, projected"),
        (
            "controller",
            {"stiffness": (1.0,)},
            "controller.stiffness is (1.0,), allowed: 2 numbers, or one for all",
        ),
        (
            "controller",
            {"stiffness": (1.0,) * 3, "integral": (1.0,) * 3, "damping": (1.0,) * 3},
            "controller.stiffness is (1.0, 1.0, 1.0), allowed: 2 numbers",
        ),
        ("controller", {"damping": (1.0,)}, "controller.damping is (1.0,), allowed: 2 numbers"),
        ("controller", {"damping": (1.0, -1.0)}, "damping is (1.0, -1.0), allowed: finite"),
        (
            "controller",
            {"feedforward_torque": (1.0,)},
            "controller.feedforward_torque is (1.0,), allowed: 2 numbers, or none",
        ),
        (
            "controller",
            {"inertia": (1.0, 1.0)},
            "inertia is (1.0, 1.0), allowed: None without full dynamics",
        ),
        ("controller", {"force_integral": -1.0}, "force_integral is -1.0, allowed: a finite"),
        ("controller", {"creep_speed": 0.0}, "creep_speed is 0.0, allowed: a finite number > 0"),
        ("controller", {"held_integrators": (2,)}, "controller.held_integrators is (2,), allo"),
        (
            "controller",
            {"law": "transpose", "full_dynamics": True},
            "law is 'transpose', allowed: inverse or projected with full dynamics",
        ),
        ("sensor", {"noise": -1.0}, "noise is -1.0, allowed: a finite number >= 0"),
        ("sensor", {"cross_talk": 1.0}, "cross_talk is 1.0, allowed: more than -0.5 and less"),
        ("detection", {"detect": 0.0}, "detect is 0.0, allowed: a finite number > 0"),
        ("detection", {"detect": 0.1, "release": 0.1}, "release is 0.1, allowed: less than det"),
    ],
)
def test_bad_values_of_a_part_are_named(part: str, values: dict[str, Any], message: str) -> None:
    assert refusal(lambda: changed(PlanarScenario(), part, **values)).startswith(message)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"coulomb": (1.0,)}, "viscous is (1.0, 1.0), allowed: 1 numbers"),
        (
            {"coulomb": (1.0, 1.0, 1.0), "viscous": (1.0, 1.0, 1.0)},
            "arm.joint_friction.coulomb is (1.0, 1.0, 1.0), allowed: 2 numbers",
        ),
        ({"coulomb": (-1.0, 1.0)}, "coulomb is (-1.0, 1.0), allowed: finite numbers >= 0"),
        ({"breakaway": 0.5}, "breakaway is 0.5, allowed: a finite number >= 1"),
    ],
)
def test_bad_values_of_joint_friction_are_named(values: dict[str, Any], message: str) -> None:
    assert refusal(lambda: rubbing(PlanarScenario(), **values)).startswith(message)


@pytest.mark.parametrize(
    ("make", "part", "values", "message"),
    [
        (AdeptNuggetHoldScenario, "surface", {"tilt": 2.0}, "tilt is 2.0, allowed: less than"),
        (AdeptNuggetHoldScenario, "surface", {"ripple": -1e-5}, "ripple is -1e-05, allowed: a"),
        (AdeptNuggetHoldScenario, "surface", {"wavelength": 0.0}, "wavelength is 0.0, allowed"),
        (AdeptNuggetHoldScenario, "surface", {"stiffness": 0.0}, "stiffness is 0.0, allowed: a"),
        (AdeptNuggetHoldScenario, "task", {"distance": -1.0}, "distance is -1.0, allowed: a fin"),
        (
            AdeptNuggetHoldScenario,
            "task",
            {"along": (1.0, 0.0, 0.0, 0.0)},
            "along is (1.0, 0.0, 0.0), allowed: at right angles to (-1.0, -0.0, -0.0)",
        ),
        (
            AdeptNuggetHoldScenario,
            "task",
            {"start": (0.9, 0.0, 0.3, 0.0)},
            "endpoint is (0.9, 0.0, 0.3, 0.0), allowed: more than 0.05 m and less than 0.8 m",
        ),
        (
            PumaRollerHoldScenario,
            "task",
            {"start": (2.0, 0.0, 0.0)},
            "endpoint is (2.0, 0.0, 0.0), allowed: more than 0.1368 m and less than 0.5432 m",
        ),
        (
            PumaRollerHoldScenario,
            "task",
            {"start": (0.005, 0.0, 0.3)},
            "endpoint is (0.005, 0.0, 0.3), allowed: more than 0.011 m from the waist's axis",
        ),
    ],
)
def test_bad_values_in_space_are_named(
    make: Make, part: str, values: dict[str, Any], message: str
) -> None:
    assert refusal(lambda: changed(make(), part, **values)).startswith(message)


POSITIVE = changed(PlanarScenario(), "arm", elbow="positive")


def test_the_unstable_elbow_is_refused_with_its_growth() -> None:
    # reference: the closed loop's eigenvalue at (1, -1.5) with q2 = +51.3 degrees is +33.6 1/s
    # In contact with 10 kN/m; out of it the loss mode's damping would hold it.
    assert growth_contact(POSITIVE) == pytest.approx(31.2, abs=0.5)
    message = refusal(lambda: POSITIVE)
    assert message.startswith(
        "controller.law is 'inverse', allowed: projected, transpose or other gains: the loop is "
        "unstable in contact"
    )
    assert f"it grows at {growth_contact(POSITIVE):.3g} 1/s" in message
    assert "controller.allow_unstable=true" in message


def test_the_unstable_elbow_runs_if_that_is_asked_for() -> None:
    allowed = changed(POSITIVE, "controller", allow_unstable=True)
    with pytest.warns(UserWarning, match=r"grows at 31\.2 1/s"):
        resolve(allowed)


@pytest.mark.parametrize("law", ["projected", "transpose"])
@pytest.mark.parametrize("elbow", ["negative", "positive"])
def test_other_laws_are_stable_with_both_elbows(law: str, elbow: str) -> None:
    scenario = changed(changed(PlanarScenario(), "arm", elbow=elbow), "controller", law=law)
    assert growth_rate(resolve(scenario)) <= NEUTRAL


def slope(scenario: HybridScenario) -> float:
    """Of the surface at the intended contact point, along the motion."""
    surface = scenario.surface
    return math.tan(surface.tilt) + 2 * math.pi * surface.ripple / surface.wavelength


def contact_point(scenario: HybridScenario, endpoint: np.ndarray) -> np.ndarray:
    q = scenario.joint_positions(endpoint)
    return scenario.dynamics().evaluate(q, np.zeros(len(q))).p_WC


def in_space(vector: tuple[float, ...]) -> np.ndarray:
    return np.array([*vector, 0.0, 0.0])[:3]


OFF_AXIS = changed(AdeptNuggetHoldScenario(), "arm", contact_offset=(0.03, -0.02, 0.01))
OFF_TIP = changed(PumaRollerHoldScenario(), "arm", contact_offset=(0.0, 0.01, 0.02))
STEEP = changed(AdeptRollerMotionScenario(), "surface", tilt=0.3, ripple=1e-3)


@pytest.mark.parametrize("scenario", [*(make() for make in SPATIAL), OFF_AXIS, OFF_TIP, STEEP])
def test_the_surface_passes_through_the_contact_point(scenario: HybridScenario) -> None:
    surface, at = scenario.make_surface(), contact_point(scenario, scenario.touching)
    gap, normal = locate(surface, at)
    assert gap == pytest.approx(0, abs=1e-12)
    away, along = -in_space(scenario.task.direction), in_space(scenario.task.along)
    level = math.hypot(1, slope(scenario))
    np.testing.assert_allclose(normal, (away - slope(scenario) * along) / level, atol=1e-12)
    # 1 mm off the surface, along its normal.
    assert locate(surface, at + 1e-3 * away).gap == pytest.approx(1e-3 / level, rel=1e-9)


@pytest.mark.parametrize("scenario", [*(make() for make in SPATIAL), OFF_AXIS, STEEP])
def test_the_start_is_the_distance_away_from_the_surface(scenario: HybridScenario) -> None:
    at = contact_point(scenario, np.array(scenario.task.start))
    gap, _ = locate(scenario.make_surface(), at)
    expected = scenario.task.distance / math.hypot(1, slope(scenario))
    assert gap == pytest.approx(expected, rel=1e-9)
    assert gap == pytest.approx(scenario.task.distance, rel=0.2)


def test_the_gap_at_the_start_is_the_distance_on_a_plain_surface() -> None:
    scenario = PumaNuggetHoldScenario()
    at = contact_point(scenario, np.array(scenario.task.start))
    assert locate(scenario.make_surface(), at).gap == pytest.approx(0.03, abs=1e-12)


def test_a_positive_tilt_rises_towards_the_motion() -> None:
    scenario = changed(AdeptRollerHoldScenario(), "surface", tilt=0.1, ripple=0.0)
    surface, at = scenario.make_surface(), contact_point(scenario, scenario.touching)
    ahead = locate(surface, at + 0.01 * in_space(scenario.task.along)).gap
    assert ahead == pytest.approx(-0.01 * math.sin(0.1), rel=1e-9)


@pytest.mark.parametrize("make", PLANAR)
def test_the_planar_arm_meets_the_crucibles_bottom(make: Make) -> None:
    scenario = make()
    assert scenario.make_surface() == Crucible()
    gap, normal = locate(scenario.make_surface(), contact_point(scenario, scenario.touching))
    assert gap == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(normal, [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("make", [PlanarScenario, PumaRollerHoldScenario, AdeptNuggetHoldScenario])
def test_start_and_contact_point_are_reached_with_the_chosen_elbow(make: Make) -> None:
    for elbow, sign in (("negative", -1.0), ("positive", 1.0)):
        scenario = changed(make(), "arm", elbow=elbow)
        for endpoint in (np.array(scenario.task.start), scenario.touching):
            q = scenario.joint_positions(endpoint)
            np.testing.assert_allclose(scenario.ARM.endpoint(q), endpoint, atol=1e-12)
            assert np.sign(q[2 if make is PumaRollerHoldScenario else 1]) == sign


def test_directions_of_any_length_are_the_same() -> None:
    scenario = changed(PlanarScenario(), "task", direction=(0.0, -7.0), along=(0.2, 0.0))
    np.testing.assert_array_equal(scenario.direction, [0, -1])
    np.testing.assert_array_equal(scenario.along, [1, 0])
    np.testing.assert_allclose(scenario.touching, [1, -1.5])
    spatial = changed(PumaRollerHoldScenario(), "task", direction=(0.0, 0.0, -2.0))
    assert spatial.make_surface() == PumaRollerHoldScenario().make_surface()


@pytest.mark.parametrize("make", [PlanarScenario, PumaRollerHoldScenario, AdeptNuggetHoldScenario])
def test_the_controller_knows_gravity_at_the_start(make: Make) -> None:
    scenario = make()
    q = scenario.joint_positions(np.array(scenario.task.start))
    expected = scenario.dynamics().gravity_torque(q)
    np.testing.assert_allclose(resolve(scenario).controller.feedforward_torque, expected)
    known = changed(scenario, "controller", feedforward_torque=(1.0,) * scenario.ARM.num_joints)
    assert resolve(known).controller.feedforward_torque == known.controller.feedforward_torque
    if make is AdeptNuggetHoldScenario:  # 6 kg that move vertically; d3 counts downwards
        np.testing.assert_allclose(expected, [0, 0, -6 * 9.81, 0], atol=1e-9)


def test_full_dynamics_brings_the_inertia_at_the_contact_point() -> None:
    scenario = AdeptNuggetHoldScenario()
    assert resolve(scenario).controller.inertia is None
    full = resolve(changed(scenario, "controller", full_dynamics=True))
    q = scenario.joint_positions(scenario.touching)
    mass = scenario.dynamics().evaluate(q, np.zeros(4)).mass
    np.testing.assert_allclose(full.controller.inertia or (), np.diag(mass))
    assert resolve(full) == full


def test_what_is_set_reaches_the_plant() -> None:
    scenario = changed(AdeptNuggetHoldScenario(), "controller", period=0.004)
    plant = scenario.plant
    assert (plant.held, plant.window) == (10, 4)
    assert plant.joint_friction == scenario.arm.joint_friction
    assert plant.contact == scenario.surface


def test_a_loop_that_only_its_sampling_makes_unstable_is_refused() -> None:
    loop = PlanarScenario()
    for damping, refused in ((60.0, False), (90.0, True)):
        controller = replace(loop.controller, damping=(damping, damping))
        scenario = replace(loop, controller=controller)
        if refused:
            with pytest.raises(ParameterError, match=r"controller\.law is 'inverse'.*grows at"):
                resolve(scenario)
        else:
            resolve(scenario)


def test_an_approach_that_its_gains_make_unstable_is_refused() -> None:
    loop = PlanarScenario()
    controller = replace(loop.controller, law="transpose", damping=(60.0, 6000.0))
    scenario = replace(loop, controller=controller)
    grows = {loop.mode: loop.growth_rate() for loop in linear_loops(scenario)}
    assert max(grows[CONTACT], grows[LOST]) <= NEUTRAL < grows[APPROACH]  # in contact y is free
    with pytest.raises(ParameterError, match=r"controller\.law is 'transpose'.*grows at"):
        resolve(scenario)
