"""What is drawn: nodes, directed edges and nested clusters, without any geometry."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "block",
    "sum",
    "source",
    "gain",
    "port",
    "state",
    "initial",
    "final",
    "failed",
    "any",
]


@dataclass(frozen=True, kw_only=True)
class Node:
    """A block, a summing node, a state or an open end."""

    id: str
    label: str
    kind: Kind = "block"
    parent: str | None = None  # id of the cluster it lies in, None for the outermost level
    detail: str = ""  # what stands beside the label, such as a gain's value


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
    """Nodes, edges and clusters.

    Raises:
        ValueError: If an id is used twice, or an edge or a parent names an id that is unknown,
            or a cluster lies in itself.
    """

    title: str
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...] = ()
    clusters: tuple[Cluster, ...] = ()

    def __post_init__(self) -> None:
        """Check the ids."""
        members: list[Node | Cluster] = [*self.nodes, *self.clusters]
        ids = [member.id for member in members]
        for twice, count in Counter(ids).items():
            if count > 1:
                raise ValueError(f"graph {self.title!r} has the id {twice!r} {count} times")
        node_ids = {node.id for node in self.nodes}
        for edge in self.edges:
            for end in (edge.source, edge.target):
                if end not in node_ids:
                    raise ValueError(
                        f"graph {self.title!r}: the edge {edge.source!r} -> {edge.target!r} "
                        f"names the unknown node {end!r}"
                    )
        parents = {cluster.id: cluster.parent for cluster in self.clusters}
        for member in members:
            if member.parent is not None and member.parent not in parents:
                raise ValueError(
                    f"graph {self.title!r}: {member.id!r} lies in the unknown cluster "
                    f"{member.parent!r}"
                )
        for start in parents:
            above, steps = parents[start], 0
            while above is not None:
                above, steps = parents[above], steps + 1
                if steps > len(parents):
                    raise ValueError(f"graph {self.title!r}: cluster {start!r} lies in itself")

    def ancestors(self, id_: str) -> Iterator[str]:
        """Yield the ids of the clusters around a node or cluster, innermost first."""
        parents = {node.id: node.parent for node in self.nodes}
        parents.update({cluster.id: cluster.parent for cluster in self.clusters})
        above = parents[id_]
        while above is not None:
            yield above
            above = parents[above]
