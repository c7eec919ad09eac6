"""The effect of camera errors on the alignment: each alone, and all of them at once."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import metrics_of, prefixed
from chamfer.analysis.cell.alignment_runs import resolve_trials
from chamfer.analysis.cell.camera_error_runs import (
    DRAWN,
    LEFT,
    MOMENTS,
    NONE,
    NOT_DRAWN,
    AssumedCameraError,
    CameraErrorsScenario,
    ErrorAtRest,
    ErrorRun,
    ResolvedCameraErrorsScenario,
    at_rest,
    reached,
    run_once,
)
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FSM,
    PID,
    PUBLISHED,
    Style,
    dress,
    legend_below,
    new_figure,
)
from chamfer.analysis.published.fsm_work_cell import MEAN_ERROR, WORST_ERROR
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column, part_of
from chamfer.diagrams.cell.alignment_scenario import ControllerChoice
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

# What of the paper's accuracy an error is to reach.
PUBLISHED_ERRORS: Final = {
    "lateral_error": MEAN_ERROR[0],
    "rotational_error": MEAN_ERROR[1],
    "behind_error": MEAN_ERROR[0],
}


_NOT_DRAWN: Final = ", ".join(error.says for error in NOT_DRAWN)
CAMERA_ERRORS: Final = CameraErrorsScenario()


def resolve(scenario: CameraErrorsScenario) -> ResolvedCameraErrorsScenario:
    """Refuse fields that the study sets itself."""
    if scenario.controller != ControllerChoice():
        raise ParameterError("controller.kind", scenario.controller.kind, "fsm; see controllers")
    if scenario.cameras.measured != CameraSettings().measured:
        allowed = "image; see measurements"
        raise ParameterError("cameras.measured", scenario.cameras.measured, allowed)
    if scenario.cameras.renderer != "software":
        raise ParameterError("cameras.renderer", scenario.cameras.renderer, "software")
    if scenario.compensated == "none":
        raise ParameterError("compensated", "none", "peg, hole, both")
    if scenario.moves:
        # What a motion makes the cameras expect is as late as their images truly are.
        allowed = "0, 0, 0: the errors of time are known on the way"
        raise ParameterError("start_offset", scenario.start_offset, allowed)
    return resolve_trials(ResolvedCameraErrorsScenario, scenario)


def run(scenario: ResolvedCameraErrorsScenario, seed: int, progress: Progress) -> Outcome:
    """Measure parts at rest, and run the loop."""
    still = _still(scenario, part_of(progress, 0.0, 0.2))
    drawn = [
        ErrorRun(name, size, *of, trial)
        for trial in range(scenario.trials)
        for of in product(scenario.controllers, scenario.measurements)
        for name, size in ((NONE, 0.0), (DRAWN, scenario.drawn))
    ]
    tasks = [*_alone(scenario), *drawn]
    finished = run_each(partial(run_once, scenario, seed), tasks, part_of(progress, 0.2, 1.0))
    traces = _rows(finished)
    metrics = _metrics(scenario, still, traces)
    return Outcome(
        metrics={"answer": answer(scenario.alone, still, traces), **metrics},
        traces=traces,
        simulated_seconds=len(finished) * scenario.duration,
        tables={"still": still},
    )


def _still(scenario: ResolvedCameraErrorsScenario, progress: Progress) -> Table:
    """Return a row for each error at each size, as either measurement sees parts at rest."""
    shares = scenario.largest * np.linspace(0.0, 1.0, scenario.points + 1)[1:]
    tasks = [
        ErrorAtRest(error.name, tuple((shares * error.most).tolist()), measured)
        for measured in scenario.measurements
        for error in scenario.alone
        if not error.moving and scenario.points
    ]
    none: Trials[ErrorAtRest] = Trials(tasks=(), rows=())
    found = run_each(partial(at_rest, scenario), tasks, progress) if tasks else none
    count = np.array([len(row["size"]) for row in found.rows], dtype=int)
    return {
        "error": np.repeat(np.array([one.error for one in found.tasks], np.str_), count),
        "measured": np.repeat(np.array([one.measured for one in found.tasks], np.str_), count),
        **{
            name: np.concatenate([np.array([]), *(row[name] for row in found.rows)])
            for name in ("size", *LEFT, "gap_error")
        },
    }


def _alone(scenario: CameraErrorsScenario) -> list[ErrorRun]:
    """Return the runs with one error, and without any, from the scenario's own start."""
    sizes = [
        (one.name, sign * scenario.largest * one.most)
        for one in scenario.alone
        if one.change
        # A dead zone, and the joints' friction, hide a bias to one side.
        for sign in ((1, -1) if one.off_axis else (1,))
    ]
    ways = [*product(scenario.controllers, scenario.measurements)]
    return [ErrorRun(name, size, *of) for of in ways for name, size in [(NONE, 0.0), *sizes]]


