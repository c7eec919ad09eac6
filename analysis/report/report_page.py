"""The report's page as HTML: self-contained, for a screen, a phone and paper."""

import base64
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Literal, get_args
from urllib.parse import quote

from chamfer.analysis.report.check_text import (
    EXPLAINED,
    WORDS,
    counts,
    counts_text,
    number,
    relation,
    typeset,
    verdict_text,
)
from chamfer.analysis.report.checks import Verdict
from chamfer.analysis.report.console import failed_text
from chamfer.analysis.report.report_style import STYLE

Kind = Literal["experiment", "sweep", "design"]

_MARKS: Final[dict[Verdict, str]] = {"holds": "✓", "does_not_hold": "✗", "not_reached": "△"}


@dataclass(frozen=True, kw_only=True)
class Section:
    """An experiment's part of the page."""

    name: str
    experiment: str
    paper: str
    figure: str
    anchor: str
    counted: Mapping[Verdict, int]
    html: str
    kind: Kind = "experiment"

    @classmethod
    def make(cls, folder: Path, result: Mapping[str, Any], summary: str) -> "Section":
        """Make a section from a result and the files beside it.

        Args:
            folder: Where the result and its figures are.
            result: The result's document.
            summary: What the experiment is, in one line.

        Raises:
            LookupError, TypeError, ValueError, AttributeError: If the document is not a result.
        """
        name = str(result["experiment"])
        anchor = re.sub(r"[^A-Za-z0-9-]+", "-", folder.name)
        return cls(
            name=name if folder.name == name else f"{name} ({folder.name})",
            experiment=name,
            paper=str(result["paper"]),
            figure=str(result["figure"]),
            anchor=anchor,
            counted=counts(result["checks"]),
            html="\n".join(_section_body(folder, result, summary)),
        )

    @classmethod
    def of_document(
        cls, kind: Literal["sweep", "design"], folder: Path, document: Mapping[str, Any]
    ) -> "Section":
        """Make a section from the document of a sweep or a design and the files beside it.

        Raises:
            LookupError, TypeError, ValueError, AttributeError: If the document is none of those.
        """
        body = _sweep_body if kind == "sweep" else _design_body
        return cls(
            name=f"{document[kind]} ({kind})",
            experiment=str(document[kind]),
            paper=str(document["paper"]),
            figure=str(document["figure"]),
            anchor=re.sub(r"[^A-Za-z0-9-]+", "-", folder.name),
            counted=counts(()),
            html="\n".join(body(folder, document)),
            kind=kind,
        )


def page(
    sections: Sequence[Section],
    titles: Mapping[str, str],
    unreadable: Sequence[str],
    *,
    running: str = "",
) -> str:
    """Return the whole page.

    Args:
        sections: The experiments, in the order of the list.
        titles: The papers' titles by key.
        unreadable: What could not be read, each with the reason.
        running: What of a run that goes on has ended; the page reloads itself then.
    """
    papers = [(key, list(group)) for key, group in groupby(sections, lambda one: one.paper)]
    total = {verdict: sum(one.counted[verdict] for one in sections) for verdict in WORDS}
    body = [
        "<header>",
        "<h1>Chamfer: published against measured</h1>",
        "<p>Experiments of published papers on compliant assembly, simulated, with every number "
        f"that a paper prints beside the one that was measured. {EXPLAINED} What is not as "
        "published is explained where it stands.</p>",
        f'<p class="total">{_counted_sections(sections)}, {counts_text(total)}</p>',
        *([f'<p class="running">Running: {escape(running)}, at {_now()}.</p>'] if running else []),
        "</header>",
        _contents(papers, titles),
    ]
    if unreadable:
        items = "".join(f"<li>{escape(one)}</li>" for one in unreadable)
        body.append(f'<section class="unreadable"><h2>Unreadable results</h2><ul>{items}</ul>')
        body.append("</section>")
    for key, group in papers:
        body.append(f'<section><h2 id="paper-{escape(key)}">{escape(titles.get(key, key))}</h2>')
        for one in group:
            figure = f' <span class="figure">{escape(one.figure)}</span>' if one.figure else ""
            body.append(f'<article id="{one.anchor}"><h3>{escape(one.name)}{figure}</h3>')
            body.append(one.html)
            body.append('<p class="back"><a href="#contents">back to the contents</a></p>')
            body.append("</article>")
        body.append("</section>")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        + ('<meta http-equiv="refresh" content="10">\n' if running else "")
        + f"<title>Chamfer: published against measured</title>\n<style>{STYLE}</style>\n"
        "</head>\n<body>\n" + "\n".join(body) + "\n</body>\n</html>\n"
    )


def _now() -> str:
    return time.strftime("%H:%M:%S")


def _counted_sections(sections: Sequence[Section]) -> str:
    counted = {kind: sum(one.kind == kind for one in sections) for kind in get_args(Kind)}
    return ", ".join(
        f"{count} {kind}{'s' * (count != 1)}"
        for kind, count in counted.items()
        if count or kind == "experiment"
    )


