import re
from pathlib import Path
from typing import Any

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.report.results_table import results_table

ROOT = Path(__file__).parents[3]


def check(**changes: Any) -> dict[str, Any]:
    return {
        "metric": "end",
        "relation": "near",
        "published": 1.0,
        "tolerance": 0.5,
        "measured": 1.25,
        "unit": "m",
        "kind": "predicted",
        "verdict": "holds",
        "ok": True,
        "note": "",
        **changes,
    }


def result(name: str, paper: str, *checks: dict[str, Any], figure: str = "") -> dict[str, Any]:
    metrics = {"a": {"value": 1.0, "unit": ""}, "b": {"value": 2.0, "unit": ""}}
    return {
        "experiment": name,
        "paper": paper,
        "figure": figure,
        "metrics": metrics,
        "checks": checks,
    }


def test_every_check_is_a_row_and_what_is_not_as_published_is_explained() -> None:
    missed = check(measured=None, ok=False, verdict="not_reached", note="it ends before")
    bound = check(relation="at_most", measured=0.1, unit="", kind="calibrated")
    results = [
        result("fall", "one", check(), missed, figure="Fig. 1"),
        result("rise", "one"),
        result("turn", "two", bound),
    ]
    text = results_table(results, {"one": "On falling", "two": "On turning"}, studies={"turn"})
    assert "**3 experiments, 3 checks: 2 hold, 0 do not hold, 1 not reached.**" in text
    header = """\
| experiment | figure | metric | published | measured | kind | verdict |
| --- | --- | --- | --- | --- | --- | --- |
"""
    assert (
        text[text.index("## On falling") :]
        == f"""\
## On falling

{header}\
| `fall` | Fig. 1 | `end` | 1 ± 0.5 m | 1.25 m | predicted | holds |
| `fall` | Fig. 1 | `end` | 1 ± 0.5 m | undefined | predicted | **not reached** |
| `rise` | | | | 2 metrics | | |

- `fall` `end` not reached: it ends before

## On turning

{header}\
| `turn` *study* | | `end` | ≤ 1 | 0.1 | calibrated | holds (not exceeded) |
"""
    )


def test_what_ended_with_an_error_is_in_it() -> None:
    text = results_table([], {}, ["fall: too deep", "rise: too high"])
    assert (
        "Made by `chamfer reproduce`, rows marked *study* by `chamfer reproduce --studies`" in text
    )
    assert "`chamfer reproduce --seed 7 --studies`" in results_table([], {}, seed=7)
    assert text.endswith("Ended with an error:\n\n- fall: too deep\n- rise: too high\n")


def test_what_the_documents_table_lists_exists() -> None:
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([^`]+)`", text, flags=re.MULTILINE)
    assert listed
    assert set(listed) <= {entry.name for entry in CATALOGUE.entries}
