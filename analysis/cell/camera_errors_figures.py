"""What errors of the cameras leave: a tornado, drawn ones, and a few sentences."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.cell.camera_error_runs import DRAWN, NONE, NOT_DRAWN, CameraError, reached
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FSM,
    PID,
    PUBLISHED,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.work_cell import MEAN_ERROR, WORST_ERROR
from chamfer.analysis.scenario.experiment import Metric, Outcome, Table

_PANELS: Final = (
    ("rotational_error", "between the axes", "mrad", MEAN_ERROR[1]),
    ("lateral_error", "at the tip", "mm", MEAN_ERROR[0]),
    ("behind_error", "behind the tip", "mm", MEAN_ERROR[0]),
)
_NOT_DRAWN: Final = ", ".join(error.says for error in NOT_DRAWN)
_BAR: Final = "#9db8dd"
_LEAST: Final = 1e-3  # mm and mrad, of a bar that is drawn


class Tried(Protocol):
    """What the figures need to know of a study."""

    @property
    def alone(self) -> tuple[CameraError, ...]:
        """The errors that were tried alone."""

    @property
    def largest(self) -> float:
        """Of their sizes, the share that was tried."""

    @property
    def soon(self) -> float:
        """When it was looked first, s."""

    @property
    def compensation_time(self) -> float:
        """When it was looked last, s."""

    @property
    def behind(self) -> float:
        """Behind the tip, m."""


def plot_errors(scenario: Tried, outcome: Outcome) -> Figure:
    """Draw what each error leaves: of parts at rest as bars, in runs of the loop as points.

    Of the first controller and measurement; the error that turns the parts most is on top. Where
    both signs were run the points are of the worse one.
    """
    runs, still = _first(outcome)
    errors = sorted(scenario.alone, key=lambda one: _weight(one, runs, still))
    figure = new_figure(11.5, 1.6 + 0.3 * len(errors))
    panels = figure.subplots(1, len(_PANELS), sharey=True)
    for axes, (kind, where, unit, published) in zip(panels, _PANELS, strict=True):
        _tornado(axes, scenario, errors, kind, runs, still)
        axes.axvline(1e3 * published, label="published mean", **PUBLISHED)
        place = f"{1e3 * scenario.behind:g} mm {where}" if kind == "behind_error" else where
        dress(axes, title=f"Error {place}", x=f"error / {unit}", y="")
        axes.set_xscale("log")
        axes.set_xlim(3e-3, None)
    labels = [f"{one.says}: {_sized(one, scenario.largest)}" for one in errors]
    panels[0].set_yticks(range(len(errors)), labels)
    panels[0].set_ylim(-0.7, len(errors) - 0.3)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(
        handles, names, loc="outside lower center", ncols=len(names), fontsize=8, frameon=False
    )
    return figure


def _sized(error: CameraError, share: float) -> str:
    both = error.off_axis
    sign = "\N{PLUS-MINUS SIGN}" if both else "" if error.most > 0 else "\N{MINUS SIGN}"
    return f"{sign}{share * abs(error.most):.3g} {error.unit}".rstrip()


def _first(outcome: Outcome) -> tuple[Table, Table]:
    runs, still = outcome.traces, outcome.tables["still"]
    controller, measured = runs["controller"][0], runs["measured"][0]
    mine = (runs["controller"] == controller) & (runs["measured"] == measured)
    rest = still["measured"] == measured
    return {name: of[mine] for name, of in runs.items()}, {n: of[rest] for n, of in still.items()}


def _weight(error: CameraError, runs: Table, still: Table) -> float:
    """Return by what errors are sorted: the angle that is left at rest, or else late."""
    value = _rest(error, "rotational_error", still)
    if np.isfinite(value):
        return value
    row = _row(error.name, runs)
    return float("-inf") if row is None else float(runs["late.rotational_error"][row]) * 1e-6


def _rest(error: CameraError, kind: str, still: Table) -> float:
    of = still["error"] == error.name
    values = still[kind][of]
    known = values[np.isfinite(values)]
    return float(known[-1]) if len(known) else float("nan")


def _row(name: str, runs: Table) -> int | None:
    rows = np.flatnonzero((runs["error"] == name) & np.isnan(runs["trial"]) & (runs["seen"] > 0))
    if not len(rows):
        return None
    return int(rows[np.argmax(runs["late.rotational_error"][rows])])  # of both signs


def _tornado(
    axes: Axes,
    scenario: Tried,
    errors: list[CameraError],
    kind: str,
    runs: Table,
    still: Table,
) -> None:
    bars = np.array([1e3 * _rest(one, kind, still) for one in errors])
    where = np.arange(len(errors))
    axes.barh(where, np.maximum(bars, _LEAST), color=_BAR, label="parts at rest: bias")
    for moment, fill, seconds in (
        ("soon", "none", scenario.soon),
        ("late", FSM["color"], scenario.compensation_time),
    ):
        rows = [_row(one.name, runs) for one in errors]
        points = [np.nan if r is None else 1e3 * runs[f"{moment}.{kind}"][r] for r in rows]
        axes.plot(
            points,
            where,
            linestyle="none",
            marker="o",
            markersize=5,
            markerfacecolor=fill,
            markeredgecolor=FSM["color"],
            label=f"the loop after {seconds:g} s",
        )
    if (none := _row(NONE, runs)) is not None:
        axes.axvline(
            1e3 * runs[f"late.{kind}"][none],
            label="the loop without an error, at the end",
            **DESIRED,
        )


def plot_drawn(scenario: Tried, outcome: Outcome) -> Figure:
    """Draw what drawn errors and starts leave soon, beside starts alone and the paper's runs."""
    runs, _ = _first(outcome)
    figure = new_figure(10.5, 4.6)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (kind, where) in zip(
        panels,
        (
            ("lateral_error", "at the tip"),
            ("behind_error", f"{1e3 * scenario.behind:g} mm behind the tip"),
        ),
        strict=True,
    ):
        for name, label, style in (
            (NONE, "no errors of the cameras", PID),
            (DRAWN, f"drawn errors of the cameras,\nwithout {_NOT_DRAWN}", FSM),
        ):
            of = (runs["error"] == name) & ~np.isnan(runs["trial"]) & (runs["seen"] > 0)
            axes.plot(
                1e3 * runs[f"soon.{kind}"][of],
                1e3 * runs["soon.rotational_error"][of],
                linestyle="none",
                marker="o",
                markersize=5,
                color=style["color"],
                label=label,
            )
        x, y = 1e3 * MEAN_ERROR[0], 1e3 * MEAN_ERROR[1]
        axes.errorbar(
            x,
            y,
            xerr=[[0.0], [1e3 * WORST_ERROR[0] - x]],
            yerr=[[0.0], [1e3 * WORST_ERROR[1] - y]],
            color=PUBLISHED["color"],
            marker="s",
            capsize=3,
            label="published: mean, up to the largest",
        )
        title = f"After {scenario.soon:g} s, {where}"
        dress(axes, title=title, x="lateral error / mm", y="rotational error / mrad")
        axes.set_xlim(0.0, None)
        axes.set_ylim(0.0, None)
    legend(panels[0], loc="best")
    return figure


