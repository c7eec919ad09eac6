"""The computed border of the damping against simulations: steps in time, blocks, and the cell."""

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import LinearBushingRollPitchYaw
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    DiscreteTimeDelay,
    LinearSystem,
    LogVectorOutput,
    MatrixGain,
    Multiplexer,
    TrajectorySource,
)
from pydrake.trajectories import PiecewisePolynomial

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import prepare
from chamfer.analysis.insertion.admittance_stability import (
    CONTACT_STABILITY,
    computed_border,
    damped,
    grows,
)
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import select
from chamfer.diagrams.cell.alignment_scenario import offset_pose
from chamfer.diagrams.insertion.contact_loop import ContactLoop, contact_loop
from chamfer.diagrams.insertion.position_cell import add_position_cell
from chamfer.models.arms.wrist import SIZE, add_wrist, in_joint_order
from chamfer.systems.force.accommodation_law import AXES
from chamfer.systems.force.admittance_law import AdmittanceLaw
from chamfer.systems.force.wrist_wrench import WRIST_AXES
from chamfer.systems.law import Signal
from chamfer.systems.law_block import LawBlock
from chamfer.systems.pose import pose_vector
from chamfer.systems.sensing.force_sensor import ChannelParams, ForceSensor, Gauges

Array = NDArray[np.float64]

LOOP: Final = CONTACT_STABILITY.loop
RCC: Final = {"centre": 0.08, "stiffness": (300.0, 300.0, 200.0, 5e4, 5e4, 1e5)}
STEP: Final = 2e-4  # s, of the sensor
SIDES: Final = ((0.9, True), (1.1, False))  # of the border, and whether it grows there


def swings_more(force: Array) -> bool:
    """Return whether the last quarter of a force swings more than the one before."""
    quarter = len(force) // 4
    return bool(np.ptp(force[-quarter:]) > np.ptp(force[-2 * quarter : -quarter]))


def blocks_grow(loop: ContactLoop, axis: int) -> bool:
    """Return whether a loop of Drake's bodies on springs, sensor and law grows in 0.4 s."""
    builder, wrist, period = DiagramBuilder(), loop.wrist, loop.servo.period
    add, wire = builder.AddNamedSystem, builder.Connect
    plant = add("tool", MultibodyPlant(0.0))
    held = add_wrist(plant, plant.world_frame(), wrist)
    turn = np.kron(np.eye(2), WRIST_AXES.rotation().matrix())
    k, no, tip = np.abs(turn.T @ loop.contact), np.zeros(3), held.body.body_frame()
    wall = LinearBushingRollPitchYaw(plant.world_frame(), tip, k[:3], no, k[3:], no)
    plant.AddForceElement(wall)
    plant.Finalize()
    # The motion of the wrist's joints of the tip's in the hole's axes.
    centre = np.eye(SIZE)
    centre[3:5, :2] = [[0.0, wrist.centre], [-wrist.centre, 0.0]]
    centre = in_joint_order() @ centre @ turn.T
    law = np.hstack([wrist.law @ np.kron(np.eye(2), centre), -wrist.law])
    springs, felt = add("springs", MatrixGain(law)), add("wrench", MatrixGain(-centre.T))
    both = add("flange and tool", Multiplexer([2 * SIZE, 2 * SIZE]))
    one, w = np.eye(SIZE), loop.servo.frequency
    follow = np.kron([[0.0, 1.0], [-w * w, -2 * w]], one), np.kron([[0.0], [w * w]], one)
    servo = add("servo", LinearSystem(*follow, np.eye(2 * SIZE), np.zeros((2 * SIZE, SIZE))))
    names = ("noise", "bias", "drift", "resolution", "full_scale", "tare")
    ideal: dict[str, Any] = dict.fromkeys(names, 0.0)
    params = ChannelParams(**ideal, bandwidth=loop.bandwidth, delay=loop.delay)
    gauges = Gauges(-one, np.ones(SIZE))
    sensor = add("sensor", ForceSensor(params, gauges, step=STEP, period=period))
    gives_way = AdmittanceLaw(loop.law(loop.damping))
    gives_way.outputs = {"displacement": Signal(SIZE)}
    admittance = add("admittance", LawBlock(gives_way))
    command = add("command", ConstantVectorSource(np.zeros(SIZE)))
    late = add("delay", DiscreteTimeDelay(period, loop.servo.delay, SIZE))
    wire(command.get_output_port(), admittance.GetInputPort("command"))
    wire(admittance.GetOutputPort("displacement"), late.get_input_port())
    wire(late.get_output_port(), servo.get_input_port())
    wire(servo.get_output_port(), both.get_input_port(0))
    wire(plant.get_state_output_port(held.instance), both.get_input_port(1))
    wire(both.get_output_port(), springs.get_input_port())
    wire(springs.get_output_port(), plant.get_actuation_input_port(held.instance))
    wire(springs.get_output_port(), felt.get_input_port())
    wire(felt.get_output_port(), sensor.GetInputPort("tool_force"))
    wire(sensor.GetOutputPort("reading"), admittance.GetInputPort("wrench"))
    log = LogVectorOutput(sensor.GetOutputPort("reading"), builder, period)
    simulator = Simulator(builder.Build())
    config = SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=STEP, use_error_control=False
    )
    ApplySimulatorConfig(config, simulator)
    context = simulator.get_mutable_context()
    off = 1e-6 * np.eye(2 * SIZE)[axis]  # m or rad, of the flange at first
    servo.GetMyMutableContextFromRoot(context).SetContinuousState(off)
    simulator.AdvanceTo(0.4)
    return swings_more(log.FindLog(context).data()[axis])


