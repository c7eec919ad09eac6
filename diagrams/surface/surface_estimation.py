"""An observer of a gripper that follows a given path along an unknown surface (Fig. 5-1)."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.surface.surface_scenario import (
    THESIS,
    ResolvedSurfaceScenario,
    SurfaceScenario,
    add_observed_contact,
    require_calibration,
    resolved_fields,
)
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.sensing.force_rate import ForceRateSensorParams


@dataclass(frozen=True, kw_only=True)
class LeadSettings:
    """The nominal trajectory (5-4): along x at a constant speed, then a halt.

    It may begin above the surface: the gripper hovers as high as the depth, is pressed straight
    down to twice the depth, and comes back up to the depth.
    """

    depth: float = 0.1  # m, below the surface's origin
    speed: float = 0.2  # m/s, along x until the halt
    halt: float = 15.0  # s, after the motion along x began; afterwards it is at rest
    hover: float = 0.0  # s, above the surface before
    press: float = 0.0  # s, then, into the surface and back
    sideways: float = 0.0  # m, of the path beside the origin, in space

    def __post_init__(self) -> None:
        require_not_negative(self, "depth", "hover", "press")
        require_positive(self, "halt")
        require_finite(self, "sideways")
        if not 0 < abs(self.speed) < math.inf:
            raise ParameterError("speed", self.speed, "a finite number other than 0")
        if bool(self.hover) != bool(self.press):
            raise ParameterError("press", self.press, "more than 0 with a hover, else 0")

    @property
    def begins(self) -> float:
        """When the motion along x begins, s."""
        return self.hover + self.press

    def path(self, dimension: int) -> PiecewisePolynomial:
        """Return the nominal position, m, over the time, s."""
        first = self.begins
        times = [first, first + self.halt, first + 2 * self.halt]
        along = [0.0, self.speed * self.halt, self.speed * self.halt]
        deep = [self.depth] * 3
        if self.hover:
            times = [0.0, self.hover, self.hover + 0.75 * self.press, *times]
            along = [0.0] * 3 + along
            deep = [-self.depth, -self.depth, 2 * self.depth, *deep]
        points = np.zeros((dimension, len(times)))
        points[0] = along
        if dimension == 3:
            points[1] = self.sideways
        points[-1] = -np.array(deep)
        return PiecewisePolynomial.FirstOrderHold(times, points)


@dataclass(frozen=True, kw_only=True)
class EstimationScenario(SurfaceScenario):
    """A gripper on a given path along the surface, with the thesis' observer by default."""

    lead: LeadSettings = LeadSettings()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_calibration(self.observer, free=self.lead.hover, pressed=self.lead.press)
        if self.observer.average != 1:
            allowed = "1, as the sensor is sampled once in a period"
            raise ParameterError("observer.average", self.observer.average, allowed)


# Typical noise, a sharp bound on the curvature (Fig. 5-3).
SURFACE_ESTIMATION: Final = EstimationScenario()
SMOOTH: Final = replace(SURFACE_ESTIMATION, observer=replace(THESIS, smallest_radius=10.0))
# The bound is that of the surface (Fig. 5-4).
NOISE_FREE: Final = EstimationScenario(
    sensor=ForceRateSensorParams(force_noise=0.0, force_rate_noise=0.0), trials=1
)  # and the observer knows (Fig. 5-5)
LARGE_NOISE: Final = EstimationScenario(
    observer=replace(THESIS, force_noise=1000.0, force_rate_noise=5000.0), duration=3.5
)  # the observer takes the sensor to be useless (Fig. 5-6)


@dataclass(frozen=True, kw_only=True)
class ResolvedEstimationScenario(ResolvedSurfaceScenario, EstimationScenario):
    """The same, with nothing left open."""


def resolve_estimation(scenario: EstimationScenario) -> ResolvedEstimationScenario:
    """Return the scenario with the surface's defaults and the observer's assumptions filled in.

    Raises:
        ParameterError: If a block refuses its parameters.
    """
    if scenario.lead.sideways and scenario.dimension == 2:
        raise ParameterError("lead.sideways", scenario.lead.sideways, "0 in the plane")
    return ResolvedEstimationScenario(**resolved_fields(scenario))


def make_estimation_diagram(
    scenario: ResolvedEstimationScenario, *, observer: LeafSystem | None = None
) -> Diagram:
    """Return the open loop of Fig. 5-1.

    Outputs:

    * the observer's ``normal``, ``covariance``, ``deviation`` and ``status``;
    * its inputs ``measured_force`` and ``measured_force_rate`` (of the gripper on the surface) and
      ``nominal_motion``;
    * the truth, ``contact_force`` and ``contact``
      (:class:`chamfer.systems.contact.sliding_contact.SlidingContact`).

    Args:
        scenario: Parameters of the blocks.
        observer: Your own, in place of the
            :class:`chamfer.systems.estimation.surface_observer.SurfaceObserver`, in d dimensions.
            Inputs: ``measured_force`` (d), N, and ``measured_force_rate`` (d), N/s, of the
            gripper on the surface; ``nominal_motion`` (2d), m and m/s; ``predicted_normal`` (d)
            with ``observer.prediction`` only. Outputs: ``normal`` (d), unit; ``covariance``
            (d * d), by rows; ``deviation`` (1), rad; ``status`` (1).

    Raises:
        ParameterError: If the observer has other ports.
    """
    builder = DiagramBuilder()
    source = TrajectorySource(
        scenario.lead.path(scenario.dimension),
        output_derivative_order=1,
        zero_derivatives_beyond_limits=True,
    )
    trajectory = builder.AddNamedSystem("nominal trajectory", source)
    add_observed_contact(builder, scenario, trajectory.get_output_port(), observer)
    diagram = builder.Build()
    diagram.set_name("Surface estimation")
    return diagram
