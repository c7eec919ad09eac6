"""Cameras: their projection, and the two of the work cell.

Pixel coordinates (u, v) count from the centre of the first pixel, u to the right and v down, so
that the middle of an image is ((width - 1) / 2, (height - 1) / 2). Camera frame C: z along the
optical axis, x to the right and y down in the image. World frame: X from the peg's arm to the
hole's arm, Z up.
"""

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from chamfer.models.rotation import rotation_matrix
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_numbers,
    require_one_of,
    require_positive,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Coefficients = tuple[float, float, float, float, float]

UNDISTORTED: Final[Coefficients] = (0.0, 0.0, 0.0, 0.0, 0.0)

_LARGEST_COEFFICIENT: Final = 1e30  # of a coefficient: its products stay numbers
_DIRECTIONS: Final = 36  # over half a turn, in which the fold is looked for
_REAL: Final = 1e-6  # imaginary part of what counts as a real root, relative
_SHORT_OF_FOLD: Final = 0.999  # at the fold itself nothing can be turned back
_STEPS: Final = 80  # at most, of Newton's method with halved steps
_EXACT: Final = 1e-14  # at a focal length of 1, from where on no step is needed
_CONVERGED: Final = 1e-11  # likewise, what counts as found


@dataclass(frozen=True)
class LensDistortion:
    """k1, k2, p1, p2, k3 of OpenCV's model.

    Points are x and y at a focal length of 1, from the principal point, shape (..., 2). With
    r^2 = x^2 + y^2 and g = 1 + k1 r^2 + k2 r^4 + k3 r^6 a point is seen at
    x g + 2 p1 x y + p2 (r^2 + 2 x^2) and y g + p1 (r^2 + 2 y^2) + 2 p2 x y.

    Far from the middle the model folds back: two points would be seen at one place. It is the
    gradient of a potential, so that its Jacobian is symmetric, and on the largest disc on which
    that is positive definite no two points meet. What is outside is refused.
    """

    coefficients: Coefficients

    def __post_init__(self) -> None:
        if len(self.coefficients) != 5 or not all(map(math.isfinite, self.coefficients)):
            allowed = "five finite numbers: k1, k2, p1, p2, k3"
            raise ParameterError("distortion", self.coefficients, allowed)
        if max(map(abs, self.coefficients)) > _LARGEST_COEFFICIENT:
            allowed = f"five numbers from {-_LARGEST_COEFFICIENT:g} to {_LARGEST_COEFFICIENT:g}"
            raise ParameterError("distortion", self.coefficients, allowed)

    @cached_property
    def reach(self) -> float:
        """Radius up to which the model does not fold back, infinite if it never does."""
        k1, k2, p1, p2, k3 = self.coefficients
        # Negative radii are the other half turn.
        turns = np.linspace(0.0, math.pi, _DIRECTIONS if p1 or p2 else 1, endpoint=False)
        c, s = np.cos(turns)[:, np.newaxis], np.sin(turns)[:, np.newaxis]
        # Along a direction the Jacobian's elements are polynomials of the radius.
        g = np.array([1.0, 0.0, k1, 0.0, k2, 0.0, k3])
        slope = np.array([0.0, 0.0, 2 * k1, 0.0, 4 * k2, 0.0, 6 * k3])
        r = np.eye(len(g))[1]
        xx = g + c * c * slope + (2 * p1 * s + 6 * p2 * c) * r
        yy = g + s * s * slope + (6 * p1 * s + 2 * p2 * c) * r
        xy = c * s * slope + (2 * p1 * c + 2 * p2 * s) * r
        most = 0.0
        for one, other, both in zip(xx, yy, xy, strict=True):
            # The determinant begins with 1: turned around it has one over its roots.
            inverse = np.roots(np.convolve(one, other) - np.convolve(both, both))
            real = np.abs(inverse)[np.abs(inverse.imag) <= _REAL * np.abs(inverse)]
            most = max(most, float(real.max(initial=0.0)))
        return _SHORT_OF_FOLD / most if most > 0 else math.inf

    def distort(self, points: Vector) -> Vector:
        """Return where points are seen; NaN outside of the reach."""
        k1, k2, p1, p2, k3 = self.coefficients
        x, y = points[..., 0], points[..., 1]
        square = x * x + y * y
        g = 1.0 + square * (k1 + square * (k2 + square * k3))
        g = np.where(square <= self.reach**2, g, math.nan)
        both = 2.0 * x * y
        seen = np.empty(points.shape)
        seen[..., 0] = x * g + p1 * both + p2 * (square + 2.0 * x * x)
        seen[..., 1] = y * g + p1 * (square + 2.0 * y * y) + p2 * both
        return seen

    def jacobian(self, points: Vector) -> Matrix:
        """Return the derivative of the image with respect to the points, shape (..., 2, 2)."""
        k1, k2, p1, p2, k3 = self.coefficients
        x, y = points[..., 0], points[..., 1]
        square = x * x + y * y
        g = 1.0 + square * (k1 + square * (k2 + square * k3))
        slope = 2.0 * (k1 + square * (2.0 * k2 + square * 3.0 * k3))
        result = np.empty((*points.shape, 2))
        result[..., 0, 0] = g + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        result[..., 1, 1] = g + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        result[..., 0, 1] = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        result[..., 1, 0] = result[..., 0, 1]
        return result

    def undistort(self, seen: Vector) -> Vector:
        """Return the points that are seen at places; NaN where no point within reach is seen."""
        target = np.asarray(seen, dtype=float).reshape(-1, 2)
        far = np.linalg.norm(target, axis=1, keepdims=True)
        points = target * np.minimum(1.0, 0.9 * self.reach / np.maximum(far, 1e-300))
        left = target - self.distort(points)
        error = np.linalg.norm(left, axis=1)
        share = np.ones(len(target))
        for _ in range(_STEPS):
            active = np.flatnonzero((error > _EXACT) & (share > 1e-6))
            if not len(active):
                break
            way = np.linalg.solve(self.jacobian(points[active]), left[active, :, np.newaxis])
            tried = points[active] + share[active, np.newaxis] * way[..., 0]
            remains = target[active] - self.distort(tried)
            size = np.linalg.norm(remains, axis=1)
            better = size < error[active]  # not where it is NaN
            good = active[better]
            points[good], left[good], error[good] = tried[better], remains[better], size[better]
            share[good] = 1.0
            share[active[~better]] /= 2.0
        points[~(error <= _CONVERGED * (1.0 + far[:, 0]))] = math.nan
        return np.asarray(points.reshape(np.shape(seen)))


