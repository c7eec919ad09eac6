"""Finite machines and the three stability properties of Tarraf, Dahleh and Megretski.

Source: D. C. Tarraf, M. A. Dahleh, A. Megretski, "Stability of Deterministic Finite State
Machines", American Control Conference 2005, cited by Ruybal, Lumia and Wood, section 3. Its
definitions are restated here in the form in which they are checked.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

State = TypeVar("State", bound=Hashable)
_MOST_STATES = 2000


@dataclass(frozen=True)
class FiniteMachine:
    """A deterministic machine ``q+ = next[q, u]``, ``y = output[q, u]``."""

    next_state: NDArray[np.intp]  # shape (states, inputs)
    output: NDArray[np.float64]  # shape (states, inputs)
    input_size: NDArray[np.float64]  # rho(u) >= 0, shape (inputs,)


def explore(
    initial: State,
    inputs: Sequence[float],
    step: Callable[[State, float], tuple[State, float]],
    *,
    input_size: Sequence[float],
) -> FiniteMachine:
    """Return the machine that ``step``, to next state and output, reaches from ``initial``.

    The inputs are one representative of each that the machine distinguishes; their size is rho.

    Raises:
        ValueError: If more than 2000 states are reached.
    """
    index: dict[State, int] = {initial: 0}
    states = [initial]
    next_state: list[list[int]] = []
    output: list[list[float]] = []
    while len(next_state) < len(states):
        state = states[len(next_state)]
        row, values = [], []
        for value in inputs:
            following, out = step(state, value)
            if following not in index:
                if len(states) == _MOST_STATES:
                    raise ValueError(f"machine has more than {_MOST_STATES} states")
                index[following] = len(states)
                states.append(following)
            row.append(index[following])
            values.append(out)
        next_state.append(row)
        output.append(values)
    return FiniteMachine(
        np.array(next_state, dtype=np.intp),
        np.array(output, dtype=np.float64),
        np.asarray(input_size, dtype=np.float64),
    )


@dataclass(frozen=True)
class TarrafProperties:
    """The three properties that hold."""

    gain: float  # the least finite gain, infinity if there is none
    merges: bool  # external and incremental stability

    @property
    def count(self) -> int:
        """Number of the three that hold."""
        return int(np.isfinite(self.gain)) + 2 * int(self.merges)


def tarraf_properties(machine: FiniteMachine) -> TarrafProperties:
    """Check finite gain, external and incremental stability.

    *Finite gain*: some gamma bounds sum(|y|) by gamma sum(rho(u)) plus a constant; that is, no
    cycle of the machine has a negative sum of gamma rho(u) - |y|. *External stability*: two
    trajectories under a common input have outputs that differ only finitely often; that is, no
    cycle of pairs of states under common inputs contains a pair of different outputs.
    *Incremental stability*: the outputs' differences are bounded by the inputs' differences; for
    a deterministic machine, where equal inputs are the case to be excluded, this is the same
    condition on the pairs.
    """
    return TarrafProperties(gain=_least_gain(machine), merges=_pairs_agree(machine))


def storage(machine: FiniteMachine, gain: float) -> NDArray[np.float64] | None:
    """Return a storage function for that gain, one value >= 0 per state, or None.

    It is the shortest-path potential of Bellman and Ford: V(q+) <= V(q) + gamma rho(u) - |y|.
    """
    count, inputs = machine.next_state.shape
    source = np.repeat(np.arange(count), inputs)
    target = machine.next_state.ravel()
    cost = gain * np.tile(machine.input_size, count) - np.abs(machine.output).ravel()
    potential = np.zeros(count)
    for _ in range(count + 1):
        relaxed = potential.copy()
        np.minimum.at(relaxed, target, potential[source] + cost)
        if np.all(potential - relaxed <= 1e-12 * (1 + np.abs(potential))):
            stored: NDArray[np.float64] = potential - potential.min()
            return stored
        potential = relaxed
    return None


def _least_gain(machine: FiniteMachine) -> float:
    used = machine.input_size[machine.input_size > 0]
    if len(used) == 0:
        return 0.0 if storage(machine, 0.0) is not None else np.inf
    # No cycle can need more than the largest output per least input at every edge of it.
    high = float(np.abs(machine.output).max() * len(machine.output) / used.min())
    if storage(machine, high) is None:
        return float(np.inf)
    low = 0.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if storage(machine, middle) is not None else (middle, high)
    return high


def _pairs_agree(machine: FiniteMachine) -> bool:
    count, inputs = machine.next_state.shape
    first, second = (grid.ravel() for grid in np.indices((count, count)))
    source = np.repeat(first * count + second, inputs)
    target = (machine.next_state[first] * count + machine.next_state[second]).ravel()
    differs = (machine.output[first] != machine.output[second]).ravel()
    graph = coo_array((np.ones(len(source)), (source, target)), shape=(count**2, count**2))
    _, component = connected_components(graph, connection="strong")
    return not bool(np.any(differs & (component[source] == component[target])))
