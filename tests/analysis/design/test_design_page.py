import re
from typing import Any
from xml.etree import ElementTree

import pytest

from chamfer.analysis.design.cell_picture import cell_picture
from chamfer.analysis.design.design_page import design_page
from chamfer.analysis.design.design_words import (
    change_sentence,
    design_text,
    limit_sentence,
    quantity,
    relation,
    share_sentence,
    verified_sentence,
)


def link(
    name: str,
    bound: float | None,
    allowed: float,
    margin: float | None,
    unit: str,
    source: str,
    share: float | None,
) -> dict[str, Any]:
    numbers = {"bound": bound, "allowed": allowed, "margin": margin, "share": share}
    by_design = name == "torque"
    return {"name": name, "unit": unit, "source": source, "by_design": by_design, **numbers}


def change(path: str, unit: str, value: float, sensitivity: float, to: float | None) -> Any:
    settings = [] if to is None else [f"{path}={to}"]
    share = None if to is None else 1.0
    numbers = {"value": value, "sensitivity": sensitivity, "to": to, "best": to, "share": share}
    return {"path": path, "unit": unit, "meaning": "of the parts", "settings": settings, **numbers}


@pytest.fixture
def document() -> dict[str, Any]:
    """Return what result.json has of a design: one link inside, one outside, one unbounded."""
    friction = change("parts.friction", "", 0.4, -0.1, 0.3)
    return {
        "design": "insertion",
        "seed": 3,
        "verdict": "likely",
        "predicted_verdict": "likely",
        "limiting_link": "two points",
        "margin": -0.25,
        "share": {"value": 0.5, "low": 0.43, "high": 0.57, "draws": 200},
        "links": [
            link("camera", 0.001, 0.004, 0.003, "m", "measured <here>", 0.75),
            link("two points", 0.05, 0.04, -0.01, "rad", "statics", -0.25),
            link("torque", 20.0, 5.0, 15.0, "N m", "the arm", 3.0),
            link("settling", None, 8.0, None, "s", "theorem", None),
        ],
        "changes": [friction, change("parts.chamfer_width", "m", 0.002, 0.05, None)],
        "pairs": [],
        "smallest_change": friction,
        "map": None,
        "verified": {
            "trials": 20,
            "seated": 19,
            "low": 0.751,
            "high": 0.999,
            "failed_trials": 0,
            "endings": {"gave up: it was stopped": 1},
            "outside": {"force": 2},
            "largest_force": 3.25,
            "warning": "",
        },
        "scenario_sha256": "0123456789abcdef",
        "overrides": ["parts.friction=0.4"],
        "versions": {"drake": "1.51.1", "control": None},
        "command": "chamfer design insertion --set parts.friction=0.4",
    }


def test_page_is_whole_escaped_and_needs_nothing_else(document: dict[str, Any]) -> None:
    page = design_page(document, "A peg < a hole.", None)
    body = page[page.index("<body>") : page.index("</html>")]
    ElementTree.fromstring(body)  # every tag is closed
    assert "measured &lt;here&gt;" in page
    assert "A peg &lt; a hole." in page
    assert not re.search(r"(src|href)=[\"'](?!data:)", page)
    assert "@page { size: A4" in page


def test_limiting_and_outside_links_are_marked(document: dict[str, Any]) -> None:
    page = design_page(document, "", None)
    rows = re.findall(r'<tr class="([^"]*)"><td>([^<]*)</td>', page)
    assert {name: kinds for kinds, name in rows} == {
        "camera": "",
        "two points": "limits outside",
        "torque": "",
        "settling": "",
    }
    bars = re.findall(r'<i style="left:([\d.]+)%;width:([\d.]+)%">', page)
    # Inside to the right of the middle, outside to the left, and never beyond the frame.
    assert bars == [("50.0", "37.5"), ("37.5", "12.5")]
    assert '<span class="fine">by design</span>' in page  # the torque, which does not limit


def test_no_section_is_empty(document: dict[str, Any]) -> None:
    document |= {"changes": None, "smallest_change": None, "verified": None}
    page = design_page(document, "", None)
    assert re.findall(r"<h3>([^<]*)", page) == ["Margin of each link"]
    assert not re.search(r"<tbody></tbody>", page)


def test_certain_says_what_it_means(document: dict[str, Any]) -> None:
    document |= {"verdict": "certain", "predicted_verdict": "certain"}
    assert "It is not a probability of 100 %." in design_page(document, "", None)


