"""Encoders as a linear sampled system, without their counts."""

import math

import numpy as np

from chamfer.models.validation import known
from chamfer.systems.force.sampled_loop import Sampled
from chamfer.systems.sensing.encoders import EncoderParams


def linear_encoders(params: EncoderParams, n: int, *, period: float, beside: int) -> Sampled:
    """Return :class:`chamfer.systems.sensing.encoders.Encoders` as fine as can be.

    Input and output: n joint positions, then velocities, and what passes beside the encoders.
    States: position before and velocity, or position and velocity of the tracking filter, shape
    (n,) each.

    Args:
        params: The encoders.
        n: Joints.
        period: s.
        beside: Number of signals that pass unchanged.
    """
    pole = math.exp(-2 * math.pi * known("bandwidth", params.bandwidth) * period)
    if params.velocity == "exact":
        none = np.zeros((0, 2 * n + beside))
        return Sampled(np.zeros((0, 0)), none, none.T, np.eye(2 * n + beside))
    if params.velocity == "differenced":
        follow = 1 - pole if pole < 1 else 1.0
        keeps = np.array([[0.0, 0.0], [-follow / period, 1 - follow]])
        takes = np.array([1.0, follow / period])
    else:
        stiff, fast = 1 - pole**2, (1 - pole) ** 2 / period
        keeps = np.array([[1 - stiff, (1 - stiff) * period], [-fast, 1 - fast * period]])
        takes = np.array([stiff, fast])
    each = np.eye(n)
    A = np.kron(keeps, each)
    B = np.hstack([np.kron(takes[:, np.newaxis], each), np.zeros((2 * n, n + beside))])
    C, D = np.zeros((2 * n + beside, 2 * n)), np.eye(2 * n + beside)
    C[n : 2 * n], D[n : 2 * n] = A[n:], B[n:]
    return Sampled(A, B, C, D)
