"""A design's page as HTML: self-contained, on paper a data sheet of one A4 sheet."""

import base64
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any, Final

from chamfer.analysis.design.cell_picture import STYLE as CELL_STYLE
from chamfer.analysis.design.cell_picture import cell_picture
from chamfer.analysis.design.design_words import (
    assumed,
    bound_rows,
    change_cells,
    change_sentence,
    effective,
    ending_sentences,
    kept_by_design,
    limit_sentence,
    link_cells,
    map_sentence,
    pair_sentences,
    quantity,
    share_sentence,
    verdict_sentence,
    verified_sentence,
)

STYLE: Final = """
@page { size: A4; margin: 9mm 10mm; }
:root { --line: #d0d7de; --soft: #57606a; --tint: #f6f8fa; --certain: #1b4f9c;
  --likely: #8a6100; --no: #b5482a; --ink: #1f2328; --paper: #fff; color-scheme: light dark; }
@media screen and (prefers-color-scheme: dark) {
  :root { --line: #3d444d; --soft: #9ba5b0; --tint: #1c2128; --certain: #6fa0e8;
    --likely: #e0b000; --no: #f08060; --ink: #e6edf3; --paper: #0d1117; }
}
* { box-sizing: border-box; print-color-adjust: exact; -webkit-print-color-adjust: exact; }
body { font: 14px/1.4 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 62rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5em; line-height: 1.2; margin: 0 0 .2em; }
h3 { font-size: 1.05em; margin: .9em 0 .2em; }
p { margin: .2em 0; }
code, pre { font: .9em/1.4 ui-monospace, monospace; }
pre { background: var(--tint); border: 1px solid var(--line); padding: .3em .5em; margin: 0;
  white-space: pre-wrap; overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; font-size: .93em; }
th, td { text-align: left; vertical-align: top; padding: .18em .5em .18em 0;
  border-bottom: 1px solid var(--line); }
th { color: var(--soft); font-weight: 600; border-bottom-width: 2px; }
.number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
th.number { white-space: normal; }
.links td:nth-child(7) { white-space: nowrap; }
.links td:nth-child(6) { min-width: 4em; }
.links td:last-child { color: var(--soft); font-size: .88em; width: 44%; }
.limits td { background: var(--tint); }
.limits td:first-child { font-weight: 700; border-left: 4px solid var(--ink); padding-left: .4em; }
.outside .bar i { background: var(--no); }
.outside .number, .outside .share { color: var(--no); font-weight: 600; }
.bar { display: inline-block; position: relative; width: 5.5em; height: .75em;
  background: linear-gradient(90deg, transparent calc(50% - .5px), var(--ink) 0,
  var(--ink) calc(50% + .5px), transparent 0) var(--tint); border: 1px solid var(--line); }
.bar i { position: absolute; top: 0; bottom: 0; background: var(--certain); }
.share { display: inline-block; min-width: 4em; text-align: right;
  font-variant-numeric: tabular-nums; }
.verdict { display: flex; gap: 1.2em; align-items: center; border: 3px solid var(--mark);
  padding: .4em .8em; margin: .6em 0; }
.verdict h2 { font-size: 2em; margin: 0; color: var(--mark); min-width: 4em;
  text-align: center; }
.certain { --mark: var(--certain); }
.likely { --mark: var(--likely); }
.no { --mark: var(--no); }
.beside { display: grid; grid-template-columns: 3fr 2fr; gap: 1.2em; }
.beside > * { min-width: 0; }
.rest figure { grid-column: 1 / -1; }
.warning { border: 2px solid var(--no); color: var(--no); font-weight: 700; padding: .2em .5em; }
ul { margin: .2em 0; padding-left: 1.2em; }
figure { margin: .3em 0; }
figure img { display: block; width: 100%; max-height: 24rem; height: auto; }
.fine, figcaption, footer { color: var(--soft); font-size: .88em; }
footer { margin-top: .8em; overflow-wrap: anywhere; }
@media screen and (max-width: 44rem) {
  .beside, .verdict { display: block; }
  table { font-size: .85em; }
  td code { overflow-wrap: anywhere; }
  .bar, .links td:nth-child(5), .links th:nth-child(5), .links td:last-child,
  .links th:last-child { display: none; }
}
@media print {
  body { font-size: 7.3pt; line-height: 1.3; max-width: none; padding: 0; }
  figure img { max-height: 46mm; }
  .bar { width: 4em; }
  .links td:last-child { font-size: .82em; width: 52%; }
  .links td:nth-child(6) { white-space: nowrap; }
  .rest { grid-template-rows: auto 1fr; }
  .rest .right { grid-area: 1 / 2 / 3; }
  .rest figure { grid-column: 1; }
  th, td { padding: .1em .5em .1em 0; }
  tr, section.verdict, figure { break-inside: avoid; }
}
"""


