"""What a log of a robot tells, each quantity with its 95 % interval."""

from collections.abc import Mapping
from dataclasses import dataclass

from matplotlib.figure import Figure

from chamfer.analysis.identify.log import Log
from chamfer.analysis.identify.quantity import Quantity
from chamfer.analysis.identify.sensor_fit import sensor_quantities

__all__ = ["Identification", "Quantity", "identify"]


@dataclass(frozen=True, kw_only=True)
class Identification:
    """What a log tells."""

    quantities: dict[str, Quantity]

    def figures(self) -> Mapping[str, Figure]:
        """Return the residuals of the fits as figures."""
        return {}


def identify(log: Log, *, told_stiffness: float | None = None) -> Identification:
    """Return what the log tells, everything that it can't tell with the reason.

    ``told_stiffness``, N/m, is what the impedance was set to, if that is known: it tells the unit
    of the forces. Nothing is drawn at random.

    Raises:
        UserError: If no rotation of the sensor fits the log, but a mirrored one does.
    """
    del told_stiffness
    return Identification(quantities=sensor_quantities(log))
