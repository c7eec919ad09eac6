"""Graphs: nodes, directed edges and nested clusters, without any geometry."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "block", "sum", "source", "gain", "port", "state", "initial", "final", "failed", "any"
]


def unique(id_: str, taken: set[str], gap: str) -> str:
    """Return an id, numbered if it is taken already, and take it."""
    candidate, number = id_, 2
    while candidate in taken:
        candidate, number = f"{id_}{gap}{number}", number + 1
    taken.add(candidate)
    return candidate


@dataclass(frozen=True, kw_only=True)
class Node:
    """A block, a summing node, a state or an open end."""

    id: str
    label: str
    kind: Kind = "block"
    parent: str | None = None  # id of the cluster it lies in, None for the outermost level
    detail: str = ""  # text beside the label, such as a gain's value


@dataclass(frozen=True, kw_only=True)
class Edge:
    """An arrow.

    Edges with the same source and ``source_port`` carry one signal: they are drawn as one line
    that branches.
    """

    source: str
    target: str
    label: str = ""
    source_port: str = ""
    target_port: str = ""
    sign: str = ""  # with which it enters a summing node, "+" or "-"


@dataclass(frozen=True, kw_only=True)
class Cluster:
    """A frame around nodes and other clusters."""

    id: str
    label: str
    parent: str | None = None


@dataclass(frozen=True, kw_only=True)
class Graph:
    """Nodes, edges and clusters; an id is that of one node or cluster."""

    title: str
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...] = ()
    clusters: tuple[Cluster, ...] = ()

    def ancestors(self, id_: str) -> Iterator[str]:
        """Yield the ids of the clusters around a node or cluster, innermost first."""
        parents = {node.id: node.parent for node in self.nodes}
        parents |= {cluster.id: cluster.parent for cluster in self.clusters}
        above = parents[id_]
        while above is not None:
            yield above
            above = parents[above]
