"""The combinatorial half of a layered layout (Sugiyama, Tagawa and Toda, 1981).

Feedback, layers, the order within a layer, heights under constraints, and the order of vertical
lines between two layers. Keys are hashable, wires pairs of them; nothing here is drawn.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping, Sequence
from graphlib import TopologicalSorter
from itertools import pairwise
from typing import Any, Final, TypeVar

import numpy as np
from pydrake.solvers import ClpSolver, MathematicalProgram

Key = TypeVar("Key", bound=Hashable)
Pair = tuple[Key, Key]
# Source, how far down it (0 to 1), target, how far down it; 0 for ends in any order.
Link = tuple[Key, float, Key, float]
# ``height[after] - height[before]`` is at least (as a tie: equal to) the last.
Gap = tuple[Key, Key, float]
Sides = tuple[Sequence[float], Sequence[float]]  # heights at the left and at the right
_Ends = dict[Key, list[tuple[float, Key, float]]]

CLEARANCE: Final = 7.0  # px, the least distance of parallel lines of different signals
_SWEEPS: Final = 12
_OVERLAP: Final = 1000  # crossings that two lines on top of each other are worth
_UPWARDS: Final = 1e-4  # how much a height is worth beside a tie


def feedback(
    keys: Sequence[Key], pairs: Sequence[Pair[Key]], returns_to: Callable[[Key], bool]
) -> set[int]:
    """Return the indices of the pairs without which there is no cycle; a key's own don't count.

    Where a loop is cut open depends on the source from which the search starts. All are tried; the
    fewest feedback pairs win, then the most of them that end where ``returns_to`` holds (a summing
    node), then the shortest wires.
    """
    targets = {target for source, target in pairs if source != target}
    sources = [key for key in keys if key not in targets]
    candidates: list[set[int]] = []
    for first in sources or keys[:1]:
        starts = [first, *(key for key in sources if key != first), *keys]
        candidates.append(_depth_first(starts, pairs))

    def score(found: set[int]) -> tuple[int, int, int]:
        forward = [pair for i, pair in enumerate(pairs) if i not in found and pair[0] != pair[1]]
        layer, _ = longest_paths(keys, forward)
        returning = sum(returns_to(pairs[i][1]) for i in found)
        length = sum(abs(layer[target] - layer[source]) for source, target in pairs)
        return len(found), -returning, length

    return min(candidates, key=score, default=set())


def _depth_first(starts: Sequence[Key], pairs: Sequence[Pair[Key]]) -> set[int]:
    leaving: defaultdict[Key, list[int]] = defaultdict(list)
    for i, (source, target) in enumerate(pairs):
        if source != target:
            leaving[source].append(i)
    found: set[int] = set()
    trail: set[Key] = set()
    seen: set[Key] = set()

    def visit(key: Key) -> None:
        seen.add(key)
        trail.add(key)
        for i in leaving[key]:
            target = pairs[i][1]
            if target in trail:
                found.add(i)
            elif target not in seen:
                visit(target)
        trail.discard(key)

    for start in starts:
        if start not in seen:
            visit(start)
    return found


def longest_paths(
    keys: Sequence[Key], pairs: Sequence[Pair[Key]]
) -> tuple[dict[Key, int], dict[Key, int]]:
    """Return the number of wires on the longest path to and from every key of an acyclic graph."""
    following, preceding = _neighbours(pairs)
    order = [*TopologicalSorter({key: preceding[key] for key in keys}).static_order()]
    before, after = dict.fromkeys(keys, 0), dict.fromkeys(keys, 0)
    for key in order:
        before[key] = max((before[source] + 1 for source in preceding[key]), default=0)
    for key in reversed(order):
        after[key] = max((after[target] + 1 for target in following[key]), default=0)
    return before, after


def _neighbours(
    pairs: Sequence[Pair[Key]],
) -> tuple[defaultdict[Key, list[Key]], defaultdict[Key, list[Key]]]:
    following: defaultdict[Key, list[Key]] = defaultdict(list)
    preceding: defaultdict[Key, list[Key]] = defaultdict(list)
    for source, target in pairs:
        following[source].append(target)
        preceding[target].append(source)
    return following, preceding


def assign_layers(keys: Sequence[Key], pairs: Sequence[Pair[Key]]) -> dict[Key, int]:
    """Return the layer of every key of an acyclic graph, from 0, by the longest path to it.

    A source, and what only passes a source on, moves up to the layer before its first target, so
    that a disturbance stands beside the block that it acts on.
    """
    layer, _ = longest_paths(keys, pairs)
    following, preceding = _neighbours(pairs)
    free: dict[Key, bool] = {}
    for key in sorted(keys, key=lambda key: layer[key]):
        only = (free[source] and len(following[source]) == 1 for source in preceding[key])
        free[key] = all(only)
    for key in sorted(keys, key=lambda key: -layer[key]):
        if free[key] and following[key]:
            layer[key] = min(layer[target] for target in following[key]) - 1
    rank = {value: i for i, value in enumerate(sorted(set(layer.values())))}
    return {key: rank[layer[key]] for key in keys}


def connected(keys: Sequence[Key], pairs: Sequence[Pair[Key]]) -> dict[Key, int]:
    """Return the number of the connected part in which every key is."""
    part = {key: i for i, key in enumerate(keys)}
    for source, target in pairs:
        old, new = part[target], part[source]
        part = {key: new if number == old else number for key, number in part.items()}
    return part


def order_layers(
    layers: Sequence[Sequence[Key]], links: Sequence[Link[Key]], group: Callable[[Key], Any]
) -> list[list[Key]]:
    """Return the layers, from top to bottom, reordered by barycentres for few crossings.

    Links are between neighbouring layers, keys of lower groups stand first, ties keep their order.
    """
    following: _Ends[Key] = defaultdict(list)
    preceding: _Ends[Key] = defaultdict(list)
    for source, leaves_at, target, enters_at in links:
        following[source].append((leaves_at, target, enters_at))
        preceding[target].append((enters_at, source, leaves_at))
    current = [sorted(layer, key=group) for layer in layers]
    best, best_count = list(current), _crossings(current, following)
    for sweep in range(_SWEEPS):
        forward = sweep % 2 == 0
        indices = range(1, len(current)) if forward else range(len(current) - 2, -1, -1)
        for i in indices:
            fixed = current[i - 1] if forward else current[i + 1]
            place = {key: j for j, key in enumerate(fixed)}
            centre = {}
            for j, key in enumerate(current[i]):
                ends = (preceding if forward else following)[key]
                places = [place[other] + at for _, other, at in ends]
                # A key without neighbours stays about where it is.
                share = j * len(fixed) / len(current[i])
                centre[key] = sum(places) / len(places) if places else share
            current[i] = sorted(current[i], key=lambda key: (group(key), centre[key]))
        count = _crossings(current, following)
        if count < best_count:
            best, best_count = list(current), count
    return best


def _crossings(layers: Sequence[Sequence[Key]], following: _Ends[Key]) -> int:
    count = 0
    for left, right in pairwise(layers):
        place = {key: i for i, key in enumerate(right)}
        lines = [
            ((i, start), (place[target], end))
            for i, key in enumerate(left)
            for start, target, end in following[key]
        ]
        count += sum(a[0] < b[0] and a[1] > b[1] for a in lines for b in lines)
    return count


def align(
    keys: Sequence[Key], gaps: Sequence[Gap[Key]], ties: Mapping[Gap[Key], float]
) -> dict[Key, float] | None:
    """Return heights that keep every gap and miss ties by little; None if gaps contradict.

    The sum of what every tie is missed by, times its weight, is least: a linear program.
    """
    if not keys:
        return {}
    place = {key: i for i, key in enumerate(keys)}
    number, rows = len(keys), len(gaps) + 2 * len(ties)
    # height[after] - height[before] >= distance; for a tie both ways, up to a slack.
    both = [*gaps, *ties, *((after, before, -distance) for before, after, distance in ties)]
    before, after = [place[gap[0]] for gap in both], [place[gap[1]] for gap in both]
    slack = [number + i for i in range(len(ties))] * 2
    matrix = np.zeros((rows, number + len(ties)), order="F")  # as Drake takes it without SciPy
    matrix[range(rows), before] -= 1.0
    matrix[range(rows), after] += 1.0
    matrix[range(len(gaps), rows), slack] = 1.0
    program = MathematicalProgram()
    heights = program.NewContinuousVariables(number + len(ties))
    program.AddLinearCost(np.array([*[_UPWARDS] * number, *ties.values()]), heights)
    least = np.array([gap[2] for gap in both])
    program.AddLinearConstraint(matrix, least, np.full(rows, np.inf), heights)
    program.AddBoundingBoxConstraint(0.0, np.inf, heights)
    solution = ClpSolver().Solve(program)  # Drake's: to import SciPy's takes longer than to solve
    if not solution.is_success():
        return None
    return dict(zip(keys, solution.GetSolution(heights).tolist(), strict=False))


def assign_tracks(pieces: Mapping[Key, Sides]) -> tuple[dict[Key, int], list[Pair[Key]]]:
    """Choose a track for every vertical line of a channel, from the left, so that few cross.

    Of each line are given the heights, px, of the horizontal ones at its left and at its right.
    Returned are also the pairs (left, right) whose horizontal lines coincide because each of the
    two would have to be left of the other.
    """
    order = list(pieces)
    cost = {(a, b): _cost(pieces[a], pieces[b]) for a in order for b in order}
    improved = True
    while improved:
        improved = False
        for piece in order:
            # Where, of all places, it costs least.
            i, rest = order.index(piece), [one for one in order if one != piece]
            costs = [sum(cost[piece, other] for other in rest)]
            for other in rest:
                costs.append(costs[-1] - cost[piece, other] + cost[other, piece])
            best = min(range(len(costs)), key=lambda j: (costs[j], abs(j - i)))
            if costs[best] < costs[i]:
                order = [*rest[:best], piece, *rest[best:]]
                improved = True
    track: dict[Key, int] = {}
    clashes = []
    for j, piece in enumerate(order):
        track[piece] = 0
        low, high = _span(pieces[piece])
        for earlier in order[:j]:
            if _overlaps(pieces[earlier], pieces[piece]):
                clashes.append((earlier, piece))
            above, below = _span(pieces[earlier])
            apart = below + CLEARANCE <= low or high + CLEARANCE <= above
            if not apart or _overlaps(pieces[piece], pieces[earlier]):
                track[piece] = max(track[piece], track[earlier] + 1)
    return track, clashes


def _span(piece: Sides) -> tuple[float, float]:
    return min(*piece[0], *piece[1]), max(*piece[0], *piece[1])


def _cost(left: Sides, right: Sides) -> int:
    (upper, lower), (above, below) = _span(left), _span(right)
    crossings = sum(above < y < below for y in left[1]) + sum(upper < y < lower for y in right[0])
    return crossings + _OVERLAP * _overlaps(left, right)


def _overlaps(left: Sides, right: Sides) -> bool:
    return any(abs(a - b) < CLEARANCE for a in left[1] for b in right[0])