def _rows(finished: Trials[ErrorRun]) -> Table:
    """Return a row a run."""
    tasks = finished.tasks
    trial = [math.nan if task.trial is None else task.trial for task in tasks]
    names = [name for name in finished.rows[0] if name not in ("seen", "diverged")]
    return {
        "error": np.array([task.error for task in tasks]),
        "size": column([task.size for task in tasks]),
        "controller": np.array([task.controller for task in tasks]),
        "measured": np.array([task.measured for task in tasks]),
        "trial": column(trial),
        **{name: finished.column(name) for name in ("seen", "diverged", *names)},
    }


def _metrics(scenario: CameraErrorsScenario, still: Table, runs: Table) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for measured in scenario.measurements:
        for error in scenario.alone:
            rows = _where(still, error=error.name, measured=measured)
            if len(rows["size"]):
                metrics |= prefixed(f"{error.name}.{measured}", _at_rest_metrics(error, rows))
        for controller in scenario.controllers:
            of = _where(runs, controller=controller, measured=measured)
            found, by = _loop_metrics(scenario, of), f"{controller}.{measured}"
            metrics |= {name.replace("*", by): one for name, one in found.items()}
    return metrics


def _where(table: Table, **labels: str) -> dict[str, NDArray[Any]]:
    """Return the rows with these labels."""
    of = np.all([np.asarray(table[name]) == label for name, label in labels.items()], axis=0)
    return {name: np.asarray(values)[of] for name, values in table.items()}


def _at_rest_metrics(error: AssumedCameraError, rows: Table) -> dict[str, Metric]:
    """Return what an error alone does where nothing moves: bias, sensitivity, and how much."""
    size, unit = np.abs(rows["size"]), error.unit
    seen = np.isfinite(rows["rotational_error"])
    found, lost = size[seen], size[~seen]
    at, beyond = "never seen", "never seen"
    if len(found):
        at = f"at {found[-1]:.3g} {unit}".rstrip()
        beyond = f"not up to {at.removeprefix('at ')}"
    first = f"at {size[0]:.3g} {unit}".rstrip()
    metrics: dict[str, tuple[float | None, str, str]] = {}
    for name, of in LEFT.items():
        left = rows[name][seen]
        reach = reached(found, left, PUBLISHED_ERRORS[name])
        bias, slope = (float(left[-1]), float(left[0] / found[0])) if len(left) else (None, None)
        metrics |= {
            f"rest.{name}": (bias, of, at),
            f"rest.{name}.per_unit": (slope, _per(of, unit), first),
            f"rest.{name}.published_at": (reach, unit, beyond if reach is None else ""),
        }
    said = "a part is not found" if len(lost) else "parts are found at all sizes"
    metrics["rest.lost_at"] = (float(lost[0]) if len(lost) else None, unit, said)
    return metrics_of(metrics)


def _per(unit: str, of: str) -> str:
    """Return the unit of a quotient."""
    if unit == of:
        return ""
    return f"{unit}/{of.removesuffix('s')}" if of else unit


