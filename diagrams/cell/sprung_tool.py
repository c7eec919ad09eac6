"""The springs between a tool and its carrier, and the wrench in them."""

from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.symbolic import Jacobian, MakeVectorVariable
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import MatrixGain, Multiplexer, SymbolicVectorSystem

from chamfer.models.arms.wrist import SIZE, Wrist, WristParams, along_tool, in_joint_order, moved


class Springs(NamedTuple):
    """The added blocks of a builder; displacements of the tip, rad above m, and their rates."""

    desired: InputPort  # where the carrier has the tip without force, shape (12,)
    wrench: OutputPort  # of the tool on the springs, about the tip, N m above N, shape (6,)
    displacement: OutputPort  # where the tip is, shape (12,); for logs alone


def add_springs(
    builder: DiagramBuilder, plant: MultibodyPlant, held: Wrist, wrist: WristParams
) -> Springs:
    """Add the drives and outputs of a wrist of a finalized plant."""
    state, centre = plant.get_state_output_port(held.instance), wrist.centre
    # Forces of what is desired, above what is.
    both = builder.AddNamedSystem("set-points and joints", Multiplexer([2 * SIZE, 2 * SIZE]))
    drive, springs = (
        MatrixGain(np.hstack([law @ in_joint_order(2), -law]))
        for law in (wrist.implicit_law(plant.time_step()), wrist.law)
    )
    builder.AddNamedSystem("drive of the wrist", drive)
    builder.AddNamedSystem("springs of the wrist", springs)
    # What holds the tool still against the contact is its opposite.
    wrench = builder.AddNamedSystem("wrist sensor", MatrixGain(-in_joint_order().T))
    connect = builder.Connect
    connect(state, both.get_input_port(1))
    connect(both.get_output_port(), drive.get_input_port())
    connect(drive.get_output_port(), plant.get_actuation_input_port(held.instance))
    connect(both.get_output_port(), springs.get_input_port())
    connect(springs.get_output_port(), wrench.get_input_port())
    name = "centre of the wrist" if centre else "tip"
    joints = builder.AddNamedSystem(name, MatrixGain(in_joint_order(2).T))
    connect(state, joints.get_input_port())
    desired, felt = both.get_input_port(0), wrench.get_output_port()
    displacement = joints.get_output_port()
    if centre:
        from_tip = builder.AddNamedSystem("desired centre", _moved_by(centre))
        to_tip = builder.AddNamedSystem("tip", _moved_by(-centre))
        lever = builder.AddNamedSystem("tip and wrench", Multiplexer([2 * SIZE, SIZE]))
        about_tip = builder.AddNamedSystem("wrench about the tip", _about_tip(centre))
        connect(from_tip.get_output_port(), desired)
        connect(displacement, to_tip.get_input_port())
        connect(displacement, lever.get_input_port(0))
        connect(felt, lever.get_input_port(1))
        connect(lever.get_output_port(), about_tip.get_input_port())
        desired, felt = from_tip.get_input_port(), about_tip.get_output_port()
        displacement = to_tip.get_output_port()
    return Springs(desired, felt, displacement)


def _moved_by(height: float) -> SymbolicVectorSystem:
    """Return the block of :func:`moved`, with the rate below the displacement, shape (12,)."""
    x = MakeVectorVariable(2 * SIZE, "x")
    with np.errstate(invalid="ignore"):  # to NumPy an expression is no number
        place = moved(x[:SIZE], height)
        rate = Jacobian(place, x[:SIZE]) @ x[SIZE:]
    return SymbolicVectorSystem(input=x, output=np.concatenate([place, rate]))


def _about_tip(centre: float) -> SymbolicVectorSystem:
    """Return the block that takes a wrench, below displacement and rate, from a centre, m."""
    x = MakeVectorVariable(3 * SIZE, "x")
    force = x[-3:]
    with np.errstate(invalid="ignore"):
        torque = x[2 * SIZE : -3] + np.cross(centre * along_tool(x), force)
    return SymbolicVectorSystem(input=x, output=np.concatenate([torque, force]))
