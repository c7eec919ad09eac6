"""The hybrid loop: how it is wired, what its controller may know, and its runs."""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.analysis.contact.contact_runs import run_contact
from chamfer.analysis.contact.hybrid_stability import settled, smooth
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.linear.to_control import to_control
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    CONTACT_RECOVERY,
    PLANAR_HOLD,
    PLANAR_SLIDE,
    PLANAR_SLIDE_LATE,
    PUMA_ROLLER_HOLD,
    PlanarScenario,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import (
    linear_loop,
    linear_loops,
    resolve,
    stability,
)
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.surface import normal
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams, LoadCellParams

Wire = tuple[str, str, str, str]  # from block and port, to block and port

PLANT = "manipulator and contact"
SENSOR = "force sensor"
CONTROL = "hybrid control"
DETECTION = "contact detection"
COMPENSATION = "friction compensation"
ENCODERS, DELAY = "encoders", "computation delay"


def into(wiring: Iterable[Wire], block: str) -> set[Wire]:
    return {wire for wire in wiring if wire[2] == block}


def changed(scenario: HybridScenario, part: str, **values: Any) -> HybridScenario:
    """The scenario with other values in one of its parts."""
    return replace(scenario, **{part: replace(getattr(scenario, part), **values)})  # type: ignore[arg-type]


PLANAR, PUMA, ADEPT = PLANAR_HOLD, PUMA_ROLLER_HOLD, ADEPT_NUGGET_HOLD
FEED = FrictionCompensationParams(bandwidth=20.0)
COMPENSATED = [replace(scenario, friction_compensation=FEED) for scenario in (PLANAR, PUMA, ADEPT)]
OTHERS = [
    changed(ADEPT, "controller", full_dynamics=True),
    replace(changed(ADEPT, "controller", full_dynamics=True), friction_compensation=FEED),
    CONTACT_RECOVERY,
]
REALISTIC = [
    replace(scenario, sensing="realistic")
    # The gains of chapter 2 are unstable with it.
    for scenario in (changed(PLANAR, "controller", allow_unstable=True), PUMA, COMPENSATED[2])
]
WIRED = [fill(scenario) for scenario in (PUMA, ADEPT, COMPENSATED[0], *OTHERS[1:], *REALISTIC)]


def reader(scenario: HybridScenario) -> str:
    """The block behind the force sensor, which gives the force to who asks."""
    return "push" if isinstance(scenario.sensor, LoadCellParams) else "force in the world"


def shown(scenario: HybridScenario) -> str:
    """The block that shows where the joints are."""
    return ENCODERS if scenario.sensing == "realistic" else PLANT


@pytest.mark.parametrize("scenario", WIRED)
def test_the_arms_state_leaves_it_through_encoders_and_force_sensors_only(
    scenario: HybridScenario, wires: Any
) -> None:
    wiring = wires(make_hybrid_diagram(scenario), flat=True)
    sensed = {(PLANT, "tool_force", SENSOR, "tool_force")}
    if scenario.sensing == "realistic":
        sensed.add((PLANT, "encoders", ENCODERS, "motion"))
    else:
        sensed.add((PLANT, "encoders", CONTROL, "encoders"))
        if not isinstance(scenario.sensor, LoadCellParams):
            sensed.add((PLANT, "encoders", reader(scenario), "encoders"))
    if scenario.friction_compensation is not None:
        sensed.add((PLANT, "base_torque", COMPENSATION, "base_torque"))
    assert {wire for wire in wiring if wire[0] == PLANT} == sensed


