"""Writes the reference's pages when the site is built: blocks, index by figure, fields.

What they say stands in the code: docstrings, comments of fields, the experiments' metadata and the
papers' values. A Sphinx extension; the pages are in ``docs/reference/generated``.
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
from docs._ext.port_picture import port_picture
from sphinx.application import Sphinx

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.scenario_fields import allowed, default_texts, leaves
from chamfer.analysis.report.check_text import relation, typeset
from chamfer.analysis.report.checks import Published, load_paper
from chamfer.analysis.report.fingerprint import code, digest
from chamfer.analysis.scenario.experiment import Entry, load
from chamfer.systems.primitives.skill import PRIMITIVES

FOLDER: Final = ROOT / "docs" / "reference" / "generated"
_ROLE: Final = re.compile(r":(?:class|func|mod|meth|attr|data|exc):`~?([^`]+)`")
_SECTION: Final = re.compile(r"^(Args|Returns|Raises):\n((?:[ ]{4}.*\n|\n)+)", re.MULTILINE)
_ENTRY: Final = re.compile(r"^ {4}(\S[^\n]*?): ", re.MULTILINE)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before Sphinx looks for them."""
    app.connect("builder-inited", lambda _: write_pages(FOLDER))
    return {"parallel_read_safe": True}


def write_pages(folder: Path) -> None:
    """Write all pages, unless they are of these sources; those of old are gone."""
    stamp = folder / "_stamp"  # Sphinx is told to pass over names that begin so
    own = sorted(Path(__file__).parent.glob("*.py"))
    sources = digest(code(()).sources, *(path.read_bytes() for path in own)).hex()
    if stamp.exists() and stamp.read_text(encoding="utf-8") == sources:
        return
    shutil.rmtree(folder, ignore_errors=True)
    for name, text in _pages():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    stamp.write_text(sources, encoding="utf-8")


def _pages() -> Iterator[tuple[str, str]]:
    packages = [*rooms("systems"), *rooms("diagrams")]
    shown = [package for package in packages if blocks(package)]
    places = {block.path: block for package in shown for block in blocks(package)}
    for package in shown:
        yield f"blocks/{package}.rst", _blocks_page(package, places)
    yield "blocks.rst", _index("Every block", f"{len(places)} blocks and loops, by room.", shown)
    yield "primitives.rst", _primitives_page(places)
    yield "figures.rst", _figures_page(places)
    entries = CATALOGUE.entries
    yield "experiments.rst", _experiments_page(entries)
    # What a field may be is tried, a minute's work in all.
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        pages = pool.map(_experiment_page, entries)
        for entry, page in zip(entries, pages, strict=True):
            yield f"experiments/{entry.name}.rst", page


def _index(title: str, text: str, packages: Sequence[str]) -> str:
    toc = "\n".join(f"   blocks/{package}" for package in packages)
    return f"{_heading(title)}\n{text}\n\n.. toctree::\n   :maxdepth: 2\n\n{toc}\n"


def _blocks_page(package: str, places: Mapping[str, Block]) -> str:
    storey, room = package.split(".")[1:]
    kind = "Blocks" if storey == "systems" else "Loops"
    parts = [_heading(f"{kind}: {room}")]
    for block in blocks(package):
        parts += [_heading(block.name, "-"), _block(block, places)]
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
    inside = _indented("\n".join(body), 3)
    return f".. {directive}:: {block.path}{block.signature}\n\n{inside}\n"


def _primitives_page(places: Mapping[str, Block]) -> str:
    parts = [
        _heading("Every primitive"),
        "What a state of a skill runs, by the names that skills in files use; events are answered "
        "by the state that runs it.\n",
    ]
    for name, kind in PRIMITIVES.items():
        text = _prose(inspect.getdoc(kind) or "", places)
        inside = _indented(f"{text}\n\n{_parameter_table(parameters_of(kind))}", 3)
        path = f"{kind.__module__}.{name}"
        parts += [_heading(name, "-"), f".. py:class:: {path}\n\n{inside}\n"]
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
        (_code(one.name), _code(one.default), one.unit, _plain(one.meaning)) for one in parameters
    ]
    return _table(("field", "default", "unit", "meaning"), rows, "18 20 12 50")


