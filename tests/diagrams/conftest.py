from collections.abc import Callable

import pytest
from pydrake.systems.framework import Diagram

Wire = tuple[str, str, str, str]  # from block and port, to block and port


def of(diagram: Diagram, flat: bool = False) -> set[Wire]:
    assert not (flat and any(isinstance(system, Diagram) for system in diagram.GetSystems()))
    return {
        (
            source.get_name(),
            source.get_output_port(output).get_name(),
            target.get_name(),
            target.get_input_port(entrance).get_name(),
        )
        for (target, entrance), (source, output) in diagram.connection_map().items()
    }


@pytest.fixture(scope="session")
def wires() -> Callable[..., set[Wire]]:
    """Finds every connection between a diagram's blocks; a diagram in it is one, if not flat."""
    return of
