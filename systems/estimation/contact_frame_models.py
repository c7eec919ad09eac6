"""Several contact frames side by side: a multiple-model extended Kalman filter.

Each model assumes another bound on the surface's curvature and has its own frame
(:mod:`chamfer.systems.estimation.contact_frame`). Their probabilities follow from their
innovations (Magill, "Optimal adaptive estimation of sampled stochastic processes", 1965), with a
chance that another model holds from a sample to the next. That chain of models is that of the
interacting multiple model filter (Blom and Bar-Shalom, "The interacting multiple model algorithm
for systems with Markovian switching coefficients", 1988), but the estimates themselves are not
mixed before a sample, only for the output.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled
from chamfer.systems.estimation.contact_frame import Model, Reading, as_frame, follow, head, travel

Array = NDArray[np.float64]

_LEAST_WEIGHT: Final = 1e-9  # of a model


@compiled
def follow_all(
    numbers: Array,
    weights: Array,
    model: Model,
    reading: Reading,
    step: Array,
    deviation: float,
) -> None:
    """Take a sample in with every model, and weigh the models by how well they foresaw it.

    Args:
        numbers: Shape (models, 156), each model's frame; changed.
        weights: Shape (models,), their probabilities; changed.
        model: What they assume.
        reading: The sample.
        step: How the contact point moves on, shape (3,), m.
        deviation: Standard deviation of its angle, rad.
    """
    likelihood = np.empty(len(weights))
    for i in range(len(weights)):
        frame = as_frame(numbers[i])
        head(frame, model, model.turn[i], step, deviation)
        likelihood[i] = follow(frame, model, model.turn[i], reading)
    weights[:] = model.switch.T @ weights * np.exp(likelihood - likelihood.max())
    weights[:] = np.maximum(weights / weights.sum(), _LEAST_WEIGHT)
    weights /= weights.sum()


@compiled
def turn_all(numbers: Array, turn: Array) -> None:
    """Turn the frames of all models, numbers of shape (models, 156), in the world frame."""
    for i in range(len(numbers)):
        R = as_frame(numbers[i]).R
        R[:] = turn @ R


@compiled
def mixture(numbers: Array, weights: Array, considered: Array) -> tuple[Array, Array]:
    """Return the normal, shape (3,), and its covariance, shape (3, 3), over all models.

    Args:
        numbers: Shape (models, 156), each model's frame.
        weights: Shape (models,).
        considered: Covariance of what is considered, shape (4, 4), or (0, 0) if nothing is.
    """
    normal = np.zeros(3)
    for i in range(len(weights)):
        normal += weights[i] * as_frame(numbers[i]).R[:, 2]
    normal /= math.sqrt(normal @ normal)
    covariance = np.zeros((3, 3))
    for i in range(len(weights)):
        frame = as_frame(numbers[i])
        R, P = frame.R, frame.P
        if len(considered):
            P = P + frame.S @ considered @ frame.S.T
        for j in range(3):
            for k in range(3):  # a rotation r takes n to n + r_b t - r_t b
                covariance[j, k] += weights[i] * (
                    R[j, 0] * P[4, 4] * R[k, 0]
                    + R[j, 1] * P[3, 3] * R[k, 1]
                    - P[3, 4] * (R[j, 0] * R[k, 1] + R[j, 1] * R[k, 0])
                    + (R[j, 2] - normal[j]) * (R[k, 2] - normal[k])
                )
    return normal, covariance


@compiled
def ahead(numbers: Array, model: Model, speed: float, delay: float, deviation: float) -> Array:
    """Return the frames as they are foreseen further on along their paths.

    Args:
        numbers: Shape (models, 156), each model's frame.
        model: What they assume.
        speed: m/s, of the contact point.
        delay: s, how long ago the frames were where they are.
        deviation: s, standard deviation of the delay.
    """
    numbers = numbers.copy()
    for i in range(len(numbers)):
        frame = as_frame(numbers[i])
        travel(frame, model, model.turn[i], speed * delay)
        for j in range(3):
            for k in range(3):
                turned = frame.w[j] * frame.w[k] + frame.P[6 + j, 6 + k]
                frame.P[3 + j, 3 + k] += (speed * deviation) ** 2 * turned
    return numbers