@pytest.mark.parametrize("scenario", WIRED)
def test_controller_and_contact_detection_know_what_is_measured_only(
    scenario: HybridScenario, wires: Any
) -> None:
    wiring = wires(make_hybrid_diagram(scenario), flat=True)
    ((force, port),) = {wire[:2] for wire in into(wiring, DETECTION)}
    assert force == reader(scenario)
    assert {wire for wire in into(wiring, force) if wire[0] != SENSOR} == (
        set()
        if isinstance(scenario.sensor, LoadCellParams)
        else {(shown(scenario), "encoders", force, "encoders")}
    )
    assert into(wiring, CONTROL) == {
        (shown(scenario), "encoders", CONTROL, "encoders"),
        (force, port, CONTROL, "measured_force"),
        (DETECTION, "state", CONTROL, "mode"),
        ("selection", "selection", CONTROL, "selection"),
        ("desired trajectory", "desired_position", CONTROL, "desired_position"),
        ("desired force", "y0", CONTROL, "desired_force"),
    }
    for block, given in (("selection", "state"), ("desired trajectory", "contact_time")):
        assert {wire[:2] for wire in into(wiring, block)} == {(DETECTION, given)}
    assert not into(wiring, "desired force")
    # Only noise comes into the sensor beside the force.
    others = {wire[0] for wire in into(wiring, SENSOR)} - {PLANT}
    sensor = scenario.sensor
    noises = {"sensor noise": sensor.noise, "sensor drift": sensor.drift}
    assert others == {name for name, size in noises.items() if size}
    assert not any(into(wiring, name) for name in others)
    # The torque reaches the arm through compensation and delay.
    read = {wire for wire in wiring if wire[1] == "base_torque"}
    (drive,) = (wire for wire in into(wiring, PLANT) if wire[3] == "torque")
    if scenario.sensing == "realistic":
        assert drive == (DELAY, "torque", PLANT, "torque")
        assert {wire[0] for wire in into(wiring, DELAY) if wire[3] == "jitter"} == {"jitter"}
        (drive,) = (wire for wire in into(wiring, DELAY) if wire[3] == "command")
    if scenario.friction_compensation is None:
        assert read == set()
        assert drive[:2] == (CONTROL, "torque")
        return
    assert read == {(PLANT, "base_torque", COMPENSATION, "base_torque")}
    assert drive[:2] == (COMPENSATION, "torque")
    assert into(wiring, COMPENSATION) == read | {(CONTROL, "torque", COMPENSATION, "command")}


def test_an_own_controller_takes_the_hybrid_laws_place(wires: Any, push: Any) -> None:
    scenario = fill(replace(PLANAR, duration=0.3))
    arm = scenario.ARM
    diagram = make_hybrid_diagram(scenario, controller=push(arm))
    assert into(wires(diagram), CONTROL) == into(wires(make_hybrid_diagram(scenario)), CONTROL)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.3)
    q = diagram.GetOutputPort("encoders").Eval(simulator.get_context())[: arm.num_joints]
    # 15 N downwards on an arm without gravity: down it goes, faster than joint friction holds.
    assert arm.endpoint(q)[1] < -0.05
    message = (
        r"^controller is 'Push', allowed: a system with the vector input port encoders of size 4; "
        r"its vector input ports and their sizes are: encoders \(2\), desired_force"
    )
    with pytest.raises(ParameterError, match=message):
        make_hybrid_diagram(scenario, controller=push(arm, encoders=2))


def test_the_controller_does_not_know_how_the_surface_is_tilted() -> None:
    tilted = changed(
        ADEPT,
        "surface",
        tilt=0.4,
        ripple=1e-3,
        friction=SurfaceFriction(coefficient=0.9),
        stiffness=5e4,
    )
    assert fill(tilted).controller == fill(ADEPT).controller
    np.testing.assert_array_equal(tilted.direction, ADEPT.direction)


# The adept's wall and the puma's table are near, so that the force settles in a short run.
NEAR_WALL = changed(
    replace(ADEPT, duration=0.6), "task", start=(0.4985, -0.3, 0.3, 0.0), distance=0.0015
)


def test_the_measured_force_is_the_one_of_its_time() -> None:
    near = changed(replace(PLANAR, duration=1.0), "task", start=(1.0, -1.4))
    traces = run_contact(resolve(near), 0)
    assert traces["force"].max() > 15
    # But for what the arm turned since.
    np.testing.assert_allclose(
        traces["measured_force"][:-1], traces["force"][:-1], rtol=1e-5, atol=1e-12
    )
    noisy = run_contact(resolve(NEAR_WALL), 0)
    across = 0.1 * 3 * np.abs(noisy["force"][:-1])  # cross-talk
    off = np.abs(noisy["measured_force"] - noisy["force"])[:-1]
    assert np.all(off <= 0.5 + across)
    assert off.max() > 0.4


def near(scenario: Any, **changes: Any) -> HybridScenario:
    """Return a scenario without dry friction and noise that starts near its surface."""
    task = {"start": (1.0, -1.4)} if isinstance(scenario, PlanarScenario) else {"distance": 2e-3}
    return smooth(changed(changed(scenario, "task", **task), "controller", **changes))


