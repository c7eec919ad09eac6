"""One compensator with many axes, each with its own parameters and a plant of its own.

The axes do not act on one another, so a single run covers a whole campaign of settings.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem

from systems.exact_discretisation import discretise
from systems.servo.compensator import AxisParams, CompensatorParams, TrajectoryCompensator
from systems.vision.measured_error import MeasuredErrorParams, add_measured_error


def make_parallel_axes_diagram(
    axes: Sequence[AxisParams],
    plant: LinearSystem,
    desired: NDArray[np.float64],
    measurement: MeasuredErrorParams,
    *,
    step: float,
) -> Diagram:
    """Build one FSM loop per axis.

    Args:
        axes: Parameters, n of them.
        plant: Continuous, one input and one output; every axis gets a copy.
        desired: Constant desired positions, shape (n,).
        measurement: The camera; its size is ignored, its period is the compensator's.
        step: s, of the plants; the period has to be a multiple of it.

    Returns:
        A diagram that exports ``increment`` and ``actual_trajectory``, of size n.
    """
    count = len(axes)
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("desired trajectory", ConstantVectorSource(desired))
    vision = add_measured_error(builder, replace(measurement, size=count))
    controller = builder.AddNamedSystem(
        "controller FSM",
        TrajectoryCompensator(CompensatorParams(axes=tuple(axes), period=measurement.period)),
    )
    each = np.eye(count)
    plants = builder.AddSystem(
        discretise(
            LinearSystem(
                A=np.kron(each, plant.A()),
                B=np.kron(each, plant.B()),
                C=np.kron(each, plant.C()),
                D=np.kron(each, plant.D()),
            ),
            step,
        )
    )
    actual = plants.get_output_port(0)
    builder.Connect(source.get_output_port(), vision.GetInputPort("desired_trajectory"))
    builder.Connect(actual, vision.GetInputPort("actual_trajectory"))
    builder.Connect(vision.GetOutputPort("error"), controller.GetInputPort("error"))
    builder.Connect(controller.GetOutputPort("compensation"), plants.get_input_port(0))
    builder.ExportOutput(controller.GetOutputPort("increment"), "increment")
    builder.ExportOutput(actual, "actual_trajectory")
    diagram = builder.Build()
    diagram.set_name("parallel axes")
    return diagram
