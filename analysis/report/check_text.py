"""Text of numbers, checks and results for the terminal, the report page and the table."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from chamfer.analysis.report.checks import Verdict

TABLE: Final = "results.md"
WORDS: Final["dict[Verdict, str]"] = {
    "holds": "holds",
    "does_not_hold": "does not hold",
    "not_reached": "not reached",
}
_PLURAL: Final = {"holds": "hold", "does_not_hold": "do not hold", "not_reached": "not reached"}
EXPLAINED: Final = (
    "A predicted value follows from published numbers. A calibrated value has a free parameter "
    "that was chosen to fit. A measured value is compared with a recording of a real robot. A "
    "claim that does not hold fails on the paper's own model. A value that is not reached is one "
    "that our simulation misses. Not exceeded, or not undercut, means that a bound is kept by "
    "more than a factor of two: this agrees with the paper, but reproduces no number of it. A "
    "specification is a limit of the task, the arm or the parts, and every run is judged by it. "
    "Published values apply to the default scenario only."
)
LIMIT: Final = "specification"  # kind of check
_SIGNS: Final = {"at_most": "<=", "at_least": ">="}
_COLUMNS: Final = ("experiment", "metric", "expected", "measured", "verdict")
_FAR: Final = 2.0  # times a bound, beyond which keeping it does not reproduce its number


def number(value: float | None) -> str:
    """Return a number with as many digits as a reader compares."""
    return "-" if value is None else re.sub(r"e([-+])0", r"e\1", f"{value:.4g}")


def relation(check: Mapping[str, Any]) -> str:
    """Return what a check's document asks for, in ASCII."""
    if check["relation"] == "between":
        return f"{number(check['low'])} to {number(check['high'])}"
    published = number(check["published"])
    if check["relation"] == "near":
        return f"{published} +- {number(check['tolerance'])}"
    return f"{_SIGNS[check['relation']]} {published}"


def typeset(text: str) -> str:
    """Return a relation with the signs that ASCII lacks."""
    return text.replace("+-", "±").replace("<=", "≤").replace(">=", "≥")


def verdict_text(check: Mapping[str, Any]) -> str:
    """Return the verdict of a check's document in words, and whether a bound is kept by far.

    A bound of zero asks for a sign, and no number is twice as far from it as another.
    """
    if check["kind"] == LIMIT:
        trials = check.get("trials", 0)
        if check["ok"] or not trials:
            return "kept" if check["ok"] else "broken"
        return f"broken in {trials - check['kept']} of {trials} trials"
    text = WORDS[check["verdict"]]
    if check["verdict"] == "holds":
        if check["relation"] == "at_most" and 0 < check["published"] > _FAR * check["measured"]:
            return f"{text} (not exceeded)"
        if check["relation"] == "at_least" and 0 < _FAR * check["published"] < check["measured"]:
            return f"{text} (not undercut)"
    return text


def counts(checks: Iterable[Mapping[str, Any]]) -> "dict[Verdict, int]":
    """Return how many of the checks' documents have each verdict, but for specifications."""
    verdicts = [check["verdict"] for check in checks if check["kind"] != LIMIT]
    return {verdict: verdicts.count(verdict) for verdict in WORDS}


def kept(checks: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """Return how many of the checks' documents are specifications that are kept, and broken."""
    found = [bool(check["ok"]) for check in checks if check["kind"] == LIMIT]
    return {"kept": found.count(True), "broken": found.count(False)}


def counts_text(checks: Iterable[Mapping[str, Any]]) -> str:
    """Return in words how many published values have each verdict, and limits that are kept."""
    checks = list(checks)
    counted, limits = counts(checks), kept(checks)
    total = sum(counted.values())
    said = ", ".join(f"{n} {WORDS[key] if n == 1 else _PLURAL[key]}" for key, n in counted.items())
    parts = [f"{total} published value{'s' * (total != 1)}: {said}"] if total else []
    if asked := sum(limits.values()):
        parts.append(f"{limits['kept']} of {asked} specification{'s' * (asked != 1)} kept")
    return "; ".join(parts) or "no checks"


def results_table(
    results: Sequence[Mapping[str, Any]],
    titles: Mapping[str, str],
    errors: Sequence[str] = (),
    *,
    studies: Collection[str] = (),
    seed: int = 0,
) -> str:
    """Return all results as a document in Markdown, every published number beside the measured.

    Args:
        results: The results' documents, those of a paper one after the other.
        titles: The papers' titles by key.
        errors: Experiments without a result, each with the reason.
        studies: Experiments whose rows are marked as such.
        seed: Random seed.
    """
    checks = [check for result in results for check in result["checks"]]
    command = f"chamfer reproduce --seed {seed}" if seed else "chamfer reproduce"
    lines = [
        "# Published and measured values",
        "",
        f"**{len(results)} experiments, {counts_text(checks)}.**",
        "",
        f"`{command}` makes this page, and `{command} --studies` the rows marked *study*. "
        f"{EXPLAINED}",
    ]
    if errors:
        lines += ["", "Failed with an error:", "", *(f"- {error}" for error in errors)]
    for paper, group in groupby(results, lambda result: str(result["paper"])):
        lines += ["", f"## {titles[paper]}", "", _row(_COLUMNS), _row(["---"] * len(_COLUMNS))]
        reasons = []
        for result in group:
            name = result["experiment"]
            lines += map(_row, _rows(result, " *study*" if name in studies else ""))
            reasons += [
                f"- `{name}` `{check['metric']}` {verdict_text(check)}. {_sentence(check['note'])}"
                for check in result["checks"]
                if not check["ok"]
            ]
        lines += ["", *reasons] if reasons else []
    return "\n".join(lines) + "\n"


def _sentence(note: str) -> str:
    return f"{note[:1].upper()}{note[1:]}{'.' if note[-1:].isalnum() or note[-1:] == ')' else ''}"


def _rows(result: Mapping[str, Any], mark: str) -> Iterator[list[str]]:
    figure = f", {result['figure']}" if result["figure"] else ""
    first = f"`{result['experiment']}`{mark}{figure}"
    for check in result["checks"]:
        measured, verdict, unit = check["measured"], verdict_text(check), check["unit"]
        kind = "" if check["kind"] == LIMIT else f", {check['kind']}"
        yield [
            first,
            f"`{check['metric']}`",
            f"{typeset(relation(check))} {unit}".rstrip(),
            "undefined" if measured is None else f"{number(measured)} {unit}".rstrip(),
            f"{verdict if check['ok'] else f'**{verdict}**'}{kind}",
        ]
        first = ""
    if not result["checks"]:
        count = len(result["metrics"])
        yield [first, "", "", f"{count} metric{'s' * (count != 1)}", ""]


def _row(cells: Sequence[str]) -> str:
    return "|" + "".join(f" {cell} |" if cell else " |" for cell in cells)
