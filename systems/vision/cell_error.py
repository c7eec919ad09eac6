"""Computes the compensator's input from the cameras: an error, and whether it is valid."""

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RotationMatrix
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.cameras.software_camera import PosePorts
from chamfer.systems.ports import fixed_output
from chamfer.systems.vision.part_detection import ContinuityParams
from chamfer.systems.vision.part_detector import ERROR_SIZE

Array = NDArray[np.float64]

AXES: Final = ("x", "y", "z", "roll", "pitch", "yaw")  # world axes, turns about X, Y and Z


def image_plane_error(xz: Array, xy: Array) -> Array:
    """Return the error of all six axes from those that two cameras see, shape (6,).

    One looks along Y, the other one down: along, across and the angle, shape (3,).
    """
    along, down, pitch = xz.tolist()
    _, aside, yaw = xy.tolist()
    roll = 0.0 if math.isfinite(pitch) else math.nan
    # Down in the images is -Z and -Y; from right to down is a turn about +Y and about -Z.
    return np.array([along, -aside, -down, roll, pitch, -yaw])


class ImagePlaneError(LeafSystem):
    """Measures the peg's error in pixels and image-plane angles, with one camera for each plane.

    .. pydrake_system::

        name: ImagePlaneError
        input_ports:
        - xz_error
        - xy_error
        output_ports:
        - alignment_error

    The inputs are :func:`chamfer.systems.vision.part_detector.alignment_error` of the camera that
    looks along Y and of the one that looks down, shape (3,), with X to the right in both images.
    It needs no calibration. ``alignment_error``, shape (6,), desired minus actual, has pixels
    along X, Y and Z and rad about them (:data:`AXES`). Parts of revolution need no turn about X.
    The first camera measures the distance along X. Elements that were not measured are NaN.
    """

    def __init__(self) -> None:
        super().__init__()
        xz, xy = (
            self.DeclareVectorInputPort(name, ERROR_SIZE) for name in ("xz_error", "xy_error")
        )

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(image_plane_error(xz.Eval(context), xy.Eval(context)))

        self.DeclareVectorOutputPort(
            "alignment_error", len(AXES), calc, {xz.ticket(), xy.ticket()}
        )


_ROLL = AXES.index("roll")
_NEEDED = [AXES.index(axis) for axis in ("y", "z", "pitch", "yaw")]


class ImageClock(NamedTuple):
    """Exposure times of a camera's frames, and the delay of their arrival."""

    period: float  # s
    offset: float  # s, of the first exposure
    latency: float  # s, from the middle of the exposure

    def age(self, time: float) -> float:
        """Return the age of the image used at a time, s, since its exposure."""
        since = time - self.offset
        # What arrives at this very instant is acted on at the next one.
        since -= (math.ceil(since / self.period - _INSTANT) - 1) * self.period
        return since + self.latency


_INSTANT: Final = 1e-6  # periods
_NEVER_AGAIN: Final = 1e9  # s, the period of what happens once


@dataclass(frozen=True, kw_only=True)
class CellErrorParams:
    """Parameters of :class:`CellError`."""

    gap: float = 60.0  # pixels, to be kept between tip and mouth: 3 cm at 0.5 mm a pixel
    most_misses: int = 4
    # missing measurements in a row after which the parts count as lost; assumed
    begin: float = 0.0
    # s, start of the compensation; before it no measurement is valid, and none is a miss
    period: float = 1 / 80  # s, section 4
    latency: float = 2 / 80  # s, age of a new image when the controller acts on it
    images: tuple[ImageClock, ...] = ()  # clocks of the cameras, if they differ from the period
    continuity: ContinuityParams = field(default_factory=ContinuityParams)

    def __post_init__(self) -> None:
        require_finite(self, "begin")
        require_not_negative(self, "gap")
        require_positive(self, "period", "latency")
        if not self.most_misses >= 0:
            raise ParameterError("most_misses", self.most_misses, "a whole number >= 0")

    @property
    def longest(self) -> float:
        """The longest time that a measurement may stay unchanged, s."""
        return max([self.period, *(image.period for image in self.images)])


