"""Writes the reference's pages and the gallery's when the site is built.

Their texts come from the code: docstrings, comments of fields, the experiments' metadata and the
papers' values. Figures and measured values come from ``docs/gallery``, drawings from the diagrams.
A Sphinx extension; the pages are in ``docs/reference/generated``.
"""

import inspect
import re
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import groupby
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

from docs._ext.blocks import ROOT, Block, Parameter, blocks, parameters_of, rooms
from docs._ext.figure_index import Mention, mentions
from docs._ext.gallery import STORED_REPLAY, stored
from docs._ext.pictures import GALLERY
from docs._ext.port_picture import port_picture
from docs._ext.replays import SCRIPT, unpacked
from docs._ext.result_pages import (
    checks,
    drawing,
    figures,
    gallery,
    made,
    paper_figures,
    replay,
)
from docs._ext.rst import code, heading, indented, plain, table
from sphinx.application import Sphinx

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import draw, prepare
from chamfer.analysis.command.scenario_fields import allowed, default_texts, leaves
from chamfer.analysis.report.checks import load_paper
from chamfer.analysis.report.fingerprint import code as code_of
from chamfer.analysis.report.fingerprint import digest
from chamfer.analysis.report.results import RESULT
from chamfer.analysis.scenario.experiment import Entry, load
from chamfer.systems.primitives.skill import PRIMITIVES

FOLDER: Final = ROOT / "docs" / "reference" / "generated"
_ROLE: Final = re.compile(r":(?:class|func|mod|meth|attr|data|exc):`~?([^`]+)`")
_SECTION: Final = re.compile(r"^(Args|Returns|Raises):\n((?:[ ]{4}.*\n|\n)+)", re.MULTILINE)
_ENTRY: Final = re.compile(r"^ {4}(\S[^\n]*?): ", re.MULTILINE)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before Sphinx looks for them."""
    app.connect("builder-inited", lambda _: write_pages(FOLDER))
    app.connect("build-finished", lambda app, _: write_replays(Path(app.outdir, "replays")))
    app.add_css_file("gallery.css")
    return {"parallel_read_safe": True}


def write_pages(folder: Path) -> None:
    """Write all pages, unless they are of these sources; those of old are gone."""
    stamp = folder / "_stamp"  # Sphinx is told to pass over names that begin so
    own = sorted(Path(__file__).parent.glob("*.py"))
    own += sorted(GALLERY.rglob(RESULT))
    sources = digest(code_of(()).sources, *(path.read_bytes() for path in own)).hex()
    if stamp.exists() and stamp.read_text(encoding="utf-8") == sources:
        return
    shutil.rmtree(folder, ignore_errors=True)
    for name, text in _pages():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    stamp.write_text(sources, encoding="utf-8")


def write_replays(folder: Path) -> None:
    """Write the page of each stored replay, and once the script that they share."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(SCRIPT, folder)
    for path in GALLERY.glob(f"*/{STORED_REPLAY}"):
        page = unpacked(path.read_bytes())
        (folder / f"{path.parent.name}.html").write_text(page, encoding="utf-8")


def _pages() -> Iterator[tuple[str, str]]:
    packages = [*rooms("systems"), *rooms("diagrams")]
    shown = [package for package in packages if blocks(package)]
    places = {block.path: block for package in shown for block in blocks(package)}
    for package in shown:
        yield f"blocks/{package}.rst", _blocks_page(package, places)
    yield "blocks.rst", _index("Every block", f"{len(places)} blocks and loops, by folder.", shown)
    yield "primitives.rst", _primitives_page(places)
    yield "figures.rst", _figures_page(places)
    entries = CATALOGUE.entries
    yield "experiments.rst", _experiments_page(entries)
    yield "_gallery.rst", "\n".join(gallery(entries))
    for paper in {entry.paper for entry in entries}:
        yield f"_figures-{paper}.rst", "\n".join(paper_figures(paper))
    # The values that a field allows are found by trial: a minute in all.
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for files in pool.map(_experiment_files, entries):
            yield from files.items()


def _index(title: str, text: str, packages: Sequence[str]) -> str:
    toc = "\n".join(f"   blocks/{package}" for package in packages)
    return f"{heading(title)}\n{text}\n\n.. toctree::\n   :maxdepth: 2\n\n{toc}\n"