_MOST_CHANGES: Final = 12
_MOST_CHANGES_BY_MAP: Final = 7
_MOST_ENDINGS: Final = 4
_MOST_SETTINGS: Final = 12

_CERTAIN: Final = "“Certain” means that none of them is outside. It is not a probability of 100 %."
_KEPT: Final = "by design: limits only where no other link can."

Document = Mapping[str, Any]


def design_page(document: Document, said: str, figure: bytes | None) -> str:
    """Return the page of a ``result.json``, with a sentence on the cell and the map as SVG."""
    title = f"Design of an {document['design']}"
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}{CELL_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(_body(document, title, said, figure))
        + "\n</body>\n</html>\n"
    )


def _body(document: Document, title: str, said: str, figure: bytes | None) -> Iterator[str]:
    verdict = document["verdict"]
    yield f'<div class="beside"><header><h1>{title}</h1><p>{escape(said)}</p>{_settings(document)}'
    yield from (f'<p class="warning">{escape(one)}</p>' for one in document.get("warnings") or ())
    means = verdict_sentence(document).partition(": ")[2]
    sure = verdict == document["predicted_verdict"] == "certain"
    yield (
        f'<section class="verdict {verdict}"><h2>{verdict}</h2><div>'
        f"<p>{escape(means[0].upper() + means[1:])}. {escape(share_sentence(document))}.</p>"
        + (f'<p class="fine">{_CERTAIN}</p>' if sure else "")
        + f"<p>Limited by <strong>{escape(document['limiting_link'])}</strong>"
        f"{escape(limit_sentence(document).removeprefix(document['limiting_link']))}.</p>"
        f"<p>{escape(change_sentence(document))}.{_none_simulated(document)}</p></div></section>"
        f"</header><figure>{cell_picture(document)}</figure></div>"
    )
    yield f"<section><h3>Margin of each link</h3>{_links(document)}</section>"
    sections = [
        _changes(document),
        _verified(document["verified"]),
        _bounds(document),
        _assumptions(document),
    ]
    left, *right = [one for one in sections if one] or [""]
    yield f'<div class="beside rest"><section>{left}</section>'
    yield f'<section class="right">{"".join(right)}</section>' if right else ""
    if figure is not None:
        content = base64.b64encode(figure).decode()
        yield (
            f'<figure><img alt="map" src="data:image/svg+xml;base64,{content}">'
            f"<figcaption>{escape(map_sentence(document['map']))}</figcaption></figure>"
        )
    yield "</div>"
    versions = ", ".join(
        f"{name} {version or 'unknown'}" for name, version in document["versions"].items()
    )
    yield (
        f"<footer><pre>{escape(document['command'])}</pre><p>seed {document['seed']}, scenario "
        f"{document['scenario_sha256'][:12]}, {escape(versions)}. A simulation and a theory, not "
        "a guarantee of hardware.</p></footer>"
    )


def _settings(document: Document) -> str:
    settings = document["overrides"]
    if not settings:
        return '<p class="fine">All fields have their defaults.</p>'
    shown = [f"<code>{escape(one)}</code>" for one in settings[:_MOST_SETTINGS]]
    if len(settings) > _MOST_SETTINGS:
        shown.append(f"{len(settings) - _MOST_SETTINGS} more in scenario.yaml")
    return f'<p class="fine">Different from the defaults: {", ".join(shown)}</p>'


