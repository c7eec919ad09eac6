"""Positions along one axis: least distances always kept, as many straight lines as possible."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

_EPSILON: Final = 1e-6
_SWEEPS: Final = 8


@dataclass(frozen=True)
class Gap:
    """``position[after] - position[before]`` is at least (as a tie: equal to) ``distance``."""

    before: int
    after: int
    distance: float


def align(count: int, gaps: Sequence[Gap], ties: Sequence[Gap]) -> list[float]:
    """Return positions that keep every gap, and the ties in the order of their importance.

    A tie that contradicts the gaps and the ties before it is only drawn as near as the rest
    allows: what is rigidly tied together moves as one to the weighted median of its wishes.

    Args:
        count: The number of positions.
        gaps: Least distances, without contradiction.
        ties: Wanted distances, the most important first.

    Returns:
        The positions, in no particular range.
    """
    kept = list(gaps)
    positions = [0.0] * count
    _settle(positions, kept)
    open_ties = []
    for tie in ties:
        equal = [tie, Gap(tie.after, tie.before, -tie.distance)]
        trial = list(positions)
        if _settle(trial, kept + equal):
            positions = trial
            kept += equal
        else:
            open_ties.append(tie)
    _balance(positions, kept, open_ties, _groups(count, kept[len(gaps) :]))
    return positions


def _settle(positions: list[float], gaps: Sequence[Gap]) -> bool:
    """Move positions up until every gap is kept; False if that never ends."""
    bound = max(positions, default=0.0) + sum(abs(gap.distance) for gap in gaps) + 1.0
    for _ in range(len(positions) * 4 + 4):
        moved = False
        for gap in gaps:
            least = positions[gap.before] + gap.distance
            if positions[gap.after] < least - _EPSILON:
                positions[gap.after] = least
                moved = True
                if least > bound:
                    return False
        if not moved:
            return True
    return False


def _groups(count: int, ties: Sequence[Gap]) -> list[list[int]]:
    leader = list(range(count))

    def find(i: int) -> int:
        while leader[i] != i:
            i = leader[i]
        return i

    for tie in ties:
        a, b = sorted((find(tie.before), find(tie.after)))
        leader[b] = a
    members: dict[int, list[int]] = {}
    for i in range(count):
        members.setdefault(find(i), []).append(i)
    return list(members.values())


def _balance(
    positions: list[float], kept: Sequence[Gap], wishes: Sequence[Gap], groups: list[list[int]]
) -> None:
    for sweep in range(_SWEEPS):
        order = sorted(groups, key=lambda group: positions[group[0]], reverse=sweep % 2 == 0)
        for group in order:
            inside = set(group)
            wanted = sorted(
                positions[wish.before] + wish.distance - positions[wish.after]
                if wish.after in inside
                else positions[wish.after] - wish.distance - positions[wish.before]
                for wish in wishes
                if (wish.before in inside) != (wish.after in inside)
            )
            if not wanted:
                continue
            least, most = float("-inf"), float("inf")
            for gap in kept:
                slack = positions[gap.after] - positions[gap.before] - gap.distance
                if gap.before in inside and gap.after not in inside:
                    most = min(most, slack)
                elif gap.after in inside and gap.before not in inside:
                    least = max(least, -slack)
            middle = len(wanted) // 2
            move = (wanted[middle] + wanted[~middle]) / 2
            move = max(least, min(most, move))
            for i in group:
                positions[i] += move
