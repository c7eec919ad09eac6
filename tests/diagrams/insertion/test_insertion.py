"""Insertions: by sight, its wiring, feed and contact; and pegs that are fed without looking."""

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.diagrams.cell.alignment_scenario import ControllerChoice
from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    HoleKind,
    HoleSettings,
    WorkCell,
    WorkCellScenario,
    support_at,
    wedging_support,
)
from chamfer.diagrams.insertion.blind_feed import (
    BlindFeedScenario,
    Plane,
    make_blind_feed_diagram,
    resolve_fed_cell,
)
from chamfer.diagrams.insertion.cell_contact import add_cell_in_contact, export_contact
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    make_insertion_diagram,
    resolve,
    task_params,
)
from chamfer.diagrams.insertion.peg_insertion import (
    PegInsertionScenario,
    make_peg_insertion_diagram,
    resolve_peg_insertion,
)
from chamfer.models.peg.bore_contact import ContactMaterial, facets_needed
from chamfer.models.peg.peg_and_hole import ColouredParts, PegAndHole
from chamfer.models.peg.support import OpenSupport
from chamfer.systems.contact.peg_hole_contact_monitor import ContactState
from chamfer.systems.pose import pose_vector
from chamfer.systems.strategies.insertion_controller import TASK
from chamfer.systems.strategies.insertion_law import InsertParams

FIXTURE = replace(HOLE_ARM, kind="fixture")
SCENARIOS = {
    "two arms": InsertionScenario(),
    "pid": InsertionScenario(controller=ControllerChoice(kind="pid")),
    "moves": InsertionScenario(start_offset=(-0.01, 0.0, 0.0)),
    "fixture": InsertionScenario(hole=FIXTURE),
}


@pytest.fixture(params=SCENARIOS, scope="module")
def diagram(request: Any) -> Diagram:
    """Every kind of insertion."""
    return make_insertion_diagram(resolve(SCENARIOS[request.param]))


def test_nobody_reads_the_true_contact(diagram: Diagram, wires: Any) -> None:
    assert not [wire for wire in wires(diagram) if wire[0] == "contact"]


def test_cameras_alone_see_where_the_tools_are(diagram: Diagram, wires: Any) -> None:
    found = wires(diagram)
    for arm in ("peg", "hole"):
        seen_by = {end for start, _, end, _ in found if start == f"{arm} true pose"}
        assert seen_by <= {"xz camera", "xy camera"}
    of_plant = {end for start, _, end, _ in found if start == "arms"}
    assert of_plant <= {
        "geometry",
        "contact",
        "peg true pose",
        "hole true pose",
        "peg impedance control",  # the encoders
        "hole impedance control",
    }


def test_the_task_knows_cameras_encoders_and_its_own_springs(diagram: Diagram, wires: Any) -> None:
    known = {port: (start, name) for start, name, end, port in wires(diagram) if end == TASK}
    saturated = "hole impedance control", "saturated"
    assert known.pop("hole_saturated", saturated) == saturated
    controller = known.pop("compensation")[0]
    assert controller in ("trajectory compensator", "PID")
    assert known == {
        "error": ("image error", "error"),
        "valid": ("image error", "valid"),
        "blind": ("image error", "blind"),
        "diverged": ("divergence watch", "diverged"),
        "force": ("spring force", "force"),
        "advance": ("spring force", "advance"),
        "peg_saturated": ("peg impedance control", "saturated"),
    }
    sensed = {
        port: (start, name) for start, name, end, port in wires(diagram) if end == "spring force"
    }
    assert sensed["command"] == ("feed offset", "advanced_pose")
    assert sensed["tool_pose"] == ("peg impedance control", "tool_pose")
    assert sensed["hole_pose"][0] in ("hole impedance control", "hole fixture")


def test_the_controller_gets_what_the_task_lets_through(diagram: Diagram, wires: Any) -> None:
    found = wires(diagram)
    controllers = {"trajectory compensator", "PID"}
    into = {port: start for start, _, end, port in found if end in controllers}
    assert into == {"error": "measurement selector", "valid": "divergence watch"}
    watched = {port: start for start, _, end, port in found if end == "divergence watch"}
    assert watched == {
        "error": "measurement selector",
        "valid": "measurement selector",
        "blind": "image error",
    }
    assert (TASK, "compensates", "measurement selector", "open") in found


def test_cameras_see_the_peg_that_is_there_and_look_for_the_one_of_the_drawing() -> None:
    right, thick = InsertionScenario(), InsertionScenario(peg_excess=0.001)
    assert right.there == right
    assert thick.there.parts.peg.radius == pytest.approx(right.parts.peg.radius + 0.001)
    assert thick.there.parts.hole == right.parts.hole
    red = []
    for scenario in (right, thick):
        diagram = make_insertion_diagram(resolve(scenario))
        camera = diagram.GetSubsystemByName("xz camera")
        context = camera.GetMyContextFromRoot(diagram.CreateDefaultContext())
        image = camera.GetOutputPort("image").Eval(context).data
        red.append(int((image[:, :, 0] > image[:, :, 2].astype(int) + 60).sum()))
    assert red[1] / red[0] == pytest.approx(1 + 0.001 / right.parts.peg_radius, rel=0.02)


