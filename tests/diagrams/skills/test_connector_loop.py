"""The loop of an insertion: its wiring, its sensors, and a controller of one's own."""

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, LeafSystem, State

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.skills.skill_run import run_skill
from chamfer.diagrams.skills.connector_loop import make_connector_diagram
from chamfer.diagrams.skills.connector_scenario import BNC_CONNECTOR, D_CONNECTOR, resolve
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.models.arms.wrist import WristParams, tip_pose
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import Stick
from chamfer.systems.primitives.primitive import sensed_signals
from chamfer.systems.primitives.skill import DONE, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.sensing.force_sensor import WrenchSensorParams
from chamfer.systems.strategies.grasp_and_transport import PARTS

Wire = tuple[str, str, str, str]  # from block and port, to block and port
PERIOD: Final = 0.01  # s
GRIPPER: Final = {"gripper", "held part"}
PART_SENSOR: Final = "gripper's part sensor"
READING: Final = "wrist sensor's reading"
TIP: Final = "tip by encoders and stiffness"
# What is true of the plug, and of the WAM.
PLUG: Final = {
    "connectors",
    "geometry",
    "set-points and joints",
    "springs of the wrist",
    "wrist sensor",
    "tip",
    "true pose",
}
ARM: Final = {"arm", "reaction on the tool", "true motion of the tool", "wam true pose"}
D: Final = resolve(D_CONNECTOR)
HELD: Final = resolve(replace(D_CONNECTOR, sight=None))
SCENARIOS: Final = [D, resolve(BNC_CONNECTOR), HELD, replace(D, robot="wam")]


def into(wiring: set[Wire], block: str) -> dict[str, tuple[str, str]]:
    return {port: (source, out) for source, out, target, port in wiring if target == block}


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_signals_are_exported_and_no_input_is_left(scenario: Any) -> None:
    diagram = make_connector_diagram(scenario)
    ports = [diagram.get_output_port(i) for i in range(diagram.num_output_ports())]
    sizes = dict.fromkeys(("V_cmd", "V_ref", "wrench", "carriage", "true_wrench"), 6)
    sizes |= {"plug": 12, "holding": 1, "retries": 1, "state": 1}
    assert {port.get_name(): port.size() for port in ports} == sizes
    assert diagram.num_input_ports() == 0
    assert diagram.get_name() == f"Insertion of a {scenario.connector.name}"


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_only_images_encoders_and_the_wrist_sensor_reach_the_skill(
    scenario: Any, wires: Any, known_to: Any
) -> None:
    wiring = wires(make_connector_diagram(scenario), flat=True)
    wam, views = scenario.robot == "wam", ("xz", "yz") if scenario.sight else ()
    seen = {f"{view}_detections": (f"{view} detection", "detections") for view in views}
    assert into(wiring, "skill") == seen | {
        "carriage": (TIP, "sum"),
        "motion": ("accommodation", "velocity"),
        "wrench": ("tare", "tared_force"),
        "spread": ("tare", "spread"),
        "holding": (PART_SENSOR, "y"),
        "perturbed": ("accommodation", "perturbed"),
    }
    assert into(wiring, "tare") == {"force": (READING, "y0"), "tare": ("skill", "tares")}
    encoders = "displacement by encoders" if wam else "carriage"
    assert {source for source, _ in into(wiring, TIP).values()} == {
        encoders,
        "deflection of the wrist",
    }
    assert {source for source, _ in into(wiring, "deflection of the wrist").values()} == {"tare"}
    assert into(wiring, "accommodation") == {
        "command": ("skill", "velocity"),
        "damping": ("skill", "damping"),
        "wrench": ("tare", "tared_force"),
    }
    if wam:
        assert into(wiring, encoders) == {"pose": ("wam impedance control", "tool_pose")}
        known = {source for source, _ in into(wiring, "wam impedance control").values()}
        assert known == {"arm", "desired pose", "V_ref"}
        assert into(wiring, "wam impedance control")["encoders"][1].endswith("_state")
    frames = {f"{view} frames" for view in views}
    true = PLUG | (ARM if wam else {"carriage and rate"}) | GRIPPER
    sensors = {READING, encoders, PART_SENSOR, *frames}
    assert known_to(wiring, "skill") >= true - {"tip", "true pose", "wam true pose"}
    assert not known_to(wiring, "skill", sensors) & true
    # What each sensor keeps back: without it something true would come through.
    for sensor in sensors:
        if sensor != "carriage":  # an ideal carriage is where its encoders say
            assert known_to(wiring, "skill", sensors - {sensor}) & true


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_true_poses_go_to_cameras_and_gripper_alone(scenario: Any, wires: Any) -> None:
    wiring = wires(make_connector_diagram(scenario), flat=True)
    cameras = {"xz camera", "yz camera"} if scenario.sight else set()
    assert {wire[2] for wire in wiring if wire[0] == "true pose"} == cameras
    # For logs and the guard of the simulation, which gives nothing to anyone.
    assert {wire[2] for wire in wiring if wire[0] == "tip"} == {"divergence"}
    assert not any(wire[0] in ("wam true pose", "divergence") for wire in wiring)
    motion = "true motion of the tool" if scenario.robot == "wam" else "carriage and rate"
    place = {"gripper's place"} if scenario.sight else set()
    assert {wire[2] for wire in wiring if wire[0] == motion} == GRIPPER | place
    for view in ("xz", "yz") if scenario.sight else ():
        assert into(wiring, f"{view} frames")["trigger"] == ("skill", "looks")
        assert into(wiring, f"{view} detection") == {"image": (f"{view} frames", "image")}


