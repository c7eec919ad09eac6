"""The cell with an arm that takes positions: presets, what its controller knows, and contact."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import PassThrough

from chamfer.analysis.insertion.cell_runs import force_medians, run_cell_insertion
from chamfer.analysis.insertion.insertion_repeatability import (
    INSERTION_REPEATABILITY,
    insert_one,
    resolve_insertion_trials,
)
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.cell.alignment_scenario import true_pose, wrong_pose
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    ResolvedInsertionScenario,
    controller_of,
    make_insertion_diagram,
    resolve,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.force.wrist_wrench import WRIST_AXES
from chamfer.systems.pose import pose_from_vector
from chamfer.systems.strategies.insertion_controller import TASK

G = 9.81


def cell(name: str, *settings: str) -> ResolvedInsertionScenario:
    """Return a preset, with settings on top, resolved."""
    return resolve(make_scenario(InsertionScenario(), settings=[f"cell={name}", *settings]))


@pytest.fixture(scope="module", params=["ur5e-fixture", "scara-rcc"])
def diagram(request: Any) -> Diagram:
    """Each preset's."""
    return make_insertion_diagram(cell(request.param))


def test_sensor_encoders_and_force_are_all_that_the_controller_knows(
    diagram: Diagram, wires: Any
) -> None:
    found = wires(diagram)
    assert not [wire for wire in found if wire[0] in ("contact", "peg true pose")]
    of_plant = {end for start, _, end, _ in found if start == "arms"}
    springs = {"set-points and joints", "tip"}
    assert of_plant <= {"geometry", "contact", "peg true pose", *springs}
    task = {port: (start, name) for start, name, end, port in found if end == TASK}
    assert task["force"] == ("admittance", "force")
    assert task["advance"] == ("admittance", "advance")
    assert {task[name][0] for name in ("error", "valid", "blind", "diverged")} == {"no sight"}
    into = {port: start for start, _, end, port in found if end == "admittance"}
    assert into == {
        "desired_pose": "feed offset",
        "reading": "wrist sensor's reading",
        "tool_pose": "joint servos",
        "tares": TASK,
    }
    # The true motion moves the plant and turns the sensor, and goes nowhere else.
    motion = {end for start, name, end, _ in found if (start, name) == ("joint servos", "motion")}
    assert motion <= {"set-points and joints", "desired centre", "in the sensor's axes"}


def test_an_unknown_load_hangs_where_it_is() -> None:
    found = cell("ur5e-fixture", "peg.payload_error=0.5", "peg.payload_position=[-0.04, 0, 0]")
    parts = ((1.0, 0.1), (0.5, 0.04))  # kg, and m above the tip
    assert found.wrist.centre_of_mass == pytest.approx(sum(m * x for m, x in parts) / 1.5)
    inertia = 3e-3 + sum(m * x**2 for m, x in parts)
    assert found.wrist.inertia == pytest.approx(inertia)


def test_the_wrench_is_about_the_tip_wherever_the_springs_have_their_centre() -> None:
    level = "axis=horizontal", "initial_error=[0, 0, 0, 0, 0, 0]"
    scenario = cell("ur5e-fixture", *level, "compliance.centre_distance=0.04")
    diagram = make_insertion_diagram(scenario)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.3)
    found = diagram.GetOutputPort("wrist_wrench").Eval(simulator.get_context())
    R_SW = (scenario.hole_axes @ WRIST_AXES.rotation()).matrix().T
    weight = R_SW @ [0.0, 0.0, -G * scenario.wrist.mass]
    moment = np.cross([0.0, 0.0, scenario.wrist.centre_of_mass], weight)
    np.testing.assert_allclose(found, [*moment, *weight], atol=0.03)


def test_in_free_space_the_springs_bear_the_tool_and_its_zero_is_taken() -> None:
    scenario = cell("ur5e-fixture", "sensor.noise=0", "sensor.drift=0", "sensor.resolution=0")
    diagram = make_insertion_diagram(scenario)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    simulator.AdvanceTo(0.45)
    wrench = diagram.GetOutputPort("wrist_wrench").Eval(context)
    weight = G * (scenario.peg.tool.mass + scenario.peg.payload_error)
    # Downwards is away from the wrist, against its z.
    assert np.allclose(wrench[3:], [0.0, 0.0, -weight], atol=1e-3 * weight)
    simulator.AdvanceTo(0.75)
    admittance = diagram.GetSubsystemByName("admittance")
    force = admittance.GetOutputPort("force").Eval(admittance.GetMyContextFromRoot(context))
    # The tool swings as a run begins, which is in the mean.
    assert np.allclose(force, 0.0, atol=0.1)


def test_the_arm_does_not_know_that_the_hole_is_elsewhere() -> None:
    far, near = cell("ur5e-fixture"), cell("ur5e-fixture", "initial_error=[0, 0, 0, 0, 0, 0]")
    seen, true = [], []
    for scenario in (far, near):
        diagram = make_insertion_diagram(scenario)
        context = diagram.CreateDefaultContext()
        seen.append(diagram.GetOutputPort("peg.tool_pose").Eval(context))
        true.append(pose_from_vector(diagram.GetOutputPort("peg.true_pose").Eval(context)))
    assert np.array_equal(*seen)
    goal = far.nominal_pose("peg")
    off = true_pose(far, "peg", wrong_pose(far, goal))
    assert true[0].IsNearlyEqualTo(off, 1e-9)
    assert true[1].IsNearlyEqualTo(goal, 1e-9)
    # The feed goes along the believed axis, which is turned in the hole's as the peg is.
    assert off.rotation().col(0) @ goal.rotation().col(0) == pytest.approx(np.cos(0.025), abs=1e-6)


