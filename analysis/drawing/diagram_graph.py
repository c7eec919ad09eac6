"""The graph of a Drake diagram: nested diagrams as clusters, leaf systems as nodes."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, InputPortIndex, OutputPortIndex, System
from pydrake.systems.primitives import (
    Adder,
    Demultiplexer,
    Gain,
    MatrixGain,
    Multiplexer,
    PassThrough,
    VectorLogSink,
)

from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Kind, Node, unique

_AUTOMATIC_NAME: Final = re.compile(r"@[0-9a-f]{8,}$")  # Drake puts an address in it
_SAYS_NOTHING: Final = re.compile(
    r"([uyx]\d*|.*_[uy]\d+|in\d*|out\d*|(in|out)put\d*|(in|out)put_?port\d*|sum|data)", re.I
)
_LONGEST_GAIN: Final = 14  # characters
_ONLY_PASS_ON: Final = (Demultiplexer, Multiplexer, PassThrough)


_Port = tuple[System, str]  # of a leaf system


@dataclass
class _Parts:
    """Holds the parts of a diagram, in an order that does not depend on addresses."""

    nodes: dict[System, Node] = field(default_factory=dict)
    clusters: list[Cluster] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    taken: set[str] = field(default_factory=set)

    def connect(self, source: str, port: str, end: _Port, label: str = "") -> None:
        """Add a wire from a node's port to a leaf system's."""
        system, name = end
        target, sign = self.nodes[system].id, "+" if isinstance(system, Adder) else ""
        ports = {"source_port": port, "target_port": name}
        self.edges.append(Edge(source=source, target=target, label=label, sign=sign, **ports))


def diagram_graph(diagram: Diagram) -> Graph:
    """Return a diagram's blocks and wires as a graph.

    Wires end at the leaf systems that they reach through the ports of nested diagrams. They are
    labelled with the names of the ports where the wire is made, unless these are Drake's own or
    repeat the name of the block beside them. Ports that the diagram exports become open ends; if
    it exports no output, the open outputs of the diagrams in it do.

    An Adder is a summing circle. A gain without a positive element that feeds nothing but an
    Adder gives it its minus sign, a gain of -1 completely. Log sinks are left out, with what only
    leads to them. Ids are the names of the systems from the outside in, joined by "/".
    """
    parts = _Parts()
    _collect(diagram, None, "", parts)
    drawn = list(parts.nodes.values())
    inputs = []
    for i in range(diagram.num_input_ports()):
        name = diagram.get_input_port(i).get_name()
        id_ = unique(f"input {name}", parts.taken, " ")
        inputs.append(Node(id=id_, label=name, kind="port"))
        for end in _reached(diagram, i):
            parts.connect(id_, "", end)
    outputs = []
    for name, (system, port) in _outputs(diagram):
        id_, source = unique(f"output {name}", parts.taken, " "), parts.nodes[system].id
        outputs.append(Node(id=id_, label=name, kind="port"))
        parts.edges.append(Edge(source=source, target=id_, source_port=port))
    hidden = _loggers(parts)
    place = {
        (node.id, system.get_input_port(i).get_name()): (number, i)
        for number, (system, node) in enumerate(parts.nodes.items())
        for i in range(system.num_input_ports())
    }
    last = (len(drawn), 0)
    wires = [wire for wire in parts.edges if not {wire.source, wire.target} & hidden]
    drawn, wires = _with_signs(parts.nodes, hidden, wires)
    wires.sort(key=lambda wire: place.get((wire.target, wire.target_port), last))
    nodes = {node.id: node for node in (*inputs, *drawn, *outputs)}
    edges = tuple(_without_repetition(wire, nodes) for wire in wires)
    graph = Graph(
        title=_name(diagram, ""),
        nodes=tuple(nodes.values()),
        edges=edges,
        clusters=tuple(parts.clusters),
    )
    occupied = {above for node in drawn for above in graph.ancestors(node.id)}
    kept = tuple(one for one in parts.clusters if one.id in occupied)
    return replace(graph, clusters=kept)


def _collect(diagram: Diagram, cluster: str | None, path: str, parts: _Parts) -> None:
    for system in diagram.GetSystems():
        label = _name(system, type(system).__name__)
        id_ = unique(f"{path}{label}", parts.taken, " ")
        if isinstance(system, Diagram):
            parts.clusters.append(Cluster(id=id_, label=label, parent=cluster))
            _collect(system, id_, f"{id_}/", parts)
        else:
            parts.nodes[system] = _node(system, id_, label, cluster)
    connections = _connections(diagram)
    # The map is in the order of addresses, the systems are in the order of construction.
    for system in diagram.GetSystems():
        for port in range(system.num_input_ports()):
            if (system, port) not in connections:
                continue
            source, output = connections[system, port]
            start, name = _resolved(source, output)
            from_, into = source.get_output_port(output), system.get_input_port(port)
            outer = from_.get_name(), into.get_name()
            for end in _reached(system, port):
                parts.connect(parts.nodes[start].id, name, end, _label(outer, (name, end[1])))


def _connections(diagram: Diagram) -> dict[tuple[System, int], tuple[System, int]]:
    """Return the output port that every connected input port gets its value from."""
    return {
        (system, int(port)): (source, int(output))
        for (system, port), (source, output) in diagram.connection_map().items()
    }


def _resolved(system: System, output: int) -> _Port:
    """Return the leaf system's port behind an output port."""
    while isinstance(system, Diagram):
        system, index = system.get_output_port_locator(OutputPortIndex(output))
        output = int(index)
    return system, system.get_output_port(output).get_name()


