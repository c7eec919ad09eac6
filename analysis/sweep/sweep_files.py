"""A sweep's folder: its points as tables, its figure and the document that says what it is."""

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.report.check_text import number
from chamfer.analysis.report.console import table
from chamfer.analysis.report.results import (
    SWEEP,
    command_text,
    figure_captions,
    figure_files,
    json_text,
    versions,
    write_folder,
)
from chamfer.analysis.report.traces import table_bytes
from chamfer.analysis.scenario.scenario_io import unstructure
from chamfer.analysis.sweep.sweep import OK, SweepPlan, SweepResult
from chamfer.analysis.sweep.sweep_figures import plot_sweep, shown_metrics

_FORMULA: Final = ("=", "+", "-", "@")  # a text that begins so is one to a spreadsheet
_SHOWN_POINTS: Final = 40  # in a terminal
_SHOWN_METRICS: Final = 6


def folder_name(experiment: str) -> str:
    """Return the name of the folder of an experiment's sweep."""
    return f"sweep-{experiment}"


def write_sweep(out: Path, result: SweepResult, wall_seconds: float) -> dict[str, Any]:
    """Write a sweep's folder in ``out`` as a whole and return its document.

    Raises:
        OSError: If it can't be written.
    """
    figure = plot_sweep(result)
    drawn = {} if figure is None else {"sweep": figure}
    figures = figure_files(drawn)
    document = _document(result, wall_seconds, list(figures))
    document["captions"] = figure_captions(drawn)
    points = io.StringIO(newline="")
    writer = csv.writer(points, lineterminator="\n")
    writer.writerow(result.table)
    columns = [column.tolist() for column in result.table.values()]
    writer.writerows(map(_csv, row) for row in zip(*columns, strict=True))
    files: dict[str, str | bytes] = {
        "points.parquet": table_bytes(result.table, infinite=True),
        "points.csv": points.getvalue(),
        "trials.parquet": table_bytes(result.trials, infinite=True),
        **figures,
        SWEEP: json_text(document),
    }
    write_folder(out / folder_name(result.plan.job.entry.name), files)
    return document


def sweep_text(result: SweepResult, document: Mapping[str, Any]) -> list[str]:
    """Return the points as a table for a terminal, shortened, and what became of them."""
    shown = shown_metrics(result)
    metrics = (shown.metrics or list(result.metrics.values()))[:_SHOWN_METRICS]
    ends = [name for name in ("broken", "status") if name in result.table]
    columns = [one.path for one in result.plan.varied] + [*metrics, *ends]
    units = [result.table.units.get(name, "") for name in columns]
    cells = [list(map(_shown, result.table[name][:_SHOWN_POINTS])) for name in columns]
    lines = table([columns, units, *zip(*cells, strict=True)], right=range(len(columns) - 1))
    left_out = [
        f"{count} more {what}"
        for what, count in (
            ("metrics", len(result.metrics) - len(metrics)),
            ("points", document["points"] - _SHOWN_POINTS),
        )
        if count > 0
    ]
    if left_out:
        lines.append(f"... {' and '.join(left_out)} in points.csv")
    if shown.metrics and (text := shown.left_out(len(metrics))):
        lines.append(text if shown.chosen else f"{text} (--metric chooses)")
    lines += ["", f"{document['points_ok']} of {document['points']} points ok"]
    lines += [f"{n} with a broken specification: {name}" for name, n in result.broken.items()]
    return lines + [f"{n} without a result: {reason}" for reason, n in result.reasons.items()]


def _shown(value: Any) -> str:
    if isinstance(value, str):
        return value
    return "-" if math.isnan(value) else number(float(value))


def _command(plan: SweepPlan) -> str:
    """Return the command that makes a sweep."""
    words = []
    for field in plan.varied:
        words += ["--vary", field.text]
    if plan.design != "grid":
        words += ["--design", plan.design, "--points", str(len(plan.points))]
    if plan.trials > 1:
        words += ["--trials", str(plan.trials)]
    for name in plan.metrics or ():
        words += ["--metric", name]
    return command_text("sweep", plan.job.entry.name, plan.job.overrides, *words, seed=plan.seed)


def _document(result: SweepResult, wall_seconds: float, figures: list[str]) -> dict[str, Any]:
    plan = result.plan
    statuses = result.table["status"]
    return {
        "sweep": plan.job.entry.name,
        "paper": plan.job.entry.paper,
        "figure": plan.job.entry.figure,
        "seed": plan.seed,
        "trials": plan.trials,
        "design": plan.design,
        "fields": [
            {"path": one.path, "unit": one.unit, "meaning": one.meaning, "vary": one.text}
            for one in plan.varied
        ],
        "metrics": {
            name: {"column": column, "unit": result.table.units.get(column, "")}
            for name, column in result.metrics.items()
        },
        "points": len(statuses),
        "points_ok": int((statuses == OK).sum()),
        "trial_counts": result.counts,
        "reasons": result.reasons,
        "broken": result.broken,
        "scenario": unstructure(plan.job.scenario),
        "overrides": list(plan.job.overrides),
        "versions": versions(),
        "simulated_seconds": result.simulated_seconds,
        "wall_seconds": round(wall_seconds, 4),
        "command": _command(plan),
        "figures": figures,
    }


def _csv(value: Any) -> Any:
    """Return a value as CSV has it: numbers in full, nothing for NaN, no text as a formula."""
    if isinstance(value, str) and value.startswith(_FORMULA):
        return f"'{value}"
    return "" if isinstance(value, float) and math.isnan(value) else value