@pytest.mark.parametrize(("share", "delay"), [(1.0, 0.003), (0.1, 0.0), (0.003, 0.003)])
def test_border_of_x_step_by_step(share: float, delay: float) -> None:
    loop = replace(LOOP, contact=tuple(share * k for k in LOOP.contact), delay=delay)
    edge = damped(loop, AXES.index("x"), computed_border(loop, AXES.index("x")))
    for off, unstable in ((0.97, True), (1.03, False)):
        assert grows(damped(edge, AXES.index("x"), off)) is unstable, (off, edge.damping)


@pytest.mark.parametrize(
    ("axis", "share", "wrist"),
    [("x", 1.0, {}), ("ry", 1.0, {}), ("z", 0.1, RCC), ("ry", 1.0, RCC)],
    ids=["x", "tilt", "lateral with an rcc", "tilt with an rcc"],
)
def test_border_within_a_tenth_of_that_of_blocks(
    axis: str, share: float, wrist: dict[str, Any]
) -> None:
    contact = tuple(share * k for k in LOOP.contact)
    loop = replace(LOOP, wrist=replace(LOOP.wrist, **wrist), contact=contact)
    i = AXES.index(axis)
    edge = damped(loop, i, computed_border(loop, i))
    for off, unstable in SIDES:
        assert blocks_grow(damped(edge, i, off), i) is unstable, (off, edge.damping[i])


def scenario(*settings: str) -> Any:
    """Return an insertion of the UR5e's cell, resolved, with a sensor that has no noise."""
    names = ("noise", "bias", "drift", "resolution")
    quiet = [f"sensor.{name}=0" for name in names]
    where = ("cell=ur5e-fixture", "initial_error=[0,0,0,0,0,0]", "gap=0.001", *quiet)
    entries = select(CATALOGUE.entries, ["insertion"])
    (job,) = prepare(entries, settings=(*where, *settings))
    return job.scenario


def pressed(scenario: Any) -> Array:
    """Return the force along x of a peg that is pressed on the face beside its hole, N."""
    builder = DiagramBuilder()
    cell, _, sensed = add_position_cell(
        builder, scenario, scenario.there.parts, seated_depth=1.0, add_parts=lambda *_: None
    )
    start, axes = pose_vector(offset_pose(scenario, 1.0)), scenario.hole_axes.matrix()
    beside, into = scenario.parts.peg_radius * axes[:, 1], 0.007 * axes[:, 0]
    ways = [np.zeros(3), beside, beside + into, beside + into]
    poses = np.stack([np.concatenate([start[:4], start[4:] + way]) for way in ways], axis=1)
    path = PiecewisePolynomial.FirstOrderHold([0.0, 0.2, 0.5, 9.0], poses)
    feed, no = builder.AddSystem(TrajectorySource(path)), ConstantVectorSource([0.0])
    builder.Connect(feed.get_output_port(), cell.arms["peg"].desired_pose)
    assert sensed.tares is not None
    builder.Connect(builder.AddSystem(no).get_output_port(), sensed.tares)
    log = LogVectorOutput(sensed.force, builder, scenario.arm.servo.period)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    force = log.FindLog(simulator.get_context()).data()[0]
    return np.asarray(force[len(force) // 2 :])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("off", "unstable"), [(0.5, True), (0.9, True), (1.1, False), (2.0, False)]
)
def test_the_cell_swings_below_the_border_alone(off: float, unstable: bool) -> None:
    cell = scenario()
    loop = replace(contact_loop(cell), step=cell.step)
    x = AXES.index("x")
    edge = damped(loop, x, computed_border(loop, x))
    force = pressed(replace(cell, admittance=damped(edge, x, off).admittance))
    swing = float(np.ptp(force[-len(force) // 4 :]))
    assert force.max() > 3
    assert (swing > 5) is unstable, (swing, edge.damping[x])


def test_an_unstable_cell_is_refused() -> None:
    designed = scenario().admittance.damping
    assert all(0 < D < math.inf for D in designed)
    low = ", ".join(f"{D / 10:g}" for D in designed)
    with pytest.raises(UserError, match=r"or a compliance at most .* in contact grows"):
        scenario(f"admittance.damping=[{low}]")