def _blocks_page(package: str, places: Mapping[str, Block]) -> str:
    storey, room = package.split(".")[1:]
    kind = "Blocks" if storey == "systems" else "Loops"
    parts = [heading(f"{kind}: {room}")]
    for block in blocks(package):
        parts += [heading(block.name, "-"), _block(block, places)]
    return "\n".join(parts)


def _block(block: Block, places: Mapping[str, Block]) -> str:
    directive = "py:class" if block.is_class else "py:function"
    body = []
    if block.is_class:
        picture = port_picture(block.name, block.inputs, block.outputs)
        body += [".. raw:: html", "", f"   {picture}", ""]
    body += [_prose(block.text, places), ""]
    for name, parameters in block.parameters:
        body += [f"Fields of ``{name}``:", "", _parameter_table(parameters), ""]
    file = f"{block.module.replace('.', '/')}.py"
    body += [f"**In** ``{file}``: " + _prose(_of_source(block.source), places)]
    inside = indented("\n".join(body), 3)
    return f".. {directive}:: {block.path}{block.signature}\n\n{inside}\n"


def _primitives_page(places: Mapping[str, Block]) -> str:
    parts = [
        heading("Every primitive"),
        "Each state of a skill runs one primitive and answers its events. Skills in files use "
        "these names.\n",
    ]
    for name, kind in PRIMITIVES.items():
        text = _prose(inspect.getdoc(kind) or "", places)
        inside = indented(f"{text}\n\n{_parameter_table(parameters_of(kind))}", 3)
        path = f"{kind.__module__}.{name}"
        parts += [heading(name, "-"), f".. py:class:: {path}\n\n{inside}\n"]
    return "\n".join(parts)


def _of_source(text: str) -> str:
    """Return a module's first paragraph, and the one that names its source, if any."""
    first, *rest = re.split(r"\n\s*\n", text)
    named = [part for part in rest if part.startswith(("Source:", "Catalogue:"))]
    return re.sub(r"::$", ".", "\n\n".join([first, *named[:1]]))


def _prose(text: str, places: Mapping[str, Block]) -> str:
    """Return a docstring as reStructuredText: roles that lead nowhere are code, sections lists."""

    def role(match: re.Match[str]) -> str:
        name = match[1]
        found = [path for path in places if path == name or path.endswith(f".{name}")]
        last = name.rpartition(".")[2]
        if len(found) != 1:
            return f"``{last}``"
        return f":py:{'class' if places[found[0]].is_class else 'func'}:`~{found[0]}`"

    def section(match: re.Match[str]) -> str:
        entries = _ENTRY.split(match[2].rstrip() + "\n")[1:]
        if not entries:
            return f"**{match[1]}:** {' '.join(match[2].split())}\n"
        pairs = zip(entries[::2], entries[1::2], strict=True)
        lines = "\n".join(f"- ``{name}``: {' '.join(said.split())}" for name, said in pairs)
        return f"**{match[1]}:**\n\n{lines}\n\n"

    return _SECTION.sub(section, _ROLE.sub(role, text) + "\n").strip()


def _parameter_table(parameters: Sequence[Parameter]) -> str:
    rows = [
        (code(one.name), code(one.default), one.unit, plain(one.meaning)) for one in parameters
    ]
    return table(("field", "default", "unit", "meaning"), rows, "18 20 12 50")


def _figures_page(places: Mapping[str, Block]) -> str:
    parts = [
        heading("Index by figure"),
        "The experiments that reproduce each figure, the blocks that implement it, and other "
        "places in the code that name it. Source: docstrings and the experiments' metadata.\n",
    ]
    for paper, of_paper in groupby(mentions(), key=lambda one: one.paper):
        rows = [
            _figure_row(label, list(same), places)
            for label, same in groupby(of_paper, key=lambda one: one.label)
        ]
        header = ("in the paper", "experiments", "blocks and loops", "more in the code")
        parts += [
            heading(load_paper(paper, CATALOGUE).title, "-"),
            table(header, rows, "12 24 26 38"),
        ]
    return "\n".join(parts)