def test_the_force_on_the_chamfer_does_not_depend_on_the_step() -> None:
    forces = []
    for step in ("0.002", "0.001"):
        scenario = cell(
            *("ur5e-fixture", f"step={step}", "gap=0.001", "begin=0.1", "duration=1.3"),
            *("search={kind: none}", "initial_error=[0, 0.0004, 0, 0, 0, 0]", "sensor.noise=0"),
        )
        done = run_cell_insertion(scenario, 0)
        forces.append(float(force_medians(done.traces, scenario.step)[0].max()))
        assert done.traces["lateral_error"][-1] < 0.1e-3
    assert forces[0] > 2.0
    assert forces[1] == pytest.approx(forces[0], rel=0.05)


def test_a_trial_draws_what_the_arm_repeats_to() -> None:
    settings = [
        "cell=ur5e-fixture",
        "duration=1.0",
        "beside=[]",
        "spread.lateral=0",
        "search={kind: none}",
    ]
    touched = []
    for repeatability in (0.0, 3e-4):
        own = [*settings, f"arm.servo.repeatability={repeatability}"]
        scenario = make_scenario(INSERTION_REPEATABILITY, settings=own)
        row = insert_one(resolve_insertion_trials(scenario), 5, (0, ""))
        touched.append(row["lateral_errors"][0])
    assert touched[0] == pytest.approx(0.0, abs=1e-9)
    assert 0 < touched[1] <= 3e-4 * np.sqrt(2)


def test_presets_are_whole_cells_and_settings_go_on_top() -> None:
    usual = InsertionScenario()
    assert make_scenario(usual, settings=["cell=wam-pair"]).peg == usual.peg
    own = make_scenario(usual, settings=["insert.push=17", "cell=ur5e-fixture"])
    assert (own.insert.push, own.peg.model, own.arm.control) == (17.0, "ur5e", "position")
    given = make_scenario(usual, given={"cell": "ur5e-fixture", "parts": "nist-16mm"})
    assert given.parts == make_scenario(usual, settings=["parts=nist-16mm"]).parts
    with pytest.raises(UserError, match="cell is 'kuka', allowed: wam-pair, ur5e-fixture, scara"):
        make_scenario(usual, settings=["cell=kuka"])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["admittance.spring=[1, 1, 1, 1, 1, 1]"], "admittance.spring is .*arm.control is imped"),
        (["arm.servo.rate=250"], "arm.servo.rate is 250.*arm.control is impedance"),
        (["arm.control=position"], "hole.kind is 'arm', allowed: fixture: arm.control is posit"),
        (
            ["cell=ur5e-fixture", "impedance.period=0.004"],
            "impedance.period .*control is position",
        ),
        (
            ["cell=ur5e-fixture", "sensor.rate=250"],
            "sensor.rate is 250.*at least arm.servo.rate, 5",
        ),
        (
            ["cell=ur5e-fixture", "step=0.003"],
            "step is 0.003, allowed: a whole part of .* 0.002 s",
        ),
        (["cell=scara-rcc", "hole.angle_error=0.03"], "hole.angle_error is 0.03, allowed: less:"),
        (["cell=ur5e-fixture", "sensor.full_scale=20"], "sensor.full_scale .* at least .*40.3 N"),
        (["cell=ur5e-fixture", "sensor.delay=3"], "sensor.delay is 3.* 0 to 0.1 s"),
        (["cell=ur5e-fixture", "compensated=peg"], "compensated is .*cameras.kind is none"),
        (
            ["cell=ur5e-fixture", "cameras.frames.noise=2"],
            "cameras.frames.noise is .*kind is none",
        ),
        (["cell=ur5e-fixture", "pid.lateral.limit=0.01"], "pid.lateral is .*kind is none"),
        (["cell=ur5e-fixture", "insert.compensation=frozen"], "insert.compens.*kind is none"),
        (
            ["cell=scara-rcc", "admittance.centre=[1, 0, 0]"],
            "^admittance.centre is .*kind is none",
        ),
        (["cell=scara-rcc", "peg.rotor_inertia=[1, 1, 1, 1]"], "peg.rotor_inertia .*is position"),
        (["cell=ur5e-fixture", "peg.payload_position=[-0.1, 0.01, 0]"], "peg.payload_p.* axis"),
        (["hole.position_error=0.001"], "hole.position_error is 0.001.*an arm's hole is no fixt"),
        (
            ["cell=ur5e-fixture", "admittance.damping=[1, 1, 1, 50, 50, 50]"],
            "admittance.damping is .*allowed: at least .* compliance at most .*times as stiff",
        ),
    ],
)
def test_refusals(settings: list[str], message: str) -> None:
    with pytest.raises((ParameterError, UserError), match=message):
        resolve(make_scenario(InsertionScenario(), settings=settings))


def test_the_one_law_is_of_impedance_control_with_cameras() -> None:
    with pytest.raises(
        ParameterError, match=r"arm.control is 'position', allowed: impedance with"
    ):
        controller_of(cell("ur5e-fixture"))
    scenario, own = cell("ur5e-fixture"), {"peg": PassThrough(1)}
    with pytest.raises(ParameterError, match="arm_controllers is"):
        make_insertion_diagram(scenario, arm_controllers=own)


def test_a_resolved_cell_resolves_to_itself() -> None:
    once = cell("scara-rcc")
    assert resolve(replace(once)) == once
