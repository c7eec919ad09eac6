"""The combinatorial half of a layered layout (Sugiyama, Tagawa and Toda, 1981).

Feedback, layers, the order within a layer, heights under constraints, and the order of vertical
lines between two layers. Keys are hashable, wires pairs of them; nothing here is drawn.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Pair = tuple[Key, Key]
# Source, how far down it (0 to 1), target, how far down it; 0 for ends in any order.
Link = tuple[Key, float, Key, float]
_Ends = dict[Key, list[tuple[float, Key, float]]]

CLEARANCE: Final = 7.0  # px, the least distance of parallel lines of different signals
_SWEEPS: Final = 12
_OVERLAP: Final = 1000  # crossings that two lines on top of each other are worth
_EPSILON: Final = 1e-6


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
    for start in starts:
        if start in seen:
            continue
        seen.add(start)
        trail.add(start)
        stack = [(start, iter(leaving[start]))]
        while stack:
            key, remaining = stack[-1]
            i = next(remaining, -1)
            if i < 0:
                stack.pop()
                trail.discard(key)
                continue
            target = pairs[i][1]
            if target in trail:
                found.add(i)
            elif target not in seen:
                seen.add(target)
                trail.add(target)
                stack.append((target, iter(leaving[target])))
    return found


def longest_paths(
    keys: Sequence[Key], pairs: Sequence[Pair[Key]]
) -> tuple[dict[Key, int], dict[Key, int]]:
    """Return the number of wires on the longest path to and from every key of an acyclic graph."""
    following, preceding = _neighbours(pairs)
    missing = {key: len(preceding[key]) for key in keys}
    order = [key for key in keys if not missing[key]]
    before, after = dict.fromkeys(keys, 0), dict.fromkeys(keys, 0)
    for key in order:
        for target in following[key]:
            before[target] = max(before[target], before[key] + 1)
            missing[target] -= 1
            if not missing[target]:
                order.append(target)
    for key in reversed(order):
        for source in preceding[key]:
            after[source] = max(after[source], after[key] + 1)
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


def assign_layers(
    keys: Sequence[Key],
    pairs: Sequence[Pair[Key]],
    first: Callable[[Key], bool],
    last: Callable[[Key], bool],
) -> dict[Key, int]:
    """Return the layer of every key of an acyclic graph, from 0, by the longest path to it.

    A source, and what only passes a source on, moves up to the layer before its first target, so
    that a disturbance stands beside the block that it acts on. The keys for which ``first`` holds,
    all without predecessors, have the first layer for themselves, those of ``last`` the last one.
    """
    layer, _ = longest_paths(keys, pairs)
    if any(first(key) for key in keys):
        shift = 0 if all(first(key) or layer[key] for key in keys) else 1
        layer = {key: 0 if first(key) else layer[key] + shift for key in keys}
    following, preceding = _neighbours(pairs)
    free: dict[Key, bool] = {}
    for key in sorted(keys, key=lambda key: layer[key]):
        only = (free[source] and len(following[source]) == 1 for source in preceding[key])
        free[key] = not first(key) and all(only)
    end = max((layer[key] for key in keys if not last(key)), default=-1) + 1
    layer = {key: end if last(key) else layer[key] for key in keys}
    for key in sorted(keys, key=lambda key: -layer[key]):
        if free[key] and following[key] and not last(key):
            layer[key] = min(layer[target] for target in following[key]) - 1
    rank = {value: i for i, value in enumerate(sorted(set(layer.values())))}
    return {key: rank[layer[key]] for key in keys}


def order_layers(layers: Sequence[Sequence[Key]], links: Sequence[Link[Key]]) -> list[list[Key]]:
    """Return the layers reordered for few crossings: barycentres, then neighbours swapped.

    Args:
        layers: The keys of every layer from top to bottom; ties keep this order.
        links: Wires between neighbouring layers.
    """
    following: _Ends[Key] = defaultdict(list)
    preceding: _Ends[Key] = defaultdict(list)
    for source, leaves_at, target, enters_at in links:
        following[source].append((leaves_at, target, enters_at))
        preceding[target].append((enters_at, source, leaves_at))
    best = [list(layer) for layer in layers]
    best_count = _crossings(best, following)
    current = [list(layer) for layer in best]
    for sweep in range(_SWEEPS):
        if best_count == 0:
            break
        forward = sweep % 2 == 0
        indices = range(1, len(current)) if forward else range(len(current) - 2, -1, -1)
        for i in indices:
            fixed = current[i - 1] if forward else current[i + 1]
            current[i] = _by_barycentre(current[i], fixed, preceding if forward else following)
        _swap_neighbours(current, following, preceding)
        count = _crossings(current, following)
        if count < best_count:
            best, best_count = [list(layer) for layer in current], count
    return best


def _by_barycentre(layer: list[Key], fixed: list[Key], ends: _Ends[Key]) -> list[Key]:
    place = {key: i for i, key in enumerate(fixed)}
    scale = len(fixed) / max(len(layer), 1)
    centre = {}
    for i, key in enumerate(layer):
        places = [place[other] + at for _, other, at in ends.get(key, ()) if other in place]
        # A key without neighbours stays about where it is.
        centre[key] = sum(places) / len(places) if places else i * scale
    return sorted(layer, key=lambda key: centre[key])


def _swap_neighbours(
    layers: list[list[Key]], following: _Ends[Key], preceding: _Ends[Key]
) -> None:
    for i, layer in enumerate(layers):
        sides = []
        for other, ends in ((i - 1, preceding), (i + 1, following)):
            if 0 <= other < len(layers):
                sides.append(({key: j for j, key in enumerate(layers[other])}, ends))
        for j in range(len(layer) - 1):
            as_is = swapped = 0
            for place, ends in sides:
                above = [(place[key], at) for _, key, at in ends.get(layer[j], ())]
                below = [(place[key], at) for _, key, at in ends.get(layer[j + 1], ())]
                as_is += sum(a > b for a in above for b in below)
                swapped += sum(b > a for a in above for b in below)
            if swapped < as_is:
                layer[j], layer[j + 1] = layer[j + 1], layer[j]


def _crossings(layers: Sequence[Sequence[Key]], following: _Ends[Key]) -> int:
    count = 0
    for left, right in pairwise(layers):
        place = {key: i for i, key in enumerate(right)}
        lines = [
            ((i, start), (place[target], end))
            for i, key in enumerate(left)
            for start, target, end in following.get(key, ())
            if target in place
        ]
        count += sum(a[0] < b[0] and a[1] > b[1] for a in lines for b in lines)
    return count


# ``height[after] - height[before]`` is at least (as a tie: equal to) the last.
Gap = tuple[Key, Key, float]


def align(
    keys: Sequence[Key], gaps: Sequence[Gap[Key]], ties: Sequence[Gap[Key]]
) -> dict[Key, float]:
    """Return the least heights that keep every gap, and ties in the order of their importance.

    A tie that contradicts the gaps and the ties before it is left out.
    """
    kept = list(gaps)
    heights = dict.fromkeys(keys, 0.0)
    _settle(heights, kept)
    for before, after, distance in ties:
        trial = dict(heights)
        equal = [*kept, (before, after, distance), (after, before, -distance)]
        if _settle(trial, equal):
            heights, kept = trial, equal
    return heights


def _settle(heights: dict[Key, float], gaps: Sequence[Gap[Key]]) -> bool:
    """Move heights up until every gap is kept; False if that never ends."""
    bound = max(heights.values(), default=0.0) + sum(abs(gap[2]) for gap in gaps) + 1.0
    for _ in range(len(heights) * 4 + 4):
        moved = False
        for before, after, distance in gaps:
            least = heights[before] + distance
            if heights[after] < least - _EPSILON:
                heights[after] = least
                moved = True
                if least > bound:
                    return False
        if not moved:
            return True
    return False


@dataclass(frozen=True)
class TrackPiece(Generic[Key]):
    """A vertical line with horizontal ones to the heights ``lefts`` and ``rights``, in px."""

    id: Key
    lefts: tuple[float, ...]
    rights: tuple[float, ...]

    @property
    def low(self) -> float:
        """The upper end."""
        return min(self.lefts + self.rights)

    @property
    def high(self) -> float:
        """The lower end."""
        return max(self.lefts + self.rights)


def assign_tracks(pieces: Sequence[TrackPiece[Key]]) -> tuple[dict[Key, int], list[Pair[Key]]]:
    """Choose a track for every piece of a channel, from the left.

    Few lines cross and none coincide.

    Returns:
        The track of every piece, and the pairs (left, right) whose horizontal lines coincide
        because each of the two would have to be left of the other.
    """
    order = list(pieces)
    for _ in range(len(order)):
        if not _insert_better(order):
            break
    track: dict[Key, int] = {}
    clashes = []
    for j, piece in enumerate(order):
        track[piece.id] = 0
        for earlier in order[:j]:
            if _overlaps(earlier, piece):
                clashes.append((earlier.id, piece.id))
            apart = earlier.high + CLEARANCE <= piece.low or piece.high + CLEARANCE <= earlier.low
            if not apart or _overlaps(piece, earlier):
                track[piece.id] = max(track[piece.id], track[earlier.id] + 1)
    return track, clashes


def _insert_better(order: list[TrackPiece[Key]]) -> bool:
    """Move single pieces to where they cost least; False if nothing can be gained."""
    improved = False
    for i in range(len(order)):
        piece = order[i]
        rest = order[:i] + order[i + 1 :]
        costs = [sum(_cost(piece, other) for other in rest)]
        for other in rest:
            costs.append(costs[-1] - _cost(piece, other) + _cost(other, piece))
        best = min(range(len(costs)), key=lambda j: (costs[j], abs(j - i)))
        if costs[best] < costs[i]:
            order[:] = [*rest[:best], piece, *rest[best:]]
            improved = True
    return improved


def _cost(left: TrackPiece[Key], right: TrackPiece[Key]) -> int:
    crossings = sum(right.low < y < right.high for y in left.rights)
    crossings += sum(left.low < y < left.high for y in right.lefts)
    return crossings + _OVERLAP * _overlaps(left, right)


def _overlaps(left: TrackPiece[Key], right: TrackPiece[Key]) -> bool:
    return any(abs(a - b) < CLEARANCE for a in left.rights for b in right.lefts)
