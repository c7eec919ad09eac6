"""A design's page as HTML: self-contained, on paper a data sheet of one A4 sheet."""

import base64
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any, Final

from chamfer.analysis.design.design_page_style import STYLE
from chamfer.analysis.design.design_words import (
    change_sentence,
    effective,
    ending_sentences,
    limit_sentence,
    link_cells,
    map_sentence,
    percent,
    quantity,
    relation,
    share_sentence,
    source,
    verdict_sentence,
    verified_sentence,
)

_MOST_CHANGES: Final = 13
_MOST_ENDINGS: Final = 4
_MOST_SETTINGS: Final = 12

Document = Mapping[str, Any]


def design_page(document: Document, said: str, figure: bytes | None) -> str:
    """Return the page.

    Args:
        document: As ``result.json`` has it.
        said: What is designed, in a sentence.
        figure: The map's figure as SVG, None without a map.
    """
    title = f"Design of an {document['design']}"
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(_body(document, title, said, figure))
        + "\n</body>\n</html>\n"
    )


def _body(document: Document, title: str, said: str, figure: bytes | None) -> Iterator[str]:
    verdict = document["verdict"]
    yield f"<header><h1>{title}</h1><p>{escape(said)}</p>{_settings(document)}</header>"
    yield (
        f'<section class="verdict {verdict}"><h2>{verdict}</h2><div>'
        f"<p>{escape(verdict_sentence(document).partition(': ')[2].capitalize())}. "
        f"{escape(share_sentence(document))}.</p>"
        f"<p>Limited by <strong>{escape(document['limiting_link'])}</strong>"
        f"{escape(limit_sentence(document).removeprefix(document['limiting_link']))}.</p>"
        f"<p>{escape(change_sentence(document))}.</p></div></section>"
    )
    yield "<section><h3>The chain</h3>"
    yield _links(document)
    yield '</section><div class="beside"><section><h3>What to change</h3>'
    yield _changes(document)
    yield "</section><section>"
    yield _verified(document["verified"])
    yield "</section></div>"
    if figure is not None:
        content = base64.b64encode(figure).decode()
        yield (
            f'<figure><img alt="map" src="data:image/svg+xml;base64,{content}">'
            f"<figcaption>{escape(map_sentence(document['map']))}</figcaption></figure>"
        )
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
    return f'<p class="fine">Not the defaults: {", ".join(shown)}</p>'


def _links(document: Document) -> str:
    rows = []
    for link in document["links"]:
        limits = link["name"] == document["limiting_link"]
        outside = link["margin"] is not None and link["margin"] < 0
        kinds = [*(["limits"] if limits else []), *(["outside"] if outside else [])]
        bound, allowed, margin, unit = link_cells(link)
        sign = "≥" if relation(link) == "at least" else "≤"
        rows.append(
            f'<tr class="{" ".join(kinds)}"><td>{escape(link["name"])}</td>'
            f'<td class="number">{bound}</td><td>{sign}</td><td class="number">{allowed}</td>'
            f'<td class="number">{margin}</td><td>{escape(unit)}</td>'
            f"<td>{_bar(link)}</td><td>{escape(source(link))}</td></tr>"
        )
    head = (
        '<th>link</th><th class="number">bound</th><th></th><th class="number">allowed</th>'
        '<th class="number">margin</th><th>unit</th><th>margin, of what is allowed</th>'
        "<th>from</th>"
    )
    return (
        f'<table class="links"><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _bar(link: Document) -> str:
    """Return a bar of the margin's share: to the right inside, to the left outside."""
    share = link["share"]
    if share is None:
        return ""
    width = 50 * min(abs(share), 1.0)
    left = 50.0 if share >= 0 else 50.0 - width
    return (
        f'<span class="bar"><i style="left:{left:.1f}%;width:{width:.1f}%"></i></span>'
        f'<span class="share">{percent(share)}</span>'
    )


def _changes(document: Document) -> str:
    changes, others = effective(document)
    rows = "".join(
        f"<tr><td title='{escape(change['meaning'], quote=True)}'>"
        f"<code>{escape(change['path'])}</code></td>"
        f'<td class="number">{quantity(change["value"], change["unit"])}</td>'
        f'<td class="number">{percent(change["sensitivity"], "+")}</td>'
        f'<td class="number">{quantity(change["to"], change["unit"])}</td></tr>'
        for change in changes[:_MOST_CHANGES]
    )
    head = (
        '<th>field</th><th class="number">is</th><th class="number">margin for +10 %</th>'
        '<th class="number">alone certain at</th>'
    )
    rest = (
        f'<p class="fine">No effect on the smallest margin: {escape(others)}.</p>'
        if others
        else ""
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{rest}"


def _verified(verified: Document | None) -> str:
    if verified is None:
        return "<h3>Simulated insertions</h3><p>None; <code>--verify 20</code> makes some.</p>"
    endings = ending_sentences(verified)
    items = "".join(f"<li>{escape(one)}</li>" for one in endings[:_MOST_ENDINGS])
    warning = verified["warning"]
    return (
        f"<h3>Simulated insertions</h3><p>{escape(verified_sentence(verified))}; contact forces "
        f"up to {quantity(verified['largest_force'], 'N')}.</p>"
        + (f"<ul>{items}</ul>" if items else "")
        + (f'<p class="warning">Contradicted: {escape(warning)}.</p>' if warning else "")
    )