# Goes down, and presses.
TOUCH = Skill(
    name="touch",
    states=[
        SkillState(name="touch", run=[Stick(speed=0.01)], on={"timed out": DONE}, timeout=9.0)
    ],
    retract=[MoveDx()],
    held=True,
)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"damping": (2.0, 3.0, 4.0, 900.0, 1000.0, math.inf)},
        {"damping": (6.0, 6.0, 6.0, 2e3, 2e3, 2e3), "centre": (0.0, 0.0, -0.01)},
        {"damping": (1.2,) * 3 + (900.0,) * 3, "inertia": (0.005,) * 3 + (1.0,) * 3},
    ],
)
def test_the_reference_is_the_command_and_what_accommodation_adds(changes: Any) -> None:
    accommodation = replace(HELD.accommodation, **changes)
    scenario = replace(HELD, height=0.001, accommodation=accommodation)
    diagram = make_connector_diagram(scenario, TOUCH)
    found = simulate(diagram, duration=0.5, step=PERIOD, seed=2).outputs
    # A row of V_ref is what was computed at the tick of the row before.
    V_cmd, V_ref, wrench = (found[name] for name in ("V_cmd", "V_ref", "wrench"))
    pushed = wrench[:-1] + (V_ref[:-1] - V_cmd[:-1]) @ accommodation.momentum.T
    expected = V_cmd[:-1] + pushed @ accommodation.mobility.T
    np.testing.assert_allclose(V_ref[1:], expected, atol=1e-15)
    assert wrench[:, 5].max() > 4.0  # it has touched
    assert np.ptp(V_cmd[:, 5]) > 0.0


def sampled(scenario: Any, samples: int, seed: int = 1) -> dict[str, np.ndarray]:
    """What the wrist sensor measures and reads at every tick of a touch."""
    diagram = make_connector_diagram(scenario, TOUCH)
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    simulator = Simulator(diagram, context)
    ports = {
        name: diagram.GetSubsystemByName(block).get_output_port()
        for name, block in (("true", "wrist sensor"), ("read", READING), ("given", TIP))
    }
    ports["encoders"] = diagram.GetSubsystemByName("carriage").get_output_port()
    rows: dict[str, list[np.ndarray]] = {name: [] for name in ports}
    for k in range(samples):
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        for name, port in ports.items():
            inside = port.get_system().GetMyContextFromRoot(context)
            rows[name].append(np.array(port.Eval(inside)))
    return {name: np.array(values) for name, values in rows.items()}


def test_the_tip_is_where_the_believed_wrist_says() -> None:
    wrist = WristParams()
    soft = replace(wrist, stiffness=tuple(0.7 * k for k in wrist.stiffness))
    for believed in (None, soft, replace(soft, centre=0.06)):
        scenario = replace(
            D_CONNECTOR,
            connector=DConnector(mass=1e-9),
            sight=None,
            height=0.0005,
            sensor=WrenchSensorParams(),
            believed_wrist=believed,
        )
        found = sampled(resolve(scenario), 60)
        read = found["read"][-1] - found["read"][0]
        given = found["given"][-1] - found["encoders"][-1]
        np.testing.assert_allclose(given, (believed or wrist).compliance @ read, atol=1e-9)
        assert given[5] > 1e-4


