"""Force sensors: a six-axis wrist sensor with cross-talk, and a uniaxial load cell."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from models.validation import ParameterError, require_finite, require_not_negative
from systems.force.selection import unit

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ForceSensorParams:
    """Parameters of :class:`ForceSensor`."""

    noise: float = 0.0  # N, half-width of a uniform noise
    cross_talk: float = 0.0  # of each direction into each other one
    decoupling: bool = False  # True: the reading is multiplied by the inverse of the cross-talk

    def __post_init__(self) -> None:
        require_finite(self, "cross_talk")
        require_not_negative(self, "noise")
        if not -0.5 < self.cross_talk < 1:
            # The eigenvalues of the matrix are 1 - c, 1 - c and 1 + 2c.
            raise ParameterError("cross_talk", self.cross_talk, "more than -0.5 and less than 1")


class ForceSensor(LeafSystem):
    """A wrist force sensor, its reading turned into the world's axes (sections 3.2.4 and 3.3).

    .. pydrake_system::

        name: ForceSensor
        input_ports:
        - contact_force
        - noise
        output_ports:
        - measured_force

    ``measured = D (C F + w)`` with noise w, ones on the diagonal of C and the cross-talk
    elsewhere; D is the inverse of C with decoupling, else the identity.

    ``contact_force``, shape (3,), N, of the surface on the arm, world frame. ``noise``, shape
    (3,), is a sample from 0 to 1 (Drake's uniform ``RandomSource``). ``measured_force``, shape
    (m,), N, of the arm on the surface: the opposite sign; angular coordinates read 0.

    Args:
        params: What the sensor adds.
        coordinates: m, size of the endpoint vector; the first of x, y, z, then angles.
    """

    def __init__(self, params: ForceSensorParams, *, coordinates: int = 3) -> None:
        super().__init__()
        size = coordinates
        cross_talk = np.full((3, 3), params.cross_talk) + (1 - params.cross_talk) * np.eye(3)
        undone = np.linalg.inv(cross_talk) if params.decoupling else np.eye(3)
        pick = np.eye(size, 3)
        reading, scale = -pick @ undone @ cross_talk, pick @ undone
        force = self.DeclareVectorInputPort("contact_force", 3)
        noise = self.DeclareVectorInputPort("noise", 3)

        def calc(context: Context, vector: BasicVector) -> None:
            measured = reading @ force.Eval(context)
            if params.noise:
                measured = measured + scale @ (params.noise * (2 * noise.Eval(context) - 1))
            vector.SetFromVector(_finite(measured))

        self.DeclareVectorOutputPort(
            "measured_force", size, calc, {force.ticket(), noise.ticket()}
        )


@dataclass(frozen=True, kw_only=True)
class LoadCellParams:
    """Parameters of :class:`LoadCell`."""

    axis: tuple[float, float, float]  # in the endpoint's frame, pointing out of the arm
    noise: float = 0.0  # N, half-width of a uniform noise

    def __post_init__(self) -> None:
        unit(np.array(self.axis), "axis")
        require_not_negative(self, "noise")


class LoadCell(LeafSystem):
    """A uniaxial load cell: what it reads is taken as the push along a known direction.

    .. pydrake_system::

        name: LoadCell
        input_ports:
        - tool_force
        - noise
        output_ports:
        - measured_force

    Section 3.1.1. The cell turns with the last link: friction along the surface enters its
    reading as soon as its axis is not along the normal.

    ``tool_force``, shape (3,), N, of the surface on the arm in the endpoint's frame; ``noise``,
    size 1, a sample from 0 to 1. ``measured_force``, shape (m,), N, of the arm on the surface.

    Args:
        params: How the cell is mounted, and its noise.
        direction: Shape (m,), in which the arm is taken to push, of any length.
    """

    def __init__(self, params: LoadCellParams, direction: Array) -> None:
        super().__init__()
        axis = unit(np.array(params.axis), "axis")
        ahead = unit(direction, "direction")
        force = self.DeclareVectorInputPort("tool_force", 3)
        noise = self.DeclareVectorInputPort("noise", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            reading = -float(axis @ force.Eval(context))
            if params.noise:
                reading += params.noise * (2 * float(noise.Eval(context)[0]) - 1)
            vector.SetFromVector(_finite(reading * ahead))

        self.DeclareVectorOutputPort(
            "measured_force", len(ahead), calc, {force.ticket(), noise.ticket()}
        )


def _finite(measured: Array) -> Array:
    if not all(map(math.isfinite, measured.tolist())):
        raise ParameterError("measured force", measured.tolist(), "finite numbers")
    return measured
