"""The report: one page made of every result in the folder."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.report.atomic_write import write_text
from chamfer.analysis.report.checks import load_paper
from chamfer.analysis.report.report_page import Section, page
from chamfer.analysis.report.results import RESULT, SWEEP, read_result
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, Entry

REPORT = "index.html"
_DOCUMENTS = (RESULT, SWEEP)


def write_report(
    out: Path,
    entries: Sequence[Entry],
    catalogue: Catalogue = CATALOGUE,
    *,
    running: str = "",
) -> Path:
    """Write ``out/index.html`` from the results and sweeps in ``out`` and return its path.

    A result that appears while the page is made, because another run writes to the same folder,
    makes it start again: the last one to write has seen everything.

    Raises:
        UserError: If the page can't be written.
    """
    path = out / REPORT
    try:
        out.mkdir(parents=True, exist_ok=True)
        while True:
            seen = _signature(out)
            write_text(path, report_text(out, entries, catalogue, running=running))
            if _signature(out) == seen:
                return path
    except OSError as error:
        raise UserError(f"{path} can't be written: {error.strerror or error}") from error


def report_text(
    out: Path,
    entries: Sequence[Entry],
    catalogue: Catalogue = CATALOGUE,
    *,
    running: str = "",
) -> str:
    """Return the page as HTML: results by paper, in the order of the registry."""
    order = {entry.name: i for i, entry in enumerate(entries)}
    summaries = {entry.name: entry.summary for entry in entries}
    sections: list[Section] = []
    unreadable: list[str] = []
    for path in sorted(path for name in _DOCUMENTS for path in out.glob(f"*/{name}")):
        try:
            document = read_result(path)
            if path.name == SWEEP:
                sections.append(Section.of_document("sweep", path.parent, document))
                continue
            if "design" in document:
                sections.append(Section.of_document("design", path.parent, document))
                continue
            sections.append(
                Section.make(path.parent, document, summaries.get(str(document["experiment"]), ""))
            )
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            reason = f"{error} is missing" if isinstance(error, LookupError) else str(error)
            unreadable.append(f"{path.relative_to(out)}: {reason}")
    sections.sort(key=lambda one: (one.paper, order.get(one.experiment, len(order)), one.name))
    titles = {key: load_paper(key, catalogue).title for key in {one.paper for one in sections}}
    return page(sections, titles, unreadable, running=running)


def _signature(out: Path) -> list[Any]:
    return sorted(
        (path, os.stat(path).st_mtime_ns)
        for entry in os.scandir(out)
        if entry.is_dir()
        for name in _DOCUMENTS
        if os.path.isfile(path := os.path.join(entry.path, name))
    )
