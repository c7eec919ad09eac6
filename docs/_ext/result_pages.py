"""Writes stored results into pages: figures, checks, the gallery's cards, a paper's figures."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from docs._ext.gallery import stored
from docs._ext.rst import code, container, figure, heading, plain, table

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.report.check_text import number, relation, typeset, verdict_text
from chamfer.analysis.report.checks import load_paper
from chamfer.analysis.scenario.experiment import Entry

_PAPERS: Final = {  # headings, and the pages that say what holds
    "fsm-visual-servoing": ("Visual servoing by a state machine, 2013", "state-machine-paper"),
    "hybrid-force-position": ("Hybrid position and force control, 1998", "thesis"),
    "sensorimotor-primitives": ("Sensorimotor primitives, 1995", "primitives-paper"),
}
_PAGE: Final = "reference/generated/experiments"
_WIDE: Final = 1100  # px, beyond which a drawing is folded
_TALL: Final = 700  # px
_FRAME: Final = """.. raw:: html

   <details class="replay" ontoggle="this.lastElementChild.src ||= this.dataset.src"
    data-src="../../../replays/{name}.html"><summary>Play the run in 3-D</summary>
   <iframe title="3-D replay of {name}"></iframe></details>
   <p><a href="../../../replays/{name}.html">Open the replay on its own page</a></p>
"""
_FOLD: Final = """.. raw:: html

   <details><summary>{text}</summary>

{drawing}
.. raw:: html

   </details>
"""


def figures(name: str, result: Mapping[str, Any], *, most: int | None = None) -> Iterator[str]:
    """Yield an experiment's stored figures, the first ``most`` of them."""
    for one in result["figures"][:most]:
        title = one["file"].removesuffix(".webp").replace("-", " ")
        alt = f"{title}: {sentence(one['caption'])}"
        yield figure(f"/gallery/{name}/{one['file']}", one["caption"], alt, drawn=one["drawn"])


def checks(found: Sequence[Mapping[str, Any]], *, notes: bool) -> str:
    """Return a table of checks, published next to measured, with or without notes."""
    rows = []
    for one in found:
        unit, verdict = one["unit"], verdict_text(one)
        row = [
            code(one["metric"]),
            plain(f"{typeset(relation(one))} {unit}"),
            "undefined" if one["measured"] is None else plain(f"{number(one['measured'])} {unit}"),
            verdict if one["ok"] else f"**{verdict}**",
        ]
        said = [f"*{one['kind']}:* {plain(one['source'])}", *filter(None, [plain(one["note"])])]
        rows.append([*row, "\n\n       ".join(said)] if notes else row)
    header = ("metric", "published", "measured", "verdict")
    if not notes:
        return table(header, rows, "36 24 20 20", name="checks")
    return table((*header, "kind, source and note"), rows, "23 14 13 13 37", name="checks")


def made(result: Mapping[str, Any]) -> str:
    """Return how a stored result was made."""
    drake = result["versions"]["drake"]
    return (
        f"The figures and numbers below come from this command, seed {result['seed']} and Drake "
        f"{drake}.\n"
    )


def replay(name: str) -> str:
    """Return the 3-D replay of an experiment, which loads when it is opened."""
    return _FRAME.format(name=name)


def drawing(path: str, svg: str, text: str) -> str:
    """Return a diagram or a chart, folded if it is large."""
    size = re.search(r'<svg[^>]* width="([\d.]+)" height="([\d.]+)"', svg)
    folded = size is not None and (float(size[1]) > _WIDE or float(size[2]) > _TALL)
    drawn = container("tag_wide", figure(path, f"{text}.", text))
    return _FOLD.format(text=text, drawing=drawn) if folded else drawn


def gallery(entries: Iterable[Entry]) -> Iterator[str]:
    """Yield a card for each experiment, by paper and, in that, by study."""
    for paper, of_paper in groupby(entries, key=lambda entry: entry.paper):
        title = load_paper(paper, CATALOGUE).title
        text, page = _PAPERS.get(paper, (title, ""))
        yield heading(text, "-")
        if page:
            yield f"\\{plain(title)}. :doc:`Claims and verdicts </reference/{page}>`.\n"
        listed = list(of_paper)
        for study, text in ((False, "Figures and tables of the paper"), (True, "Studies")):
            if cards := [_card(entry) for entry in listed if entry.study == study]:
                yield heading(text, "^")
                yield container("gallery", *cards)


def _card(entry: Entry) -> str:
    result = stored(entry.name)
    shown = result["figures"][:1] if result else []
    line = f"{entry.summary[0].upper()}{entry.summary[1:]}."
    parts = []
    for one in shown:
        line = sentence(one["caption"])
        picture = [
            f".. image:: /gallery/{entry.name}/{one['file']}",
            f"   :alt: {line}",
            f"   :target: {_PAGE}/{entry.name}.html",
            *(["   :class: drawn"] if one["drawn"] else []),
            "",
        ]
        parts.append("\n".join(picture))
    where = f" ({plain(entry.figure)})" if entry.figure else ""
    parts += [f":doc:`{entry.name} </{_PAGE}/{entry.name}>`{where}\n", f"{plain(line)}\n"]
    return container("card", *parts, f"``chamfer run {entry.name}``\n")


def paper_figures(paper: str) -> Iterator[str]:
    """Yield what remakes a paper's figures: ours, and its numbers next to the measured ones."""
    for entry in CATALOGUE.entries:
        result = stored(entry.name) if entry.paper == paper and entry.figure else None
        if result is None or not (result["figures"] and (result["checks"] or not entry.study)):
            continue
        yield heading(f"{entry.figure[0].upper()}{entry.figure[1:]}: {entry.name}", "~")
        yield from figures(entry.name, result, most=1)
        if result["checks"]:
            yield checks(result["checks"], notes=False)
        more = len(result["figures"]) - 1
        further = f" has {more} more figure{'s' * (more != 1)}," if more else " has"
        yield f":doc:`{entry.name} </{_PAGE}/{entry.name}>`{further} the notes and the fields.\n"


def sentence(text: str) -> str:
    """Return the first sentence of a text."""
    return re.split(r"(?<=[.!?])\s", text.strip(), maxsplit=1)[0]
