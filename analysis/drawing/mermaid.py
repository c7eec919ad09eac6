"""Graphs and state charts as Mermaid text, which web pages and editors draw on their own."""

import json
import re
from collections.abc import Iterable
from typing import Any, Final

from chamfer.analysis.drawing.chart_graph import chart_graph
from chamfer.analysis.drawing.graph import Graph, Node, unique
from chamfer.systems.statechart.chart import Chart

_SHAPES: Final = {  # what stands around the quoted label
    "sum": ("((", "))"),
    "source": ("([", "])"),
    "gain": ("[", "]"),
    "port": (">", "]"),
    "state": ("(", ")"),
    "initial": ("((", "))"),
    "final": ("(((", ")))"),
    "failed": ("{{", "}}"),
    "any": ("(", ")"),
}
_STYLES: Final = {  # of a class of nodes that its shape doesn't tell apart
    "failed": "fill:#d1d5db,stroke:#1f2937,stroke-width:3px",
    "any": "fill:#ffffff,stroke-dasharray:4 3",
}
_SPECIAL: Final = re.compile(r"[^\w \-.,()/+=\u0080-\U0010ffff]")
_NOT_IN_ID: Final = re.compile(r"[^A-Za-z0-9]+")


def flowchart(graph: Graph) -> str:
    """Write a graph as a Mermaid flowchart from left to right; clusters are subgraphs."""
    ids = _ids([*(node.id for node in graph.nodes), *(part.id for part in graph.clusters)])
    lines = [*_front_matter(graph.title), "flowchart LR"]
    lines += _members(graph, None, ids, "    ")
    for edge in graph.edges:
        texts = [edge.label, {"-": "\N{MINUS SIGN}"}.get(edge.sign, edge.sign)]
        label = " ".join(_escaped(text) for text in texts if text)
        arrow = f'-->|"{label}"|' if label else "-->"
        lines.append(f"    {ids[edge.source]} {arrow} {ids[edge.target]}")
    lines += _classes(graph.nodes, ids)
    return "\n".join(lines) + "\n"


def state_diagram(chart: Chart[Any, Any]) -> str:
    """Write a state chart as a Mermaid state diagram.

    A final state has an arrow to the end, transitions from any state come from a state of that
    name.
    """
    graph = chart_graph(chart)
    states = [node for node in graph.nodes if node.kind != "initial"]
    ids = _ids([node.id for node in states])
    start = {node.id for node in graph.nodes if node.kind == "initial"}
    lines = [*_front_matter(graph.title), "stateDiagram-v2", "    direction LR"]
    lines += [f'    state "{_escaped(node.label)}" as {ids[node.id]}' for node in states]
    for edge in graph.edges:
        source = "[*]" if edge.source in start else ids[edge.source]
        label = f" : {_escaped(edge.label)}" if edge.label else ""
        lines.append(f"    {source} --> {ids[edge.target]}{label}")
    for node in states:
        if node.kind in ("final", "failed"):
            lines.append(f"    {ids[node.id]} --> [*]")
    lines += _classes(states, ids)
    return "\n".join(lines) + "\n"


def _members(graph: Graph, parent: str | None, ids: dict[str, str], indent: str) -> list[str]:
    lines = [
        f"{indent}{ids[node.id]}{_shape(node)}" for node in graph.nodes if node.parent == parent
    ]
    for cluster in graph.clusters:
        if cluster.parent == parent:
            lines.append(f'{indent}subgraph {ids[cluster.id]}["{_escaped(cluster.label)}"]')
            lines += _members(graph, cluster.id, ids, indent + "    ")
            lines.append(f"{indent}end")
    return lines


def _shape(node: Node) -> str:
    left, right = _SHAPES.get(node.kind, ("[", "]"))
    texts = [node.label, node.detail]
    if node.kind == "sum":
        texts = ["\N{GREEK CAPITAL LETTER SIGMA}"]
    label = "<br/>".join(_escaped(text) for text in texts if text)
    return f'{left}"{label or " "}"{right}'


def _classes(nodes: Iterable[Node], ids: dict[str, str]) -> list[str]:
    lines = []
    kinds = {node.id: node.kind for node in nodes}
    for kind, style in _STYLES.items():
        members = [ids[id_] for id_ in kinds if kinds[id_] == kind]
        if members:
            lines.append(f"    classDef {kind} {style}")
            lines.append(f"    class {','.join(members)} {kind}")
    return lines


def _front_matter(title: str) -> list[str]:
    return ["---", f"title: {json.dumps(title, ensure_ascii=False)}", "---"] if title else []


def _ids(names: Iterable[str]) -> dict[str, str]:
    """Return unique ids that Mermaid can't take for one of its words (``end``)."""
    taken: set[str] = set()
    stems = {name: "n_" + _NOT_IN_ID.sub("_", name).strip("_") for name in names}
    return {name: unique(stem, taken, "_") for name, stem in stems.items()}


def _escaped(text: str) -> str:
    """Write what could end a label or be markup as a character code."""
    flat = " ".join(text.split())
    return _SPECIAL.sub(lambda match: f"#{ord(match[0])};", flat)