CASES = {
    "planar, full dynamics, positive elbow": near(
        replace(PLANAR_HOLD, arm=replace(PLANAR_HOLD.arm, elbow="positive")),
        law="projected",
        full_dynamics=True,
    ),
    "planar, gripper": near(
        replace(PLANAR_HOLD, gripper=GripperCompliance(stiffness=(3e3, 5e3, 4e3), damping=30.0))
    ),
    "Puma, tracked, friction compensated": near(
        replace(
            PUMA_ROLLER_HOLD,
            encoders=EncoderParams(velocity="tracked", bandwidth=60.0),
            friction_compensation=FrictionCompensationParams(bandwidth=10.0),
        )
    ),
    "Adept, late by a period, differenced, slow sensor": near(
        replace(
            ADEPT_NUGGET_HOLD,
            encoders=EncoderParams(velocity="differenced", bandwidth=40.0),
            sensor=ForceSensorParams(bandwidth=20.0, delay=7e-3),
        ),
        computation_delay=5e-3,
        computation_jitter=0.0,
    ),
    "Adept, gripper without damping": near(
        replace(ADEPT_NUGGET_HOLD, gripper=GripperCompliance(stiffness=2e4)), force_damping=300.0
    ),
}


# The gate's alone.
PATIENT = {
    "planar, full dynamics, positive elbow",
    "planar, gripper",
    "Adept, gripper without damping",
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=[pytest.mark.slow] if one in PATIENT else []) for one in CASES],
)
def test_poles_in_contact_are_those_of_the_diagram(name: str) -> None:
    scenario = resolve(CASES[name])
    diagram, period = make_hybrid_diagram(scenario), scenario.controller.period
    context = settled(diagram, 1.0)
    assert diagram.GetOutputPort("mode").Eval(context)[0] == CONTACT
    found = to_control(diagram, at=context, period=period, whole=True).poles()
    q = diagram.GetOutputPort("encoders").Eval(context)[: scenario.ARM.num_joints]
    loop = linear_loop(scenario, "here", CONTACT, scenario.ARM.endpoint(q))
    expected = np.linalg.eigvals(loop.period_map())
    assert np.abs(expected).max() == pytest.approx(1.0, abs=1e-6)
    for pole in expected:  # the slow ones decide; fast ones feel the contact's implicit steps
        assert np.abs(found - pole).min() < (1.5e-3 if abs(pole) > 0.6 else 6e-3), pole


def test_the_gain_margin_is_that_of_the_diagram_opened_at_its_torque() -> None:
    scenario = resolve(CASES["planar, full dynamics, positive elbow"])
    diagram = make_hybrid_diagram(scenario)
    context = settled(diagram, 1.0)
    opened = to_control(
        diagram,
        input="manipulator and contact::torque",
        at=context,
        period=scenario.controller.period,
    )
    q = diagram.GetOutputPort("encoders").Eval(context)[: scenario.ARM.num_joints]
    margin = linear_loop(scenario, "here", CONTACT, scenario.ARM.endpoint(q)).gain_margin()
    assert margin is not None
    for share, stable in ((0.98, True), (1.02, False)):
        closed = opened.A - share * margin * opened.B @ opened.C
        largest = np.abs(np.linalg.eigvals(closed)).max()
        assert bool(largest < 1 + 1e-6) is stable


def test_the_modes_are_looked_at_where_they_happen() -> None:
    loops = linear_loops(resolve(PLANAR_SLIDE))
    modes = [loop.mode for loop in loops]
    assert modes == [APPROACH, APPROACH, LOST, *5 * [CONTACT]]
    # without friction it does not matter which way the tip slides
    assert len({loop.gain_margin() for loop in loops}) == len(loops) - 2
    assert all(loop.growth_rate() <= NEUTRAL for loop in loops)


LOWER = "a lower one: the loop is unstable"
RUN = "(or controller.allow_unstable=true)"