def _figure_row(
    label: str, same: Sequence[Mention], places: Mapping[str, Block]
) -> tuple[str, ...]:
    experiments = [one.path for one in same if one.kind == "experiment"]
    named = [one.path for one in same if one.kind != "experiment"]
    found = {
        path
        for path, block in places.items()
        if path in named or (block.module in named and block.is_class)
    }
    covered = {path.rpartition(".")[0] for path in found}  # the modules of these blocks
    more = [
        path
        for path in named
        if path not in found and not {path, path.rpartition(".")[0]} & covered
    ]
    return (
        label,
        ", ".join(f":doc:`experiments/{name}`" for name in experiments),
        ", ".join(
            f":py:{'class' if places[path].is_class else 'func'}:`~{path}`"
            for path in sorted(found)
        ),
        ", ".join(f"``{'.'.join(path.split('.')[-2:])}``" for path in more),
    )


def _experiments_page(entries: Sequence[Entry]) -> str:
    parts = [
        heading("Every experiment"),
        "Each page has the figures, the checks, the block diagram and the fields of one "
        "experiment. The :doc:`gallery </gallery>` shows all of them.\n",
    ]
    for paper, same in groupby(entries, key=lambda entry: entry.paper):
        names = "\n".join(f"   experiments/{entry.name}" for entry in same)
        parts += [
            heading(load_paper(paper, CATALOGUE).title, "-"),
            f".. toctree::\n   :maxdepth: 1\n\n{names}\n",
        ]
    return "\n".join(parts)


def _experiment_files(entry: Entry) -> dict[str, str]:
    """Return the page of an experiment and its drawings."""
    folder = f"experiments/{entry.name}"
    with warnings.catch_warnings(action="ignore"):  # of a default that is unstable, as the paper's
        (job,) = prepare([entry])
        drawings = {name: svg for name, svg in draw(job).items() if name.endswith(".svg")}
        fields = _fields_table(entry)
    parts = [*_results_of(entry), *_drawings_of(folder, drawings)]
    if (GALLERY / entry.name / STORED_REPLAY).exists():
        parts += [heading("3-D replay", "-"), replay(entry.name)]
    files = {f"{folder}.rst": "\n".join([*parts, heading("Fields", "-"), fields])}
    return files | {f"{folder}/{name}": svg for name, svg in drawings.items()}


def _results_of(entry: Entry) -> list[str]:
    paper, result = load_paper(entry.paper, CATALOGUE), stored(entry.name)
    where = f"{entry.figure} of {paper.title}" if entry.figure else "a study of this project"
    parts = [
        heading(entry.name),
        f"{entry.summary[0].upper()}{entry.summary[1:]}. {plain(where[0].upper() + where[1:])}.\n",
        f"::\n\n   chamfer run {entry.name}\n",
    ]
    if result is None:
        return parts
    parts += [made(result), *figures(entry.name, result)]
    if result["checks"]:
        parts += [heading("Checks", "-"), checks(result["checks"], notes=True)]
    return parts


def _drawings_of(folder: str, drawings: Mapping[str, str]) -> list[str]:
    parts = [heading("Diagrams", "-")] if drawings else []
    for name, svg in drawings.items():
        stem = name.removesuffix(".svg")
        chart = stem.removesuffix("-overview").removeprefix("chart-").replace("-", " ")
        text = "Block diagram" if chart == "diagram" else f"State chart: {chart}"
        text += ", overview" if stem.endswith("-overview") else ""
        parts.append(drawing(f"/reference/generated/{folder}/{name}", svg, text))
    return parts


def _fields_table(entry: Entry) -> str:
    experiment = load(entry)
    scenario = experiment.default
    defaults = default_texts(scenario, experiment.resolve)
    rows = [
        (
            code(leaf.path),
            code(defaults[leaf.path]),
            leaf.unit,
            plain(leaf.meaning),
            plain(allowed(scenario, leaf)),
        )
        for leaf in leaves(scenario)
    ]
    text = (
        "``--set FIELD=VALUE`` changes a field. A default of ``null`` is derived from other "
        "fields; its derived value is in brackets.\n"
    )
    header = ("field", "default", "unit", "meaning", "allowed")
    return "\n".join([text, table(header, rows, "24 16 8 30 22", name="fields")])