def test_simulation_that_contradicts_is_said(document: dict[str, Any]) -> None:
    assert 'class="warning"' not in design_page(document, "", None)
    document["verified"]["warning"] = "it was not so"
    assert "Contradicted: it was not so." in design_page(document, "", None)
    document["verified"] = None
    assert "No insertion was simulated" in design_page(document, "", None)


def test_map_is_in_the_page(document: dict[str, Any]) -> None:
    axis = {"path": "parts.friction", "unit": "", "from": 0.1, "to": 0.6}
    document["map"] = {"x": axis, "y": axis, "points": [2, 2], "verdicts": {"no": 4}}
    page = design_page(document, "", b"<svg/>")
    assert "data:image/svg+xml;base64,PHN2Zy8+" in page
    assert "4 no" in page


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (0.0042, "m", "4.2 mm"),
        (0.05, "rad", "50 mrad"),
        (3.5, "N", "3.5 N"),
        (0.45, "", "0.45"),
        (None, "m", "-"),
    ],
)
def test_lengths_and_angles_are_in_thousandths(value: float, unit: str, said: str) -> None:
    assert quantity(value, unit) == said


def test_which_side_of_what_is_allowed(document: dict[str, Any]) -> None:
    sides = {link["name"]: relation(link) for link in document["links"]}
    assert sides == {
        "camera": "at most",
        "two points": "at most",
        "torque": "at least",
        "settling": "at most",
    }


def test_sentences(document: dict[str, Any]) -> None:
    assert limit_sentence(document) == (
        "two points: 50 mrad, at most 40 mrad is allowed, margin -10 mrad (-25 %)"
    )
    assert share_sentence(document) == (
        "50 % of 200 random cells are within the limits "
        "(95 % interval for all cells: 43 % to 57 %)"
    )
    assert verified_sentence(document["verified"]) == (
        "19 of 20 simulated insertions are seated (95 % interval 75.1 % to 99.9 %)"
    )


def test_smallest_change(document: dict[str, Any]) -> None:
    assert change_sentence(document) == (
        "Smallest change: parts.friction from 0.4 to 0.3 (-25 %) makes it certain "
        "(--set parts.friction=0.3)"
    )
    assert change_sentence({**document, "changes": None}) == "No changes were tried (--no-changes)"
    none = {**document, "smallest_change": None}
    assert change_sentence(none) == "No single change makes it certain; a pair may"
    assert change_sentence({**document, "verdict": "certain"}).startswith("Nothing has")


def test_choices_pairs_and_what_helps_are_said_with_their_shares(document: dict[str, Any]) -> None:
    kind = {**change("controller.kind", "", 0.0, 0.0, None), "value": "fsm", "sensitivity": None}
    kind |= {"best": "pid", "share": 0.68}
    chamfer = {**change("parts.chamfer_width", "m", 0.002, 0.05, None), "best": 0.003}
    pair = {
        "changes": [kind, chamfer],
        "share": 0.9,
        "certain": False,
        "settings": ["a=1", "b=[1, 2]"],
    }
    document |= {"changes": [kind, *document["changes"]], "pairs": [pair]}
    said = (
        "controller.kind from fsm to pid and parts.chamfer_width from 2 mm to 3 mm (+50 %) "
        "come to 90 % (--set a=1 --set 'b=[1, 2]')"
    )
    text = " ".join(" ".join(design_text(document)).split())
    assert f"pair: {said}" in text
    assert "controller.kind fsm - pid: 68 %" in text
    assert "parts.friction 0.4 -10 % 0.3: certain" in text
    assert "from fsm to pid and" in design_page(document, "", None)
    document["smallest_change"] = None
    assert (
        change_sentence(document) == f"No change makes it certain, alone or with another; {said}"
    )
    document["smallest_change"] = {**pair, "certain": True}
    assert " make it certain (--set a=1" in change_sentence(document)


def test_terminal_has_links_changes_and_a_plain_warning(document: dict[str, Any]) -> None:
    verified = {**document["verified"], "warning": "the design is called 'no', but it went in"}
    lines = list(design_text({**document, "verified": verified}))
    assert lines[0].startswith("insertion  likely: ")
    (limits,) = [line for line in lines if line.startswith("> ")]
    assert limits.split()[:3] == [">", "two", "points"]
    assert any(
        line.split() == ["settling", "infinite", "<=", "8", "-", "s", "-", "theorem"]
        for line in (one.strip() for one in lines)
    )
    assert "WARNING: the design is called 'no', but it went in" in lines
    assert "  1: gave up: it was stopped" in lines


