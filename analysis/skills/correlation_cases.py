"""Eq. (1): the obstructions that the correlation of command and motion detects, and misses."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Final, Literal

import numpy as np
import scipy  # whose submodules are imported where they are used
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FSM,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.skills.dither_loops import (
    AxisSensorParams,
    CorrelationScenario,
    ResolvedCorrelationScenario,
    make_correlation_diagram,
    resolve,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.spring_constraint import SpringConstraintParams
from chamfer.systems.primitives.correlation import FREE, correlation

Array = NDArray[np.float64]

CASES: Final = ("free", "constrained", "one_sided", "noisy", "biased")
_MOST: Final = 10_000  # cycles
_FIRST: Final = 2  # windows, until what began at rest goes round
_LABELS: Final = {
    "free": "free",
    "constrained": "spring on both sides",
    "one_sided": "stop on one side",
    "noisy": "noisy force sensor",
    "biased": "biased force sensor",
}
_SHORT: Final = ("free", "spring", "stop", "noisy", "biased")
_LATER: Final[Style] = {"color": "#1b4f9c", "linestyle": "--", "linewidth": 1.4}
_THEORY: Final[Style] = {"color": "black", "marker": "_", "markersize": 26, "linestyle": "none"}
_MEASURED: Final[Style] = {"color": "#e07b00", "marker": "o", "markersize": 3, "alpha": 0.5}


CASES_SCENARIO: Final = CorrelationScenario(sensor=AxisSensorParams(noise=2.5, bias=2.5))
# Noise and bias are those of the cases named for them; all are assumed.


def resolve_cases(scenario: CorrelationScenario) -> ResolvedCorrelationScenario:
    """Return the scenario with nothing open; every case has to be able to run its dither."""
    dither, sensor, sides = scenario.dither, scenario.sensor, scenario.constraint.sides
    if not sensor.bias >= 0:
        raise ParameterError("sensor.bias", sensor.bias, "a finite number >= 0")
    if sides != SpringConstraintParams.sides:
        raise ParameterError("constraint.sides", sides, "both; cases set it")
    if dither.amplitude == 0:
        raise ParameterError("dither.amplitude", dither.amplitude, "a number but 0")
    if dither.kind != "linear":
        raise ParameterError("dither.kind", dither.kind, "linear")
    if not (_FIRST < dither.cycles <= _MOST and dither.cycles.is_integer()):
        allowed = f"a whole number, {_FIRST + 1} to {_MOST}"
        raise ParameterError("dither.cycles", dither.cycles, allowed)
    return resolve(scenario)


def one_case(scenario: ResolvedCorrelationScenario, name: str) -> ResolvedCorrelationScenario:
    """Return the loop of one of the cases: free, obstructed on both sides, or beside a stop."""
    sides: dict[str, Literal["both", "one"]] = {"constrained": "both", "one_sided": "one"}
    return replace(
        scenario,
        # One more cycle, so that it goes on to the last row.
        dither=replace(scenario.dither, cycles=scenario.dither.cycles + 1.0),
        constraint=replace(scenario.constraint, sides=sides.get(name, "none")),
        sensor=AxisSensorParams(
            noise=scenario.sensor.noise if name == "noisy" else 0.0,
            bias=scenario.sensor.bias if name == "biased" else 0.0,
        ),
    )


def run(scenario: ResolvedCorrelationScenario, seed: int, progress: Progress) -> Outcome:
    """Run every case and correlate its cycles."""
    metrics: dict[str, Metric] = {}
    cycles = np.arange(round(scenario.dither.cycles))
    traces = {"cycle": column(cycles)}
    shapes: dict[str, Array] = {"sample": column(np.arange(scenario.samples))}
    finished = run_each(partial(_run_case, scenario, seed), CASES, progress)
    for name, one in finished.split(CASES, lambda name: name).items():
        (row,) = one.rows
        command, motion = row["command"], row["motion"]  # shape (cycles, N)
        each = [correlation(f, g) for f, g in zip(command, motion, strict=True)]
        later = each[_FIRST:]
        value = float(np.mean([one.value for one in later]))
        spread = float(np.std([one.value for one in later]))
        metrics[f"correlation.{name}"] = Metric(
            value=value, unit="", note=f"mean of {len(later)} windows, deviation {spread:.2g}"
        )
        metrics[f"theory.{name}"] = Metric(value=theory(scenario, name), unit="")
        for what in ("amplitude_ratio", "bias"):
            ratio = float(np.mean([getattr(one, what) for one in later]))
            metrics[f"{what}.{name}"] = Metric(value=round(ratio, 9), unit="")
            metrics[f"{what}.{name}.first"] = Metric(
                value=round(float(getattr(each[0], what)), 9), unit="", note="of the first window"
            )
        metrics[f"hindered.{name}"] = Metric(
            value=100 * row["hindered"], unit="%", note="of the time, by the correlator"
        )
        traces[name] = column([one.value for one in each])
        shapes[f"{name}_motion"] = motion[0]
        shapes[f"{name}_later"] = motion[_FIRST]
    shapes["command"] = command[0]
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=len(CASES) * round(scenario.dither.cycles) / scenario.dither.frequency,
        tables={"cycles": shapes},
    )


def _run_case(scenario: ResolvedCorrelationScenario, seed: int, name: str) -> Row:
    period, samples = scenario.accommodation.period, scenario.samples
    count = round(scenario.dither.cycles) * samples
    outputs = simulate(
        make_correlation_diagram(one_case(scenario, name)),
        duration=(count + 0.5) * period,
        step=period,
        seed=trial_seed(seed, CASES.index(name)),
    ).outputs
    # What accommodation makes of a sample shows up in the next row.
    shape = (round(scenario.dither.cycles), samples)
    return {
        "command": outputs["command"][:count].reshape(shape),
        "motion": outputs["motion"][1 : count + 1].reshape(shape),
        # Share of the time after the first two cycles for which the correlator says so.
        "hindered": float(outputs["hindered"][_FIRST * samples : count].mean()),
    }


def theory(scenario: ResolvedCorrelationScenario, name: str) -> float:
    """Return the expected value of eq. (1) in closed form, sampled as the loop is.

    Free: ``(N^2 / 8) tan^2(pi / N)`` for N a multiple of four. Constrained: the phase lag of
    ``(z - 1) / (z - 1 + kappa)``, damping control that samples with one hold. One-sided: as free,
    once the tool has left the stop. Noisy: the motion's mean size is that of a folded normal
    distribution. Biased: the sums of a shifted cosine.
    """
    n = scenario.samples
    angle = 2 * np.pi * np.arange(n) / n
    f = np.cos(angle)
    free = correlation(f, f).value
    if name in ("free", "one_sided"):
        return free
    damping = scenario.accommodation.damping[scenario.dither.index]
    peak = abs(scenario.dither.amplitude) * 2 * np.pi * scenario.dither.frequency
    if name == "constrained":
        kappa = scenario.constraint.stiffness * scenario.accommodation.period / damping
        z = np.exp(2j * np.pi / n)
        lag = float(np.angle((z - 1) / (z - 1 + kappa)))
        return correlation(f, np.cos(angle + lag)).value
    if name == "noisy":
        deviation = scenario.sensor.noise / damping / peak
        if deviation == 0:
            return free
        size = deviation * np.sqrt(2 / np.pi) * np.exp(-0.5 * (f / deviation) ** 2)
        size += f * (1 - 2 * scipy.stats.norm.cdf(-f / deviation))
        return float(n * (f @ f) / (np.abs(f).sum() * size.sum()))
    return correlation(f, f + scenario.sensor.bias / damping / peak).value


def figures(scenario: ResolvedCorrelationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw a cycle of every case, and C of all windows next to the theory."""
    caption = (
        "Commanded velocity and motion of one cycle, and the correlation C of each window with "
        f"its theory. The cases: {', '.join(_LABELS.values())}."
    )
    figure = new_figure(8.0, 6.2, caption=caption)
    grid = figure.add_gridspec(2, 6)
    table = outcome.tables["cycles"]
    phase = 360 * table["sample"] / scenario.samples
    for i, name in enumerate(_LABELS):
        row, k = divmod(i, 3)
        axes = figure.add_subplot(grid[row, 2 * k : 2 * k + 2])
        axes.plot(phase, 1e3 * table["command"], label="commanded", **DESIRED)
        axes.plot(phase, 1e3 * table[f"{name}_motion"], label="motion, first cycle", **FSM)
        axes.plot(phase, 1e3 * table[f"{name}_later"], label="motion, third cycle", **_LATER)
        mean = float(np.mean(outcome.traces[name]))
        title = f"({'abcde'[i]}) {_SHORT[i].capitalize()}: C = {mean:.2f}"
        dress(axes, title=title, x="phase / deg", y="velocity / (mm/s)" if k == 0 else "")
        axes.set_xticks([0, 90, 180, 270, 360])
    below: Style = {"loc": "outside lower center", "fontsize": 8, "frameon": False, "ncols": 3}
    figure.legend(*axes.get_legend_handles_labels(), **below)
    axes = figure.add_subplot(grid[1, 4:])
    axes.axhline(FREE, label=r"published: $\pi^2/8$", **PUBLISHED)
    for i, name in enumerate(_LABELS):
        windows = outcome.traces[name]
        spread = 0.5 * (np.arange(len(windows)) / len(windows) - 0.5)
        axes.plot(i + spread, windows, linestyle="none", **_MEASURED)
        expected = outcome.metrics[f"theory.{name}"].value
        if expected is not None:
            axes.plot(i, expected, **_THEORY)
    axes.plot([], [], label="windows", linestyle="none", **_MEASURED)
    axes.plot([], [], label="theory", **_THEORY | {"markersize": 10})
    axes.set_xticks(range(len(_LABELS)), _SHORT)
    axes.set_ylim(0.0, 2.3)
    dress(axes, title="(f) C of each window", x="", y="C")
    legend(axes, loc="upper right")
    return {"correlation": figure}
