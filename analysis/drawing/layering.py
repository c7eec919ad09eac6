"""The combinatorial half of a layered layout: feedback, layers, order within a layer.

Nodes are hashable keys and wires pairs of them; there is no geometry here.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
# By key: how far down it the wire ends, the key at the other end, how far down that one.
_Ends = dict[Key, list[tuple[float, Key, float]]]

_SWEEPS: Final = 12


@dataclass(frozen=True)
class Link(Generic[Key]):
    """A wire between neighbouring layers; 0 to 1 is how far down its ends are on their keys.

    Ends that may still be put in any order are at the same place.
    """

    source: Key
    target: Key
    leaves_at: float = 0.0
    enters_at: float = 0.0


def feedback(
    keys: Sequence[Key], pairs: Sequence[tuple[Key, Key]], returns_to: Callable[[Key], bool]
) -> set[int]:
    """Return the indices of the pairs that close a cycle, as seen from the sources.

    Where a loop is cut open depends on the source from which the search starts and on whether it
    goes deep or broad first. All are tried; the fewest feedback pairs win, then the most of them
    that end where ``returns_to`` holds (a summing node), then the shortest wires, so that what
    works in parallel stands in parallel.

    Args:
        keys: All keys, in the order in which they were declared.
        pairs: The wires as (source, target); a pair from a key to itself is no feedback.
        returns_to: Whether feedback is expected to end at a key.

    Returns:
        Indices into ``pairs``; without these pairs there is no cycle.
    """
    targets = {target for source, target in pairs if source != target}
    sources = [key for key in keys if key not in targets]
    candidates: list[set[int]] = []
    for first in sources or keys[:1]:
        starts = [first, *(key for key in sources if key != first), *keys]
        candidates += [_depth_first(starts, pairs), _breadth_first(starts, pairs)]

    def score(found: set[int]) -> tuple[int, int, int]:
        forward = [pair for i, pair in enumerate(pairs) if i not in found and pair[0] != pair[1]]
        layer, _ = longest_paths(keys, forward)
        returning = sum(returns_to(pairs[i][1]) for i in found)
        length = sum(abs(layer[target] - layer[source]) for source, target in pairs)
        return len(found), -returning, length

    return min(candidates, key=score, default=set())


def longest_paths(
    keys: Sequence[Key], pairs: Sequence[tuple[Key, Key]]
) -> tuple[dict[Key, int], dict[Key, int]]:
    """Return the number of wires on the longest path to and from every key of an acyclic graph."""
    following, preceding = _neighbours(pairs)
    order: list[Key] = []
    missing = {key: len(preceding[key]) for key in keys}
    ready = [key for key in keys if not missing[key]]
    while ready:
        key = ready.pop(0)
        order.append(key)
        for target in following[key]:
            missing[target] -= 1
            if not missing[target]:
                ready.append(target)
    before = dict.fromkeys(keys, 0)
    for key in order:
        for target in following[key]:
            before[target] = max(before[target], before[key] + 1)
    after = dict.fromkeys(keys, 0)
    for key in reversed(order):
        for source in preceding[key]:
            after[source] = max(after[source], after[key] + 1)
    return before, after


def assign_layers(
    keys: Sequence[Key],
    pairs: Sequence[tuple[Key, Key]],
    first: Callable[[Key], bool],
    last: Callable[[Key], bool],
) -> dict[Key, int]:
    """Return the layer of every key of an acyclic graph, from 0, by the longest path to it.

    A source, and what only passes a source on, moves up to the layer before its first target, so
    that a disturbance stands beside the block that it acts on.

    Args:
        keys: All keys.
        pairs: The wires as (source, target), without cycles.
        first: Which keys share a first layer of their own (all of them without predecessors).
        last: Which keys share a last layer of their own (all of them without successors).

    Returns:
        The layers; every pair leads to a higher layer.
    """
    layer, _ = longest_paths(keys, pairs)
    if any(first(key) for key in keys):
        shift = 0 if all(first(key) or layer[key] for key in keys) else 1
        layer = {key: 0 if first(key) else layer[key] + shift for key in keys}
    following, preceding = _neighbours(pairs)
    free = {key: not first(key) for key in keys}
    for key in sorted(keys, key=lambda key: layer[key]):
        free[key] = free[key] and all(
            free[source] and len(following[source]) == 1 for source in preceding[key]
        )
    if any(last(key) for key in keys):
        inner = [layer[key] for key in keys if not last(key)]
        end = max(inner, default=-1) + 1
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

    Returns:
        The layers in their new order.
    """
    following: _Ends[Key] = defaultdict(list)
    preceding: _Ends[Key] = defaultdict(list)
    for link in links:
        following[link.source].append((link.leaves_at, link.target, link.enters_at))
        preceding[link.target].append((link.enters_at, link.source, link.leaves_at))
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


def _leaving(pairs: Sequence[tuple[Key, Key]]) -> defaultdict[Key, list[int]]:
    leaving: defaultdict[Key, list[int]] = defaultdict(list)
    for i, (source, target) in enumerate(pairs):
        if source != target:
            leaving[source].append(i)
    return leaving


def _breadth_first(starts: Sequence[Key], pairs: Sequence[tuple[Key, Key]]) -> set[int]:
    leaving = _leaving(pairs)
    place: dict[Key, tuple[int, int]] = {}
    for tree, start in enumerate(starts):
        front = [start]
        for key in front:
            if key not in place:
                # Nothing leads from an earlier tree to a later one: the later one goes in front.
                place[key] = (-tree, len(place))
                front += [pairs[i][1] for i in leaving[key]]
    return {
        i
        for i, (source, target) in enumerate(pairs)
        if source != target and place[target] < place[source]
    }


def _depth_first(starts: Sequence[Key], pairs: Sequence[tuple[Key, Key]]) -> set[int]:
    leaving = _leaving(pairs)
    found: set[int] = set()
    seen: set[Key] = set()
    for start in starts:
        if start in seen:
            continue
        seen.add(start)
        trail = {start}
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


def _neighbours(
    pairs: Sequence[tuple[Key, Key]],
) -> tuple[defaultdict[Key, list[Key]], defaultdict[Key, list[Key]]]:
    following: defaultdict[Key, list[Key]] = defaultdict(list)
    preceding: defaultdict[Key, list[Key]] = defaultdict(list)
    for source, target in pairs:
        following[source].append(target)
        preceding[target].append(source)
    return following, preceding


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
        if i > 0:
            sides.append(({key: j for j, key in enumerate(layers[i - 1])}, preceding))
        if i + 1 < len(layers):
            sides.append(({key: j for j, key in enumerate(layers[i + 1])}, following))
        for j in range(len(layer) - 1):
            upper, lower = layer[j], layer[j + 1]
            as_is = swapped = 0
            for place, ends in sides:
                above = [(place[key], at) for _, key, at in ends.get(upper, ())]
                below = [(place[key], at) for _, key, at in ends.get(lower, ())]
                as_is += sum(a > b for a in above for b in below)
                swapped += sum(b > a for a in above for b in below)
            if swapped < as_is:
                layer[j], layer[j + 1] = lower, upper


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
