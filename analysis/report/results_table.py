"""The results as one table in Markdown: every published number beside the measured one."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from chamfer.analysis.report.check_text import (
    EXPLAINED,
    counts,
    counts_text,
    number,
    relation,
    typeset,
    verdict_text,
)

TABLE: Final = "results.md"

_COLUMNS: Final = ("experiment", "figure", "metric", "published", "measured", "kind", "verdict")


def results_table(
    results: Sequence[Mapping[str, Any]],
    titles: Mapping[str, str],
    errors: Sequence[str] = (),
    *,
    studies: Collection[str] = (),
    seed: int = 0,
) -> str:
    """Return the document.

    Args:
        results: The results' documents, those of a paper one after the other.
        titles: The papers' titles by key.
        errors: What ended without a result, each with the reason.
        studies: The experiments that go beyond the papers' own; their rows are marked.
        seed: Of all randomness in them.
    """
    counted = counts(check for result in results for check in result["checks"])
    command = f"chamfer reproduce --seed {seed}" if seed else "chamfer reproduce"
    lines = [
        "# Results: published against measured",
        "",
        f"Made by `{command}`, rows marked *study* by `{command} --studies`, don't edit. "
        f"{EXPLAINED}",
        "",
        f"**{len(results)} experiments, {counts_text(counted)}.**",
    ]
    if errors:
        lines += ["", "Ended with an error:", "", *(f"- {error}" for error in errors)]
    for paper, group in groupby(results, lambda result: str(result["paper"])):
        lines += ["", f"## {titles[paper]}", "", _row(_COLUMNS), _row(["---"] * len(_COLUMNS))]
        reasons = []
        for result in group:
            name = result["experiment"]
            lines += map(_row, _rows(result, " *study*" if name in studies else ""))
            reasons += [
                f"- `{name}` `{check['metric']}` {verdict_text(check)}: {check['note']}"
                for check in result["checks"]
                if not check["ok"]
            ]
        lines += ["", *reasons] if reasons else []
    return "\n".join(lines) + "\n"


def _rows(result: Mapping[str, Any], mark: str) -> Iterator[list[str]]:
    first = [f"`{result['experiment']}`{mark}", str(result["figure"])]
    for check in result["checks"]:
        measured, verdict, unit = check["measured"], verdict_text(check), check["unit"]
        yield [
            *first,
            f"`{check['metric']}`",
            f"{typeset(relation(check))} {unit}".rstrip(),
            "undefined" if measured is None else f"{number(measured)} {unit}".rstrip(),
            check["kind"],
            verdict if check["ok"] else f"**{verdict}**",
        ]
    if not result["checks"]:
        count = len(result["metrics"])
        yield [*first, "", "", f"{count} metric{'s' * (count != 1)}", "", ""]


def _row(cells: Sequence[str]) -> str:
    return "|" + "".join(f" {cell} |" if cell else " |" for cell in cells)
