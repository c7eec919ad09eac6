"""The servo plants as Drake systems, made of :mod:`chamfer.models.plants.servo_plant`."""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, Gain, LinearSystem, MatrixGain

from chamfer.models.plants.servo_plant import (
    Form,
    SpringMassDamperParams,
    StateSpace,
    state_space,
)


def make_linear_plant(model: StateSpace) -> LinearSystem:
    """Return a plant as one continuous block."""
    plant = LinearSystem(*model)
    plant.set_name("plant")
    return plant


def make_spring_mass_damper(params: SpringMassDamperParams, form: Form) -> LinearSystem:
    """Return the spring-mass-damper as one block with the state (position m, velocity m/s)."""
    return make_linear_plant(state_space(params, form))


def make_plant(params: SpringMassDamperParams, form: Form) -> Diagram:
    """Build the inner loop of Fig. 5, with the transfer function of :func:`state_space`.

    A(s) is the free mass, from force N to (position m, velocity m/s). B(s) is the reaction of
    spring and damper. In the position form the stiffness K_p of eq. (1) turns the commanded
    position into a force.
    """
    model = state_space(params, form)
    builder = DiagramBuilder()
    balance = builder.AddNamedSystem("force balance", Adder(2, 1))
    motion = builder.AddNamedSystem(
        "impedance control A(s)",
        LinearSystem(
            A=np.array([[0.0, 1.0], [0.0, 0.0]]),
            B=np.array([[0.0], [1.0 / params.mass]]),
            C=np.eye(2),
            D=np.zeros((2, 1)),
        ),
    )
    environment = builder.AddNamedSystem(
        "environment B(s)", MatrixGain(D=np.array([[-params.stiffness, -params.damping]]))
    )
    actual = builder.AddNamedSystem("actual trajectory", MatrixGain(D=model.C))
    if form == "position":
        stiffness = builder.AddNamedSystem("stiffness K_p", Gain(params.stiffness, 1))
        builder.Connect(stiffness.get_output_port(), balance.get_input_port(0))
        builder.ExportInput(stiffness.get_input_port(), "commanded_trajectory")
    else:
        builder.ExportInput(balance.get_input_port(0), "force")
    builder.Connect(environment.get_output_port(), balance.get_input_port(1))
    builder.Connect(balance.get_output_port(), motion.get_input_port())
    builder.Connect(motion.get_output_port(), environment.get_input_port())
    builder.Connect(motion.get_output_port(), actual.get_input_port())
    builder.ExportOutput(actual.get_output_port(), "actual_trajectory")
    plant = builder.Build()
    plant.set_name("plant")
    return plant