def _loop_metrics(scenario: CameraErrorsScenario, runs: Table) -> dict[str, Metric]:
    """Return what is left in runs of one controller with one measurement, by ``*`` for both."""
    metrics: dict[str, tuple[float | None, str, str]] = {}
    alone = np.isnan(runs["trial"])
    times = {"soon": scenario.soon, "late": scenario.compensation_time}
    units = LEFT | {"vision.lateral_error": "m", "vision.rotational_error": "rad"}
    for name in dict.fromkeys(runs["error"][alone].tolist()):
        rows = np.flatnonzero(alone & (runs["error"] == name))
        row = int(rows[np.argmax(np.nan_to_num(runs["late.rotational_error"][rows]))])
        seen = bool(runs["seen"][row])
        vision = (("late", kind) for kind in units if kind not in LEFT)
        for moment, kind in (*product(MOMENTS, LEFT), *vision):
            note = f"after {times[moment]:g} s"
            if kind not in LEFT:
                note = "true less measured"
            elif not seen:
                note = "blind: that of the start, or of no run"
            value = float(runs[f"{moment}.{kind}"][row])
            known = value if math.isfinite(value) else None
            metrics[f"{name}.*.{moment}.{kind}"] = (known, units[kind], note)
        metrics[f"{name}.*.blind"] = (float(not seen), "", "")
    found = metrics_of(metrics)
    drawn = {key: of[~alone] for key, of in runs.items()}
    for name in (NONE, DRAWN):
        if len((of := _where(drawn, error=name))["seen"]):
            found |= _drawn_metrics(name, of)
    return found


def _drawn_metrics(name: str, runs: Table) -> dict[str, Metric]:
    """Return means and maxima over drawn starts, and errors if there are any."""
    metrics: dict[str, tuple[float | None, str, str]] = {}
    seen = runs["seen"] > 0
    n = int(seen.sum())
    note = f"of {n} runs of {len(seen)} in which the parts are seen"
    note += f", without {_NOT_DRAWN}" if name == DRAWN else ""
    for moment, (kind, unit) in product(MOMENTS, LEFT.items()):
        left = runs[f"{moment}.{kind}"][seen]
        for of, value in (("mean", np.mean), ("max", np.max)):
            found = float(value(left)) if n else None
            metrics[f"{moment}.{kind}.{of}"] = (found, unit, note)
    for stop, values in (("blind", ~seen), ("diverged", runs["diverged"] > 0)):
        metrics[stop] = (100 * float(np.mean(values)), "%", f"of {len(seen)} runs")
    return prefixed(f"drawn.{'errors' if name == DRAWN else NONE}.*", metrics_of(metrics))


