"""The adapter against Drake's own driver of an iiwa: its messages, in memory."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.lcm import DrakeLcm
from pydrake.manipulation import BuildIiwaControl, IiwaDriver
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import LcmInterfaceSystem

from chamfer.models.arms.wam import URDF
from chamfer.models.validation import ParameterError
from chamfer.systems.law import Signal
from chamfer.systems.robot.command_guard import CommandGuard, CommandGuardParams
from chamfer.systems.robot.command_limits import EffortLimits, Limits, PositionLimits
from chamfer.systems.robot.iiwa import Iiwa
from chamfer.systems.robot.robot import RunReport, run_controller
from chamfer.systems.statechart.chart import Chart, State, Tick
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput

Array = NDArray[np.float64]

PERIOD = 0.005  # s
START = np.array([0.0, 0.5, 0.1, 1.5, -0.1, 0.3, 0.2])  # rad
GOAL = START + np.array([0.1, -0.05, 0.02, 0.04, -0.03, 0.06, 0.01])
MEASURED = "joint_position_measured"


class Cabinet:
    """An arm with seven joints, a WAM, behind Drake's driver; time goes on when somebody waits."""

    def __init__(self, mode: str) -> None:
        builder, self.lcm, config = DiagramBuilder(), DrakeLcm("memq://"), IiwaDriver()
        config.control_mode = mode
        self.plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
        self.known = MultibodyPlant(1e-3)
        arm, _ = self.add(self.plant), self.add(self.known)
        builder.AddSystem(LcmInterfaceSystem(self.lcm))
        BuildIiwaControl(builder, self.lcm, self.plant, arm, config, self.known)
        self.simulator = Simulator(builder.Build())
        context = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetPositions(self.context, START)
        self.frozen = np.inf

    def add(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        (arm,) = Parser(plant).AddModels(str(URDF))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base", arm))
        plant.Finalize()
        return arm

    def clock(self) -> float:
        return float(self.simulator.get_context().get_time())

    def sleep(self, wait: float) -> None:
        self.simulator.AdvanceTo(self.clock() + wait)

    @property
    def joints(self) -> Array:
        return self.plant.GetPositions(self.context)


class Seen(NamedTuple):
    joint_position_measured: tuple[float, ...]
    joint_velocity_estimated: tuple[float, ...]


def law_of(command: str) -> ChartLaw[Seen, Array]:
    """Return what goes to the goal: by the place, or by a spring and a damper at each joint."""

    def answer(tick: Tick[Seen, Array]) -> Array:
        q, v = map(np.array, tick.inputs)
        torque = [60, 60, 40, 30, 5, 2, 0.2] * (GOAL - q) - [15, 15, 10, 7, 1, 0.3, 0.02] * v
        return GOAL if command == "joint_position" else torque

    return ChartLaw(
        Chart("law", states=[State(name="go", during=answer)], transitions=[], memory=GOAL),
        observation=Seen,
        inputs=dict.fromkeys(Seen._fields, Signal(7)),
        outputs={command: MachineOutput(size=7, read=lambda memory: tuple(memory))},
        period=PERIOD,
    )


def drive(cabinet: Cabinet, command: str, limits: Limits) -> RunReport:
    robot = Iiwa(cabinet.lcm)
    while not robot.ready:
        cabinet.sleep(PERIOD)
    return run_controller(
        robot,
        law_of(command),
        CommandGuard(
            CommandGuardParams(period=PERIOD, timeout=4 * PERIOD, limits={command: limits})
        ),
        until=lambda state, time: time > 1.5,
        clock=cabinet.clock,
        sleep=cabinet.sleep,
    )


POSITION = PositionLimits(speed=(0.3,) * 7, acceleration=(2.0,) * 7, measured=MEASURED)
TORQUE = EffortLimits(most=(5, 5, 5, 4, 1, 0.5, 0.2), rate=(100.0,) * 7)


@pytest.mark.parametrize(
    ("mode", "command", "limits", "near"),
    [
        ("position_only", "joint_position", POSITION, 0.003),
        ("torque_only", "joint_torque", TORQUE, 0.01),
    ],
)
def test_a_law_moves_each_joint_to_its_goal(
    mode: str, command: str, limits: Limits, near: float
) -> None:
    cabinet = Cabinet(mode)
    report = drive(cabinet, command, limits)
    assert report.stopped is None
    assert report.missed == 0
    assert cabinet.joints == pytest.approx(GOAL, abs=near)


def test_units_signs_and_order_are_those_of_the_arm() -> None:
    cabinet = Cabinet("torque_only")
    robot = Iiwa(cabinet.lcm)
    with pytest.raises(ParameterError, match="num_joints is 0, allowed: 7"):
        robot.read()
    cabinet.sleep(2 * PERIOD)
    weight = robot.read().values["joint_torque_measured"]
    torque = np.array([1.0, -2, 3, -4, 0.5, 0.2, 0.01])
    robot.write({"joint_torque": torque})
    cabinet.sleep(PERIOD)
    reading = robot.read()
    assert reading.time == pytest.approx(cabinet.clock())
    assert reading.values["joint_torque_measured"] == pytest.approx(weight + torque, abs=0.05)
    assert reading.values[MEASURED] == pytest.approx(cabinet.joints)
    robot.stop()
    robot.stop()
    cabinet.sleep(PERIOD)
    held = robot.read().values["joint_torque_commanded"]
    assert held == pytest.approx(weight, abs=0.05)
