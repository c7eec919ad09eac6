from typing import Any

import pytest

from chamfer.analysis.report.check_text import (
    counts,
    counts_text,
    number,
    relation,
    typeset,
    verdict_text,
)


def check(relation: str, published: float, measured: float | None, **more: Any) -> dict[str, Any]:
    return {
        "relation": relation,
        "published": published,
        "measured": measured,
        "verdict": "holds",
        **more,
    }


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (check("at_most", 1.0, 0.5), "holds"),
        (check("at_most", 1.0, 0.49), "holds (not exceeded)"),
        (check("at_most", 1.0, -3.0), "holds (not exceeded)"),
        (check("at_least", 1.0, 2.0), "holds"),
        (check("at_least", 1.0, 2.01), "holds (not undercut)"),
        (check("at_least", 0.0, 50.0), "holds"),
        (check("at_most", 0.0, -50.0), "holds"),
        (check("at_least", -1.0, 50.0), "holds"),
        (check("near", 0.01, 0.001, tolerance=0.01), "holds"),
        (check("at_most", 1.0, 7.0, verdict="does_not_hold"), "does not hold"),
        (check("at_least", 1.0, None, verdict="not_reached"), "not reached"),
    ],
)
def test_a_bound_that_is_kept_by_more_than_a_factor_of_two_is_said_so(
    given: dict[str, Any], text: str
) -> None:
    assert verdict_text(given) == text


def test_a_bound_between_two_numbers_has_no_published_one() -> None:
    assert (
        verdict_text({"relation": "between", "low": 1, "high": 9, "verdict": "holds"}) == "holds"
    )


@pytest.mark.parametrize(
    ("verdicts", "text"),
    [
        ([], "0 checks: 0 hold, 0 do not hold, 0 not reached"),
        (["not_reached"], "1 check: 0 hold, 0 do not hold, 1 not reached"),
        (
            ["holds", "does_not_hold", "holds", "does_not_hold", "holds"],
            "5 checks: 3 hold, 2 do not hold, 0 not reached",
        ),
        (["holds", "does_not_hold"], "2 checks: 1 holds, 1 does not hold, 0 not reached"),
    ],
)
def test_verdicts_are_counted_apart(verdicts: list[str], text: str) -> None:
    assert counts_text(counts({"verdict": verdict} for verdict in verdicts)) == text


def test_numbers_and_relations() -> None:
    assert [number(value) for value in (None, 0.00888123, 1e-5, -2.0)] == [
        "-",
        "0.008881",
        "1e-5",
        "-2",
    ]
    assert relation(check("near", 1.0, 1.0, tolerance=1e-5)) == "1 +- 1e-5"
    assert typeset("1 +- 1e-5") == "1 ± 1e-5"
    assert typeset(relation(check("at_most", 2.0, 1.0))) == "≤ 2"
    assert typeset(relation(check("at_least", 2.0, 1.0))) == "≥ 2"
