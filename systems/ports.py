"""Checks inputs at a block's ports, and the ports of a user's own block."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
    PortDataType,
    System,
)

from chamfer.models.validation import ParameterError, finite

Array = NDArray[np.float64]


def finite_input(port: InputPort, context: Context) -> Array:
    """Return the value at a vector port, checked as :func:`finite` does."""
    return finite(port.get_name(), port.Eval(context))


def fixed_output(system: LeafSystem, name: str, value: Array) -> OutputPort:
    """Declare an output that never changes; outputs that depend on it alone are evaluated once.

    Outputs that depend on Drake's ``ConstantVectorSource`` are evaluated whenever time advances.
    """

    def calc(context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(value)

    return system.DeclareVectorOutputPort(name, len(value), calc, {system.nothing_ticket()})


def add_fixed(builder: DiagramBuilder, name: str, value: Array) -> OutputPort:
    """Add a block that gives a constant vector, see :func:`fixed_output`."""
    return fixed_output(builder.AddNamedSystem(name, LeafSystem()), "fixed", value)


def require_ports(
    name: str, system: System, *, inputs: Mapping[str, int], outputs: Mapping[str, int]
) -> None:
    """Raise unless a system has the required vector ports, by name with their sizes.

    It may have further ports, inputs if the system works without them.

    Args:
        name: Its name in the message, "controller".
        system: A user's own.
        inputs: Sizes by name.
        outputs: Sizes by name.

    Raises:
        ParameterError: With the missing port and the available ones.
    """
    there = {
        "input": [system.get_input_port(i) for i in range(system.num_input_ports())],
        "output": [system.get_output_port(i) for i in range(system.num_output_ports())],
    }
    for kind, wanted in (("input", inputs), ("output", outputs)):
        sizes = {
            port.get_name(): port.size()
            for port in there[kind]
            if port.get_data_type() == PortDataType.kVectorValued
        }
        for port, size in wanted.items():
            if sizes.get(port) != size:
                found = ", ".join(f"{one} ({sizes[one]})" for one in sizes) or "none"
                raise ParameterError(
                    name,
                    type(system).__name__,
                    f"a system with the vector {kind} port {port} of size {size}; "
                    f"its vector {kind} ports and their sizes are: {found}",
                )
