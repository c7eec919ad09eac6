"""How the hybrid loop is wired, and what its controller may know."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import Diagram

from chamfer.diagrams.contact.contact_scenarios import (
    AdeptNuggetHoldScenario,
    PlanarScenario,
    PumaRollerHoldScenario,
    RecoveryScenario,
)
from chamfer.diagrams.contact.hybrid_loop import SIGNALS, make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.friction_compensation import (
    FrictionCompensation,
    FrictionCompensationParams,
)
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.sensing.force_sensor import ForceSensor, LoadCellParams

Wire = tuple[str, str, str, str]  # from block and port, to block and port

PLANT = "manipulator and contact"
SENSOR = "force sensor"
CONTROL = "hybrid control"
DETECTION = "contact detection"
COMPENSATION = "friction compensation"
BLOCKS = {PLANT, SENSOR, CONTROL, DETECTION, "selection", "desired trajectory", "desired force"}
ENCODERS, DELAY = "encoders", "computation delay"


def changed(scenario: HybridScenario, part: str, **values: Any) -> HybridScenario:
    """The scenario with other values in one of its parts."""
    return replace(scenario, **{part: replace(getattr(scenario, part), **values)})  # type: ignore[arg-type]


def wires(diagram: Diagram) -> set[Wire]:
    """Every connection of a diagram without diagrams in it."""
    assert not any(isinstance(system, Diagram) for system in diagram.GetSystems())
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


def into(wiring: Iterable[Wire], block: str) -> set[Wire]:
    return {wire for wire in wiring if wire[2] == block}


PLANAR, PUMA, ADEPT = PlanarScenario(), PumaRollerHoldScenario(), AdeptNuggetHoldScenario()
FEED = FrictionCompensationParams(bandwidth=20.0)
COMPENSATED = [replace(scenario, friction_compensation=FEED) for scenario in (PLANAR, PUMA, ADEPT)]
OTHERS = [
    changed(ADEPT, "controller", full_dynamics=True),
    replace(changed(ADEPT, "controller", full_dynamics=True), friction_compensation=FEED),
    RecoveryScenario(),
]
REALISTIC = [
    replace(scenario, sensing="realistic")
    # The gains of chapter 2 are unstable with it.
    for scenario in (changed(PLANAR, "controller", allow_unstable=True), PUMA, COMPENSATED[2])
]
WIRED = [PLANAR, PUMA, ADEPT, *COMPENSATED, *OTHERS, *REALISTIC]


def reader(scenario: HybridScenario) -> str:
    """The block behind the force sensor, which gives the force to who asks."""
    return "push" if isinstance(scenario.sensor, LoadCellParams) else "force in the world"


def shown(scenario: HybridScenario) -> str:
    """The block that shows where the joints are."""
    return ENCODERS if scenario in REALISTIC else PLANT


pytestmark = pytest.mark.filterwarnings("ignore:the loop is unstable")


@pytest.mark.parametrize("scenario", WIRED)
def test_the_arms_state_leaves_it_through_encoders_and_force_sensors_only(
    scenario: HybridScenario,
) -> None:
    wiring = wires(make_hybrid_diagram(scenario))
    sensed = {(PLANT, "tool_force", SENSOR, "tool_force")}
    if scenario in REALISTIC:
        sensed.add((PLANT, "encoders", ENCODERS, "motion"))
    else:
        sensed.add((PLANT, "encoders", CONTROL, "encoders"))
        if not isinstance(scenario.sensor, LoadCellParams):
            sensed.add((PLANT, "encoders", reader(scenario), "encoders"))
    if scenario.friction_compensation is not None:
        sensed.add((PLANT, "base_torque", COMPENSATION, "base_torque"))
    assert {wire for wire in wiring if wire[0] == PLANT} == sensed
    # With the sensors' wires cut, nothing is left that knows the arm.
    assert reached(wiring - sensed, PLANT) == set()
    assert reached(wiring, PLANT) >= {CONTROL, DETECTION, "selection", "desired trajectory"}


@pytest.mark.parametrize("scenario", WIRED)
def test_controller_and_contact_detection_know_what_is_measured_only(
    scenario: HybridScenario,
) -> None:
    wiring = wires(make_hybrid_diagram(scenario))
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
    sensor = resolve(scenario).sensor
    noises = {"sensor noise": sensor.noise, "sensor drift": sensor.drift}
    assert others == {name for name, size in noises.items() if size}
    assert not any(into(wiring, name) for name in others)


@pytest.mark.parametrize("scenario", WIRED)
def test_the_torque_reaches_the_arm_through_the_delay(scenario: HybridScenario) -> None:
    wiring = wires(make_hybrid_diagram(scenario))
    read = {wire for wire in wiring if wire[1] == "base_torque"}
    (drive,) = (wire for wire in into(wiring, PLANT) if wire[3] == "torque")
    if scenario in REALISTIC:
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


def test_blocks_are_named_and_of_their_kind() -> None:
    wrist, noise = {"force in the world"}, {"sensor noise"}
    real = {"sensor noise", "sensor drift", ENCODERS, DELAY, "jitter"}
    for scenario, more in (
        (PLANAR, wrist),
        (PUMA, {"push", *noise}),
        (ADEPT, wrist | noise),
        (COMPENSATED[0], wrist | {COMPENSATION}),
        (RecoveryScenario(), wrist | {"kick"}),
        (REALISTIC[0], wrist | real),
        (REALISTIC[1], {"push"} | real),
        (REALISTIC[2], wrist | real | {COMPENSATION}),
    ):
        diagram = make_hybrid_diagram(scenario)
        assert {system.get_name() for system in diagram.GetSystems()} == BLOCKS | more
        assert scenario.ARM.name in diagram.get_name()
        for name, kind in (
            (PLANT, ArmInContact),
            (CONTROL, HybridController),
            (DETECTION, ContactDetection),
            (SENSOR, ForceSensor),
        ):
            assert isinstance(diagram.GetSubsystemByName(name), kind)
    compensation = make_hybrid_diagram(COMPENSATED[0]).GetSubsystemByName(COMPENSATION)
    assert isinstance(compensation, FrictionCompensation)


@pytest.mark.parametrize("scenario", WIRED)
def test_signals_are_exported_and_no_input_is_left(scenario: HybridScenario) -> None:
    diagram = make_hybrid_diagram(scenario)
    names = [diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())]
    assert names == list(SIGNALS)
    assert diagram.num_input_ports() == 0
    n = scenario.ARM.num_joints
    assert [diagram.GetOutputPort(name).size() for name in SIGNALS] == [
        2 * n,
        2 * n,
        3,
        6,
        n,
        n,
        n,
        1,
    ]


def test_the_controller_does_not_know_how_the_surface_is_tilted() -> None:
    tilted = changed(
        ADEPT,
        "surface",
        tilt=0.4,
        ripple=1e-3,
        friction=SurfaceFriction(coefficient=0.9),
        stiffness=5e4,
    )
    assert resolve(tilted).controller == resolve(ADEPT).controller
    np.testing.assert_array_equal(tilted.direction, ADEPT.direction)
