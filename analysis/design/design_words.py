"""The sentences and numbers of a design in the terminal and on the page."""

import shlex
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any, Final

from chamfer.analysis.design.design import AT_LEAST
from chamfer.analysis.design.design_scenario import DesignScenario
from chamfer.analysis.report.check_text import number
from chamfer.analysis.report.console import table

_WIDTH: Final = 96
_MOST_PAIRS: Final = 2
# Lengths and angles of parts are thousandths of their SI units.
_SHOWN: Final = {"m": ("mm", 1e3), "rad": ("mrad", 1e3)}
_SAID: Final = {
    "certain": "certain: every bound and every random cell is within its limits",
    "likely": "likely: a bound or a random cell is outside its limits",
    "no": "no: less than 5 % of the random cells could go in, with 95 % confidence",
}

Document = Mapping[str, Any]


def scaled(value: float, unit: str) -> tuple[float, str]:
    """Return a value in the unit in which it is shown, and that unit."""
    shown, factor = _SHOWN.get(unit, (unit, 1.0))
    return factor * value, shown


def quantity(value: float | str | None, unit: str) -> str:
    """Return a number with its unit, both formatted; a text unchanged."""
    if isinstance(value, str):
        return value
    shown, its = scaled(0.0 if value is None else value, unit)
    return "-" if value is None else f"{number(shown)} {its}".rstrip()


def percent(share: float | None, sign: str = "") -> str:
    """Return a share in percent."""
    return "-" if share is None else f"{100 * share:{sign}.3g} %"


def described(scenario: DesignScenario) -> str:
    """Return a sentence that describes the cell."""
    parts, cameras, spread = scenario.parts, scenario.cameras, scenario.spread
    across, about = scenario.stiffness[1], scenario.stiffness[5]
    arms = "two arms" if scenario.hole.kind == "arm" else "an arm against a fixture"
    if scenario.servo:
        arms = "an arm that takes positions, against a fixture, with a compliance"
    sees = "no cameras"
    if cameras.kind == "pair":
        size = quantity(cameras.pixel_size, "m")
        sees = f"cameras of {cameras.width} x {cameras.height} pixels of {size}"
    peg, hole = 2 * parts.peg_radius, 2 * parts.hole_radius
    return (
        f"A peg of {quantity(peg, 'm')} into a hole of {quantity(hole, 'm')}, "
        f"{quantity(scenario.insert.depth, 'm')} deep: radial clearance "
        f"{quantity(parts.clearance, 'm')} ({percent(parts.clearance / parts.peg_radius)} of the "
        f"radius), friction {number(parts.friction)}, chamfers "
        f"{quantity(parts.chamfer_width, 'm')}; {arms} of {number(across)} N/m and "
        f"{number(about)} N m/rad; {sees}; first errors up to "
        f"{quantity(spread.lateral, 'm')} and {quantity(spread.rotational, 'rad')}."
    )


def verdict_sentence(document: Document) -> str:
    """Return the verdict in a sentence."""
    if (predicted := document["predicted_verdict"]) != document["verdict"]:
        return f"{document['verdict']}: simulation contradicts the predicted {predicted!r}"
    return _SAID[document["verdict"]]


def limit_sentence(document: Document) -> str:
    """Return the limiting link, and its margin."""
    name = document["limiting_link"]
    link = next(one for one in document["links"] if one["name"] == name)
    bound = "infinite" if link["bound"] is None else quantity(link["bound"], link["unit"])
    return (
        f"{name}: {bound}, {relation(link)} {quantity(link['allowed'], link['unit'])} is allowed, "
        f"margin {quantity(link['margin'], link['unit'])} ({percent(document['margin'])})"
    )


def link_cells(link: Document) -> tuple[str, ...]:
    """Return bound, relation, allowed value, margin, unit, share and source of a link in words."""
    bound, allowed, margin = (
        "-" if link[name] is None else number(scaled(link[name], link["unit"])[0])
        for name in ("bound", "allowed", "margin")
    )
    if link["bound"] is None:  # null in the document is infinite
        bound = "infinite"
    share = "by design" if kept_by_design(link) else percent(link["share"])
    unit = scaled(0, link["unit"])[1]
    return bound, relation(link), allowed, margin, unit, share, link["source"]


def kept_by_design(link: Document) -> bool:
    """Return whether a link's margin follows from design rules, so that it does not limit."""
    return bool(link["by_design"] and link["margin"] is not None and link["margin"] >= 0)


def change_cells(change: Document) -> tuple[str, ...]:
    """Return path, value, sensitivity, and the best other value with its share, in words."""
    value, best = (quantity(change[name], change["unit"]) for name in ("value", "best"))
    if change["best"] is not None:
        best += ": certain" if change["to"] is not None else f": {percent(change['share'])}"
    return change["path"], value, percent(change["sensitivity"], "+"), best


def effective(document: Document) -> tuple[list[Document], str]:
    """Return the changes that change the smallest margin, or help; the names of the others."""
    changes = document["changes"] or ()
    of = [one for one in changes if one["sensitivity"] or one["best"] is not None]
    return of, ", ".join(one["path"] for one in changes if one not in of)


def relation(link: Document) -> str:
    """Return on which side of the allowed value a link has to be."""
    bound, allowed, margin = (link[name] for name in ("bound", "allowed", "margin"))
    if None in (bound, allowed, margin):
        return "at most"
    return "at least" if (bound > allowed) == (margin > 0) else "at most"


def share_sentence(document: Document) -> str:
    """Return how many of the random errors every link admits."""
    share = document["share"]
    ends = " to ".join(percent(share[name]) for name in ("low", "high"))
    return (
        f"{percent(share['value'])} of {share['draws']} random cells are within the limits "
        f"(95 % interval for all cells: {ends})"
    )


