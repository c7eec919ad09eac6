"""The carriage and the WAM that may carry a gripper."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from chamfer.diagrams.skills.connector_scenario import ConnectorScenario
from chamfer.diagrams.skills.robots import ARM, add_carriage, add_wam

STEP: Final = 0.001  # s
START: Final = np.array([0.02, -0.03, 0.2, 0.01, -0.02, 0.03])
IMPEDANCE: Final = ConnectorScenario().impedance
STIFFNESS: Final = np.array([*IMPEDANCE.rotational_stiffness, *IMPEDANCE.stiffness])
SMOOTH: Final = replace(ARM, joint_friction=(0.0,) * 7)


class Moved:
    """A robot alone, to be told a velocity and to be pushed."""

    def __init__(
        self, name: str, *, arm: Any = ARM, start: Any = START, step: float = STEP
    ) -> None:
        builder = DiagramBuilder()
        if name == "carriage":
            robot = add_carriage(builder, start, step)
        else:
            robot = add_wam(builder, arm, IMPEDANCE, start, step)
        self.robot = robot
        builder.ExportInput(robot.velocity, "velocity")
        builder.ExportOutput(robot.motion, "motion")
        builder.ExportOutput(robot.encoders, "encoders")
        if robot.reaction is not None:
            builder.ExportInput(robot.reaction, "reaction")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.tell("velocity", np.zeros(6))
        if robot.reaction is not None:
            self.tell("reaction", np.zeros(6))

    def tell(self, port: str, values: Any) -> None:
        self.diagram.GetInputPort(port).FixValue(self.context, np.array(values))

    def read(self, port: str) -> Any:
        return np.array(self.diagram.GetOutputPort(port).Eval(self.context))

    def run(self, duration: float) -> None:
        self.simulator.AdvanceTo(self.context.get_time() + duration)


def test_the_carriage_follows_a_velocity_exactly() -> None:
    moved = Moved("carriage")
    np.testing.assert_array_equal(moved.read("encoders"), START)
    rng = np.random.default_rng(0)
    expected = START.copy()
    for _ in range(5):
        velocity = rng.normal(size=6)
        moved.tell("velocity", velocity)
        moved.run(0.02)
        expected += 0.02 * velocity
        np.testing.assert_allclose(moved.read("encoders"), expected, atol=1e-14)
        np.testing.assert_array_equal(moved.read("motion"), [*moved.read("encoders"), *velocity])


def test_the_arm_weighs_what_its_law_believes() -> None:
    moved = Moved("wam")
    plant = moved.diagram.GetSubsystemByName("arm")
    context = plant.GetMyContextFromRoot(moved.context)
    known = ARM.known_arm().evaluate(plant.GetPositions(context)).mass
    np.testing.assert_allclose(plant.CalcMassMatrix(context), known, rtol=0, atol=1e-9)


SLOW: Final = np.array([0.03, -0.02, 0.05, 0.01, 0.01, -0.01])


@pytest.mark.parametrize("step", [STEP, IMPEDANCE.period])
def test_without_friction_the_arm_follows_closely(step: float) -> None:
    # As slow a step as the controller's period would make it diverge, without friction or with.
    moved = Moved("wam", arm=SMOOTH, step=step)
    moved.tell("velocity", SLOW)
    moved.run(0.4)
    np.testing.assert_allclose(moved.read("motion")[6:], SLOW, atol=2e-3)
    moved.tell("velocity", np.zeros(6))
    moved.run(0.4)
    np.testing.assert_allclose(moved.read("encoders"), START + 0.4 * SLOW, atol=2e-4)


def test_what_the_gripper_does_to_the_arm_deflects_it_by_its_stiffness() -> None:
    moved = Moved("wam", arm=SMOOTH, start=np.zeros(6))
    wrench = np.array([0.2, -0.1, 0.15, 10.0, -5.0, 20.0])
    moved.tell("reaction", wrench)
    moved.run(1.0)
    for port in ("encoders", "motion"):
        deflected = moved.read(port)[:6] * STIFFNESS
        np.testing.assert_allclose(deflected[:3], wrench[:3], atol=0.01)
        np.testing.assert_allclose(deflected[3:], wrench[3:], atol=0.4)