def figures(scenario: CameraErrorsScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {
        "camera-errors": plot_errors(scenario, outcome),
        "camera-errors-drawn": plot_drawn(scenario, outcome),
    }


_PANELS: Final = (
    ("rotational_error", "between the axes", "mrad", MEAN_ERROR[1]),
    ("lateral_error", "at the tip", "mm", MEAN_ERROR[0]),
    ("behind_error", "behind the tip", "mm", MEAN_ERROR[0]),
)
_BAR: Final = "#9db8dd"
_POINT: Final[Style] = {"linestyle": "none", "marker": "o", "markersize": 5}
_LEAST: Final = 1e-3  # mm and mrad, of a bar that is drawn


def plot_errors(scenario: CameraErrorsScenario, outcome: Outcome) -> Figure:
    """Draw the remaining errors: of parts at rest as bars, in runs of the loop as points.

    Of the first controller and measurement; the error that turns the parts most is on top. Where
    both signs were run the points are of the worse one.
    """
    runs, still = _first(outcome.traces, outcome.tables["still"])
    errors = sorted(scenario.alone, key=lambda one: _weight(one, runs, still))
    figure = new_figure(
        height=2.2 + 0.3 * len(errors),
        caption="Angle and offset between peg and hole that each camera error leaves: bias with "
        "the parts at rest (bars), and the loop in motion (points). The largest angle is on top.",
    )
    panels = figure.subplots(1, len(_PANELS), sharey=True)
    rows = [_row(one.name, runs) for one in errors]
    moments = (("soon", "none", scenario.soon), ("late", FSM["color"], scenario.compensation_time))
    for axes, (kind, where, unit, published) in zip(panels, _PANELS, strict=True):
        bars = np.array([1e3 * _rest(one, kind, still) for one in errors])
        places = np.arange(len(errors))
        axes.barh(places, np.maximum(bars, _LEAST), color=_BAR, label="parts at rest: bias")
        for moment, fill, seconds in moments:
            points = [np.nan if r is None else 1e3 * runs[f"{moment}.{kind}"][r] for r in rows]
            look: Style = {"markerfacecolor": fill, "markeredgecolor": FSM["color"], **_POINT}
            axes.plot(points, places, label=f"the loop after {seconds:g} s", **look)
        if (none := _row(NONE, runs)) is not None:
            left = 1e3 * runs[f"late.{kind}"][none]
            axes.axvline(left, label="the loop without camera errors", **DESIRED)
        axes.axvline(1e3 * published, label="published mean", **PUBLISHED)
        place = f"{1e3 * scenario.behind:g} mm\n{where}" if kind == "behind_error" else where
        dress(axes, title="", x=f"error / {unit}", y="")
        axes.set_title(place.capitalize(), fontsize=9, loc="left", fontweight="bold")
        axes.set_xscale("log")
        axes.set_xlim(3e-3, None)
    labels = [f"{one.says}: {_sized(one, scenario.largest)}" for one in errors]
    panels[0].set_yticks(range(len(errors)), labels)
    panels[0].set_ylim(-0.7, len(errors) - 0.3)
    legend_below(figure, panels[0])
    return figure


def _sized(error: AssumedCameraError, share: float) -> str:
    sign = "" if error.most > 0 else "\N{MINUS SIGN}"
    if error.off_axis:
        sign = "\N{PLUS-MINUS SIGN}"
    return f"{sign}{share * abs(error.most):.3g} {error.unit}".rstrip()


def _first(runs: Table, still: Table) -> tuple[Table, Table]:
    """Return the rows of the first controller and measurement that were run."""
    controller, measured = runs["controller"][0], runs["measured"][0]
    mine = _where(runs, controller=controller, measured=measured)
    return mine, _where(still, measured=measured)


def _weight(error: AssumedCameraError, runs: Table, still: Table) -> float:
    """Return by what errors are sorted: the angle that is left at rest, or else late."""
    value = _rest(error, "rotational_error", still)
    if np.isfinite(value):
        return value
    row = _row(error.name, runs)
    return -math.inf if row is None else float(runs["late.rotational_error"][row]) * 1e-6


def _rest(error: AssumedCameraError, kind: str, still: Table) -> float:
    values = _where(still, error=error.name)[kind]
    known = values[np.isfinite(values)]
    return float(known[-1]) if len(known) else math.nan


def _row(name: str, runs: Table) -> int | None:
    rows = np.flatnonzero((runs["error"] == name) & np.isnan(runs["trial"]) & (runs["seen"] > 0))
    if not len(rows):
        return None
    return int(rows[np.argmax(runs["late.rotational_error"][rows])])  # of both signs


def plot_drawn(scenario: CameraErrorsScenario, outcome: Outcome) -> Figure:
    """Draw early errors with drawn errors and starts, with starts alone, and of the paper."""
    runs, _ = _first(outcome.traces, outcome.tables["still"])
    figure = new_figure(
        height=4.4,
        caption="Errors left in trials with random camera errors, beside trials without camera "
        "errors and the published runs.",
    )
    panels = figure.subplots(1, 2, sharey=True)
    behind = f"{1e3 * scenario.behind:g} mm behind the tip"
    places = ("lateral_error", "at the tip"), ("behind_error", behind)
    for axes, (kind, where) in zip(panels, places, strict=True):
        for name, label, style in (
            (NONE, "no camera errors", PID),
            (DRAWN, f"random camera errors,\nwithout {_NOT_DRAWN}", FSM),
        ):
            of = (runs["error"] == name) & ~np.isnan(runs["trial"]) & (runs["seen"] > 0)
            left = 1e3 * runs[f"soon.{kind}"][of], 1e3 * runs["soon.rotational_error"][of]
            axes.plot(*left, color=style["color"], label=label, **_POINT)
        mean, worst = 1e3 * np.array(MEAN_ERROR), 1e3 * np.array(WORST_ERROR)
        right, up = ([[0.0], [beyond]] for beyond in worst - mean)
        bars: Style = {"color": PUBLISHED["color"], "marker": "s", "capsize": 3}
        label = "published: mean, up to the largest"
        axes.errorbar(*mean, xerr=right, yerr=up, label=label, **bars)
        title = f"After {scenario.soon:g} s, {where}"
        dress(axes, title=title, x="lateral error / mm", y="rotational error / mrad")
        axes.set_xlim(0.0, None)
        axes.set_ylim(0.0, None)
    legend_below(figure, panels[0])
    return figure


_MATTERS: Final = 0.25  # of the published angle, from which on an error's bias is said


def answer(errors: Sequence[AssumedCameraError], still: Table, runs: Table) -> Metric:
    """Return how many errors alone reach the published angle, and the study's answer as note.

    Of the first controller and measurement that were run.
    """
    runs, still = _first(runs, still)
    reach, turns, harmless, lost = 0, [], [], set(runs["error"][runs["seen"] < 1].tolist())
    takes, tips = [], []
    for one in errors:
        of = _where(still, error=one.name)
        seen = np.isfinite(of["rotational_error"])
        if not seen.all():
            lost.add(one.name)
        if not seen.any():
            continue
        size, tip, angle, behind = (np.abs(of[name][seen]) for name in ("size", *LEFT))
        tips.append((float(tip[-1]), one.says))
        if (at := reached(size, angle, MEAN_ERROR[1])) is not None:
            reach += 1
            wanted = f"{math.copysign(at, one.most):.3g} {one.unit}".rstrip()
            takes.append(f"{1e3 * MEAN_ERROR[1]:g} mrad take {wanted} of {one.says}.")
        if angle[-1] < _MATTERS * MEAN_ERROR[1]:
            harmless.append(one.says)
            continue
        sized = f"{one.says} of {math.copysign(size[-1], one.most):.3g} {one.unit}".rstrip()
        left = f"{1e3 * angle[-1]:.3g} mrad, {1e3 * behind[-1]:.2g} mm behind the tip"
        turns.append(f"{sized} ({left})")
    said = [
        f"The angle is biased by {_listed(turns)}." if turns else "",
        *takes,
        f"The loop does not care about {_listed(harmless)}." if harmless else "",
    ]
    if tips:
        most, name = max(tips)
        verb = "reaches" if most >= MEAN_ERROR[0] else "is not"
        said.append(
            f"At the tip the largest bias is {1e3 * most:.2g} mm, by {name}, which {verb} the "
            f"published {1e3 * MEAN_ERROR[0]:g} mm."
        )
    if gone := [one.says for one in errors if one.name in lost]:
        said.append(f"Parts get lost by {_listed(gone)}.")
    drawn = (runs["error"] == DRAWN) & (runs["seen"] > 0)
    if drawn.any():
        tip, angle, behind = (1e3 * float(runs[f"soon.{kind}"][drawn].mean()) for kind in LEFT)
        said.append(
            f"Drawn all together, without {_NOT_DRAWN}, they leave {tip:.2g} mm at the tip, "
            f"{angle:.3g} mrad and {behind:.2g} mm behind it on the average, in "
            f"{int(drawn.sum())} runs; published are {1e3 * MEAN_ERROR[0]:g} mm, "
            f"the paper does not say where, and {1e3 * MEAN_ERROR[1]:g} mrad."
        )
    return Metric(value=float(reach), unit="", note=" ".join(text for text in said if text))


def _listed(names: Sequence[str]) -> str:
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
