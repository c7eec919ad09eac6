"""The controllers of the alignment: one element an axis, those of a kind alike."""

from dataclasses import dataclass
from typing import Final, Literal

from chamfer.systems.servo.compensator import AxisParams, OpenAxisParams
from chamfer.systems.servo.sampled_pid import OpenPidGains, PidGains

Kind = Literal["lateral", "rotational"]

KINDS: Final[tuple[Kind, ...]] = ("lateral", "rotational")  # three axes each, in this order


@dataclass(frozen=True, kw_only=True)
class OpenAxis(OpenAxisParams):
    """One of the compensator's elements: errors in pixels or rad, increments in m or rad.

    What is None is designed, see :mod:`chamfer.diagrams.cell.controller_design`.
    """

    dead_zone: float | None = None
    # pixels or rad; None: designed, the smallest one in which the increment settles
    large_error: float | None = None
    # pixels or rad; None: designed, the least that large increments need to die out
    increment: float | None = None
    # m or rad; None: designed, 8 mm or 0.32 rad per s, less if a given dead zone needs it
    limit: float | None = None  # m or rad; None: 0.03 m or 0.3 rad


@dataclass(frozen=True, kw_only=True)
class OpenGains(OpenPidGains):
    """One of the PID laws; what is None is designed likewise."""

    proportional: float | None = None
    # m/pixels or 1; None: designed, by SIMC for a closed loop of 0.05 s about the dead time
    integral: float | None = None  # m/(pixels s) or 1/s; None: designed, likewise
    limit: float | None = None  # m or rad; None: 0.03 m or 0.3 rad


@dataclass(frozen=True, kw_only=True)
class SixAxisSettings:
    """The compensator's elements."""

    lateral: OpenAxis = OpenAxis()
    rotational: OpenAxis = OpenAxis()

    @property
    def axes(self) -> tuple[AxisParams, ...]:
        """The six elements in the order of ``image_plane_error.AXES``."""
        return (self.lateral.closed,) * 3 + (self.rotational.closed,) * 3


@dataclass(frozen=True, kw_only=True)
class SixAxisPid:
    """The baseline's gains."""

    lateral: OpenGains = OpenGains()
    rotational: OpenGains = OpenGains()

    @property
    def axes(self) -> tuple[PidGains, ...]:
        """The six laws, in the order of the compensator's elements."""
        return (self.lateral.closed,) * 3 + (self.rotational.closed,) * 3