def _contents(papers: Sequence[tuple[str, list[Section]]], titles: Mapping[str, str]) -> str:
    rows = []
    for key, group in papers:
        title = escape(titles.get(key, key))
        rows.append(
            f'<tr class="paper"><th colspan="{2 + len(WORDS)}"><a href="#paper-{escape(key)}">'
            f"{title}</a></th></tr>"
        )
        rows += [
            f'<tr><td><a href="#{one.anchor}">{escape(one.name)}</a></td>'
            f"<td>{escape(one.figure)}</td>{_counted(one.counted)}</tr>"
            for one in group
        ]
    verdicts = "".join(f'<th class="number">{words}</th>' for words in WORDS.values())
    return (
        '<nav id="contents"><h2>Contents</h2><table><thead><tr><th>experiment</th>'
        f"<th>figure</th>{verdicts}</tr></thead><tbody>{''.join(rows)}</tbody></table></nav>"
    )


def _counted(counted: Mapping[Verdict, int]) -> str:
    cells = []
    for verdict, count in counted.items():
        bold = count and verdict != "holds"
        shown = f"<strong>{_MARKS[verdict]} {count}</strong>" if bold else str(count)
        cells.append(f'<td class="number {verdict}">{shown}</td>')
    return "".join(cells)


def _section_body(folder: Path, result: Mapping[str, Any], summary: str) -> Iterator[str]:
    if summary:
        yield f"<p>{escape(summary)}</p>"
    if result["checks"]:
        yield _checks(result["checks"])
    else:
        yield from _different(result, " Published values apply to the default one only.")
    if failed := result.get("failed_trials"):
        yield (
            f'<p class="missing">{escape(failed_text(failed))}. The numbers are of the trials '
            "that finished.</p>"
        )
    for name in result["figures"]:
        if str(name).endswith(".svg"):
            yield _image(folder, str(name), "chart")
    for name in result["drawings"]:
        yield _image(folder, str(name), "drawing")
    if (replay := result.get("replay")) is not None:
        yield _replay(folder, str(replay))
    metrics = "".join(_metric(name, metric) for name, metric in result["metrics"].items())
    yield (
        f"<details><summary>All {len(result['metrics'])} metrics</summary>"
        '<table class="plain"><thead><tr><th>metric</th><th class="number">measured</th>'
        f"<th>unit</th><th>note</th></tr></thead><tbody>{metrics}</tbody></table></details>"
    )
    values = "".join(
        f"<tr><td>{escape(path)}</td><td>{escape(value)}</td></tr>"
        for path, value in _leaves(result["scenario"], "")
    )
    yield (
        '<details><summary>Scenario</summary><table class="plain"><tbody>'
        f"{values}</tbody></table></details>"
    )
    yield from _remake(result)
    yield (
        f'<p class="fine">{_times(result)}, scenario '
        f"{escape(str(result['scenario_sha256'])[:12])}. Versions: {_versions(result)}.</p>"
    )


def _different(document: Mapping[str, Any], more: str = "") -> Iterator[str]:
    if document["overrides"]:
        listed = ", ".join(f"<code>{escape(str(one))}</code>" for one in document["overrides"])
        yield f'<p class="different">Not the default scenario: {listed}.{more}</p>'


def _remake(document: Mapping[str, Any]) -> Iterator[str]:
    yield f"<p>Remake it:</p><pre>{escape(str(document['command']))}</pre>"


def _times(document: Mapping[str, Any]) -> str:
    return (
        f"{float(document['simulated_seconds']):.4g} s simulated in "
        f"{float(document['wall_seconds']):.3g} s, seed {int(document['seed'])}"
    )


def _versions(document: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{escape(str(name))} {escape(str(version or 'unknown'))}"
        for name, version in document["versions"].items()
    )


def _sweep_body(folder: Path, document: Mapping[str, Any]) -> Iterator[str]:
    points, ok, trials = (int(document[name]) for name in ("points", "points_ok", "trials"))
    seeds = f", {trials} seeds each" if trials > 1 else ""
    yield (
        f"<p>The experiment at {points} point{'s' * (points != 1)} of its scenario"
        f" ({escape(str(document['design']))}{seeds}), {ok} with a result.</p>"
    )
    yield from _different(document)
    fields = "".join(
        f"<tr><td><code>{escape(str(field['vary']))}</code></td>"
        f"<td>{escape(str(field['unit']))}</td><td>{escape(str(field['meaning']))}</td></tr>"
        for field in document["fields"]
    )
    yield (
        '<table class="plain"><thead><tr><th>varied</th><th>unit</th><th>meaning</th></tr></thead>'
        f"<tbody>{fields}</tbody></table>"
    )
    for name in document["figures"]:
        if str(name).endswith(".svg"):
            yield _image(folder, str(name), "chart")
    if document["reasons"]:
        reasons = "".join(
            f'<tr><td class="number">{int(count)}</td><td>{escape(str(reason))}</td></tr>'
            for reason, count in document["reasons"].items()
        )
        yield (
            '<details><summary>Points without a result</summary><table class="plain"><thead><tr>'
            f'<th class="number">points</th><th>reason</th></tr></thead><tbody>{reasons}</tbody>'
            "</table></details>"
        )
    link = escape(f"{quote(folder.name)}/points.csv")
    yield f'<p><a href="{link}">All points</a> with {len(document["metrics"])} metrics</p>'
    yield from _remake(document)
    yield f'<p class="fine">{_times(document)}. Versions: {_versions(document)}.</p>'


