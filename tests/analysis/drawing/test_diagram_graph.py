from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Gain,
    Integrator,
    LogVectorOutput,
    MatrixGain,
    PassThrough,
)

from chamfer.analysis.drawing.diagram_graph import diagram_graph, gain_matrix, gain_text
from chamfer.analysis.drawing.graph import Graph


def graph_of(builder: DiagramBuilder) -> Graph:
    diagram = builder.Build()
    diagram.set_name("root")
    return diagram_graph(diagram)


def _wires(graph: Graph) -> dict[tuple[str, str], tuple[str, str]]:
    return {(edge.source, edge.target): (edge.label, edge.sign) for edge in graph.edges}


def test_diagrams_are_clusters_and_wires_end_at_the_blocks_behind(loops: Diagram) -> None:
    graph = diagram_graph(loops)
    assert {(cluster.id, cluster.parent) for cluster in graph.clusters} == {
        ("PID loop", None),
        ("PID loop/computer vision", "PID loop"),
        ("PID loop/plant", "PID loop"),
        ("FSM loop", None),
        ("FSM loop/plant", "FSM loop"),
    }
    plant = "FSM loop/plant"
    kinds = {node.id: (node.kind, node.detail) for node in graph.nodes}
    assert kinds["FSM loop/desired trajectory"] == ("source", "")
    assert kinds["FSM loop/computer vision"] == ("block", "")
    assert kinds[f"{plant}/force balance"] == ("sum", "")
    assert kinds[f"{plant}/stiffness K_p"] == ("gain", "700")
    assert kinds["output fsm.actual_trajectory"] == ("port", "")
    assert {ends: wire for ends, wire in _wires(graph).items() if ends[0].startswith("FSM")} == {
        ("FSM loop/desired trajectory", "FSM loop/computer vision"): ("", ""),
        ("FSM loop/computer vision", "FSM loop/controller FSM"): ("error", ""),
        ("FSM loop/controller FSM", f"{plant}/stiffness K_p"): ("compensation", ""),
        (f"{plant}/stiffness K_p", f"{plant}/force balance"): ("", "+"),
        (f"{plant}/force balance", f"{plant}/impedance control A(s)"): ("", ""),
        (f"{plant}/impedance control A(s)", f"{plant}/environment B(s)"): ("", ""),
        (f"{plant}/impedance control A(s)", f"{plant}/actual trajectory"): ("", ""),
        (f"{plant}/environment B(s)", f"{plant}/force balance"): ("", "-"),
        (f"{plant}/actual trajectory", "FSM loop/computer vision"): ("actual_trajectory", ""),
        (f"{plant}/actual trajectory", "output fsm.actual_trajectory"): ("", ""),
    }
    assert len(graph.edges) == 19


def test_names_with_addresses_are_replaced() -> None:
    builder = DiagramBuilder()
    first, second = builder.AddSystem(Integrator(1)), builder.AddSystem(Integrator(1))
    builder.Connect(first.get_output_port(), second.get_input_port())

    graph = graph_of(builder)
    assert [(node.id, node.label) for node in graph.nodes] == [
        ("Integrator", "Integrator"),
        ("Integrator 2", "Integrator"),
    ]
    assert _wires(graph) == {("Integrator", "Integrator 2"): ("", "")}


def test_exported_ports_of_the_root_are_open_ends() -> None:
    builder = DiagramBuilder()
    block = builder.AddNamedSystem("block", PassThrough(1))
    other = builder.AddNamedSystem("sum", Adder(1, 1))
    port = builder.ExportInput(block.get_input_port(), "command")
    builder.ConnectInput(port, other.get_input_port(0))
    builder.ExportOutput(block.get_output_port(), "position")

    graph = graph_of(builder)
    assert [(node.id, node.kind) for node in graph.nodes] == [
        ("input command", "port"),
        ("block", "block"),
        ("sum", "sum"),
        ("output position", "port"),
    ]
    assert _wires(graph) == {
        ("input command", "block"): ("", ""),
        ("input command", "sum"): ("", "+"),
        ("block", "output position"): ("", ""),
    }


def test_one_port_of_a_nested_diagram_may_reach_several_blocks() -> None:
    builder = DiagramBuilder()
    inner = DiagramBuilder()
    a, b = inner.AddNamedSystem("a", Gain(2.0, 1)), inner.AddNamedSystem("b", Gain(3.0, 1))
    inner.ConnectInput(inner.ExportInput(a.get_input_port(), "force"), b.get_input_port())
    nested = builder.AddNamedSystem("nested", inner.Build())
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
    builder.Connect(source.get_output_port(), nested.get_input_port())

    assert _wires(graph_of(builder)) == {
        ("source", "nested/a"): ("force", ""),
        ("source", "nested/b"): ("force", ""),
    }


@pytest.mark.parametrize(
    ("gain", "node", "sign"),
    [
        (Gain(-1.0, 2), None, "-"),
        (MatrixGain(D=-np.eye(2)), None, "-"),
        (Gain(-2.5, 2), "2.5", "-"),
        (Gain(2.5, 2), "2.5", "+"),
        (MatrixGain(D=np.array([[-1.0, 0.0], [0.0, 2.0]])), "diag(\N{MINUS SIGN}1, 2)", "+"),
    ],
)
def test_a_negative_gain_before_a_sum_is_a_minus_sign(
    gain: Any, node: str | None, sign: str
) -> None:
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0, 1.0]))
    builder.AddNamedSystem("gain", gain)
    total = builder.AddNamedSystem("total", Adder(1, 2))
    builder.Connect(source.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), total.get_input_port(0))

    graph = graph_of(builder)
    details = {node.id: node.detail for node in graph.nodes}
    assert details.get("gain") == node
    assert _wires(graph)[("source" if node is None else "gain", "total")] == ("", sign)


def test_a_minus_that_goes_elsewhere_too_stays_a_gain() -> None:
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
    gain = builder.AddNamedSystem("gain", Gain(-1.0, 1))
    total = builder.AddNamedSystem("total", Adder(1, 1))
    builder.Connect(source.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), total.get_input_port(0))
    builder.ExportOutput(gain.get_output_port(), "negative")

    graph = graph_of(builder)
    assert _wires(graph)["gain", "total"] == ("", "+")


def test_a_diagram_of_loggers_is_empty_without_them() -> None:
    builder = DiagramBuilder()
    inner = DiagramBuilder()
    through = inner.AddNamedSystem("through", PassThrough(1))
    inner.ExportInput(through.get_input_port(), "signal")
    LogVectorOutput(through.get_output_port(), inner)
    nested = builder.AddNamedSystem("log", inner.Build())
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
    builder.Connect(source.get_output_port(), nested.get_input_port())

    graph = graph_of(builder)
    assert [node.id for node in graph.nodes] == ["source"]
    assert graph.clusters == ()
    assert graph.edges == ()


@pytest.mark.parametrize(
    ("system", "text"),
    [
        (Gain(2.0, 3), "2"),
        (Gain(np.array([1.0, -2.0])), "diag(1, \N{MINUS SIGN}2)"),
        (MatrixGain(D=np.array([[0.0, 1.0]])), "[0 1]"),
        (MatrixGain(D=np.arange(36.0).reshape(6, 6)), ""),
    ],
)
def test_gains_are_written_as_short_as_they_are(system: Any, text: str) -> None:
    matrix = gain_matrix(system)
    assert matrix is not None
    assert gain_text(matrix) == text
    assert gain_matrix(Integrator(1)) is None
