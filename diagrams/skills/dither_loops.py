"""Dithers of a carriage: free of contact, and under damping control with a correlator.

Source: Morrow, Nelson and Khosla, section 2, and section 3.2, eq. (1): the correlator has to
detect an obstructed dither. The paper shows no diagram of either and prints no parameters: all are
assumed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Integrator,
    MatrixGain,
    RandomSource,
    ZeroOrderHold,
)

from chamfer.models.validation import ParameterError, require_finite, require_not_negative
from chamfer.systems.contact.spring_constraint import (
    SIZE,
    SpringConstraint,
    SpringConstraintParams,
)
from chamfer.systems.force.accommodation import AccommodationController
from chamfer.systems.force.accommodation_law import AccommodationParams
from chamfer.systems.primitives.dither_blocks import (
    Correlator,
    CorrelatorParams,
    ResolvedCorrelatorParams,
    TrajectoryPrimitive,
)
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx


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


@dataclass(frozen=True, kw_only=True)
class AxisSensorParams:
    """A force sensor along, or about, one axis."""

    noise: float = 0.0  # N or N m, standard deviation of every sample
    bias: float = 0.0  # N or N m, added to every sample

    def __post_init__(self) -> None:
        require_not_negative(self, "noise")
        require_finite(self, "bias")


@dataclass(frozen=True, kw_only=True)
class CorrelationScenario:
    """One dither and its obstruction."""

    dither: Dither = Dither(cycles=40.0)
    accommodation: AccommodationParams = AccommodationParams()
    constraint: SpringConstraintParams = SpringConstraintParams()
    sensor: AxisSensorParams = AxisSensorParams()
    correlator: CorrelatorParams = CorrelatorParams()

    def __post_init__(self) -> None:
        samples = 1 / (self.dither.frequency * self.accommodation.period)
        if not (samples >= 4 and abs(samples - round(samples)) < 1e-6):
            raise ParameterError(
                "dither.frequency",
                self.dither.frequency,
                f"whose cycles are four or more periods of {self.accommodation.period:g} s",
            )

    @property
    def samples(self) -> int:
        """N of eq. (1): a cycle."""
        return round(1 / (self.dither.frequency * self.accommodation.period))


@dataclass(frozen=True, kw_only=True)
class ResolvedCorrelationScenario(CorrelationScenario):
    """One dither and its obstruction; nothing is open."""

    correlator: ResolvedCorrelatorParams


def resolve(scenario: CorrelationScenario) -> ResolvedCorrelationScenario:
    """Return the scenario with its constraint along the dither, and with windows of a cycle."""
    found = {one.name: getattr(scenario, one.name) for one in fields(scenario)}
    if scenario.constraint.index is None:
        found["constraint"] = replace(scenario.constraint, index=scenario.dither.index)
    found["correlator"] = scenario.correlator.resolved(
        samples=scenario.samples, period=scenario.accommodation.period
    )
    return ResolvedCorrelationScenario(**found)


def make_correlation_diagram(scenario: ResolvedCorrelationScenario) -> Diagram:
    """Build the loop.

    Outputs: ``command`` and ``motion`` along the dither's axis, m/s or rad/s; ``displacement``, m
    or rad, shape (6,); ``correlation`` (3,) and ``hindered`` of the correlator.
    """
    builder = DiagramBuilder()
    connect = builder.Connect
    index, period = scenario.dither.index, scenario.accommodation.period
    unit = np.zeros((SIZE, 1))
    unit[index] = 1.0
    dither = builder.AddNamedSystem("dither", TrajectoryPrimitive(scenario.dither))
    accommodation = builder.AddNamedSystem(
        "accommodation", AccommodationController(scenario.accommodation)
    )
    carriage = builder.AddNamedSystem("carriage", Integrator(SIZE))
    constraint = builder.AddNamedSystem("constraint", SpringConstraint(scenario.constraint))
    bias = builder.AddNamedSystem("bias", ConstantVectorSource(scenario.sensor.bias * unit[:, 0]))
    random = builder.AddNamedSystem("noise", RandomSource(RandomDistribution.kGaussian, 1, period))
    noise = builder.AddNamedSystem("sensor noise", MatrixGain(scenario.sensor.noise * unit))
    sensor = builder.AddNamedSystem("force sensor", Adder(3, SIZE))
    connect(dither.get_output_port(), accommodation.GetInputPort("command"))
    connect(accommodation.GetOutputPort("velocity"), carriage.get_input_port())
    connect(carriage.get_output_port(), constraint.get_input_port())
    connect(random.get_output_port(), noise.get_input_port())
    for i, source in enumerate((constraint, bias, noise)):
        connect(source.get_output_port(), sensor.get_input_port(i))
    connect(sensor.get_output_port(), accommodation.GetInputPort("wrench"))
    correlator = builder.AddNamedSystem("correlator", Correlator(scenario.correlator))
    for name, source in (
        ("command", dither.get_output_port()),
        ("motion", accommodation.GetOutputPort("velocity")),
    ):
        along = builder.AddNamedSystem(f"{name} along the axis", MatrixGain(unit.T))
        connect(source, along.get_input_port())
        connect(along.get_output_port(), correlator.GetInputPort(name))
        builder.ExportOutput(along.get_output_port(), name)
    builder.ExportOutput(carriage.get_output_port(), "displacement")
    builder.ExportOutput(correlator.GetOutputPort("correlation"), "correlation")
    builder.ExportOutput(correlator.GetOutputPort("hindered"), "hindered")
    diagram = builder.Build()
    diagram.set_name("Correlation of command and motion")
    return diagram
