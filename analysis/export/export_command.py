"""The command ``chamfer export``: laws and state machines without Python."""

import argparse
import re
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.report.console import say
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, select

if TYPE_CHECKING:
    from chamfer.analysis.command.running import Job
    from chamfer.analysis.export.c_code import LawInC

Files = Mapping[str, str | bytes]


def add_export(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command, without the scenario's options and ``--out``."""
    export: argparse.ArgumentParser = commands.add_parser(
        "export",
        help="write an experiment's controllers as C, FMU, SCXML or Mermaid",
        description="Writes an experiment's controllers into OUT/NAME/export. Format c is C99 "
        "without"
        " dynamic allocation, with outputs that equal the simulated ones to the last bit."
        " Format fmu is the same code as a co-simulation unit, FMI 2.0. Format scxml has "
        "the state charts, for any W3C SCXML engine. Format mermaid has the block diagram"
        " and the charts as text.",
    )
    export.add_argument("name", metavar="NAME", help="an experiment of `chamfer list`")
    export.add_argument("--format", required=True, choices=_FORMATS, help="format of the files")
    export.set_defaults(command=_export)
    return export


def _export(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.command.running import named_failures, prepare
    from chamfer.analysis.report.atomic_write import written
    from chamfer.analysis.report.results import write_folder

    chosen = select(catalogue.entries, [arguments.name])
    (job,) = prepare(
        chosen, file=arguments.scenario, settings=arguments.settings, catalogue=catalogue
    )
    with named_failures(job.entry.name, job.overrides):
        files = _FORMATS[arguments.format](job)
        if not files:
            others = {"c": "c, fmu", "scxml": "scxml", "mermaid": "mermaid"}
            there = ", ".join(text for name, text in others.items() if _FORMATS[name](job))
            instead = f" as {arguments.format}, there is: {there}" if there else ""
            raise UserError(f"has nothing to export{instead}")
    require_writable(arguments.out, [job.entry.name])
    folder = arguments.out / job.entry.name / "export"
    with written(folder):
        write_folder(folder, files)
    for name in files:
        print(folder / name)
    return 0


def _c(job: "Job") -> Files:
    return {name: text for law in _laws(job) for name, text in law.files().items()}


def _fmu(job: "Job") -> Files:
    from chamfer.analysis.export.fmu import compiler, fmu

    laws, found = _laws(job), compiler()
    if laws and found is None:
        say("without a C compiler for Linux on x86-64 a unit holds its sources alone")
    experiment = job.entry.name
    return {
        f"{experiment}-{law.name}.fmu": fmu(law, experiment, tool=_tool(), compiler=found)
        for law in laws
    }


def _scxml(job: "Job") -> Files:
    from chamfer.analysis.export.scxml import scxml

    charts = () if job.experiment.charts is None else job.experiment.charts(job.scenario)
    return {f"{re.sub('[ /]', '-', chart.name)}.scxml": scxml(chart) for chart in charts}


def _mermaid(job: "Job") -> Files:
    from chamfer.analysis.command.running import draw

    return {name: text for name, text in draw(job).items() if name.endswith(".mmd")}


_FORMATS: Final[Mapping[str, Callable[["Job"], Files]]] = {
    "c": _c,
    "fmu": _fmu,
    "scxml": _scxml,
    "mermaid": _mermaid,
}


def _laws(job: "Job") -> "list[LawInC]":
    from chamfer.analysis.export.c_code import laws_in_c
    from chamfer.analysis.report.results import command_text
    from chamfer.analysis.scenario.scenario_io import sha256, unstructure

    if job.experiment.diagram is None:
        return []
    made = command_text("export", job.entry.name, job.overrides, "--format", "c", seed=0)
    scenario = sha256(unstructure(job.scenario))
    origin = (f"{_tool()}: {made}", f"Scenario: SHA-256 {scenario[:16]}")
    return laws_in_c(job.experiment.diagram(job.scenario), origin)


def _tool() -> str:
    try:
        return f"Chamfer {version('chamfer')}"
    except PackageNotFoundError:
        return "Chamfer"
