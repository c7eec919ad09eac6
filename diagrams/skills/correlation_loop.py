"""A dither under damping control, hindered or not, and the correlator that has to tell which.

Source: Morrow, Nelson and Khosla, section 3.2, eq. (1). The paper shows no diagram of it and
prints no parameters: all are assumed.
"""

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Integrator,
    MatrixGain,
    RandomSource,
)

from chamfer.models.validation import ParameterError, require_finite, require_not_negative
from chamfer.systems.contact.spring_constraint import (
    SIZE,
    SpringConstraint,
    SpringConstraintParams,
)
from chamfer.systems.force.accommodation import AccommodationController, AccommodationParams
from chamfer.systems.primitives.correlation import Correlator, CorrelatorParams
from chamfer.systems.primitives.trajectory_primitives import Dither, TrajectoryPrimitive


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
    """One dither, and what hinders it."""

    dither: Dither = field(default_factory=lambda: Dither(cycles=40.0))
    accommodation: AccommodationParams = field(default_factory=AccommodationParams)
    constraint: SpringConstraintParams = field(default_factory=SpringConstraintParams)
    sensor: AxisSensorParams = field(default_factory=AxisSensorParams)
    correlator: CorrelatorParams = field(default_factory=CorrelatorParams)

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


ScenarioT = TypeVar("ScenarioT", bound=CorrelationScenario)


def resolve(scenario: ScenarioT) -> ScenarioT:
    """Return the scenario with its constraint along the dither, watched a cycle at a time."""
    constraint, correlator = scenario.constraint, scenario.correlator
    if constraint.index is None:
        constraint = replace(constraint, index=scenario.dither.index)
    if correlator.samples is None:
        correlator = replace(correlator, samples=scenario.samples)
    if correlator.period is None:
        correlator = replace(correlator, period=scenario.accommodation.period)
    return replace(scenario, constraint=constraint, correlator=correlator)


def make_correlation_diagram(scenario: CorrelationScenario) -> Diagram:
    """Build the loop.

    Outputs: ``command`` and ``motion`` along the dither's axis, m/s or rad/s; ``displacement``, m
    or rad, shape (6,); ``correlation`` (3,) and ``hindered`` of the correlator.
    """
    scenario = resolve(scenario)
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