@pytest.mark.parametrize(
    ("name", "part"),
    [
        *((name, "cameras") for name in ("sight", "sight.way")),
        *((name, "compensator") for name in ("settled.lateral", "settled.tilt", "settling")),
        *((name, "compensator") for name in ("range.lateral", "range.rotational", "time")),
        *((name, "arms") for name in ("start.force", "loop", "torque", "torque.saturated")),
        *((name, "arms") for name in ("posture", "posture.limits")),
        *((name, "peg") for name in ("wedging", "jamming", "push", "force")),
        *((name, "mouth") for name in ("chamfer", "edge")),
        ("depth", "bottom"),
    ],
)
def test_the_picture_marks_what_limits(document: dict[str, Any], name: str, part: str) -> None:
    document["links"] = [
        link(name, 0.05, 0.04, -0.01, "rad", "", -0.25),
        link("sight", 2.0, 1.0, -1.0, "", "", -1.0),
    ]
    document["limiting_link"] = name
    picture = ElementTree.fromstring(cell_picture(document))
    kinds = [one.get("class", "").split() for one in picture.iter("g")]
    assert [one[1] for one in kinds if "limits" in one] == [part]
    assert {one[1] for one in kinds if "outside" in one} == {part, "cameras"}
    said = [one.text for one in picture.iter("text")]
    assert said[-2:] == [f"{name}: 50 mrad", "at most 40 mrad allowed, margin -25 %"]
    assert ("hole's arm" in said, "fixture" in said) == (True, False)
    fixed = cell_picture({**document, "scenario": {"hole": {"kind": "fixture"}}})
    assert ">fixture<" in fixed


def test_the_picture_has_dimensions(document: dict[str, Any]) -> None:
    parts = {"section": "round", "peg_radius": 0.008, "hole_radius": 0.00805}
    cell = {"parts": {**parts, "chamfer_width": 0.001}, "gap": 0.01, "insert": {"depth": 0.025}}
    picture = ElementTree.fromstring(cell_picture({**document, "scenario": cell}))
    said = {one.text for one in picture.iter("text")}
    assert {"⌀ 16 mm", "⌀ 16.1 mm", "gap 10 mm", "chamfer 1 mm", "depth 25 mm"} <= said
    assert "radial clearance 0.05 mm" in said


def test_a_link_that_is_of_no_part_is_said(document: dict[str, Any]) -> None:
    assert ">two points: 50 mrad</text>" in cell_picture(document)


def test_bounds_and_warnings_are_shown_where_there_are_any(document: dict[str, Any]) -> None:
    for none in (document, {**document, "bounds": {}, "warnings": []}):
        said = "\n".join(design_text(none)) + design_page(none, "", None)
        assert not re.search("(?i)promised|warning:|class=.warning", said)
    bound = {"bound": 0.00043, "unit": "m", "coverage": 0.985, "confidence": 0.95}
    some = {**document, "bounds": {"lateral": bound}, "warnings": ["50 s < a day: Hz meant?"]}
    lines = list(design_text(some))
    assert "WARNING: 50 s < a day: Hz meant?" in lines
    assert "lateral   at most 0.43 mm  98.5 %        95 %" in lines
    page = design_page(some, "", None)
    assert '<p class="warning">50 s &lt; a day: Hz meant?</p>' in page
    cells = '<td>lateral</td><td class="number">at most 0.43 mm</td><td class="number">98.5 %</td>'
    assert cells in page


def test_assumptions_of_both_arms_are_one_line_the_suspicious_first(
    document: dict[str, Any],
) -> None:
    assert "ssumed" not in "\n".join(design_text(document)) + design_page(document, "", None)
    document["assumptions"] = [
        *({"field": f"{arm}.a", "says": "a: 1 & 2", "suspicious": False} for arm in ("p", "h")),
        {"field": "p.b", "says": "b: none", "suspicious": True},
    ]
    lines = list(design_text(document))
    assert lines[lines.index("! p.b: b: none") + 1] == "  p.a, h.a: a: 1 & 2"
    page = design_page(document, "", None)
    one, other = "<strong>b: none</strong>", "<code>p.a, h.a</code>: a: 1 &amp; 2"
    assert page.index(one) < page.index(other)


def test_changes_beyond_what_the_sheet_holds_are_counted(document: dict[str, Any]) -> None:
    document["changes"] = [change(f"parts.{i}", "", 1.0, 0.1, None) for i in range(20)]
    assert "8 more in result.json" in design_page(document, "", None)
