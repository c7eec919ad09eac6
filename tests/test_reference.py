"""The reference that is made of the code: it finds what it should, and ports are Drake's own."""

import importlib
import inspect
from collections.abc import Iterator
from xml.etree import ElementTree

import pytest
from docs._ext.blocks import Block, blocks, rooms
from docs._ext.figure_index import labels, mentions
from docs._ext.port_picture import port_picture
from pydrake.systems.framework import Diagram, LeafSystem, System

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import load

THESIS, CHART = "hybrid-force-position", "fsm-visual-servoing"


def every_block() -> dict[str, Block]:
    return {block.path: block for room in rooms("systems") for block in blocks(room)}


@pytest.mark.parametrize(
    ("text", "paper", "found"),
    [
        ("The servo loops of Figs. 5 to 7.", CHART, ["Fig. 5", "Fig. 6", "Fig. 7"]),
        ("Figs. 12-14", CHART, ["Fig. 12", "Fig. 13", "Fig. 14"]),
        ("(Figs. 2-3 to 2-6)", THESIS, ["Fig. 2-3", "Fig. 2-4", "Fig. 2-5", "Fig. 2-6"]),
        ("eqs. (5-5), (5-6)", THESIS, ["eq. (5-5)", "eq. (5-6)"]),
        ("sections 1.1.2 and 6.2", THESIS, ["section 1.1.2", "section 6.2"]),
        ("by eq. (23) of another paper", CHART, []),
    ],
)
def test_numbers_are_read_as_they_are_written(text: str, paper: str, found: list[str]) -> None:
    assert labels(text, paper) == found


def test_a_figure_leads_to_its_block_and_its_experiment() -> None:
    found = {(one.paper, one.label, one.path) for one in mentions()}
    assert (CHART, "Fig. 3", "chamfer.systems.servo.compensator") in found
    assert (CHART, "Fig. 8", "step-response") in found
    assert (
        THESIS,
        "Fig. 2-1",
        "chamfer.systems.force.hybrid_controller.HybridController",
    ) in found
    assert ("sensorimotor-primitives", "Fig. 5", "d-connector") in found
    assert (
        "sensorimotor-primitives",
        "Fig. 3",
        "chamfer.models.connectors.bnc_connector",
    ) in found


def test_the_picture_has_every_port_and_dashes_what_is_optional() -> None:
    picture = port_picture("A<B>", ["error", "valid (optional)"], ["command"])
    texts = [node.text for node in ElementTree.fromstring(picture).iter() if node.text]
    assert texts == ["A<B>", "error", "valid", "command"]
    assert picture.count("stroke-dasharray") == 1


def test_every_public_block_describes_its_ports() -> None:
    described = set(every_block())
    modules = {path.rpartition(".")[0] for path in described}
    for module in modules:
        for name, cls in vars(importlib.import_module(module)).items():
            if inspect.isclass(cls) and issubclass(cls, LeafSystem) and cls.__module__ == module:
                assert name.startswith("_") or f"{module}.{name}" in described


def leaves(system: System) -> Iterator[System]:
    if isinstance(system, Diagram):
        for inner in system.GetSystems():
            yield from leaves(inner)
    else:
        yield system


@pytest.mark.slow
def test_ports_are_those_of_drake() -> None:
    """Blocks have their ports in the order that is described, and each of them somewhere."""
    known = every_block()
    seen: dict[str, set[str]] = {}
    for entry in CATALOGUE.entries:
        experiment = load(entry)
        if experiment.diagram is None:
            continue
        diagram = experiment.diagram(experiment.resolve(experiment.default))
        for system in leaves(diagram):
            path = f"{type(system).__module__}.{type(system).__name__}"
            if path not in known:
                continue
            ports = seen.setdefault(path, set())
            for described, port, count in (
                (known[path].inputs, system.get_input_port, system.num_input_ports()),
                (known[path].outputs, system.get_output_port, system.num_output_ports()),
            ):
                if not any(name.startswith(("(", "<")) for name in described):
                    names = [name.removesuffix(" (optional)") for name in described]
                    real = [port(i).get_name() for i in range(count)]
                    ports |= set(real)
                    assert real == [name for name in names if name in real], path
    assert len(seen) > 40
    for path, ports in seen.items():
        described = {
            name
            for name in (*known[path].inputs, *known[path].outputs)
            if not name.startswith(("(", "<")) and not name.endswith(" (optional)")
        }
        assert described <= ports, path