class NoSight(LeafSystem):
    """Replaces the cameras, and reports that the peg is at its commanded pose.

    .. pydrake_system::

        name: NoSight
        input_ports: []
        output_ports:
        - error
        - valid
        - age
        - blind
        - diverged
        - stop
        - compensation

    ``error``, shape (6,), ``valid`` (1), ``age`` and ``blind`` (0) are those of
    :class:`CellError`, ``diverged`` and ``stop`` (0) those of the divergence watch,
    ``compensation``, shape (6,), 0, that of the compensator.
    """

    def __init__(self) -> None:
        super().__init__()
        sizes = {"error": len(AXES), "compensation": len(AXES)}
        for name in ("error", "valid", "age", "blind", "diverged", "stop", "compensation"):
            fixed_output(self, name, np.full(sizes.get(name, 1), float(name == "valid")))


class CellError(LeafSystem):
    """Computes the peg's alignment error, desired minus actual, with its validity and age.

    .. pydrake_system::

        name: CellError
        input_ports:
        - alignment_error
        - expected_error (optional)
        - hidden (optional)
        output_ports:
        - error
        - valid
        - age
        - blind

    Inputs:

    - ``alignment_error``, shape (6,): the displacement from the tip to the mouth along X, Y and Z
      in pixels, and about them in rad (:data:`AXES`). It is NaN where it was not measured.
    - ``expected_error``, shape (6,): the error at this point of a trajectory; 0 if it is not
      connected.
    - ``hidden``, size 1: while it is 1 a missing measurement is no miss.

    Outputs:

    - ``error``, shape (6,): the alignment error less the commanded gap along X, and less
      ``expected_error``. Along X it is 0 while the tip is hidden, and about X always: the parts
      are round.
    - ``valid``, size 1: 1 if Y, Z and the angles were measured; else 0, and the error is 0.
    - ``age``, size 1, s: the age of the last valid measurement, of the older of its images,
      beyond ``latency``.
    - ``blind``, size 1: turns to 1 and stays so after more than ``most_misses`` in a row.

    A jump is a measurement that differs from the last valid one by more than the parts can have
    moved since. The block refuses it, except after ``continuity.most_jumps`` in a row.

    Discrete state: whether it has begun, the misses in a row and ``blind``. Also the last valid
    measurement (NaN before the first), its age when it was new, s, and the jumps refused since.
    """

    def __init__(self, params: CellErrorParams) -> None:
        super().__init__()
        self._params = params
        self._measured_error = self.DeclareVectorInputPort("alignment_error", len(AXES))
        self._expected = self.DeclareVectorInputPort("expected_error", len(AXES))
        self._hidden = self.DeclareVectorInputPort("hidden", 1)
        begin = params.begin - 0.5 * params.period
        self.DeclareDiscreteState([float(begin <= 0), *[0.0] * 4, *[math.nan] * len(AXES)])

        def calc_error(context: Context, vector: BasicVector) -> None:
            measured = self._measured(context)
            vector.SetFromVector(np.zeros(len(AXES)) if measured is None else measured)

        def calc_valid(context: Context, vector: BasicVector) -> None:
            vector[0] = float(self._measured(context) is not None)

        def calc_age(context: Context, vector: BasicVector) -> None:
            _, misses, old, *_ = _state(context)
            vector[0] = old + params.period * misses

        def calc_blind(context: Context, vector: BasicVector) -> None:
            vector[0] = _state(context)[3]

        # Not of time: what follows would be evaluated anew whenever it goes on.
        seen = {self.all_input_ports_ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort("error", len(AXES), calc_error, seen)
        self.DeclareVectorOutputPort("valid", 1, calc_valid, seen)
        self.DeclareVectorOutputPort("age", 1, calc_age, {self.xd_ticket()})
        self.DeclareVectorOutputPort("blind", 1, calc_blind, {self.xd_ticket()})
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._count)
        if begin > 0:
            self.DeclarePeriodicDiscreteUpdateEvent(_NEVER_AGAIN, begin, self._begin)

    def _begin(self, context: Context, changed: DiscreteValues) -> None:
        changed.set_value([1.0, *_state(context)[1:]])

    def _measured(self, context: Context) -> Array | None:
        """Return the error that is measured and believed; None if there is none."""
        error = self._seen(context)
        return None if error is None or self._jumped(context, error) else error

    def _jumped(self, context: Context, error: Array) -> bool:
        params = self._params
        _, misses, _, _, jumps, *last = _state(context)
        # A release has to come before the parts count as lost.
        most = min(params.continuity.most_jumps, params.most_misses)
        if not math.isfinite(last[0]) or jumps >= most:
            return False
        seconds = params.period * misses + params.longest
        moved, turned = np.abs(error - last)[_NEEDED].reshape(2, 2).max(axis=1).tolist()
        return params.continuity.jumps(moved, turned, seconds)

    def _seen(self, context: Context) -> Array | None:
        if not _state(context)[0]:
            return None
        error: Array = np.array(self._measured_error.Eval(context))
        if not np.isfinite(error[_NEEDED]).all():
            return None
        error[0] -= self._params.gap
        if self._expected.HasValue(context):
            error -= self._expected.Eval(context)
        error[_ROLL] = 0.0
        if not math.isfinite(error[0]):
            error[0] = 0.0
        return error

    def _count(self, context: Context, state: DrakeState) -> None:
        begun, misses, old, blind, jumps, *last = _state(context)
        if not begun:
            return
        misses += 1
        seen = self._seen(context)
        if (
            seen is None
            and self._hidden.HasValue(context)
            and self._hidden.Eval(context)[0] >= 0.5
        ):
            return
        if seen is not None and self._jumped(context, seen):
            jumps += 1
        elif seen is not None:
            ages = [image.age(context.get_time()) for image in self._params.images]
            old = max(ages, default=0.0) - self._params.latency
            if old < _INSTANT * self._params.period:
                old = 0.0
            misses, jumps, last = 0.0, 0.0, seen.tolist()
        blind = blind or float(misses > self._params.most_misses)
        changed = np.array([begun, misses, old, blind, jumps, *last])
        state.get_mutable_discrete_state().set_value(changed)


