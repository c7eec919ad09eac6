"""State machines as SCXML, whose events are the labels of the transitions.

W3C, State Chart XML (SCXML), 2015. The documents hold no expressions. The law judges the
measurements, and raises one event in a tick with a transition, none in any other: staying in a
state is no event. The law also counts the time, and makes an abort the last event.
"""

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any, Final
from xml.etree import ElementTree

from chamfer.analysis.drawing.graph import unique
from chamfer.systems.statechart.chart import ANY, Chart, State, TransitionRecord

_WORDS: Final = {"<=": " at most ", ">=": " at least ", "<": " below ", ">": " above "}
_SYMBOL: Final = re.compile("|".join(_WORDS))


def scxml(chart: Chart[Any, Any]) -> str:
    """Return a chart as an SCXML document; transitions are in the order of their priority.

    Transitions from any state are written out in each. A chart's final states end it.
    """
    ids = state_ids(chart)
    root = ElementTree.Element(
        "scxml",
        xmlns="http://www.w3.org/2005/07/scxml",
        version="1.0",
        datamodel="null",
        name=_slug(chart.name),
        initial=ids[chart.initial],
    )
    for state in chart.states:
        kind = "state" if state.outcome is None else "final"
        element = ElementTree.SubElement(root, kind, id=ids[state.name])
        ways = {(event, target): None for (_, target), event in _events(chart, state).items()}
        for event, target in ways:
            ElementTree.SubElement(element, "transition", event=event, target=ids[target])
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def state_ids(chart: Chart[Any, Any]) -> Mapping[str, str]:
    """Return the ids of states in the document, by their names."""
    taken: set[str] = set()
    spelled = {name: re.sub(r"[^A-Za-z0-9_.-]+", "_", name) for name in chart.state_names}
    return {
        name: unique(text if text[:1].isalpha() or text[:1] == "_" else f"_{text}", taken, "_")
        for name, text in spelled.items()
    }


def event(chart: Chart[Any, Any], record: TransitionRecord) -> str:
    """Return the event that a law raises as it takes a transition.

    Raises:
        KeyError: If the chart has no such transition.
    """
    return _events(chart, chart.state(record.source))[record.label, record.target]


def _events(chart: Chart[Any, Any], state: State[Any, Any]) -> dict[tuple[str, str], str]:
    """Return the event of each way out of a state by label and target, in order of priority.

    One label names one event in all states, unless it leads to several states.
    """
    if state.outcome is not None:
        return {}
    slugs = {("abort", chart.on_abort): "abort"}  # before all others
    for one in chart.transitions:
        if one.source == state.name or (one.source == ANY and one.target != state.name):
            slugs.setdefault((one.label, one.target), _slug(one.label))
    if state.timeout is not None and state.on_timeout is not None:
        slugs.setdefault((f"after {state.timeout:g} s", state.on_timeout), "timed-out")
    targets = Counter(slug for slug, _ in {(slug, way[1]) for way, slug in slugs.items()})
    events, leads = dict[tuple[str, str], str](), dict[str, str]()
    for way, slug in slugs.items():
        name = slug if targets[slug] == 1 else f"{slug}-to-{_slug(way[1])}"
        while leads.setdefault(name, way[1]) != way[1]:
            name += "-too"
        events[way] = name
    return events


def _slug(text: str) -> str:
    """Return a text as a word of an event: letters, digits and dashes."""
    worded = _SYMBOL.sub(lambda found: _WORDS[found[0]], text.lower().replace("%", " percent "))
    return re.sub("[^a-z0-9]+", "-", worded.replace("'", "")).strip("-") or "event"
