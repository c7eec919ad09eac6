"""A plug on a compliant wrist, its socket, and the carriage that moves the wrist."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain, Multiplexer

from chamfer.models.arms.wrist import SIZE, WristParams, add_wrist, in_joint_order
from chamfer.models.connectors.connector import Connector, ContactMaterial, ConvexPiece, add_pieces
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import TruePose

_OBSTACLE: Final = ContactMaterial(stiffness=1e6, dissipation=20.0, friction=0.2)


class ConnectorPlant(NamedTuple):
    """What was added to a builder."""

    plant: MultibodyPlant
    desired: InputPort  # displacement of the tip, rad above m, and its rate, shape (12,)
    wrench: OutputPort  # of the tool on the wrist's springs, N m above N, shape (6,)
    displacement: OutputPort  # of the tip and its rate, shape (12,); for logs alone
    plug_pose: OutputPort  # of the tool's frame, shape (7,); for cameras and logs alone


def add_connector_plant(
    builder: DiagramBuilder,
    connector: Connector,
    wrist: WristParams,
    *,
    X_WS: RigidTransform,
    X_TP: RigidTransform,
    start: NDArray[np.float64] | None = None,
    step: float = 0.001,
    obstacle: float | None = None,
) -> ConnectorPlant:
    """Add a plant in which a carriage in the world's axes holds a plug by the wrist.

    Args:
        builder: Where to.
        connector: Plug and socket.
        wrist: Its compliance.
        X_WS: Where the socket is.
        X_TP: How the plug sits in the tool's frame: what the grasp is wrong by.
        start: Displacement of the tip at which it starts, rad above m, shape (6,); 0 by default.
        step: s, of the plant.
        obstacle: Depth in the socket at which something is in the way, m; None: nothing is.
    """
    if not 0 < step < math.inf:
        raise ParameterError("step", step, "a finite number > 0")
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, step)
    plant.set_name("connectors")
    scene_graph.set_name("geometry")
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kTamsi)
    held = add_wrist(plant, plant.world_frame(), wrist)
    connector.add_plug(plant, held.body, X_TP)
    connector.add_socket(plant, X_WS)
    if obstacle is not None:
        _add_obstacle(plant, X_WS, obstacle)
    plant.Finalize()
    if start is not None:
        plant.SetDefaultPositions(held.instance, in_joint_order() @ start)
    # Forces of what is desired, above what is.
    both = builder.AddNamedSystem("set-points and joints", Multiplexer([2 * SIZE, 2 * SIZE]))
    drive, springs = (
        MatrixGain(np.hstack([law @ in_joint_order(2), -law]))
        for law in (wrist.implicit_law(step), wrist.law)
    )
    builder.AddNamedSystem("drive of the wrist", drive)
    builder.AddNamedSystem("springs of the wrist", springs)
    # What holds the tool still against the contact is its opposite.
    wrench = builder.AddNamedSystem("wrist sensor", MatrixGain(-in_joint_order().T))
    connect = builder.Connect
    connect(plant.get_state_output_port(held.instance), both.get_input_port(1))
    connect(both.get_output_port(), drive.get_input_port())
    connect(drive.get_output_port(), plant.get_actuation_input_port(held.instance))
    connect(both.get_output_port(), springs.get_input_port())
    connect(springs.get_output_port(), wrench.get_input_port())
    displacement = builder.AddNamedSystem("tip", MatrixGain(in_joint_order(2).T))
    builder.Connect(plant.get_state_output_port(held.instance), displacement.get_input_port())
    pose = builder.AddNamedSystem("true pose", TruePose(held.body.index()))
    builder.Connect(plant.get_body_poses_output_port(), pose.get_input_port())
    return ConnectorPlant(
        plant,
        both.get_input_port(0),
        wrench.get_output_port(),
        displacement.get_output_port(),
        pose.get_output_port(),
    )


def add_weight(
    builder: DiagramBuilder, added: ConnectorPlant, mass: float, held: OutputPort
) -> OutputPort:
    """Let the tool carry the weight of a plug, its mass in kg, at the tip while ``held`` is 1.

    Returns:
        The wrench of what the plug touches, N m above N, shape (6,): the wrist's, less the weight.
    """
    plant = added.plant
    weight = mass * plant.gravity_field().gravity_vector()[2]  # N, along z
    force = np.zeros((plant.num_velocities(), 1))
    force[plant.GetJointByName("z").velocity_start()] = weight
    carried = builder.AddNamedSystem("weight of the plug", MatrixGain(force))
    rest = builder.AddNamedSystem("what bears it", MatrixGain(-weight * np.eye(SIZE)[:, -1:]))
    touched = builder.AddNamedSystem("what the plug touches", Adder(2, SIZE))
    for gain in (carried, rest):
        builder.Connect(held, gain.get_input_port())
    builder.Connect(carried.get_output_port(), plant.get_applied_generalized_force_input_port())
    builder.Connect(added.wrench, touched.get_input_port(0))
    builder.Connect(rest.get_output_port(), touched.get_input_port(1))
    return touched.get_output_port()


def _add_obstacle(plant: MultibodyPlant, X_WS: RigidTransform, depth: float) -> None:
    """Add a plate all around the socket."""
    size = (0.08, 0.08, 0.002)
    X_SO = RigidTransform([0.0, 0.0, -depth - size[2] / 2])
    plate = [ConvexPiece("obstacle", Box(*size), X_SO)]
    add_pieces(plant, plant.world_body(), X_WS, plate, _OBSTACLE, np.array([0.2, 0.2, 0.2, 1.0]))
