"""The desired trajectory: towards a surface until it is touched, then along it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
)
from chamfer.systems.force.selection import unit

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ApproachParams:
    """An approach, after which the position is held; m is the endpoint vector's size."""

    start: tuple[float, ...]  # m or rad, the endpoint at the start
    direction: tuple[float, ...]  # of the approach, in endpoint coordinates, of any length
    along: tuple[float, ...]  # of the motion in contact, in endpoint coordinates, of any length
    speed: float  # m/s, of the approach
    acceleration: float = 10.0  # m/s^2, with which the approach begins

    def __post_init__(self) -> None:
        require_positive(self, "speed", "acceleration")
        if not all(math.isfinite(value) for value in self.start):
            raise ParameterError("start", self.start, "finite numbers")
        for name in ("direction", "along"):
            vector = getattr(self, name)
            if len(vector) != len(self.start):
                raise ParameterError(name, vector, f"{len(self.start)} numbers")
            unit(np.array(vector), name)

    @property
    def period(self) -> float | None:
        """Period of the motion in contact, s; None if the position is held."""
        return None

    def approached(self, time: float) -> float:
        """Return the distance covered in the approach, m, at a time >= 0, s."""
        ramp = self.speed / self.acceleration
        if time < ramp:
            return 0.5 * self.acceleration * time**2
        return self.speed * (time - 0.5 * ramp)

    def swing(self, time: float) -> float:
        """Return the motion in contact, m along ``along``, at a time after contact, s: none."""
        return 0.0


@dataclass(frozen=True, kw_only=True)
class GuardedMotionParams(ApproachParams):
    """An approach, after which the arm moves to and fro along the surface."""

    amplitude: float = 0.0  # m, of the sinusoid in contact; 0 holds the position
    frequency: float = 1.0  # rad/s, of the sinusoid
    blend: float = 0.5  # s, in which the sinusoid grows to its amplitude

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "frequency", "blend")
        require_not_negative(self, "amplitude")

    @property
    def period(self) -> float | None:
        """Period of the motion in contact, s; None if the position is held."""
        return 2 * math.pi / self.frequency if self.amplitude else None

    def swing(self, time: float) -> float:
        """Return the sinusoid, m, at a time after contact, s; it starts with zero velocity."""
        part = min(time / self.blend, 1.0)
        grown = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
        return self.amplitude * grown * math.sin(self.frequency * time)


class GuardedMotion(LeafSystem):
    """Moves towards the surface, and after the first contact along it.

    .. pydrake_system::

        name: GuardedMotion
        input_ports:
        - contact_time
        output_ports:
        - desired_position

    The approach begins and the motion along the surface grows with continuous velocity and finite
    acceleration (section 6.2.2). At the contact the approach stops at once; its direction is then
    under force control.

    ``contact_time``, size 1, s, negative before contact. ``desired_position``, shape (m,).
    """

    def __init__(self, params: ApproachParams) -> None:
        super().__init__()
        # Lists are faster than arrays for the few coordinates of an arm.
        start = params.start
        direction = unit(np.array(params.direction), "direction").tolist()
        along = unit(np.array(params.along), "along").tolist()
        contact_time = self.DeclareVectorInputPort("contact_time", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            time, contact = context.get_time(), float(contact_time.Eval(context)[0])
            into = params.approached(time if contact < 0 else contact)
            sideways = 0.0 if contact < 0 else params.swing(time - contact)
            vector.SetFromVector(
                [
                    x + d * into + a * sideways
                    for x, d, a in zip(start, direction, along, strict=True)
                ]
            )

        self.DeclareVectorOutputPort(
            "desired_position",
            len(start),
            calc,
            {self.time_ticket(), contact_time.ticket()},
        )
