"""Finds ports of a diagram and of the blocks in it, by name."""

from collections.abc import Iterator, Sequence
from typing import Any, Final, Literal, NamedTuple

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    InputPortIndex,
    OutputPort,
    OutputPortIndex,
    PortDataType,
    System,
)

from chamfer.models.validation import ParameterError

SEPARATOR: Final = "::"  # between the names of blocks and ports, as in Drake's own paths

Way = Literal["input", "output"]


class Port(NamedTuple):
    """A vector port, of a system or of a block somewhere in it."""

    way: Way
    path: tuple[int, ...]  # to the block: which subsystem, from the outside in
    number: int
    name: str  # with the names of the blocks in front
    size: int

    @property
    def labels(self) -> list[str]:
        """A name for each element."""
        if self.size == 1:
            return [self.name]
        return [f"{self.name}[{i}]" for i in range(self.size)]

    def of(self, system: System) -> Any:
        """Return Drake's port, in a system of any scalar type."""
        block = _block(system, self.path)
        if self.way == "input":
            return block.get_input_port(InputPortIndex(self.number))
        return block.get_output_port(OutputPortIndex(self.number))

    def context(self, system: System, context: Context) -> Context:
        """Return the context of its block, in that of the whole."""
        for i in self.path:
            block = system.GetSystems()[i]
            context = system.GetMutableSubsystemContext(block, context)
            system = block
        return context


def _all(
    system: System, path: tuple[int, ...] = (), name: str = ""
) -> Iterator[tuple[tuple[int, ...], str, System]]:
    """Return path, name and system of the whole, and of all in it in the states' order."""
    yield path, name, system
    if isinstance(system, Diagram):
        for i, inner in enumerate(system.GetSystems()):
            yield from _all(inner, (*path, i), _joined(name, inner.get_name()))


def own_ports(system: System, way: Way) -> list[Port]:
    """Return a system's own vector ports."""
    return [port for port in _ports(system, way, (), "") if port.size]


def find_ports(
    system: System, way: Way, wanted: "str | InputPort | OutputPort | Sequence[Any] | None"
) -> list[Port]:
    """Return the ports that are meant, or all of the system's own for None.

    Args:
        system: Where they are.
        way: Of the ports.
        wanted: One or several, each a port or its name: ``port`` of the system itself,
            ``block::port`` of a block in it, ``block`` if that is its only one.

    Raises:
        ParameterError: If there is none of that name, or it has no vector.
    """
    if wanted is None:
        return own_ports(system, way)
    each = [wanted] if isinstance(wanted, str | InputPort | OutputPort) else list(wanted)
    return [_find(system, way, one) for one in each]


def source_of(system: System, port: Port) -> Port | None:
    """Return the output that is connected to a block's input, None if there is none."""
    if not port.path:
        return None
    diagram = _block(system, port.path[:-1])
    block = diagram.GetSystems()[port.path[-1]]
    connected = diagram.connection_map().get((block, InputPortIndex(port.number)))
    if connected is None:
        return None
    source, index = connected
    return next(
        found
        for path, name, one in _all(system)
        if one is source
        for found in _ports(one, "output", path, name)
        if found.number == int(index)
    )


def state_labels(system: System, context: Context) -> list[str]:
    """Return a name for each state: continuous ones, then discrete ones, block by block."""
    continuous, discrete = [], []
    for path, name, block in _all(system):
        if isinstance(block, Diagram):
            continue
        own = Port("input", path, 0, name, 0).context(system, context)
        groups = own.get_discrete_state()
        sizes = [len(groups.value(i)) for i in range(groups.num_groups())]
        counts = own.num_continuous_states(), sum(sizes)
        names = [f"x{i}" for i in range(sum(counts))]
        if isinstance(block, MultibodyPlant) and block.num_multibody_states() == sum(counts):
            names = block.GetStateNames()
        named = [_joined(name, one) for one in names]
        continuous += named[: counts[0]]
        discrete += named[counts[0] :]
    return continuous + discrete


def _find(system: System, way: Way, wanted: Any) -> Port:
    everywhere = [
        port for path, name, one in _all(system) for port in _ports(one, way, path, name)
    ]
    if isinstance(wanted, InputPort | OutputPort):
        found = [port for port in everywhere if _same(port.of(system), wanted)]
        shown = wanted.get_name()
    else:
        shown = wanted
        found = [port for port in everywhere if port.name == wanted]
        if not found:
            ahead = f"{wanted}{SEPARATOR}"
            found = [
                port
                for port in everywhere
                if port.name.startswith(ahead) and SEPARATOR not in port.name[len(ahead) :]
            ]
    if len(found) == 1 and found[0].size:
        return found[0]
    names = ", ".join(dict.fromkeys(port.name for port in (found or everywhere) if port.size))
    raise ParameterError(way, shown, f"one of the vector ports: {names or 'there is none'}")


def _same(port: Any, wanted: Any) -> bool:
    return (
        isinstance(wanted, type(port))
        and port.get_system() is wanted.get_system()
        and port.get_index() == wanted.get_index()
    )


def _ports(system: System, way: Way, path: tuple[int, ...], name: str) -> list[Port]:
    """Return a block's ports; an abstract one has the size 0."""
    if way == "input":
        ports = [system.get_input_port(InputPortIndex(i)) for i in range(system.num_input_ports())]
    else:
        ports = [
            system.get_output_port(OutputPortIndex(i)) for i in range(system.num_output_ports())
        ]
    return [
        Port(
            way,
            path,
            i,
            _joined(name, port.get_name()),
            port.size() if port.get_data_type() == PortDataType.kVectorValued else 0,
        )
        for i, port in enumerate(ports)
    ]


def _block(system: System, path: tuple[int, ...]) -> System:
    for i in path:
        system = system.GetSystems()[i]
    return system


def _joined(name: str, inner: str) -> str:
    return f"{name}{SEPARATOR}{inner}" if name else inner
