"""One row a number: what a paper prints, and how close a simulation has to come.

A row is *calibrated* unless it says ``kind="predicted"`` or is :func:`specified`, and a number
that is missed is *not reached* unless it says ``otherwise="does_not_hold"``; see
:class:`chamfer.analysis.report.checks.Published`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from chamfer.analysis.report.checks import Published

Row = Callable[..., Published]  # lacks the experiment


def near(
    metric: str,
    value: float,
    tolerance: float,
    unit: str,
    source: str,
    note: str = "",
    **more: Any,
) -> Row:
    """Return the row of a metric that comes within a tolerance of a value."""
    return _row("near", metric, unit, source, note, value=value, tolerance=tolerance, **more)


def at_most(metric: str, value: float, unit: str, source: str, note: str = "", **more: Any) -> Row:
    """Return the row of a metric with a largest value."""
    return _row("at_most", metric, unit, source, note, value=value, **more)


def at_least(
    metric: str, value: float, unit: str, source: str, note: str = "", **more: Any
) -> Row:
    """Return the row of a metric with a least value."""
    return _row("at_least", metric, unit, source, note, value=value, **more)


def between(
    metric: str, low: float, high: float, unit: str, source: str, note: str = "", **more: Any
) -> Row:
    """Return the row of a metric with a least and a largest value."""
    return _row("between", metric, unit, source, note, low=low, high=high, **more)


def specified(*rows: Row) -> tuple[Row, ...]:
    """Return rows as limits of a task, an arm or parts, which are judged on every run."""
    return tuple(partial(row, kind="specification") for row in rows)


def of(experiment: str, *rows: Row) -> tuple[Published, ...]:
    """Return the rows of an experiment."""
    return tuple(row(experiment=experiment) for row in rows)


def _row(relation: str, metric: str, unit: str, source: str, note: str, **more: Any) -> Row:
    named = {"relation": relation, "metric": metric, "unit": unit, "source": source, "note": note}
    return partial(Published, **{"kind": "calibrated", **named, **more})
