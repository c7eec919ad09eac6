from typing import Any

import pytest

from chamfer.analysis.design.design_words import (
    change_sentence,
    design_text,
    limit_sentence,
    quantity,
    relation,
    share_sentence,
    verified_sentence,
)


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
        "50 % of 200 drawn errors are inside (95 % interval 43 % to 57 %)"
    )
    assert verified_sentence(document["verified"]) == (
        "19 of 20 simulated insertions are seated (95 % interval 75.1 % to 99.9 %)"
    )


def test_smallest_change(document: dict[str, Any]) -> None:
    assert change_sentence(document) == (
        "Smallest single change: parts.friction from 0.4 to 0.3 (-25 %) makes it certain "
        "(--set parts.friction=0.3); two together may take less"
    )
    assert change_sentence({**document, "changes": None}) == "What to change was not asked"
    assert change_sentence({**document, "smallest_change": None}).startswith("No single field")
    assert change_sentence({**document, "verdict": "certain"}).startswith("Nothing has")


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