def test_with_sight_the_plug_rests_beside_and_without_it_is_held_above() -> None:
    error = (0.01, -0.02, 0.03, 1e-3, -2e-3, 3e-3)
    blind = replace(HELD, height=0.004, initial_error=error)
    assert blind.above == pytest.approx((1e-3, -2e-3, 7e-3))
    for values in (blind.start, blind.resting):
        np.testing.assert_allclose(values, [0, 0, 0, 1e-3, -2e-3, 7e-3])
    sight = SightSettings()
    seeing = replace(blind, sight=D.sight)
    np.testing.assert_allclose(seeing.resting[3:], sight.plug)
    np.testing.assert_allclose(seeing.start[3:], np.add(sight.plug, sight.standby))
    X = tip_pose(np.array([*error[:3], 0, 0, 0]))
    assert seeing.plug_in_tool.IsExactlyEqualTo(X)  # how far off it is grasped is not seen
    for scenario, holding in ((blind, 1.0), (seeing, 0.0)):
        diagram = make_connector_diagram(scenario)
        context = diagram.CreateDefaultContext()
        assert diagram.GetOutputPort("holding").Eval(context) == [holding]
        for name, start in (("plug", scenario.resting), ("carriage", scenario.start)):
            value = diagram.GetOutputPort(name).Eval(context)[:6]
            np.testing.assert_allclose(value, start, atol=1e-15)


class OwnLaw(LeafSystem):
    """Gives way to force along z alone, by 1/1500 m/s a newton."""

    def __init__(self, size: int = 6) -> None:
        super().__init__()
        self.inputs = [
            self.DeclareVectorInputPort(name, size) for name in ("command", "wrench", "damping")
        ]
        self.states = {name: self.DeclareDiscreteState(6) for name in ("velocity", "perturbed")}
        for name, state in self.states.items():
            self.DeclareStateOutputPort(name, state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self.tick)

    def tick(self, context: Context, state: State) -> None:
        command, wrench, _ = (port.Eval(context) for port in self.inputs)
        reference = command.copy()
        reference[5] += wrench[5] / 1500
        values = state.get_mutable_discrete_state()
        values.set_value(self.states["velocity"], reference)
        values.set_value(self.states["perturbed"], command)


def test_a_law_of_ones_own_takes_the_place_of_accommodation(wires: Any) -> None:
    scenario = replace(HELD, height=0.001, duration=2.0)
    diagram = make_connector_diagram(scenario, TOUCH, controller=OwnLaw())
    assert wires(diagram) == wires(make_connector_diagram(scenario, TOUCH))
    found = run_skill(TOUCH, scenario, controller=OwnLaw()).traces
    expected = found["V_cmd_z"][:-1] + found["wrench_z"][:-1] / 1500
    np.testing.assert_allclose(found["V_ref_z"][1:], expected, atol=1e-15)
    assert found["wrench_z"].max() > 4.0  # it has touched
    assert not found["V_ref_rx"].any()
    said = r"^controller is 'OwnLaw', allowed: a system with the vector input port command of size"
    with pytest.raises(ParameterError, match=said):
        make_connector_diagram(scenario, controller=OwnLaw(size=3))


class OwnSkill(LeafSystem):
    """Holds what it has, and goes down by 10 mm/s for a tenth of a second."""

    def __init__(self, *without: str) -> None:
        super().__init__()
        sizes = {name: one.size for name, one in sensed_signals(PARTS).items()}
        for name in sizes.keys() - {"cross_section", *without}:
            self.DeclareVectorInputPort(name, sizes[name])
        held = {self.nothing_ticket()}
        for name in ("looks", "tares", "retries", "state"):
            self.DeclareVectorOutputPort(name, 1, lambda _, out: out.set_value([0.0]), held)
        self.DeclareVectorOutputPort("closed", 1, lambda _, out: out.set_value([1.0]), held)
        self.DeclareVectorOutputPort("damping", 6, lambda _, out: out.set_value(np.zeros(6)), held)
        self.DeclareVectorOutputPort("velocity", 6, self.calc, {self.time_ticket()})

    def calc(self, context: Context, out: Any) -> None:
        out.set_value([0, 0, 0, 0, 0, -0.01 if context.get_time() < 0.095 else 0.0])


def test_a_block_of_ones_own_takes_the_place_of_the_skill() -> None:
    quiet = resolve(replace(D_CONNECTOR, sight=None, sensor=WrenchSensorParams()))
    found = simulate(make_connector_diagram(quiet, OwnSkill()), duration=0.2, step=PERIOD).outputs
    assert found["carriage"][0, 5] - found["carriage"][-1, 5] == pytest.approx(0.001, abs=1.5e-4)
    with pytest.raises(ParameterError, match=r"^skill is 'OwnSkill', allowed: .* port wrench of"):
        make_connector_diagram(quiet, OwnSkill("wrench"))