_MATTERS: Final = 0.25  # of the published error, from which on an error's own one is said
_SLOW: Final = 1.3  # times what is left without errors, beyond which a run is slower


class Bias(NamedTuple):
    """What an error does to parts at rest, at the largest size at which they are found."""

    error: CameraError
    size: float  # without a sign
    lateral: float  # m, at the tip
    rotational: float  # rad
    behind: float  # m, behind the tip
    published_at: float | None  # the size that makes the published angle

    @property
    def sized(self) -> str:
        """The error with its size."""
        size = math.copysign(self.size, self.error.most)
        return f"{self.error.says} of {size:.3g} {self.error.unit}".rstrip()


def answer(errors: Sequence[CameraError], still: Table, runs: Table) -> Metric:
    """Return how many errors alone make the published angle, and in the note what the study says.

    Of the first controller and measurement that were run.
    """
    controller, measured = runs["controller"][0], runs["measured"][0]
    mine = (runs["controller"] == controller) & (runs["measured"] == measured)
    alone = {name: of[mine & np.isnan(runs["trial"])] for name, of in runs.items()}
    drawn = {name: of[mine & ~np.isnan(runs["trial"])] for name, of in runs.items()}
    rest = {name: of[still["measured"] == measured] for name, of in still.items()}
    biases = [bias for one in errors if (bias := _bias(one, rest)) is not None]
    said = [_biased(biases), _slow(errors, alone), _blind(errors, rest, alone), _drawn(drawn)]
    reach = sum(one.published_at is not None for one in biases)
    return Metric(value=float(reach), unit="", note=" ".join(text for text in said if text))