def _design_body(folder: Path, document: Mapping[str, Any]) -> Iterator[str]:
    yield (
        f"<p>Verdict: <strong>{escape(str(document['verdict']))}</strong>, limited by "
        f"{escape(str(document['limiting_link']))}.</p>"
    )
    yield from _different(document)
    for name in document["figures"]:
        if str(name).endswith(".svg"):
            yield _image(folder, str(name), "chart")
    page = str(document["page"])
    _require_file_name(page)
    link = escape(f"{quote(folder.name)}/{quote(page)}")
    yield f'<p><a href="{link}">Data sheet</a></p>'
    yield from _remake(document)
    yield f'<p class="fine">Versions: {_versions(document)}.</p>'


def _checks(checks: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for check in checks:
        kind = check["verdict"]
        verdict = f"{_MARKS[kind]} {verdict_text(check)}"
        unit = str(check["unit"])
        cells = (
            ("metric", _metric_name(str(check["metric"]))),
            ("published", escape(_with_unit(_minus(typeset(relation(check))), unit))),
            ("measured", escape(_with_unit(_number(check["measured"]), unit))),
            ("kind", escape(str(check["kind"]))),
            ("source", escape(str(check["source"]))),
            ("verdict", f'<span class="verdict">{verdict}</span>'),
        )
        row = "".join(f'<td data-label="{label}">{cell}</td>' for label, cell in cells)
        noted = " noted" if check["note"] else ""
        rows.append(f'<tr class="{kind}{noted}">{row}</tr>')
        if check["note"]:
            note = escape(str(check["note"]))
            rows.append(f'<tr class="{kind} note"><td colspan="6">{note}</td></tr>')
    head = "".join(
        f"<th>{label}</th>"
        for label in ("metric", "published", "measured", "kind", "source", "verdict")
    )
    return (
        f'<table class="checks"><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _metric(name: str, metric: Mapping[str, Any]) -> str:
    return (
        f'<tr><td>{_metric_name(name)}</td><td class="number">{_number(metric["value"])}'
        f"</td><td>{escape(str(metric['unit']))}</td>"
        f"<td>{escape(str(metric.get('note', '')))}</td></tr>"
    )


def _metric_name(name: str) -> str:
    """Return a name that breaks at its dots and underscores where the column is narrow."""
    breakable = re.sub("([._])", r"\1<wbr>", escape(name))
    return f"<code>{breakable}</code>"


def _replay(folder: Path, name: str) -> str:
    """Return a link to the replay: it is ten times as large as the page."""
    _require_file_name(name)
    if not (folder / name).is_file():
        return f'<p class="missing">The 3-D replay {escape(name)} is missing.</p>'
    link = escape(f"{quote(folder.name)}/{quote(name)}")
    return f'<p class="replay"><a href="{link}">3-D replay</a> (needs a browser with WebGL)</p>'


def _image(folder: Path, name: str, kind: str) -> str:
    """Return a figure as an image of its own, so that the ids of two figures don't collide."""
    _require_file_name(name)
    title = escape(_caption(Path(name).stem))
    try:
        content = base64.b64encode((folder / name).read_bytes()).decode()
    except OSError:
        return f'<p class="missing">The figure {escape(name)} is missing.</p>'
    return (
        f'<figure class="{kind}"><img alt="{title}" src="data:image/svg+xml;base64,{content}">'
        f"<figcaption>{title}</figcaption></figure>"
    )


def _require_file_name(name: str) -> None:
    if Path(name).name != name:
        raise ValueError(f"{name!r} is not a file name")


def _caption(stem: str) -> str:
    if stem == "diagram":
        return "Block diagram"
    chart, separator, name = stem.partition("chart-")
    words = (name if separator and not chart else stem).replace("_", " ").replace("-", " ")
    return f"State chart: {words}" if separator and not chart else words.capitalize()


def _leaves(value: Any, path: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(inner, f"{path}.{name}" if path else str(name))
    else:
        yield path, "null" if value is None else str(value)


def _number(value: float | None) -> str:
    return "undefined" if value is None else _minus(number(value))


def _minus(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}" if unit else text