def test_the_feed_ends_where_the_push_is_reached_at_the_mouth() -> None:
    two = resolve(InsertionScenario()).insert.feed
    one = resolve(InsertionScenario(hole=FIXTURE)).insert.feed
    assert two == pytest.approx(0.03 + 0.04 + 8.0 / 200)
    assert one == pytest.approx(0.03 + 0.04 + 8.0 / 400)
    own = resolve(InsertionScenario(insert=InsertParams(feed=0.07))).insert.feed
    assert own == 0.07


def test_depth_and_speed_of_the_feed_follow_from_the_parts() -> None:
    tight = ColouredParts(peg_radius=0.010035 - 1e-5, hole_length=0.03)
    insert = resolve(InsertionScenario(parts=tight)).insert
    assert insert.depth == 0.03
    assert insert.speed == pytest.approx(2e-5 / 0.002)
    short = resolve(InsertionScenario(parts=ColouredParts(peg_length=0.03))).insert
    assert (short.depth, short.speed) == (pytest.approx(0.027), 0.02)


def test_the_decision_goes_by_the_support_of_the_arms_unless_it_is_said() -> None:
    scenario = InsertionScenario()
    assert scenario.wedging_support == wedging_support(scenario)
    assert scenario.support_at(0.03) == support_at(scenario, 0.03)
    remote = InsertionScenario(support=OpenSupport(centre_distance=0.2))
    assert remote.support_at(0.03).centre_distance == 0.2
    assert remote.support_at(0.03).lateral_stiffness == scenario.support_at(0.03).lateral_stiffness
    margins = [task_params(resolve(one)).region.margin(0.001, 0.05) for one in (scenario, remote)]
    assert margins[1] < margins[0]


PARTS = PegAndHole()
MATERIAL = ContactMaterial()


def build(
    gap: float, hole: HoleSettings = HOLE_ARM, material: ContactMaterial = MATERIAL
) -> tuple[Diagram, WorkCell]:
    """Return the cell at rest at a gap."""
    scenario = WorkCellScenario(gap=gap, hole=hole)
    builder = DiagramBuilder()
    cell, contact = add_cell_in_contact(
        builder, scenario, PARTS, seated_depth=0.036, material=material.over(PARTS)
    )
    for arm in scenario.arms:
        pose = ConstantVectorSource(pose_vector(scenario.nominal_pose(arm)))
        builder.Connect(builder.AddSystem(pose).get_output_port(), cell.arms[arm].desired_pose)
    export_contact(builder, contact)
    return builder.Build(), cell


def read(diagram: Diagram, context: Context, name: str) -> np.ndarray:
    value: np.ndarray = diagram.GetOutputPort(f"contact.{name}").Eval(context)
    return value


def test_only_the_peg_against_the_hole_can_touch() -> None:
    diagram, _ = build(0.03)
    inspector = diagram.GetSubsystemByName("geometry").model_inspector()
    pairs = inspector.GetCollisionCandidates()
    assert len(pairs) == facets_needed(PARTS)
    for pair in pairs:
        names = sorted(inspector.GetName(one).rpartition("::")[2].split()[0] for one in pair)
        assert names == ["peg", "wedge"]


@pytest.mark.parametrize("kind", get_args(HoleKind))
def test_a_peg_in_the_bore_is_pushed_back_by_the_wall_that_it_leans_on(kind: HoleKind) -> None:
    diagram, cell = build(-0.02, replace(HOLE_ARM, kind=kind))  # in the bore, in line
    simulator = Simulator(diagram)
    simulator.Initialize()
    plant = cell.plant
    context = plant.GetMyContextFromRoot(simulator.get_context())
    q = plant.GetPositions(context)
    q[0] += 0.0004  # rad, about the vertical: 0.3 mm to +y, where the clearance is less
    plant.SetPositions(context, q)
    simulator.AdvanceTo(0.002)
    root = simulator.get_context()
    assert read(diagram, root, "state") in (ContactState.ONE_POINT, ContactState.TWO_POINT)
    assert read(diagram, root, "wrench")[4] < -0.01
    assert read(diagram, root, "depth") == pytest.approx(0.02, abs=1e-3)


SPRUNG = PegInsertionScenario()
BLIND = BlindFeedScenario()


def test_the_peg_starts_in_front_of_the_mouth_as_it_is_off() -> None:
    diagram = make_peg_insertion_diagram(resolve_peg_insertion(SPRUNG))
    context = diagram.CreateDefaultContext()
    x, y, z, rz, ry = diagram.GetOutputPort("joints").Eval(context)[:5]
    L_g = SPRUNG.support.centre_distance
    assert (z, ry, rz) == (0.0, 0.0, -SPRUNG.tilt)
    assert x + L_g * math.cos(rz) == pytest.approx(-SPRUNG.gap)
    assert y + L_g * math.sin(rz) == pytest.approx(SPRUNG.lateral)  # the tip's