def _state(context: Context) -> list[float]:
    values: list[float] = context.get_discrete_state_vector().value().tolist()
    return values


_WORLD: Final = RotationMatrix()


class ExpectedError(LeafSystem):
    """Computes the alignment error that a trajectory intends at its present point.

    .. pydrake_system::

        name: ExpectedError
        input_ports:
        - peg_pose
        - hole_pose
        output_ports:
        - expected_error

    The input poses, shape (7,), are the commanded ones, before any compensation. The output
    ``expected_error``, shape (6,), is subtracted by :class:`CellError`. It leads from peg to hole,
    in pixels along and rad about axes H, x into the hole. It needs only the size of the cameras'
    pixels, m. The gap, pixels, is no error along X.
    """

    def __init__(self, *, pixel_size: float, gap: float, R_WH: RotationMatrix = _WORLD) -> None:
        super().__init__()
        if not 0 < pixel_size < np.inf:
            raise ParameterError("pixel_size", pixel_size, "a finite number > 0")
        poses = PosePorts(self)
        R_HW = R_WH.matrix().T

        def calc(context: Context, vector: BasicVector) -> None:
            X_WT, X_WM = poses.read(context)
            if X_WT is None or X_WM is None:
                raise ParameterError("peg_pose and hole_pose", None, "both connected")
            moved = R_HW @ (X_WM.translation() - X_WT.translation()) / pixel_size
            moved[0] -= gap
            turn = RotationMatrix(X_WM.rotation() @ X_WT.rotation().inverse()).ToAngleAxis()
            error = np.concatenate([moved, turn.angle() * (R_HW @ turn.axis())])
            error[AXES.index("roll")] = 0.0
            vector.SetFromVector(error)

        self.DeclareVectorOutputPort("expected_error", len(AXES), calc, poses.tickets())