def _bias(error: CameraError, still: Table) -> Bias | None:
    of = (still["error"] == error.name) & np.isfinite(still["rotational_error"])
    if not of.any():
        return None
    size = np.abs(still["size"][of])
    lateral, rotational, behind = (
        still[kind][of] for kind in ("lateral_error", "rotational_error", "behind_error")
    )
    return Bias(
        error,
        float(size[-1]),
        float(lateral[-1]),
        float(rotational[-1]),
        float(behind[-1]),
        reached(size, rotational, MEAN_ERROR[1]),
    )


def _biased(biases: Sequence[Bias]) -> str:
    if not biases:
        return ""
    turns = [one for one in biases if one.rotational >= _MATTERS * MEAN_ERROR[1]]
    said = []
    if turns:
        each = [
            f"{one.sized} ({1e3 * one.rotational:.3g} mrad, {1e3 * one.behind:.2g} mm behind the "
            "tip)"
            for one in turns
        ]
        said.append(f"The angle is biased by {_listed(each)}.")
    for one in turns:
        if one.published_at is not None:
            size = math.copysign(one.published_at, one.error.most)
            said.append(
                f"{1e3 * MEAN_ERROR[1]:g} mrad take {size:.3g} {one.error.unit}".rstrip()
                + f" of {one.error.says}."
            )
    if rest := [one for one in biases if one not in turns]:
        worst = max(one.rotational for one in rest)
        names = _listed([one.error.says for one in rest])
        said.append(f"The loop does not care about {names}: at most {1e3 * worst:.2g} mrad.")
    tip = max(biases, key=lambda one: one.lateral)
    verb = "reaches" if tip.lateral >= MEAN_ERROR[0] else "is not"
    said.append(
        f"At the tip the largest bias is {1e3 * tip.lateral:.2g} mm, by {tip.error.says}, which "
        f"{verb} the published {1e3 * MEAN_ERROR[0]:g} mm."
    )
    return " ".join(said)


def _slow(errors: Sequence[CameraError], runs: Table) -> str:
    """Say which errors leave more soon than late, beyond what is left without any."""
    (none,) = np.flatnonzero(runs["error"] == NONE)
    found = []
    for error in errors:
        if error.off_axis:
            continue  # its bias, either way, is no slowness
        for row in np.flatnonzero((runs["error"] == error.name) & (runs["seen"] > 0)):
            soon, late = (runs[f"{moment}.rotational_error"] for moment in ("soon", "late"))
            if soon[row] > _SLOW * soon[none] and late[row] < _SLOW * late[none]:
                found.append(
                    f"{error.says} ({1e3 * soon[row]:.3g} mrad, then {1e3 * late[row]:.3g})"
                )
    said = f"It is slower, not worse in the end, by {_listed(found)}." if found else ""
    same = [
        error.says
        for error in errors
        if error.moving
        for row in np.flatnonzero((runs["error"] == error.name) & (runs["seen"] > 0))
        if runs["soon.rotational_error"][row] <= _SLOW * runs["soon.rotational_error"][none]
    ]
    return f"{said} Hardly anything is lost by {_listed(same)}.".strip() if same else said


def _blind(errors: Sequence[CameraError], still: Table, runs: Table) -> str:
    lost = set(runs["error"][runs["seen"] < 1].tolist())
    lost |= set(still["error"][~np.isfinite(still["rotational_error"])].tolist())
    found = [one.says for one in errors if one.name in lost]
    return f"Parts get lost by {_listed(found)}." if found else ""


def _drawn(runs: Table) -> str:
    of = (runs["error"] == DRAWN) & (runs["seen"] > 0)
    if not of.any():
        return ""
    tip, angle, behind = (
        1e3 * float(runs[f"soon.{kind}"][of].mean())
        for kind in ("lateral_error", "rotational_error", "behind_error")
    )
    without = _listed([one.says for one in NOT_DRAWN])
    return (
        f"Drawn all together, without {without}, they leave {tip:.2g} mm at the tip, "
        f"{angle:.3g} mrad and {behind:.2g} mm behind it on the average, in "
        f"{int(of.sum())} runs; published are {1e3 * MEAN_ERROR[0]:g} mm, "
        f"the paper does not say where, and {1e3 * MEAN_ERROR[1]:g} mrad."
    )


def _listed(names: Sequence[str]) -> str:
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