@pytest.mark.parametrize(
    ("name", "value", "blamed", "allowed"),
    [
        ("force_integral", 20.0, None, f"{LOWER} in contact, it grows at 4.93 1/s {RUN}"),
        ("computation_delay", 0.005, None, f"{LOWER} out of contact, it grows at 60.6 1/s {RUN}"),
        ("creep_damping", 2e3, None, f"{LOWER} out of contact"),
        ("force_damping", 2e3, None, f"{LOWER} in contact"),
        ("damping", 90.0, "law is 'inverse'", "projected, transpose or other gains: the loop is"),
    ],
)
def test_what_makes_a_loop_unstable_is_named(
    name: str, value: float, blamed: str | None, allowed: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        resolve(changed(PLANAR, "controller", **{name: value}))
    message = f"controller.{blamed or f'{name} is {value}'}, allowed: {allowed}"
    assert str(caught.value).startswith(message)


def test_with_sensors_and_computer_as_they_are_chapter_2s_gains_are_too_high() -> None:
    realistic = replace(PLANAR_HOLD, sensing="realistic")
    with pytest.raises(ParameterError, match="unstable out of contact"):
        resolve(realistic)
    late = replace(realistic, controller=PLANAR_SLIDE_LATE.controller)
    resolve(changed(late, "controller", computation_delay=None, computation_jitter=None))


def test_gains_for_a_late_torque_bear_it() -> None:
    thesis, late = stability(fill(PLANAR_HOLD)), PLANAR_SLIDE_LATE
    assert thesis.delay_margin == pytest.approx(2.7e-3, abs=1e-4)
    assert thesis.gain_margin == pytest.approx(1.09, abs=0.01)
    borne = stability(fill(late))
    assert max(borne.growth or 0.0, borne.growth_contact) <= NEUTRAL
    assert borne.delay_margin is not None
    assert borne.delay_margin > 2.5e-3  # beyond the sample that it has
    # A delay that is there and one that is still to come add up.
    in_time = replace(late, controller=replace(late.controller, computation_delay=0.0))
    both = stability(fill(in_time)).delay_margin
    assert both == pytest.approx(borne.delay_margin + late.controller.period, abs=1e-6)


def rough(coefficient: float) -> PLANAR_SLIDE:
    """Return a slide on a rough crucible, from near its wall."""
    slide = replace(PLANAR_SLIDE, duration=5.5, measure_after=0.5)
    return replace(
        slide,
        surface=replace(slide.surface, friction=SurfaceFriction(coefficient=coefficient)),
        task=replace(slide.task, start=(1.0, -1.45), amplitude=0.03, frequency=2.0),
        controller=replace(slide.controller, allow_unstable=True),
    )


def test_on_a_rough_surface_it_slides_one_way_only() -> None:
    # Ahead, friction and push drive each other through the inverse law.
    assert stability(fill(rough(0.3))).growth_contact <= NEUTRAL
    loops = {loop.name: loop.growth_rate() for loop in linear_loops(fill(rough(0.8)))}
    assert loops["sliding back"] <= NEUTRAL < 5 < loops["sliding ahead"]
    with pytest.warns(UserWarning, match="unstable in contact, sliding ahead"):
        resolve(rough(0.8))


def gripped(stiffness: float) -> PlanarScenario:
    return PlanarScenario(gripper=GripperCompliance(stiffness=stiffness, damping=20.0))


def test_stability_is_that_of_the_pose_to_which_a_soft_gripper_gives() -> None:
    # 15 N press a gripper of 100 N/m by 0.15 m, to where the arm is nearly straight.
    resolve(gripped(200.0))
    with pytest.raises(ParameterError, match="unstable in contact, it grows at 75"):
        resolve(gripped(100.0))
    with pytest.raises(ParameterError, match=r"gripper\.stiffness is 10\.0, allowed: more, so"):
        resolve(gripped(10.0))


def test_a_motion_that_ends_out_of_reach_is_named() -> None:
    slide = PLANAR_SLIDE
    with pytest.raises(ParameterError, match=r"task\.amplitude is 0\.9, allowed: ends with more"):
        resolve(replace(slide, task=replace(slide.task, amplitude=0.9)))


def test_friction_is_as_uneven_as_it_says() -> None:
    """Without noise it is the coefficient, with it off by that much; each seed has its own."""
    rough = SurfaceFriction(coefficient=0.3)
    found = []
    for noise, seed in ((0.0, 0), (0.085, 0), (0.085, 1)):
        task = replace(PLANAR_SLIDE.task, start=(1.0, -1.3), amplitude=0.05, frequency=0.5)
        surface = replace(PLANAR_SLIDE.surface, friction=rough, friction_noise=noise)
        loop = fill(replace(PLANAR_SLIDE, task=task, surface=surface, duration=6.0))
        diagram = make_hybrid_diagram(loop)
        outputs = simulate(diagram, duration=6.0, step=loop.controller.period, seed=seed).outputs
        force, contact = outputs["contact_force"][:, :2], outputs["contact"]
        slides = (np.arange(len(force)) > 400) & (np.abs(contact[:, 2]) > 0.02)
        tip = loop.ARM.endpoint
        points = np.array([tip(q) for q in outputs["encoders"][slides, :2]])[:, :2]
        normals = np.array([normal(loop.make_surface(), np.array([*p, 0.0]))[:2] for p in points])
        push = np.sum(force[slides] * normals, axis=1)
        drag = np.linalg.norm(force[slides] - push[:, None] * normals, axis=1)
        found.append(drag / push)
    np.testing.assert_allclose(found[0], 0.3, rtol=1e-3)
    off = np.concatenate(found[1:]) / 0.3 - 1
    assert 0.05 < math.sqrt(float(np.mean(off**2))) < 0.15  # 0.085, of some four lengths each
    assert abs(found[1].mean() - found[2].mean()) > 1e-3
