"""The graph of a state chart."""

from typing import Any, Final

from chamfer.analysis.drawing.graph import Edge, Graph, Kind, Node
from chamfer.systems.statechart.chart import ANY, Chart

START: Final = "start"  # id of the dot from which the arrow to the initial state comes
ANY_STATE: Final = "any"  # id of the node that stands for every state
_OUTCOMES: Final[dict[str, Kind]] = {"done": "final", "failed": "failed"}


def chart_graph(chart: Chart[Any, Any]) -> Graph:
    """Return a chart's states and transitions as a graph; a state's note stands behind its name.

    A transition from any state is drawn once, from a node of its own. Where a state has several
    ways out, the transitions carry their priority, 1 first; in a chart with transitions from any
    state, which compete with all others, that is their place in the chart. A timeout counts only
    if no guard is true and carries no number. The ways back to the state before are drawn as one,
    to a node that stands for it.
    """
    nodes = [Node(id=START, label="", kind="initial")]
    for state in chart.states:
        kind = _OUTCOMES[state.outcome] if state.outcome else "state"
        label = f"{state.name}: {state.note}" if state.note else state.name
        nodes.append(Node(id=state_id(state.name), label=label, kind=kind))
    edges = [Edge(source=START, target=state_id(chart.initial))]
    sources = [transition.source for transition in chart.transitions]
    if ANY in sources:
        nodes.append(Node(id=ANY_STATE, label="any state", kind="any"))
    for i, transition in enumerate(chart.transitions):
        priority = sources[:i].count(transition.source) + 1
        if ANY in sources:
            priority = i + 1
        alone = sources.count(transition.source) == 1 and (ANY not in sources or len(sources) == 1)
        label = transition.label if alone else f"({priority}) {transition.label}"
        source = ANY_STATE if transition.source == ANY else state_id(transition.source)
        if transition.history:
            before = f"before {source}"
            if before not in {node.id for node in nodes}:
                nodes.append(Node(id=before, label="state before", kind="any"))
                edges.append(Edge(source=source, target=before, label=f"({priority}) back"))
            continue
        edges.append(_transition(len(edges), source, transition.target, label))
    for state in chart.states:
        if state.timeout is not None and state.on_timeout is not None:
            label = f"after {state.timeout:g} s"
            edges.append(_transition(len(edges), state_id(state.name), state.on_timeout, label))
    return Graph(title=chart.name, nodes=tuple(nodes), edges=tuple(edges))


def state_id(name: str) -> str:
    """Return the id of a state's node."""
    return f"state {name}"


def _transition(number: int, source: str, target: str, label: str) -> Edge:
    # Every transition is a line of its own, hence the ports.
    ports = {"source_port": str(number), "target_port": str(number)}
    return Edge(source=source, target=state_id(target), label=label, **ports)