def run_to(scenario: PegInsertionScenario, time: float) -> dict[str, Any]:
    diagram = make_peg_insertion_diagram(resolve_peg_insertion(scenario))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(time)
    return {
        name: np.array(diagram.GetOutputPort(name).Eval(simulator.get_context()))
        for name in ("joints", "drives", "depth", "wrench")
    }


def test_free_of_contact_it_is_fed_at_its_speed_without_force() -> None:
    free = replace(SPRUNG, lateral=0.0, tilt=0.0, speed=0.05, gap=0.001)
    found = run_to(free, 0.1)
    assert found["depth"][0] == pytest.approx(0.05 * 0.1 - 0.001, abs=2e-4)
    np.testing.assert_allclose(found["drives"], 0.0, atol=0.05)
    assert not found["wrench"].any()


def test_the_push_has_a_cap() -> None:
    beside = replace(SPRUNG, lateral=0.008, tilt=0.0, force_cap=12.0, speed=0.1, gap=0.001)
    found = run_to(beside, beside.released)
    assert found["drives"][0] == pytest.approx(12.0, rel=1e-3)
    assert found["wrench"][3] == pytest.approx(-12.0, rel=1e-2)
    assert found["depth"][0] == pytest.approx(0.0, abs=1e-4)  # on the face


def test_mirrored_errors_give_the_mirrored_motion() -> None:
    short = replace(SPRUNG, speed=0.1, gap=0.001, step=0.002)
    here = run_to(short, 0.12)
    there = run_to(replace(short, lateral=-short.lateral, tilt=-short.tilt), 0.12)
    np.testing.assert_allclose(here["wrench"][4], -there["wrench"][4], rtol=1e-3)
    np.testing.assert_allclose(here["joints"][1], -there["joints"][1], atol=2e-6)


@pytest.mark.parametrize(("plane", "k"), [("xy", 1), ("xz", 2)])
def test_the_peg_starts_with_errors_of_which_equal_signs_add(plane: Plane, k: int) -> None:
    scenario = BlindFeedScenario(plane=plane, lateral=0.002, tilt=0.03)
    X_MT = scenario.nominal_pose("hole").inverse() @ scenario.start()
    tip = X_MT.translation()
    assert tip[0] == pytest.approx(-scenario.gap)
    assert tip[k] == pytest.approx(0.002)
    assert tip[3 - k] == pytest.approx(0.0)
    far_end = X_MT.multiply(np.array([-0.06, 0.0, 0.0]))
    assert far_end[k] == pytest.approx(0.002 + 0.06 * math.sin(0.03))
    assert far_end[3 - k] == pytest.approx(0.0)


def test_the_arm_starts_there_at_rest_and_is_fed_along_the_axis() -> None:
    scenario = BlindFeedScenario(gap=0.02, lateral=0.003, tilt=0.02)
    diagram = make_blind_feed_diagram(resolve_fed_cell(scenario))
    simulator = Simulator(diagram)
    port, depth = (diagram.GetOutputPort(name) for name in ("peg.true_pose", "contact.depth"))
    simulator.Initialize()
    p = port.Eval(simulator.get_context())[4:]
    np.testing.assert_allclose(p, scenario.start().translation(), atol=1e-9)
    simulator.AdvanceTo(0.3)
    moved = port.Eval(simulator.get_context())[4:] - p
    assert moved[0] == pytest.approx(0.3 * scenario.speed, abs=2e-3)  # friction
    np.testing.assert_allclose(moved[1:], 0.0, atol=5e-4)
    assert depth.Eval(simulator.get_context())[0] == pytest.approx(-0.014, abs=2e-3)


@pytest.mark.parametrize("plane", get_args(Plane))
def test_theory_goes_by_the_support_of_the_arms_unless_it_is_said(plane: Plane) -> None:
    assert BLIND.support_at(0.02, plane) == support_at(BLIND, 0.02, plane)
    remote = replace(BLIND, support=OpenSupport(centre_distance=0.2))
    expected = replace(BLIND.support_at(0.02, plane), centre_distance=0.2)
    assert remote.support_at(0.02, plane) == expected


@pytest.mark.parametrize(("plane", "k"), [("xy", 1), ("xz", 2)])
def test_downwards_the_peg_is_off_along_the_axes_of_the_hole(plane: Plane, k: int) -> None:
    hole = replace(BLIND.hole, kind="fixture")
    scenario = BlindFeedScenario(
        axis="downwards", hole=hole, plane=plane, lateral=0.002, tilt=0.03
    )
    X_MT = scenario.nominal_pose("hole").inverse() @ scenario.start()
    assert X_MT.translation()[k] == pytest.approx(0.002)
    above = scenario.start().translation()[2] - scenario.mouth[2]
    assert above == pytest.approx(scenario.gap)
    diagram = make_blind_feed_diagram(resolve_fed_cell(scenario))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.3)
    read = diagram.GetOutputPort("contact.depth").Eval(simulator.get_context())
    assert read[0] > -scenario.gap + 0.003  # it is fed downwards
