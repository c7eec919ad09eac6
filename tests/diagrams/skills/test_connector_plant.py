"""The plant of the insertions, with a ball for a plug and a block for a socket."""

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.skills.connector_loop import add_connector_plant, add_weight
from chamfer.models.arms.wrist import SIZE, WristParams, moved, tip_pose
from chamfer.models.connectors.connector import ContactMaterial, ConvexPiece, add_pieces
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]
WRIST: Final = WristParams(stiffness=(15.0, 25.0, 20.0, 1e4, 2e4, 3e4))
CONTACT: Final = 2e6  # N/m, of both pieces in series
GREY: Final = np.full(4, 0.5)
RADIUS: Final = 0.002  # m


@dataclass(frozen=True)
class Blocks:
    """A ball whose lowest point is P's origin, and a block that ends in S's plane."""

    friction: float = 0.0
    touching: bool = True
    mass: float = 0.05

    @property
    def material(self) -> ContactMaterial:
        return ContactMaterial(stiffness=2 * CONTACT, dissipation=20.0, friction=self.friction)

    def add_plug(self, plant: MultibodyPlant, body: RigidBody, X_BP: RigidTransform) -> None:
        ball = ConvexPiece("ball", Sphere(RADIUS), RigidTransform([0.0, 0.0, RADIUS]))
        add_pieces(plant, body, X_BP, [ball], self.material, GREY)

    def add_socket(self, plant: MultibodyPlant, X_WS: RigidTransform) -> None:
        if self.touching:
            block = ConvexPiece("block", Box(0.1, 0.1, 0.1), RigidTransform([0.0, 0.0, -0.05]))
            add_pieces(plant, plant.world_body(), X_WS, [block], self.material, GREY)


def move(
    path: PiecewisePolynomial,
    connector: Blocks,
    held: float | None = None,
    wrist: WristParams = WRIST,
    **fields: Any,
) -> dict[str, Array]:
    """Signals while the carriage follows a path, at every millisecond."""
    builder = DiagramBuilder()
    added = add_connector_plant(
        builder,
        connector,
        wrist,
        **{
            "X_WS": RigidTransform(),
            "X_TP": RigidTransform(),
            "start": path.value(path.start_time())[:, 0],
            **fields,
        },
    )
    source = builder.AddSystem(TrajectorySource(path, 1))
    builder.Connect(source.get_output_port(), added.desired)
    ports = {
        "desired": source.get_output_port(),
        "displacement": added.displacement,
        "wrench": added.wrench,
        "pose": added.plug_pose,
    }
    if held is not None:
        share = builder.AddSystem(ConstantVectorSource([held]))
        ports["touched"] = add_weight(builder, added, connector.mass, share.get_output_port())
    logs = {name: LogVectorOutput(port, builder, 0.001) for name, port in ports.items()}
    simulator = Simulator(builder.Build())
    # A little longer, or the last log entry is from before the last step.
    simulator.AdvanceTo(path.end_time() + 1e-4)
    root = simulator.get_context()
    return {name: log.FindLog(root).data().copy() for name, log in logs.items()}


def line(*points: tuple[float, Any]) -> PiecewisePolynomial:
    """A path by way of displacements at times."""
    values = np.array([point for _, point in points], dtype=np.float64).T
    return PiecewisePolynomial.FirstOrderHold([time for time, _ in points], values)


def down(z: float, *, x: float = 0.0, y: float = 0.0) -> Array:
    return np.array([0.0, 0.0, 0.0, x, y, z])


@pytest.mark.parametrize("held", [0.0, 1.0])
def test_a_plug_that_is_held_weighs_at_the_wrist_whatever_its_tilt(held: float) -> None:
    start = np.array([0.2, -0.3, 0.4, 1e-3, 2e-3, 3e-3])
    found = move(line((0.0, start), (0.1, start)), Blocks(touching=False, mass=0.4), held)
    weight = held * 0.4 * 9.81  # N
    expected = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -weight])
    np.testing.assert_allclose(found["wrench"][:, -1], expected, atol=1e-4)
    np.testing.assert_allclose(found["touched"][:, -1], np.zeros(SIZE), atol=1e-4)
    sagged = start - down(weight / WRIST.stiffness[5])
    np.testing.assert_allclose(found["displacement"][:SIZE, -1], sagged, atol=1e-8)


