"""A six-axis sensor between an arm and its tool, read as the wrench on the tool's tip."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, known, require_positive
from chamfer.systems.sensing.force_sensor import ChannelParams, Gauges, Matrix6

Array = NDArray[np.float64]

_SIZE = 6
# Channels are forces, then moments; wrenches are moments above forces.
_SWAP = np.roll(np.eye(_SIZE), 3, axis=0)


@dataclass(frozen=True, kw_only=True)
class WrenchSensorParams(ChannelParams):
    """Parameters of a six-axis sensor; its channels are three forces, then three moments."""

    cross_talk: Matrix6 | None = None
    # 6 x 6, what each channel reads of all, in N and N m, ones on the diagonal; None: derived
    # from ``sensing``
    decoupling: bool = False  # True: the reading is multiplied by the inverse of the cross-talk
    position: tuple[float, float, float] | None = None
    # m, of the sensor's origin from the tool's tip; None: derived from ``sensing``
    radius: float = 0.02  # m, a moment's noise, bias, ... are the forces' times this; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "radius")
        if not all(map(math.isfinite, self.position or ())):
            raise ParameterError("position", self.position, "three finite numbers")
        given = self.cross_talk
        if given is not None:
            square = len(given) == _SIZE and all(len(row) == _SIZE for row in given)
            if not (square and np.all(np.isfinite(given)) and np.linalg.cond(given) < 1e6):
                raise ParameterError("cross_talk", given, "a regular 6 x 6 matrix")
        if self.tare:
            raise ParameterError("tare", self.tare, "0: the skill takes the zero")

    @property
    def coupling(self) -> Array:
        """What the channels read of forces and moments at the sensor's origin, shape (6, 6)."""
        return np.array(known("cross_talk", self.cross_talk), dtype=np.float64)

    @property
    def _moved(self) -> Array:
        """Forces and moments at the sensor's origin of those at the tip, shape (6, 6)."""
        x, y, z = known("position", self.position)
        moved = np.eye(_SIZE)
        moved[3:, :3] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return moved

    @property
    def gauges(self) -> Gauges:
        """How the channels feel the wrench on the tool at its tip, N m above N."""
        # The sensor block reads what the arm does to the surface, the opposite.
        felt = -self.coupling @ self._moved @ _SWAP
        return Gauges(felt, np.array([1.0, 1.0, 1.0, *3 * [self.radius]]))

    @property
    def undoing(self) -> Array:
        """What the reading is multiplied by for the wrench on the tool's tip, shape (6, 6)."""
        undone = np.linalg.inv(self.coupling) if self.decoupling else np.eye(_SIZE)
        matrix: Array = np.asarray(_SWAP.T @ np.linalg.inv(self._moved) @ undone, dtype=np.float64)
        return matrix
