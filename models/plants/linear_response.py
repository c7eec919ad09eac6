"""The response of a linear system without input."""

import numpy as np
from numpy.typing import NDArray

_SEEN = 0.01  # of the largest mode, from which on a mode shows in a response


def free_response(
    transition: NDArray[np.float64], initial: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Return ``x_k = transition^k initial`` for k = 0 ... count - 1, shape (n, count).

    The block of known states is doubled with ever higher powers, so that the work grows with the
    logarithm of the count, which is at least one.
    """
    states = np.empty((len(initial), count))
    states[:, 0] = initial
    known, power = 1, transition
    while known < count:
        more = min(known, count - known)
        states[:, known : known + more] = power @ states[:, :more]
        known += more
        if known < count:
            power = power @ power
    return states


def fastest_mode(
    dynamics: NDArray[np.float64], output: NDArray[np.float64], initial: NDArray[np.float64]
) -> float:
    """Return how fast, 1/s, the fastest mode is that shows in ``y = C e^(A t) x_0``.

    That is its pole's magnitude, 0 if there is none. Modes of less than a hundredth of the largest
    one don't show; what is constant or grows with a power of the time only is no mode here.
    """
    poles, right = np.linalg.eig(dynamics)
    # Each pole's left vector is what the dynamics without it take to nothing. SciPy has them too,
    # and takes a quarter of a second to import.
    each = [np.linalg.svd(dynamics - pole * np.eye(len(poles)))[0][:, -1] for pole in poles]
    left = np.array(each).T
    speeds = np.abs(poles)
    moving = speeds > 1e-9 * speeds.max()
    scale = np.sum(left.conj() * right, axis=0)[moving]
    sizes = np.abs((output @ right) * (left.conj().T @ initial))[moving]
    # Of two poles that coincide the scale is zero: each mode is infinite, their sum is not.
    shares = sizes / np.maximum(np.abs(scale), 1e-12)
    if not np.any(shares > 0):
        return 0.0
    return float(speeds[moving][shares >= _SEEN * shares.max()].max())