@pytest.mark.parametrize("centre", [0.0, 0.06])
@pytest.mark.parametrize("along", [0, 1])
def test_pressed_beside_the_tip_it_turns_by_the_torque(along: int, centre: float) -> None:
    wrist = replace(WRIST, centre=centre)
    arm = 0.004 * np.eye(3)[along]
    path = line((0.0, down(0.0)), (0.1, down(-0.5e-3)), (1.0, down(-0.5e-3)))
    found = move(path, Blocks(), wrist=wrist, X_TP=RigidTransform(arm))
    wrench, displacement = found["wrench"][:, -1], found["displacement"][:SIZE, -1]
    # The lowest point is below the ball's middle, wherever that has been turned to.
    p_TC = tip_pose(np.array([*displacement[:3], 0, 0, 0])) @ (arm + np.array([0.0, 0.0, RADIUS]))
    touched = p_TC - np.array([0.0, 0.0, RADIUS])
    torque = np.cross(touched, wrench[3:])
    np.testing.assert_allclose(wrench[:3], torque, atol=2e-3 * np.abs(torque).max())
    assert abs(torque[1 - along]) == pytest.approx(0.004 * wrench[5], rel=0.01)
    lack = np.array(path.value(1.0)[:, 0]) - displacement
    given = wrist.compliance @ wrench
    # Turned, the tip comes up a little, and the push has a lever about the centre.
    np.testing.assert_allclose(-lack, given, atol=1e-9 if not centre else 1e-5, rtol=0.1)
    assert wrench[5] > 1.0
    turn, stiffness = displacement[1 - along], WRIST.stiffness[1 - along]
    expected = torque[1 - along] / (stiffness - centre * wrench[5])
    assert turn == pytest.approx(expected, rel=0.01)


def test_a_wrist_above_the_tip_leans_where_it_is_pushed_aside() -> None:
    wrist, start = replace(WRIST, centre=0.06), np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    path = line((0.0, start), (0.1, start - down(1e-3)), (1.0, start - down(1e-3)))
    found = move(path, Blocks(friction=1.0), wrist=wrist, start=start + down(1e-4))
    wrench, displacement = found["wrench"][:, -1], found["displacement"][:SIZE, -1]
    assert abs(wrench[3]) > 0.5
    R, desired = tip_pose(displacement).rotation(), path.value(1.0)[:, 0]
    np.testing.assert_allclose(found["pose"][4:, -1], displacement[3:], atol=1e-9)
    # At the centre each spring gives way by itself.
    given = moved(displacement, 0.06) - moved(desired, 0.06)
    torque = wrench[:3] - np.cross(R @ np.array([0.0, 0.0, 0.06]), wrench[3:])
    at_centre = np.array(wrist.stiffness) * given
    np.testing.assert_allclose(at_centre, [*torque, *wrench[3:]], atol=1e-4)
    # Moments about the lowest point, which is below the ball's middle.
    lowest = R @ np.array([0.0, 0.0, RADIUS]) - np.array([0.0, 0.0, RADIUS])
    np.testing.assert_allclose(wrench[:3], np.cross(lowest, wrench[3:]), atol=2e-3)


def test_an_obstacle_is_met_at_its_depth() -> None:
    path = line((0.0, down(0.0)), (0.1, down(-3e-3)), (0.5, down(-3e-3)))
    place = RigidTransform([0.0, 0.0, 1e-3])
    found = move(path, Blocks(touching=False), X_WS=place, obstacle=2e-3, start=down(2e-3))
    # 1e6 N/m of the obstacle and 4e6 of the ball, in series.
    force = 2e-3 / (1 / WRIST.stiffness[5] + 1 / 0.8e6)
    assert found["wrench"][5, -1] == pytest.approx(force, rel=1e-3)
    assert found["displacement"][5, -1] == pytest.approx(-1e-3 - force / 0.8e6, abs=1e-6)


@pytest.mark.parametrize("step", [0.0, -1e-3, math.nan, math.inf])
def test_refuses_what_is_no_step(step: float) -> None:
    with pytest.raises(ParameterError) as refused:
        move(line((0.0, down(0.0)), (0.1, down(0.0))), Blocks(), step=step)
    assert str(refused.value) == f"step is {step}, allowed: a finite number > 0"
