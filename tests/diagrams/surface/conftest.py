from collections.abc import Callable

import pytest
from pydrake.systems.framework import Diagram

Wire = tuple[str, str]


@pytest.fixture(scope="package")
def reached() -> Callable[..., set[str]]:
    """Return a function that finds the blocks that one acts on, directly or through others."""

    def find(
        diagram: Diagram, start: str, cut: Callable[[Wire], bool] = lambda wire: False
    ) -> set[str]:
        """Do it without the wires, source and target, that are to be cut."""
        wires = [
            (source.get_name(), target.get_name())
            for (target, _), (source, _) in diagram.connection_map().items()
        ]
        found: set[str] = set()
        front = [start]
        while front:
            at = front.pop()
            more = {end for begin, end in wires if begin == at and not cut((begin, end))} - found
            found |= more
            front += more
        return found

    return find