def _figures_page(places: Mapping[str, Block]) -> str:
    parts = [
        _heading("Index by figure"),
        "Which experiment remakes a figure, which block is a box of it, and where else it stands "
        "in the code. Read from the docstrings and the experiments' metadata.\n",
    ]
    for paper, of_paper in groupby(mentions(), key=lambda one: one.paper):
        rows = [
            _figure_row(label, list(same), places)
            for label, same in groupby(of_paper, key=lambda one: one.label)
        ]
        header = ("in the paper", "experiments", "blocks and loops", "more in the code")
        parts += [
            _heading(load_paper(paper, CATALOGUE).title, "-"),
            _table(header, rows, "12 24 26 38"),
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
        _heading("Every experiment and its fields"),
        "What ``chamfer list`` and ``chamfer fields NAME`` print. A default of ``null`` is "
        "derived from other fields; what it comes to is in brackets.\n",
    ]
    for paper, same in groupby(entries, key=lambda entry: entry.paper):
        names = "\n".join(f"   experiments/{entry.name}" for entry in same)
        parts += [
            _heading(load_paper(paper, CATALOGUE).title, "-"),
            f".. toctree::\n   :maxdepth: 1\n\n{names}\n",
        ]
    return "\n".join(parts)


def _experiment_page(entry: Entry) -> str:
    experiment = load(entry)
    scenario = experiment.default
    where = (
        f"{entry.figure} of {load_paper(entry.paper, CATALOGUE).title}"
        if entry.figure
        else "Our own"
    )
    parts = [
        _heading(entry.name),
        f"{entry.summary[0].upper()}{entry.summary[1:]}. {_plain(where)}.\n",
        f"::\n\n   chamfer run {entry.name}\n",
    ]
    published = [
        one for one in load_paper(entry.paper, CATALOGUE).published if one.experiment == entry.name
    ]
    if published:
        parts += [_heading("Checks", "-"), _published_table(published)]
    with warnings.catch_warnings(action="ignore"):  # of a default that is unstable, as the paper's
        defaults = default_texts(scenario, experiment.resolve)
        rows = [
            (
                _code(leaf.path),
                _code(defaults[leaf.path]),
                leaf.unit,
                _plain(leaf.meaning),
                _plain(allowed(scenario, leaf)),
            )
            for leaf in leaves(scenario)
        ]
    header = ("field", "default", "unit", "meaning", "allowed")
    parts += [_heading("Fields", "-"), _table(header, rows, "26 14 8 32 20")]
    return "\n".join(parts)


def _published_table(published: Sequence[Published]) -> str:
    rows = [
        (_code(one.metric), _plain(_expected(one)), one.kind, _plain(one.source))
        for one in published
    ]
    header = ("metric", "expected", "kind", "source")
    return _table(header, rows, "30 20 14 36") + "\nMeasured: :doc:`/results`.\n"


def _expected(one: Published) -> str:
    return f"{typeset(relation({**vars(one), 'published': one.value}))} {one.unit}".strip()


def _heading(text: str, mark: str = "=") -> str:
    return f"{text}\n{mark * max(len(text), 4)}\n"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]], widths: str) -> str:
    lines = [".. list-table::", "   :header-rows: 1", f"   :widths: {widths}", ""]
    for row in (header, *rows):
        for i, cell in enumerate(row):
            lines.append(f"   {'* -' if i == 0 else '  -'} {cell}".rstrip())
    return "\n".join([*lines, ""])


def _code(text: str) -> str:
    return f"``{text}``" if text else ""


def _plain(text: str) -> str:
    """Return a text none of whose characters mean anything to reStructuredText."""
    return re.sub(r"([\\*`|_\[\]<>])", r"\\\1", " ".join(text.split()))


def _indented(text: str, by: int) -> str:
    return "\n".join(" " * by + line if line else "" for line in text.splitlines())
