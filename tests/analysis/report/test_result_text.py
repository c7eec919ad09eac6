"""Numbers, checks and results in words: in the terminal, and as a table in Markdown."""

import re
from pathlib import Path
from typing import Any

import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.report.check_text import (
    counts_text,
    results_table,
    verdict_text,
)
from chamfer.analysis.report.console import result_text

ROOT = Path(__file__).parents[3]


def check(
    asked: str = "near", published: float = 1.0, measured: float | None = 1.25, **changes: Any
) -> dict[str, Any]:
    return {
        "metric": "end",
        "relation": asked,
        "published": published,
        "tolerance": 0.5,
        "measured": measured,
        "unit": "m",
        "kind": "predicted",
        "verdict": "holds",
        "ok": True,
        "note": "",
        **changes,
    }


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (check("at_most", 1.0, 0.5), "holds"),
        (check("at_most", 1.0, 0.49), "holds (not exceeded)"),
        (check("at_least", 1.0, 2.0), "holds"),
        (check("at_least", 1.0, 2.01), "holds (not undercut)"),
        (check("at_least", 0.0, 50.0), "holds"),
        (check("at_most", 0.0, -50.0), "holds"),
        (check("at_least", -1.0, 50.0), "holds"),
        (check("near", 0.01, 0.001), "holds"),
        (check("between", low=1, high=9), "holds"),
        (check("at_most", 1.0, 0.1, kind="specification"), "kept"),
        (check("at_most", 1.0, 7.0, kind="specification", ok=False), "broken"),
        (check(kind="specification", ok=False, trials=9, kept=7), "broken in 2 of 9 trials"),
        (check("at_most", 1.0, 7.0, verdict="does_not_hold"), "does not hold"),
        (check("at_least", 1.0, None, verdict="not_reached"), "not reached"),
    ],
)
def test_a_bound_that_is_kept_by_more_than_a_factor_of_two_is_said_so(
    given: dict[str, Any], text: str
) -> None:
    assert verdict_text(given) == text


@pytest.mark.parametrize(
    ("verdicts", "text"),
    [
        ([], "no checks"),
        (["not_reached"], "1 published value: 0 hold, 0 do not hold, 1 not reached"),
        (["kept"], "1 of 1 specification kept"),
        (
            ["holds", "kept", "does_not_hold", "broken"],
            "2 published values: 1 holds, 1 does not hold, 0 not reached; "
            "1 of 2 specifications kept",
        ),
    ],
)
def test_verdicts_and_specifications_are_counted_apart(verdicts: list[str], text: str) -> None:
    limits = ("kept", "broken")
    checks = [
        check(kind="specification", ok=one == "kept") if one in limits else check(verdict=one)
        for one in verdicts
    ]
    assert counts_text(checks) == text


def test_what_an_experiment_comes_to_is_said_last_and_once() -> None:
    note = "Of all that was tried nothing matters. " * 5
    metrics = {
        "answer": {"value": 0.0, "unit": "", "note": note},
        "error": {"value": 2.0, "unit": "m"},
    }
    study = {"experiment": "study", "figure": "", "wall_seconds": 1.0}
    text = result_text({**study, "checks": [], "overrides": [], "metrics": metrics})
    table, _, said = text.partition("\n\n")
    assert "answer" not in table
    assert table.splitlines()[-1].split() == ["error", "2", "m"]
    assert " ".join(said.split()) == note.strip()
    assert max(map(len, said.splitlines())) <= 92


def result(name: str, paper: str, *checks: dict[str, Any], figure: str = "") -> dict[str, Any]:
    metrics = {name: {"value": 1.0, "unit": ""} for name in "ab"}
    named = {"experiment": name, "paper": paper, "figure": figure}
    return {**named, "metrics": metrics, "checks": checks}


def test_every_check_is_a_row_and_what_is_not_as_published_is_explained() -> None:
    missed = check(measured=None, ok=False, verdict="not_reached", note="it ends before")
    bound = check("at_most", measured=0.1, unit="", kind="calibrated")
    results = [
        result("fall", "one", check(), missed, figure="Fig. 1"),
        result("rise", "one"),
        result("turn", "two", bound),
    ]
    text = results_table(results, {"one": "On falling", "two": "On turning"}, studies={"turn"})
    assert "**3 experiments, 3 published values: 2 hold, 0 do not hold, 1 not reached.**" in text
    header = """\
| experiment | metric | expected | measured | verdict |
| --- | --- | --- | --- | --- |
"""
    expected = f"""\
## On falling

{header}\
| `fall`, Fig. 1 | `end` | 1 ± 0.5 m | 1.25 m | holds, predicted |
| | `end` | 1 ± 0.5 m | undefined | **not reached**, predicted |
| `rise` | | | 2 metrics | |

- `fall` `end` not reached. It ends before.

## On turning

{header}\
| `turn` *study* | `end` | ≤ 1 | 0.1 | holds (not exceeded), calibrated |
"""
    assert text[text.index("## On falling") :] == expected


def test_what_ended_with_an_error_is_in_the_table() -> None:
    text = results_table([], {}, ["fall: too deep", "rise: too high"])
    assert (
        "`chamfer reproduce` makes this page, and `chamfer reproduce --studies` the rows" in text
    )
    assert "`chamfer reproduce --seed 7 --studies`" in results_table([], {}, seed=7)
    assert text.endswith("Failed with an error:\n\n- fall: too deep\n- rise: too high\n")


def test_what_the_documents_table_lists_exists() -> None:
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([^`]+)`", text, flags=re.MULTILINE)
    assert listed
    assert set(listed) <= {entry.name for entry in CATALOGUE.entries}
