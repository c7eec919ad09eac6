"""The report: one page, self-contained HTML, made of every result in the folder."""

import base64
import re
import time
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import quote

from chamfer.analysis.report.atomic_write import locked, write_text, written
from chamfer.analysis.report.check_text import (
    EXPLAINED,
    counts,
    kept,
    number,
    relation,
    typeset,
    verdict_text,
)
from chamfer.analysis.report.checks import Verdict, load_paper
from chamfer.analysis.report.console import failed_text
from chamfer.analysis.report.results import RESULT, SWEEP, nested_values, read_result
from chamfer.analysis.scenario.experiment import Catalogue

REPORT: Final = "index.html"
_DOCUMENTS: Final = (RESULT, SWEEP)
_OF_A_LOG: Final = "identify"  # folder of a result that is no experiment's
_KINDS: Final = ("experiment", "sweep", "design")


class _Section(NamedTuple):
    """A document's part of the page."""

    kind: str
    experiment: str
    name: str
    paper: str
    figure: str
    summary: str
    anchor: str
    checks: Sequence[Mapping[str, Any]]
    counted: Mapping[Verdict, int]
    limits: Mapping[str, int]
    html: str


def write_report(out: Path, catalogue: Catalogue, *, running: str = "") -> Path:
    """Write ``out/index.html`` from the results and sweeps in ``out`` and return its path.

    Runs that write to the same folder write the page one after the other, so that the last page
    has the results of all runs. ``running`` describes the progress of a run; with it, the page
    reloads itself and all sections are open.

    Raises:
        UserError: If the page can't be written.
    """
    path = out / REPORT
    with written(path):
        out.mkdir(parents=True, exist_ok=True)
        with locked(out):
            write_text(path, report_text(out, catalogue, running=running))
    return path


def report_text(out: Path, catalogue: Catalogue, *, running: str = "") -> str:
    """Return the page as HTML: results by paper, in the order of the catalogue."""
    order = {entry.name: i for i, entry in enumerate(catalogue.entries)}
    summaries = {entry.name: entry.summary for entry in catalogue.entries}
    sections: list[_Section] = []
    unreadable: list[str] = []
    for path in sorted(path for name in _DOCUMENTS for path in out.glob(f"*/{name}")):
        if path.parent.name == _OF_A_LOG:
            continue
        try:
            sections.append(_section(path, summaries))
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            reason = f"{error} is missing" if isinstance(error, LookupError) else str(error)
            unreadable.append(f"{path.relative_to(out)}: {reason}")
    sections.sort(key=lambda one: (one.paper, order.get(one.experiment, len(order)), one.name))
    counted = {kind: sum(one.kind == kind for one in sections) for kind in _KINDS}
    total = [
        f"{count} {kind}{'s' * (count != 1)}"
        for kind, count in counted.items()
        if count or kind == "experiment"
    ]
    checks = [check for one in sections for check in one.checks]
    page = _macros().page(
        papers=[
            (load_paper(key, catalogue), list(group))
            for key, group in groupby(sections, lambda one: one.paper)
        ],
        total=", ".join(total),
        counted=counts(checks),
        far=sum(
            "not exceeded" in said or "not undercut" in said for said in map(verdict_text, checks)
        ),
        limits=kept(checks),
        explained=EXPLAINED,
        unreadable=unreadable,
        running=running,
        now=time.strftime("%H:%M:%S"),
    )
    return str(page)


def _section(path: Path, summaries: Mapping[str, str]) -> _Section:
    """Return the section of a document and the files beside it.

    Raises:
        LookupError, TypeError, ValueError, AttributeError: If it is none that the page shows.
    """
    folder, document = path.parent, read_result(path)
    kind = "sweep" if path.name == SWEEP else "design" if "design" in document else "experiment"
    experiment = str(document[kind])
    macro = getattr(_macros(), kind)
    if kind == "experiment":
        name = experiment if folder.name == experiment else f"{experiment} ({folder.name})"
        html, checks = macro(folder, document), document["checks"]
    else:
        name, html, checks = f"{experiment} ({kind})", macro(folder, document), ()
    return _Section(
        kind=kind,
        experiment=experiment,
        name=name,
        paper=str(document["paper"]),
        figure=str(document["figure"]),
        summary=summaries.get(experiment, "") if kind == "experiment" else "",
        anchor=re.sub(r"[^A-Za-z0-9-]+", "-", folder.name),
        checks=checks,
        counted=counts(checks),
        limits=kept(checks),
        html=html,
    )


@cache
def _macros() -> Any:
    from jinja2 import Environment, FileSystemLoader

    class Strict(Environment):
        """Looks a name up in a mapping, where Jinja would take a missing one as empty."""

        def getattr(self, obj: Any, attribute: str) -> Any:
            if isinstance(obj, Mapping) and not hasattr(obj, attribute):
                return obj[attribute]
            return getattr(obj, attribute)

    environment = Strict(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
    )
    environment.filters |= {
        "caption": _caption,
        "digits": lambda value, count: f"{float(value):.{count}g}",
        "encoded": _encoded,
        "failed": failed_text,
        "leaves": nested_values,
        "link": _link,
        "measured": lambda value: "undefined" if value is None else _minus(number(value)),
        "minus": _minus,
        "relation": relation,
        "typeset": typeset,
        "verdict": verdict_text,
    }
    return environment.get_template("report.html.jinja").module


def _minus(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")


def _caption(file: str) -> str:
    stem = Path(file).stem
    whole = stem.removesuffix("-overview")
    chart = whole.removeprefix("chart-")
    words = chart.replace("_", " ").replace("-", " ")
    kind = words.capitalize() if chart == whole else f"State chart: {words}"
    return ("Block diagram" if whole == "diagram" else kind) + ", overview" * (whole != stem)


def _encoded(folder: Path, name: str) -> tuple[str, str]:
    """Return a figure for an image of its own, and whether it is drawn or has pixels.

    Images keep the ids of two figures apart. What is drawn may be inverted for a dark page.
    """
    _link(folder, name)
    try:
        content = (folder / name).read_bytes()
    except OSError:
        return "", ""
    return base64.b64encode(content).decode(), "photo" if b"<image" in content else "drawn"


def _link(folder: Path, name: str) -> str:
    """Return the address of a file beside a document."""
    if Path(name).name != name:
        raise ValueError(f"{name!r} is not a file name")
    return f"{quote(folder.name)}/{quote(name)}"
