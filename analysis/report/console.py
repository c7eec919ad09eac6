"""Results as text in a terminal. Plain ASCII, for terminals that know nothing else."""

import itertools
import sys
import textwrap
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Final

from chamfer.analysis.report.check_text import number, relation, verdict_text

_NOTE_WIDTH: Final = 92
_ANSWER: Final = "answer"


def say(message: str) -> None:
    """Say something in one line to whoever runs the program, on standard error."""
    with suppress(OSError):  # nobody can be told
        print(f"chamfer: {' '.join(message.split())}", file=sys.stderr, flush=True)


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Print the warnings of runs in one line each; warnings of libraries are not changed."""
    with warnings.catch_warnings():
        shown = warnings.showwarning

        def show(
            message: Warning | str, category: type[Warning], *where: Any, **more: Any
        ) -> None:
            if category is UserWarning:
                say(f"warning: {message}")
            else:
                shown(message, category, *where, **more)

        warnings.showwarning = show
        yield


def failed_text(failed: Sequence[Mapping[str, Any]]) -> str:
    """Return how many trials of an experiment failed, and why the first one did."""
    count = f"{len(failed)} trials" if len(failed) > 1 else "1 trial"
    return f"{count} failed, trial {failed[0]['trial']}: {failed[0]['reason']}"


def result_text(result: Mapping[str, Any]) -> str:
    """Return an experiment's checks, and its metrics where there are no published values.

    What the note of a metric called ``answer`` says is what the experiment comes to, and is last.
    """
    seconds = result["wall_seconds"]
    lines = [f"{result['experiment']}  {result['figure']}".rstrip() + f"  ({seconds:.2f} s)"]
    checks = result["checks"]
    if checks:
        lines += _checks(checks)
    if result["overrides"] or not checks:
        if result["overrides"]:
            lines.append("  published values apply to the default scenario only, not to this one")
        lines += _metrics(result["metrics"])
    if answer := result["metrics"].get(_ANSWER):
        lines += ["", *textwrap.wrap(answer["note"], _NOTE_WIDTH)]
    return "\n".join(lines)


def table(rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> list[str]:
    """Return rows as lines with aligned columns, those in ``right`` aligned to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if i in right else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def wrapped_table(rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Return rows as lines of at most ``width``, cells wrapped in their columns.

    Lines are longer only where a single word is longer than its share. A dot in the first column
    may end a line, as in dotted paths.
    """
    dotted = [[row[0].replace(".", ". "), *row[1:]] for row in rows]
    columns = list(zip(*dotted, strict=True))
    natural = [max(map(len, column)) for column in columns]
    least = [max(len(word) for cell in column for word in cell.split(" ")) for column in columns]
    room = width - 2 * (len(columns) - 1)

    def widths(share: int) -> list[int]:
        return [max(low, min(high, share)) for low, high in zip(least, natural, strict=True)]

    share = next((one for one in range(room, 0, -1) if sum(widths(one)) <= room), 0)
    lines = []
    for row in dotted:
        cells = [
            textwrap.wrap(cell, size, subsequent_indent="  ", break_long_words=False) or [""]
            for cell, size in zip(row, widths(share), strict=True)
        ]
        cells[0] = [part.replace(". ", ".") for part in cells[0]]
        for parts in itertools.zip_longest(*cells, fillvalue=""):
            sized = zip(parts, widths(share), strict=True)
            lines.append("  ".join(part.ljust(size) for part, size in sized).rstrip())
    return lines


def _checks(checks: Sequence[Mapping[str, Any]]) -> list[str]:
    rows = [("metric", "expected", "measured", "unit", "kind", "")]
    rows += [
        (
            check["metric"],
            relation(check),
            number(check["measured"]),
            check["unit"],
            check["kind"],
            verdict_text(check),
        )
        for check in checks
    ]
    header, *lines = (f"  {line}" for line in table(rows, right=(2,)))
    text = [header]
    for check, line in zip(checks, lines, strict=True):
        text.append(line)
        if check["note"]:
            text += textwrap.wrap(
                check["note"], _NOTE_WIDTH, initial_indent="    ", subsequent_indent="    "
            )
    return text


def _metrics(metrics: Mapping[str, Mapping[str, Any]]) -> list[str]:
    rows = [("metric", "measured", "unit", "")]
    rows += [
        (name, number(metric["value"]), metric["unit"], metric.get("note", ""))
        for name, metric in metrics.items()
        if name != _ANSWER
    ]
    return [f"  {line}" for line in table(rows, right=(1,))]