def _links(document: Document) -> str:
    rows = []
    # To the left as far as the worst link, so that its bar is the longest.
    worst = max(1.0, *(-(link["share"] or 0.0) for link in document["links"]))
    for link in document["links"]:
        limits = link["name"] == document["limiting_link"]
        outside = link["margin"] is not None and link["margin"] < 0
        kinds = [*(["limits"] if limits else []), *(["outside"] if outside else [])]
        bound, side, allowed, margin, unit, share, source = link_cells(link)
        rows.append(
            f'<tr class="{" ".join(kinds)}"><td>{escape(link["name"])}</td>'
            f'<td class="number">{bound}</td><td>{"≥" if side == "at least" else "≤"}</td>'
            f'<td class="number">{allowed}</td><td class="number">{margin}</td>'
            f"<td>{escape(unit)}</td><td>{_bar(link, share, worst)}</td>"
            f"<td>{escape(source)}</td></tr>"
        )
    head = (
        '<th>link</th><th class="number">bound</th><th></th><th class="number">allowed</th>'
        '<th class="number">margin</th><th>unit</th><th>margin in %</th>'
        "<th>source</th>"
    )
    kept = any(map(kept_by_design, document["links"]))
    return (
        f'<table class="links"><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
        + (f'<p class="fine">{_KEPT}</p>' if kept else "")
    )


def _bar(link: Document, said: str, worst: float) -> str:
    """Return a bar of the margin's share: to the right inside, to the left outside.

    A link that is kept by design has none, so that the shortest bar is that of the limiting link.
    """
    share = link["share"]
    if share is None:
        return ""
    if kept_by_design(link):
        return f'<span class="fine">{said}</span>'
    width = 50 * (min(share, 1.0) if share >= 0 else -share / worst)
    left = 50.0 if share >= 0 else 50.0 - width
    return (
        f'<span class="bar"><i style="left:{left:.1f}%;width:{width:.1f}%"></i></span>'
        f'<span class="share">{said}</span>'
    )


def _changes(document: Document) -> str:
    changes, others = effective(document)
    rows, most = "", _MOST_CHANGES_BY_MAP if document["map"] else _MOST_CHANGES
    for change in changes[:most]:
        path, *numbers = change_cells(change)
        cells = "".join(f'<td class="number">{one}</td>' for one in numbers)
        meaning = escape(change["meaning"], quote=True)
        rows += f"<tr><td title='{meaning}'><code>{escape(path)}</code></td>{cells}</tr>"
    head = (
        '<th>field</th><th class="number">value</th>'
        '<th class="number">margin change for +10&#160;%</th>'
        '<th class="number">best single value</th>'
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>" if rows else ""
    both = "".join(f"<p>Pair: {escape(pair)}.</p>" for pair in pair_sentences(document))
    more = f"{len(changes) - most} more in result.json. " if len(changes) > most else ""
    none = f"No effect on the limiting margin: {escape(others)}." if others else ""
    rest = f'<p class="fine">{more}{none}</p>' if more or none else ""
    return f"<h3>Suggested changes</h3>{table}{both}{rest}" if table or both or rest else ""


def _none_simulated(document: Document) -> str:
    if document["verified"] is not None:
        return ""
    return " No insertion was simulated (<code>--verify 20</code> simulates 20)."


def _verified(verified: Document | None) -> str:
    if verified is None:
        return ""
    endings = ending_sentences(verified)
    items = "".join(f"<li>{escape(one)}</li>" for one in endings[:_MOST_ENDINGS])
    warning = verified["warning"]
    return (
        f"<h3>Simulated insertions</h3><p>{escape(verified_sentence(verified))}; contact forces "
        f"up to {quantity(verified['largest_force'], 'N')}.</p>"
        + (f"<ul>{items}</ul>" if items else "")
        + (f'<p class="warning">Contradicted: {escape(warning)}.</p>' if warning else "")
    )


def _bounds(document: Document) -> str:
    rows = "".join(
        f"<tr><td>{escape(name)}</td>"
        + "".join(f'<td class="number">{one}</td>' for one in rest)
        + "</tr>"
        for name, *rest in bound_rows(document)
    )
    head = "".join(
        f'<th class="number">{one}</th>' for one in ("promised", "of all cells", "confidence")
    )
    table = f"<table><thead><tr><th>bound</th>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return f"<h3>Promised bounds</h3>{table}" if rows else ""


def _assumptions(document: Document) -> str:
    items = "".join(
        f"<li><code>{escape(fields)}</code>: "
        + (f"<strong>{escape(says)}</strong></li>" if suspicious else f"{escape(says)}</li>")
        for fields, says, suspicious in assumed(document)
    )
    head = "<h3>Assumed values of the arms</h3>"
    return f"{head}<ul>{items}</ul>" if items else ""
