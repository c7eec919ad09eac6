import re
from typing import Any
from xml.etree import ElementTree

from chamfer.analysis.design.design_page import design_page


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
    assert bars == [("50.0", "37.5"), ("37.5", "12.5"), ("50.0", "50.0")]


def test_simulation_that_contradicts_is_said(document: dict[str, Any]) -> None:
    assert 'class="warning"' not in design_page(document, "", None)
    document["verified"]["warning"] = "it was not so"
    assert "Contradicted: it was not so." in design_page(document, "", None)
    document["verified"] = None
    assert "--verify 20" in design_page(document, "", None)


def test_map_is_in_the_page(document: dict[str, Any]) -> None:
    axis = {"path": "parts.friction", "unit": "", "from": 0.1, "to": 0.6}
    document["map"] = {"x": axis, "y": axis, "points": [2, 2], "verdicts": {"no": 4}}
    page = design_page(document, "", b"<svg/>")
    assert "data:image/svg+xml;base64,PHN2Zy8+" in page
    assert "4 no" in page