View = Literal["xz", "xy", "yz"]

# Columns: the axes of an unrolled camera in the world frame.
_AXES: dict[View, tuple[tuple[int, int, int], ...]] = {
    "xz": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),  # looks along Y; right is X, up is Z
    "xy": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),  # looks down; right is X, up is Y
    "yz": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),  # looks along X; right is -Y, up is Z
}


LARGEST_PIXEL: Final = 0.01  # m, that a pixel covers at the parts
_LARGEST: Final = 10_000  # pixels, width and height of an image
_OBLONG: Final = 4  # longer over shorter side of a pixel, at most


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A pinhole camera with a lens.

    What its distortion would fold back is not seen, see :class:`LensDistortion`.
    """

    width: int  # pixels
    height: int  # pixels
    focal: tuple[float, float]  # pixels, along u and v
    centre: tuple[float, float]  # pixels, where the optical axis meets the image
    R_WC: Matrix  # shape (3, 3)
    p_WC: Vector  # shape (3,), m
    distortion: Coefficients = UNDISTORTED  # k1, k2, p1, p2, k3 of OpenCV's model

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not getattr(self, name) >= 1:
                raise ParameterError(name, getattr(self, name), "a whole number >= 1")
        if not all(0 < f < math.inf for f in self.focal):
            raise ParameterError("focal", self.focal, "two finite numbers > 0")
        require_numbers(self, 2, "centre")
        R, p = np.asarray(self.R_WC), np.asarray(self.p_WC)
        if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-9):
            raise ParameterError("R_WC", R.tolist(), "a rotation matrix")
        if np.linalg.det(R) < 0:
            raise ParameterError("R_WC", R.tolist(), "a rotation, not a reflection")
        if p.shape != (3,) or not np.isfinite(p).all():
            raise ParameterError("p_WC", p.tolist(), "three finite numbers")
        LensDistortion(self.distortion)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        return (
            self._key == other._key
            and np.array_equal(self.R_WC, other.R_WC)
            and np.array_equal(self.p_WC, other.p_WC)
        )

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[object, ...]:
        return self.width, self.height, self.focal, self.centre, self.distortion

    @cached_property
    def lens(self) -> LensDistortion | None:
        """Its distortion; None where it has none."""
        return LensDistortion(self.distortion) if any(self.distortion) else None

    @property
    def matrix(self) -> Matrix:
        """Intrinsic matrix K, shape (3, 3), as OpenCV writes it."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def project(self, p_W: Vector) -> Vector:
        """Return the pixels u and v, shape (..., 2), of points, m, world frame, shape (..., 3).

        NaN for points that are not in front of the camera, or that the distortion folds back.
        """
        p_C = (p_W - self.p_WC) @ self.R_WC
        depth = p_C[..., 2:]
        if not (depth > 0).all():
            depth = np.where(depth > 0, depth, math.nan)
        return self._pixels(p_C[..., :2] / depth)

    def _pixels(self, seen: Vector) -> Vector:
        """Return where points at a focal length of 1 are shown."""
        if self.lens is not None:
            seen = self.lens.distort(seen)
        return np.asarray(seen * self.focal + self.centre)

    def shown_by(self, other: "Camera", pixel: Vector) -> Vector:
        """Return this camera's pixels in the image of another camera at the same place.

        Both of shape (..., 2); NaN where this one or the other one shows nothing.
        """
        if other is self:
            return np.asarray(pixel, dtype=float)
        return other._pixels(self.at_unit_focal(pixel))

    def without_distortion(self) -> "Camera":
        """Return this camera with another lens, which shows straight lines straight."""
        return self if self.lens is None else replace(self, distortion=UNDISTORTED)

    def straight(self) -> "Camera":
        """Return this camera with a lens that shows straight lines straight, in square pixels.

        They are as small as the shorter sides of this one's, and as many more as are needed.

        Raises:
            ParameterError: If the sides are too different.
        """
        f = max(self.focal)
        if f == min(self.focal):
            return self.without_distortion()
        if f > _OBLONG * min(self.focal):
            allowed = f"two of which none is more than {_OBLONG} times the other"
            raise ParameterError("focal_length", self.focal, allowed)
        more_u, more_v = (f / one for one in self.focal)
        cx, cy = self.centre
        return replace(
            self,
            width=round(more_u * self.width),
            height=round(more_v * self.height),
            focal=(f, f),
            centre=(more_u * (cx + 0.5) - 0.5, more_v * (cy + 0.5) - 0.5),
            distortion=UNDISTORTED,
        )

    def at_unit_focal(self, pixel: Vector) -> Vector:
        """Return pixels as points at a focal length of 1, shape (..., 2)."""
        seen: Vector = (pixel - np.array(self.centre)) / self.focal
        return seen if self.lens is None else self.lens.undistort(seen)

    def ray(self, pixel: Vector) -> Vector:
        """Return the unit vectors, shape (..., 3), world frame, of the rays through pixels.

        NaN where nothing can be seen.
        """
        direction = np.ones((*np.shape(pixel)[:-1], 3))
        direction[..., :2] = self.at_unit_focal(pixel)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        return np.asarray(direction @ self.R_WC.T)

    def point(self, pixel: Vector, depth: float) -> Vector:
        """Return the point, m, world frame, shape (3,), that is seen at a pixel, shape (2,).

        The depth, m, is along the optical axis.
        """
        p_C = depth * np.append(self.at_unit_focal(pixel), 1.0)
        return np.asarray(self.p_WC + self.R_WC @ p_C)

    def point_jacobian(self, pixel: Vector, depth: float) -> Matrix:
        """Return how fast the image of a point moves with the point, pixels / m, shape (2, 3).

        The point is seen at a pixel, shape (2,), at a depth along the optical axis, m.
        """
        point = self.at_unit_focal(pixel)
        x, y = point
        rows = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y]]) / depth
        if self.lens is not None:
            rows = self.lens.jacobian(point) @ rows
        return np.asarray((np.array(self.focal)[:, np.newaxis] * rows) @ self.R_WC.T)

    def placed(self, R_WC: Matrix, p_WC: Vector) -> "Camera":
        """Return this camera at another place: orientation, shape (3, 3), and position, m."""
        return replace(self, R_WC=R_WC, p_WC=p_WC)

    def miscalibrated(
        self, *, focal_factor: float = 1.0, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> "Camera":
        """Return this camera as it is believed to be where its calibration is wrong.

        The focal factor is of the believed to the true focal length; the turn from the true to the
        believed orientation is a rotation vector in the camera's frame, rad; the place stays.
        """
        return replace(
            self,
            focal=(focal_factor * self.focal[0], focal_factor * self.focal[1]),
            R_WC=self.R_WC @ rotation_matrix(turn),
        )


@dataclass(frozen=True, kw_only=True)
class CameraStand:
    """The poses of the work cell's cameras; all except the size is assumed.

    They are rolled about their optical axes: where the parts are nearly aligned their edges would
    be parallel to the rows of pixels, and what a row gains or loses would change for all columns
    at once.
    """

    distance: float = 0.5  # m, from what is in the image's middle
    pixel_size: float = 0.0005  # m, that one pixel covers there
    roll: float = 0.1  # rad, about the optical axis
    width: int = 320  # pixels, section 4
    height: int = 240  # pixels, section 4

    def __post_init__(self) -> None:
        require_positive(self, "distance")
        require_positive(self, "pixel_size", most=LARGEST_PIXEL, unit="m")
        require_finite(self, "roll")
        for name in ("width", "height"):
            value = getattr(self, name)
            if not (isinstance(value, int) and 1 <= value <= _LARGEST):
                raise ParameterError(name, value, f"a whole number from 1 to {_LARGEST}")

    def placement(self, view: View, target: tuple[float, float, float]) -> "CameraPlacement":
        """Return the pose of a camera that looks at a target, m, in the world."""
        stand = {one.name: getattr(self, one.name) for one in fields(CameraStand)}
        return CameraPlacement(view=view, target=target, **stand)


@dataclass(frozen=True, kw_only=True)
class CameraPlacement(CameraStand):
    """Where one of the work cell's cameras stands and how much it sees.

    The camera looks at ``target`` at right angles to a plane. The paper gives the planes.
    """

    view: View = "xz"  # plane that the camera looks at (section 4)
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, world, in the image's middle

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "view", _AXES)
        require_numbers(self, 3, "target")

    @property
    def camera(self) -> Camera:
        """The camera at this place."""
        cos, sin = math.cos(self.roll), math.sin(self.roll)
        axes = np.array(_AXES[self.view], dtype=float)
        R_WC = axes @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        focal = self.distance / self.pixel_size
        return Camera(
            width=self.width,
            height=self.height,
            focal=(focal, focal),
            centre=((self.width - 1) / 2, (self.height - 1) / 2),
            R_WC=R_WC,
            p_WC=np.array(self.target) - self.distance * R_WC[:, 2],
        )
