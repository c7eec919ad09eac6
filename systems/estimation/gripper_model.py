"""What an observer of the normal takes of the gripper and its force sensor, in space."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.estimation.normal_filter import Sensing

Array = NDArray[np.float64]

_LEAST_NOISE: Final = 1e-3  # N and N/s, taken for a sensor said to have none


class GripperModel(NamedTuple):
    """Stiffness and noise, in three dimensions but for ``sensing``."""

    sensing: Sensing
    stiffness: Array  # (3, 3), N/m
    compliance: Array  # (3, 3), m/N
    force_deviation: float  # N, a component's
    point_covariance: Array  # (3, 3), m^2
    point_root: Array  # (3, 3), 1/m, inverse Cholesky factor of it
    point_deviation: float  # m, the largest of any direction
    velocity_covariance: Array  # (3, 3), m^2/s^2
    velocity_deviation: float  # m/s, the largest of any direction

    def scaled(self, factor: float) -> "GripperModel":
        """Return the gripper with a stiffness that is larger by a factor."""
        return self._replace(
            sensing=self.sensing._replace(
                compliance=self.sensing.compliance / factor,
                velocity_noise=self.sensing.velocity_noise / factor,
            ),
            stiffness=factor * self.stiffness,
            compliance=self.compliance / factor,
            point_covariance=self.point_covariance / factor**2,
            point_root=factor * self.point_root,
            point_deviation=self.point_deviation / factor,
            velocity_covariance=self.velocity_covariance / factor**2,
            velocity_deviation=self.velocity_deviation / factor,
        )


def gripper_model(sensing: Sensing) -> GripperModel:
    """Return what is taken for a gripper that an observer is told of, in d dimensions."""
    # A force's component has u / sqrt(3) (4-9).
    force = max(sensing.force_noise, _LEAST_NOISE) / math.sqrt(3)
    rate = max(sensing.force_rate_noise, _LEAST_NOISE) / math.sqrt(3)
    stiffness = _in_space(sensing.stiffness)
    compliance: Array = np.asarray(np.linalg.inv(stiffness), dtype=np.float64)
    spread = compliance @ compliance.T
    point_covariance = force**2 * spread
    return GripperModel(
        sensing=sensing,
        stiffness=stiffness,
        compliance=compliance,
        force_deviation=force,
        point_covariance=point_covariance,
        point_root=np.linalg.inv(np.linalg.cholesky(point_covariance)),
        point_deviation=force * float(np.linalg.norm(compliance, 2)),
        velocity_covariance=rate**2 * spread,
        velocity_deviation=rate * float(np.linalg.norm(compliance, 2)),
    )


def _in_space(stiffness: Array) -> Array:
    if len(stiffness) == 3:
        return stiffness
    padded = np.zeros((3, 3))
    padded[:2, :2] = stiffness
    padded[2, 2] = stiffness[0, 0]  # anything but zero would do
    return padded
