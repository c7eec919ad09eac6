"""The hybrid loop: how it is wired, what its controller may know, and its runs."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, LeafSystem

from chamfer.analysis.contact.contact_runs import Traces, measure, run_contact
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    ADEPT_ROLLER_MOTION,
    CONTACT_RECOVERY,
    PLANAR_HOLD,
    PUMA_ROLLER_HOLD,
    PUMA_ROLLER_MOTION,
)
from chamfer.diagrams.contact.hybrid_loop import SIGNALS, make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
from chamfer.models.arms.arm import Arm
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import CONTACT, LOST
from chamfer.systems.force.friction_compensation import (
    FrictionCompensationParams,
)
from chamfer.systems.sensing.force_sensor import LoadCellParams

Wire = tuple[str, str, str, str]  # from block and port, to block and port

PLANT = "manipulator and contact"
SENSOR = "force sensor"
CONTROL = "hybrid control"
DETECTION = "contact detection"
COMPENSATION = "friction compensation"
ENCODERS, DELAY = "encoders", "computation delay"


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
    scenario: HybridScenario,
) -> None:
    wiring = wires(make_hybrid_diagram(scenario))
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
    sensor = scenario.sensor
    noises = {"sensor noise": sensor.noise, "sensor drift": sensor.drift}
    assert others == {name for name, size in noises.items() if size}
    assert not any(into(wiring, name) for name in others)


@pytest.mark.parametrize("scenario", WIRED)
def test_the_torque_reaches_the_arm_through_the_delay(scenario: HybridScenario) -> None:
    wiring = wires(make_hybrid_diagram(scenario))
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


class Push(LeafSystem):
    """A user's own law: pushes straight ahead with the desired force, whatever is measured."""

    def __init__(self, arm: Arm, *, torque: str = "torque", encoders: int | None = None) -> None:
        super().__init__()
        n, m = arm.num_joints, arm.num_coordinates
        motion = self.DeclareVectorInputPort("encoders", 2 * n if encoders is None else encoders)
        force = self.DeclareVectorInputPort("desired_force", m)
        for name, size in (
            ("desired_position", m),
            ("measured_force", m),
            ("selection", m * m),
            ("mode", 1),
        ):
            self.DeclareVectorInputPort(name, size)

        def calc(context: Context, vector: BasicVector) -> None:
            J = arm.jacobian(motion.Eval(context)[:n])
            vector.SetFromVector(J.T @ force.Eval(context))

        self.DeclareVectorOutputPort(torque, n, calc, {motion.ticket(), force.ticket()})
        for name in ("position_error", "force_error"):
            self.DeclareVectorOutputPort(name, m, lambda _, __: None)


