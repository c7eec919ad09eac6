"""From what two cameras see to the error of all six degrees of freedom (section 4)."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.framework import State as DrakeState

from models.validation import ParameterError, require_finite, require_positive
from systems.vision.part_detector import ERROR_SIZE

Array = NDArray[np.float64]

AXES: Final = ("x", "y", "z", "roll", "pitch", "yaw")  # world axes, turns about X, Y and Z


@dataclass(frozen=True, kw_only=True)
class CellErrorParams:
    """Parameters of :class:`CellError`."""

    gap: float = 60.0  # pixels, to be kept between tip and mouth: 3 cm at 0.5 mm a pixel
    most_misses: int = 4  # measurements in a row without which the parts count as lost; assumed
    begin: float = 0.0  # s, before which nothing is compensated: not valid, and no miss
    period: float = 1 / 80  # s, section 4

    def __post_init__(self) -> None:
        require_finite(self, "gap", "begin")
        require_positive(self, "period")
        if not self.most_misses >= 0:
            raise ParameterError("most_misses", self.most_misses, "a whole number >= 0")


class CellError(LeafSystem):
    """The peg's alignment error, desired minus actual, from one camera for each plane.

    .. pydrake_system::

        name: CellError
        input_ports:
        - xz_error
        - xy_error
        - expected_error (optional)
        output_ports:
        - error
        - valid
        - age
        - blind

    The inputs are :func:`systems.vision.part_detector.alignment_error` of the camera that looks
    along Y and of the one that looks down, shape (3,), with X to the right in both images. Nothing
    is calibrated: ``error``, shape (6,), has pixels along X, Y and Z and rad about them
    (:data:`AXES`); parts of revolution need no turn about X. The distance along X is that of the
    first camera, less the gap to be kept, and 0 while the tip is hidden.

    ``expected_error``, shape (6,), is subtracted: what the images should show at this point of a
    trajectory; 0 if it is not connected.

    ``valid``, size 1, is 1 if both cameras measured across and angle, else 0 and the error is 0;
    ``age``, size 1, s, is how old the last valid measurement is, and ``blind``, size 1, turns to 1
    and stays so once more than ``most_misses`` in a row were missing.

    Discrete state: the misses in a row, and ``blind``.
    """

    def __init__(self, params: CellErrorParams) -> None:
        super().__init__()
        self._params = params
        self._ports = [
            self.DeclareVectorInputPort(name, ERROR_SIZE) for name in ("xz_error", "xy_error")
        ]
        self._expected = self.DeclareVectorInputPort("expected_error", len(AXES))
        seen = {port.ticket() for port in (*self._ports, self._expected)}
        seen.add(self.time_ticket())
        self.DeclareVectorOutputPort("error", len(AXES), self._calc_error, seen)
        self.DeclareVectorOutputPort("valid", 1, self._calc_valid, seen)
        misses = self.DeclareDiscreteState(1)
        self._misses = misses
        self._blind = self.DeclareDiscreteState(1)

        def calc_age(context: Context, vector: BasicVector) -> None:
            vector[0] = params.period * context.get_discrete_state(misses)[0]

        self.DeclareVectorOutputPort("age", 1, calc_age, {self.discrete_state_ticket(misses)})
        self.DeclareStateOutputPort("blind", self._blind)
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._count)

    def _waits(self, context: Context) -> bool:
        return bool(context.get_time() < self._params.begin - 0.5 * self._params.period)

    def _measured(self, context: Context) -> Array | None:
        if self._waits(context):
            return None
        xz, xy = (port.Eval(context) for port in self._ports)
        if not all(map(math.isfinite, (*xz[1:], *xy[1:]))):
            return None
        along = xz[0] - self._params.gap if math.isfinite(xz[0]) else 0.0
        # Down in the images is -Z and -Y; from right to down is a turn about +Y and about -Z.
        error = np.array([along, -xy[1], -xz[1], 0.0, xz[2], -xy[2]])
        if self._expected.HasValue(context):
            error = error - self._expected.Eval(context)
        return error

    def _calc_error(self, context: Context, vector: BasicVector) -> None:
        measured = self._measured(context)
        vector.SetFromVector(np.zeros(len(AXES)) if measured is None else measured)

    def _calc_valid(self, context: Context, vector: BasicVector) -> None:
        vector[0] = float(self._measured(context) is not None)

    def _count(self, context: Context, state: DrakeState) -> None:
        if self._waits(context):
            return
        values = context.get_discrete_state()
        misses = 0.0 if self._measured(context) is not None else values.value(self._misses)[0] + 1
        blind = values.value(self._blind)[0] or float(misses > self._params.most_misses)
        changed = state.get_mutable_discrete_state()
        changed.set_value(self._misses, np.array([misses]))
        changed.set_value(self._blind, np.array([blind]))
