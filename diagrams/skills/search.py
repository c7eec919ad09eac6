"""Trajectory primitives that move a carriage, free of contact (section 2)."""

from collections.abc import Sequence

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Integrator, ZeroOrderHold

from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx, TrajectoryPrimitive


def make_search_diagram(primitives: Sequence[MoveDx | Dither], *, step: float) -> Diagram:
    """Build a carriage that follows the velocity of primitives, held over a step, s.

    It exports ``velocity``, rad/s above m/s, and ``displacement``, rad above m, shape (6,) each.
    """
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("primitives", TrajectoryPrimitive(*primitives))
    hold = builder.AddNamedSystem("set-points", ZeroOrderHold(step, 6))
    carriage = builder.AddNamedSystem("carriage", Integrator(6))
    builder.Connect(source.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), carriage.get_input_port())
    builder.ExportOutput(hold.get_output_port(), "velocity")
    builder.ExportOutput(carriage.get_output_port(), "displacement")
    diagram = builder.Build()
    diagram.set_name("Search by dithers")
    return diagram