def test_an_own_controller_takes_the_hybrid_laws_place() -> None:
    scenario = fill(replace(PLANAR, duration=0.3))
    arm = scenario.ARM
    diagram = make_hybrid_diagram(scenario, controller=Push(arm))
    assert into(wires(diagram), CONTROL) == into(wires(make_hybrid_diagram(scenario)), CONTROL)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.3)
    q = diagram.GetOutputPort("encoders").Eval(simulator.get_context())[: arm.num_joints]
    # 15 N downwards on an arm without gravity: down it goes, faster than joint friction holds.
    assert arm.endpoint(q)[1] < -0.05


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"encoders": 2},
            r"^controller is 'Push', allowed: a system with the vector input port encoders of "
            r"size 4; its vector input ports and their sizes are: encoders \(2\), desired_force",
        ),
        (
            {"torque": "effort"},
            r"^controller is 'Push', allowed: a system with the vector output port torque of "
            r"size 2; its vector output ports and their sizes are: effort \(2\), position_error",
        ),
    ],
)
def test_an_own_controller_without_a_port_is_refused(wrong: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make_hybrid_diagram(fill(PLANAR), controller=Push(PLANAR.ARM, **wrong))


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


def velocities(scenario: HybridScenario, traces: Traces) -> NDArray[np.float64]:
    return np.stack([traces[f"{name}.velocity"] for name in scenario.ARM.joint_names], axis=1)


# The adept's wall and the puma's table are near, so that the force settles in a short run.
NEAR_WALL = changed(
    replace(ADEPT, duration=0.6),
    "task",
    start=(0.4985, -0.3, 0.3, 0.0),
    distance=0.0015,
)
NEAR_TABLE = changed(
    replace(PUMA, duration=0.6), "task", start=(0.176, -0.011, 0.1075), distance=0.003
)
NEAR = changed(replace(PLANAR, duration=3.5), "task", start=(1.0, -1.4))


@pytest.mark.parametrize("scenario", [NEAR_WALL, NEAR_TABLE])
def test_the_same_seed_gives_the_same_bytes(scenario: HybridScenario) -> None:
    runs = [run_contact(resolve(scenario), seed) for seed in (3, 3, 4)]
    same, other = (
        [one[name].tobytes() == runs[0][name].tobytes() for name in runs[0]] for one in runs[1:]
    )
    assert all(same)
    assert runs[0]["mode"].max() == CONTACT  # so that the noise comes back through the force
    unlike = {name for name, equal in zip(runs[0], other, strict=True) if not equal}
    assert {"measured_force", "force", "gap", "joint_2.torque", "joint_2.velocity"} <= unlike


@pytest.mark.parametrize(
    ("scenario", "near"),
    [
        (replace(PLANAR, duration=2.0), 0.05),
        (replace(PUMA, duration=1.0), 0.008),
        (replace(ADEPT, duration=0.8), 0.003),
    ],
)
def test_free_motion_follows_the_approach(scenario: HybridScenario, near: float) -> None:
    traces = run_contact(resolve(scenario), 0)
    assert not np.any(traces["mode"])
    assert not np.any(traces["force"])
    arm, task = scenario.ARM, scenario.task
    covered = np.array([task.approached(t) for t in traces["time"]])
    wanted = np.array(task.start) + covered[:, np.newaxis] * scenario.direction
    for i, name in enumerate(arm.coordinates):
        # The last row of what the controller puts out is of the tick before.
        np.testing.assert_allclose(traces[f"desired_{name}"][:-1], wanted[:-1, i], atol=1e-12)
        np.testing.assert_allclose(traces[name], wanted[:, i], atol=near)
    half = len(covered) // 2
    travelled = np.diff(traces["height"][[half, -1]])[0] / np.diff(traces["time"][[half, -1]])[0]
    assert travelled == pytest.approx(-task.speed, rel=0.1)


def test_the_measured_force_is_the_one_of_its_time() -> None:
    traces = run_contact(resolve(replace(NEAR, duration=1.0)), 0)
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


@pytest.mark.slow
@pytest.mark.parametrize("law", ["projected", "transpose"])
@pytest.mark.parametrize("elbow", ["negative", "positive"])
def test_laws_that_settle_with_both_elbows(law: str, elbow: str) -> None:
    scenario = resolve(changed(changed(NEAR, "arm", elbow=elbow), "controller", law=law))
    traces = run_contact(scenario, 0)
    late = traces["time"] > 3.0
    np.testing.assert_allclose(traces["force"][late], 15.0, atol=0.3)
    assert np.sign(traces["joint_2.position"][-1]) == (1 if elbow == "positive" else -1)
    assert np.abs(velocities(scenario, traces)).max() < 2.0
    assert np.abs(traces["position_error"]).max() < 0.1
    assert np.all(traces["mode"][late] == CONTACT)
    assert np.diff(traces["dissipated"]).min() >= 0


def test_the_inverse_law_diverges_with_the_other_elbow() -> None:
    scenario = changed(changed(NEAR, "arm", elbow="positive"), "controller", allow_unstable=True)
    with pytest.warns(UserWarning, match="unstable in contact, it grows at 31"):
        scenario = resolve(scenario)
    with pytest.raises(ParameterError, match=r"finite numbers|regular") as caught:
        run_contact(scenario, 0)
    assert "\n" not in str(caught.value)


def test_the_blow_takes_the_tip_off_the_surface() -> None:
    kicked = changed(replace(NEAR, duration=4.2, measure_after=3.5), "task", kick_time=4.0)
    traces = run_contact(resolve(kicked), 0)
    time = traces["time"]
    struck = (time > 4.001) & (time < 4.006)
    # 0.2 m/s less what push and joint friction take in the meantime
    np.testing.assert_allclose(-traces["approach_speed"][struck], 0.2, atol=0.025)
    assert traces["mode"][time < 4.0][-1] == CONTACT
    assert traces["gap"][time > 4.0].max() > 1e-3
    assert np.any(traces["mode"][time > 4.0] == LOST)


# Step-size convergence.

STICK_SLIP = {
    "force.below": 0.05,
    "force.min": 0.1,
    "scratch_time": 0.05,
    **dict.fromkeys(("force.peak", "deviation", "force.above"), 0.07),
}
# With sensors and a computer as they are, but for what rounds and what is random.
LATE_ADEPT = changed(
    changed(
        changed(
            replace(ADEPT_ROLLER_MOTION, duration=12.0, sensing="realistic"),
            "encoders",
            counts=0.0,
        ),
        "sensor",
        noise=0.0,
        drift=0.0,
        resolution=0.0,
    ),
    "controller",
    computation_jitter=0.0,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "tolerance", "wider"),
    [
        # A bounce that ends a sample earlier changes times by a sample.
        (replace(PLANAR, duration=9.0), 5e-3, {"settling_time": 0.02, "scratch_time": 0.03}),
        # Joints that stick and slip take small differences to other places.
        (PUMA_ROLLER_MOTION, 2e-2, STICK_SLIP),
        (LATE_ADEPT, 1e-2, {}),
    ],
)
def test_half_the_step_gives_the_same_results(
    scenario: HybridScenario, tolerance: float, wider: dict[str, float]
) -> None:
    coarse, fine = (
        measure(scenario, run_contact(resolve(replace(scenario, step=step)), 0))
        for step in (scenario.step, scenario.step / 2)
    )
    for name, value in coarse.items():
        if value is None:
            assert fine[name] is None, name
            continue
        wide = next((one for part, one in wider.items() if name.endswith(part)), tolerance)
        assert value == pytest.approx(fine[name], rel=wide, abs=1e-9), name
