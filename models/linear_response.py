"""The response of a sampled linear system without input."""

import numpy as np
from numpy.typing import NDArray


def free_response(
    transition: NDArray[np.float64], initial: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Return the states ``x_k = transition^k initial`` for k = 0 ... count - 1.

    The block of known states is doubled with ever higher powers, so that the work grows with the
    logarithm of the count.

    Args:
        transition: Shape (n, n).
        initial: Shape (n,).
        count: How many states, at least one.

    Returns:
        Shape (n, count).
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
