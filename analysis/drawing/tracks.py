"""The order of the vertical lines in the channel between two layers."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

Id = TypeVar("Id", bound=Hashable)

CLEARANCE: Final = 7.0  # px, the least distance of parallel lines of different signals
_OVERLAP: Final = 1000


@dataclass(frozen=True)
class Piece(Generic[Id]):
    """A vertical line with horizontal ones to the heights ``lefts`` and ``rights``, in px."""

    id: Id
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


def assign_tracks(pieces: Sequence[Piece[Id]]) -> tuple[dict[Id, int], list[tuple[Id, Id]]]:
    """Choose a track for every piece, from the left, so that few lines cross and none coincide.

    Args:
        pieces: The pieces of one channel.

    Returns:
        The track of every piece, and the pairs (left, right) whose horizontal lines coincide
        because each of the two would have to be left of the other.
    """
    order = list(pieces)
    for _ in range(len(order)):
        if not _insert_better(order):
            break
    track: dict[Id, int] = {}
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


def _insert_better(order: list[Piece[Id]]) -> bool:
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


def _cost(left: Piece[Id], right: Piece[Id]) -> int:
    crossings = sum(right.low < y < right.high for y in left.rights)
    crossings += sum(left.low < y < left.high for y in right.lefts)
    return crossings + _OVERLAP * _overlaps(left, right)


def _overlaps(left: Piece[Id], right: Piece[Id]) -> bool:
    return any(abs(a - b) < CLEARANCE for a in left.rights for b in right.lefts)