def _reached(system: System, port: int) -> Iterator[_Port]:
    """Yield the leaf systems' ports behind an input port."""
    if isinstance(system, Diagram):
        for inner, index in system.GetInputPortLocators(InputPortIndex(port)):
            yield from _reached(inner, int(index))
    else:
        yield system, system.get_input_port(port).get_name()


def _name(system: System, automatic: str) -> str:
    name = system.get_name()
    return automatic if not name or _AUTOMATIC_NAME.search(name) else name


def _label(outer: tuple[str, str], inner: tuple[str, str]) -> str:
    """Choose what a wire is called: the more specific of the names where it is made."""
    for pair in (outer, inner):
        source, target = ("" if _SAYS_NOTHING.fullmatch(name) else name for name in pair)
        if source or target:
            return target if source in target else source
    return ""


def _node(system: System, id_: str, label: str, parent: str | None) -> Node:
    matrix = gain_matrix(system)
    detail = "" if matrix is None else gain_text(matrix)
    kind: Kind = "block" if system.num_input_ports() else "source"
    if isinstance(system, Adder):
        kind = "sum"
    elif matrix is not None:
        kind = "gain"
    return Node(id=id_, label=label, kind=kind, parent=parent, detail=detail)


def _outputs(diagram: Diagram) -> list[tuple[str, _Port]]:
    """Return the exported outputs, if none those of nested diagrams that only loggers use."""
    used = {
        source
        for (system, _), source in _connections(diagram).items()
        if not isinstance(system, VectorLogSink)
    }
    ends = [(diagram, i) for i in range(diagram.num_output_ports())] or [
        (system, i)
        for system in diagram.GetSystems()
        if isinstance(system, Diagram)
        for i in range(system.num_output_ports())
        if (system, i) not in used
    ]
    return [(system.get_output_port(i).get_name(), _resolved(system, i)) for system, i in ends]


def _loggers(parts: _Parts) -> set[str]:
    hidden = {node.id for one, node in parts.nodes.items() if isinstance(one, VectorLogSink)}
    passing = {node.id for one, node in parts.nodes.items() if isinstance(one, _ONLY_PASS_ON)}
    while True:
        targets = {
            id_: {wire.target for wire in parts.edges if wire.source == id_}
            for id_ in passing - hidden
        }
        more = {id_ for id_, found in targets.items() if found and found <= hidden}
        if not more:
            return hidden
        hidden |= more


def _with_signs(
    nodes: Mapping[System, Node], hidden: set[str], wires: list[Edge]
) -> tuple[list[Node], list[Edge]]:
    """Turn negative gains in front of summing circles into minus signs."""
    drawn = {node.id: node for node in nodes.values() if node.id not in hidden}
    for system, node in nodes.items():
        matrix = gain_matrix(system)
        leaving = [wire for wire in wires if wire.source == node.id]
        entering = [wire for wire in wires if wire.target == node.id]
        negative = matrix is not None and (matrix <= 0).all() and (matrix < 0).any()
        if matrix is None or not negative or len(leaving) != 1 or not entering:
            continue
        wire = leaving[0]
        if wire.target not in drawn or drawn[wire.target].kind != "sum":
            continue
        minus = replace(wire, sign="-")
        if np.array_equal(matrix, -np.eye(len(matrix))):
            before = entering[0]
            wires = [other for other in wires if other is not before]
            minus = replace(before, target=wire.target, target_port=wire.target_port, sign="-")
            minus = replace(minus, label=before.label or wire.label)
            del drawn[node.id]
        else:
            drawn[node.id] = replace(node, detail=gain_text(-matrix))
        wires = [minus if other is wire else other for other in wires]
    return list(drawn.values()), wires


def _without_repetition(wire: Edge, nodes: Mapping[str, Node]) -> Edge:
    """Drop a label that only repeats the name of a block in the same cluster as the other end."""
    source, target = nodes[wire.source], nodes[wire.target]
    beside = {
        _words(node.label)
        for node, other in ((source, target), (target, source))
        if node.parent is None or other.id.startswith(f"{node.parent}/")
    }
    return replace(wire, label="") if _words(wire.label) in beside else wire


def _words(name: str) -> str:
    return name.replace("_", " ").lower()


def gain_matrix(system: System) -> NDArray[np.float64] | None:
    """Return the matrix that a gain block multiplies its input with; None for other systems."""
    if isinstance(system, MatrixGain):
        return np.asarray(system.D(), dtype=np.float64)
    if isinstance(system, Gain):
        # Drake binds no getter for the gain, but the output for ones at the input is the gain.
        context = system.CreateDefaultContext()
        port = system.get_input_port()
        port.FixValue(context, np.ones(port.size()))
        return np.diag(np.asarray(system.get_output_port().Eval(context), dtype=np.float64))
    return None


def gain_text(matrix: NDArray[np.float64]) -> str:
    """Return a gain as text: one number for all elements, or a small matrix; "" if it is long."""
    square = matrix.shape[0] == matrix.shape[1]
    if square and np.array_equal(matrix, matrix[0, 0] * np.eye(len(matrix))):
        return _short(matrix[0, 0])
    if square and np.array_equal(matrix, np.diag(np.diag(matrix))):
        text = f"diag({', '.join(map(_short, np.diag(matrix)))})"
    else:
        text = f"[{'; '.join(' '.join(map(_short, row)) for row in matrix)}]"
    return text if len(text) <= _LONGEST_GAIN else ""


def _short(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "\N{MINUS SIGN}")