def change_sentence(document: Document) -> str:
    """Return the smallest change, or pair, that makes a design certain."""
    least = document["smallest_change"]
    if document["verdict"] == "certain":
        return "Nothing has to be changed"
    if document["changes"] is None:
        return "No changes were tried (--no-changes)"
    if least is not None:
        return f"Smallest change: {_said(least)}"
    if document["pairs"]:
        return f"No change makes it certain, alone or with another; {_said(document['pairs'][0])}"
    return "No single change makes it certain; a pair may"


def pair_sentences(document: Document) -> list[str]:
    """Return the effects of the best pairs that no other sentence has."""
    said = change_sentence(document)
    pairs = [_said(pair) for pair in document["pairs"][: _MOST_PAIRS + 1]]
    return [pair for pair in pairs if pair not in said][:_MOST_PAIRS]


def _said(change: Document) -> str:
    """Return a change, or a pair, and its effect in words."""
    parts = change.get("changes", [change])
    each = []
    for one in parts:
        value, to = (quantity(one[name], one["unit"]) for name in ("value", "best"))
        of_number = one["value"] and not isinstance(one["value"], str)
        by = f" ({percent(one['best'] / one['value'] - 1, '+')})" if of_number else ""
        each.append(f"{one['path']} from {value} to {to}{by}")
    verb, come = ("make", "come") if len(parts) > 1 else ("makes", "comes")
    sure = change.get("certain", True)
    does = f"{verb} it certain" if sure else f"{come} to {percent(change['share'])}"
    settings = " ".join(f"--set {shlex.quote(one)}" for one in change["settings"])
    return f"{' and '.join(each)} {does} ({settings})"


def verified_sentence(verified: Document) -> str:
    """Return how many simulated insertions went in."""
    ends = " to ".join(percent(verified[name]) for name in ("low", "high"))
    failed = verified["failed_trials"]
    without = f", {failed} more ended with an error" if failed else ""
    return (
        f"{verified['seated']} of {verified['trials']} simulated insertions are seated "
        f"(95 % interval {ends}){without}"
    )


def ending_sentences(verified: Document) -> list[str]:
    """Return the endings of insertions that were not seated, and the bounds they broke."""
    ends = [f"{count}: {ending}" for ending, count in verified["endings"].items()]
    of = verified["outside"].items()
    return [*ends, *(f"{count}: outside of the bound of the {name}" for name, count in of)]


def map_sentence(found: Document) -> str:
    """Return how many points of a map have each verdict."""
    counts = ", ".join(f"{count} {name}" for name, count in found["verdicts"].items())
    return f"over {found['x']['path']} and {found['y']['path']}: {counts}"


def bound_rows(document: Document) -> list[tuple[str, ...]]:
    """Return name, bound, coverage and confidence of each promised bound."""
    return [
        (
            name,
            f"{'at least' if name in AT_LEAST else 'at most'} {quantity(of['bound'], of['unit'])}",
            percent(of["coverage"]),
            percent(of["confidence"]),
        )
        for name, of in (document.get("bounds") or {}).items()
    ]


def assumed(document: Document) -> list[tuple[str, str, bool]]:
    """Return fields, assumptions, and whether one is suspicious; the suspicious ones first."""
    found: dict[tuple[str, bool], list[str]] = {}
    for one in document.get("assumptions", ()):
        found.setdefault((one["says"], one["suspicious"]), []).append(one["field"])
    rows = [(", ".join(fields), *of) for of, fields in found.items()]
    return sorted(rows, key=lambda row: not row[2])


def design_text(document: Document) -> Iterator[str]:
    """Yield the lines of a design for a terminal."""
    yield f"{document['design']}  {verdict_sentence(document)}"
    yield f"limited by {limit_sentence(document)}"
    yield share_sentence(document)
    for warning in document.get("warnings") or ():
        yield from textwrap.wrap(f"WARNING: {warning}", _WIDTH)
    yield ""
    links: list[tuple[str, ...]] = [("link", "bound", "", "allowed", "margin", "", "", "from")]
    for link in document["links"]:
        mark = "> " if link["name"] == document["limiting_link"] else "  "
        bound, side, *rest = link_cells(link)
        links.append((mark + link["name"], bound, ">=" if side == "at least" else "<=", *rest))
    yield from table(links, right=(1, 3, 4, 6))
    yield ""
    if bounds := bound_rows(document):
        yield from table([("promised", "", "of all", "confidence"), *bounds], right=(1, 2, 3))
        yield ""
    changes, others = effective(document)
    if changes:
        head = ("field", "value", "margin change for +10 %", "best single value")
        yield from table([head, *map(change_cells, changes)], right=(1, 2, 3))
    if others:
        yield from textwrap.wrap(f"no effect on the limiting margin: {others}", _WIDTH)
    if changes or others:
        yield ""
    yield from textwrap.wrap(change_sentence(document), _WIDTH)
    for pair in pair_sentences(document):
        yield from textwrap.wrap(f"pair: {pair}", _WIDTH, subsequent_indent="    ")
    if found := document["map"]:
        yield from textwrap.wrap(f"map {map_sentence(found)}", _WIDTH)
    if rows := assumed(document):
        yield ""
        yield "assumed values of the arms (!: suspicious):"
        for fields, says, suspicious in rows:
            text = f"{'!' if suspicious else ' '} {fields}: {says}"
            yield from textwrap.wrap(text, _WIDTH, subsequent_indent="    ")
    if verified := document["verified"]:
        yield ""
        yield f"{verified_sentence(verified)}; predicted: {document['predicted_verdict']}"
        yield from (f"  {one}" for one in ending_sentences(verified))
        if warning := verified["warning"]:
            yield from textwrap.wrap(f"WARNING: {warning}", _WIDTH)
