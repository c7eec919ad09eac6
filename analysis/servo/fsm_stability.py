"""When the FSM settles: theorem, simulation, describing function, and the paper's criteria."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from chamfer.analysis.campaign.trial_metrics import metrics_of, prefixed
from chamfer.analysis.drawing.figure_kit import Curve, ReferenceLine, draw_lines, metric_value
from chamfer.analysis.drawing.figure_style import FSM, PUBLISHED, Style, dress, legend, new_figure
from chamfer.analysis.linear.to_control import to_control
from chamfer.analysis.scenario.experiment import (
    Metric,
    Outcome,
    Progress,
    column,
    measured,
    part_of,
)
from chamfer.analysis.servo.loop_margins import loop_margins
from chamfer.analysis.servo.response_metrics import FINAL_PART
from chamfer.analysis.servo.servo_response import run_loops
from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_loops import make_pid_loop, make_servo_diagram
from chamfer.diagrams.servo.servo_scenario import (
    CameraParams,
    FsmParams,
    PlantParams,
    ResolvedServoScenario,
    SinusoidScenario,
    StepScenario,
    fsm_axis,
    resolve,
    settling_plant,
)
from chamfer.models.plants.servo_plant import SpringMassDamperParams
from chamfer.models.validation import ParameterError, require_positive, within
from chamfer.systems.servo.compensator_law import (
    AxisMemory,
    AxisParams,
    CompensatorChart,
    CompensatorInputs,
    CompensatorMemory,
    CompensatorParams,
    make_axis_chart,
    make_compensator_chart,
)
from chamfer.systems.servo.describing_function import predict_limit_cycle
from chamfer.systems.servo.desired_trajectory import Sinusoid, Step
from chamfer.systems.servo.pid import PidParams
from chamfer.systems.servo.servo_plant import make_spring_mass_damper
from chamfer.systems.servo.settling import SettlingPlant, allowed_axis, guarantee
from chamfer.systems.statechart.chart import Chart, Snapshot, Transition
from chamfer.systems.statechart.chart_design import not_connected, not_local, not_used, replay
from chamfer.systems.statechart.finite_machine import FiniteMachine, explore, tarraf_properties

Array = NDArray[np.float64]

SETTLES, REVERSES, CYCLES, UNFINISHED = 0, 1, 2, 3  # verdicts of the map
TICKS = 320  # of a trial
_LEVELS = 4  # large increments up to the limit; the machine is finite because it is limited
_QUIET = 0.25  # of a trial, at its end, without an action: it has come to rest
_SHARES = tuple(np.geomspace(0.8, 12.0, 12).tolist())  # of the bound, for the limit cycles
_SEARCH_DURATION = 2.5  # s
_WITHOUT_OVERSHOOT = 1.005  # of the step, what counts as none


@dataclass(frozen=True, kw_only=True)
class MapParams:
    """The grid of the map and the size of the searches."""

    points: int = 41  # of the grid, per side
    trials: int = 5  # random initial errors per cell
    dead_zone: tuple[float, float] = (0.003, 0.03)  # m, first and last of the grid
    increment: tuple[float, float] = (0.002, 0.08)  # m, first and last, n of Fig. 4
    settings: int = 1000  # of the force-to-velocity search, per rate

    def __post_init__(self) -> None:
        for name, least in (("points", 2), ("trials", 1), ("settings", 1)):
            if getattr(self, name) < least:
                raise ParameterError(name, getattr(self, name), f"a whole number >= {least}")
        for name in ("dead_zone", "increment"):
            low, high = getattr(self, name)
            if not 0 < low < high < math.inf:
                raise ParameterError(name, (low, high), "two increasing numbers > 0")


@dataclass(frozen=True, kw_only=True)
class FsmRule:
    """The state machine compensator, as far as it does not follow from the settling theorem."""

    dead_zone: float = FsmParams.dead_zone
    # m, a measured error smaller than this is left alone; 1 % of the step, assumed
    divider: float = 5.0  # a small error gets the increment over this; n/5 of Fig. 4
    period: float = FsmParams.period  # s, between two ticks; section 4


@dataclass(frozen=True, kw_only=True)
class StabilityScenario:
    """The loops of Fig. 8 on the plant in position form, and the variations around them."""

    desired: Step = field(default_factory=Step)
    plant: SpringMassDamperParams = field(default_factory=SpringMassDamperParams)
    pid: PidParams = field(default_factory=PidParams)
    fsm: FsmRule = field(default_factory=FsmRule)
    camera: CameraParams = field(default_factory=CameraParams)
    map: MapParams = field(default_factory=MapParams)

    def __post_init__(self) -> None:
        require_positive(self.desired, "amplitude")
        bound = self.loop.measurement.bound
        if not self.map.dead_zone[0] > bound:
            allowed = f"from more than the camera's error, {bound:g}"
            raise ParameterError("map.dead_zone", self.map.dead_zone, allowed)

    @property
    def loop(self) -> StepScenario:
        """The loops, everything open."""
        with within("fsm"):
            fsm = FsmParams(**vars(self.fsm))
        return StepScenario(
            desired=self.desired,
            plant=PlantParams(**vars(self.plant)),
            pid=self.pid,
            fsm=fsm,
            camera=self.camera,
        )


STABILITY: Final = StabilityScenario()


def run(scenario: StabilityScenario, seed: int, progress: Progress) -> Outcome:
    """Map the settings that settle, find the limit cycles and check the paper's criteria."""
    loop, grid = scenario.loop, scenario.map
    cells = _map(loop, grid, seed, part_of(progress, 0.0, 0.6))
    progress(0.6, "limit cycles")
    cycles = _limit_cycles(loop, seed)
    metrics = _map_metrics(cells) | _cycle_metrics(cycles)
    progress(0.63, "criteria")
    metrics |= _criteria(loop, seed)
    pid = to_control(make_pid_loop(loop, "velocity"), input="controller PID::u0")
    metrics |= loop_margins(pid).as_metrics("pid")
    for begin, end, rate in ((0.65, 0.7, 80), (0.7, 1.0, 1000)):
        metrics |= _velocity_search(loop, grid.settings, rate, seed, part_of(progress, begin, end))
    return Outcome(
        metrics=metrics,
        traces=cells,
        tables={"limit_cycles": cycles},
        simulated_seconds=TICKS * grid.points**2 * grid.trials * scenario.fsm.period,
    )


def _axes(
    scenario: StepScenario, plant: SettlingPlant, dead_zone: float, increments: Sequence[float]
) -> list[AxisParams]:
    of = {"dead_zone": dead_zone, "divider": scenario.fsm.divider}
    error = scenario.measurement.bound
    return [
        allowed_axis(plant, measurement_error=error, increment=increment, **of)
        for increment in increments
    ]


def _map(
    scenario: StepScenario, grid: MapParams, seed: int, progress: Progress
) -> dict[str, Array]:
    error = scenario.measurement.bound
    theorem = settling_plant(scenario, "position")
    rows: list[dict[str, float]] = []
    dead_zones = np.linspace(*grid.dead_zone, grid.points)
    for i, dead_zone in enumerate(dead_zones.tolist()):
        progress(i / len(dead_zones), "map")
        increments = np.geomspace(*grid.increment, grid.points).tolist()
        axes = _axes(scenario, theorem, dead_zone, increments)
        done = classify(axes, scenario, trials=grid.trials, seed=seed * grid.points + i)
        for axis, verdict in zip(axes, done, strict=True):
            said = guarantee(axis, theorem, error)
            row = {"dead_zone": dead_zone, "increment": axis.increment, "share": said.small_share}
            row |= {"small_band": said.small_band, "guaranteed": said.everywhere}
            rows.append(row | {"verdict": verdict})
    return {name: column([row[name] for row in rows]) for name in rows[0]}


def _map_metrics(cells: Mapping[str, Array]) -> dict[str, Metric]:
    guaranteed, verdict, share = cells["guaranteed"] > 0, cells["verdict"], cells["share"]
    moving, cycling = (verdict != SETTLES) & (verdict != UNFINISHED), verdict == CYCLES

    def least(which: NDArray[np.bool_]) -> Metric:
        return measured(share[which].min(initial=math.inf), "", missing="none on the grid")

    counts = {
        "guaranteed": guaranteed,
        "settling": verdict == SETTLES,
        "cycling": cycling,
        "guaranteed_not_settling": guaranteed & moving,
    }
    unfinished = int((verdict == UNFINISHED).sum())
    note = "cells too slow for the trial" if unfinished else ""
    return {
        "map.cells": Metric(value=len(verdict), unit=""),
        **{f"map.{name}": Metric(value=int(of.sum()), unit="") for name, of in counts.items()},
        "map.unfinished": Metric(value=unfinished, unit="", note=note),
        "map.first_reversal": least(moving),
        "map.first_cycle": least(cycling),
    }


def _limit_cycles(scenario: StepScenario, seed: int) -> dict[str, Array]:
    plant = make_spring_mass_damper(scenario.plant, "position")
    theorem = settling_plant(scenario, "position")
    dead_zone, error = scenario.fsm.dead_zone, scenario.measurement.bound
    bound = 2 * (dead_zone - error) / (1 + theorem.total) / theorem.gain * scenario.fsm.divider
    axes = _axes(scenario, theorem, dead_zone, [share * bound for share in _SHARES])
    delay = scenario.measurement.delay_samples
    predicted = [
        predict_limit_cycle(plant, axis, scenario.fsm.period, delay_samples=delay) for axis in axes
    ]
    frequency, amplitude = oscillation(axes, scenario, seed=seed)
    return {
        "share": column(_SHARES),
        "increment": column([axis.increment for axis in axes]),
        "predicted_frequency": column([math.nan if p is None else p.frequency for p in predicted]),
        "predicted_amplitude": column([math.nan if p is None else p.amplitude for p in predicted]),
        "measured_frequency": frequency,
        "measured_amplitude": amplitude,
    }


def _cycle_metrics(cycles: Mapping[str, Array]) -> dict[str, Metric]:
    def first(name: str) -> Metric:
        found = cycles["share"][np.isfinite(cycles[name])]
        none = "none up to the largest increment tried"
        return measured(found[0] if len(found) else None, "", missing=none)

    both = np.isfinite(cycles["predicted_frequency"]) & np.isfinite(cycles["measured_frequency"])
    off = np.abs(cycles["predicted_frequency"] / cycles["measured_frequency"] - 1)[both]
    return {
        "describing_function.first_cycle": first("predicted_frequency"),
        "limit_cycle.first_cycle": first("measured_frequency"),
        "describing_function.frequency_error": measured(
            100 * float(off.max(initial=-math.inf)),
            "%",
            missing="no limit cycle is both predicted and simulated",
        ),
    }


def _sinusoid(scenario: StepScenario) -> ResolvedServoScenario:
    return resolve(SinusoidScenario(**vars(scenario) | {"desired": Sinusoid()}))


def _criteria(scenario: StepScenario, seed: int) -> dict[str, Metric]:
    axis = fsm_axis(scenario, "position")
    metrics = {}
    for name, accumulated in (("increment", False), ("compensation", True)):
        properties = tarraf_properties(axis_machine(axis, accumulated=accumulated))
        metrics[f"{name}.tarraf_properties"] = Metric(value=properties.count, unit="")
        note = "in small increments per m of error"
        metrics[f"{name}.gain"] = measured(
            properties.gain, "1/m", note=note, missing="no finite gain"
        )
    sinusoid = _sinusoid(scenario)
    every = round(sinusoid.fsm.period / sinusoid.step)
    traces = run_loops(sinusoid, ("fsm_compensation",), seed=seed).traces
    errors = (traces["desired_trajectory"] - traces["fsm_compensation.actual_trajectory"])[::every]
    fig3_axis, period = sinusoid.axis, sinusoid.fsm.period
    for name, folded in (("gore_criteria", False), ("folded.gore_criteria", True)):
        findings = gore_findings(fig3_axis, errors.tolist(), period, folded=folded)
        metrics[name] = Metric(value=2 - len(findings), unit="", note="; ".join(findings))
    return metrics


def axis_machine(axis: AxisParams, *, accumulated: bool) -> FiniteMachine:
    """Return the finite machine that the chart of one axis is.

    Its inputs are the five classes of the error. With ``accumulated`` the total compensation, in
    small increments, is state and output; otherwise the output is the increment and the total,
    which no later increment depends on, is left out of the state.
    """
    limited = replace(axis, limit=_LEVELS * axis.increment)
    chart = make_axis_chart(limited)
    small = axis.small_increment
    errors = (0.0, axis.dead_zone, axis.large_error, -axis.dead_zone, -axis.large_error)

    def step(state: tuple[str, int], error: float) -> tuple[tuple[str, int], float]:
        name, level = state
        snapshot = Snapshot(name, 0.0, AxisMemory(level * small, 0.0), True)
        following, _ = chart.step(snapshot, error, 0.0)
        total = round(following.memory.compensation / small)
        if accumulated:
            return (following.state, total), float(total)
        return (following.state, 0), following.memory.increment / small

    return explore((chart.initial, 0), errors, step, input_size=[abs(error) for error in errors])


def lap_chart(params: CompensatorParams) -> CompensatorChart:
    """Return Fig. 3 as it is drawn: every lap begins in, and returns to, the initial state.

    The chart that runs does a lap in one tick and does not return. Here a lap takes two ticks,
    the first decides as the one tick does and the second returns.
    """
    folded = make_compensator_chart(params)
    decide = [replace(transition, source=folded.initial) for transition in folded.transitions]
    returns: list[Transition[CompensatorInputs, CompensatorMemory]] = [
        Transition(
            source=state.name, target=folded.initial, guard=lambda _: True, label="next lap"
        )
        for state in folded.states
        if state.name != folded.initial and state.outcome is None
    ]
    ways = [*decide, *returns]
    return Chart(folded.name, states=folded.states, transitions=ways, memory=folded.memory)


def gore_findings(
    axis: AxisParams, errors: list[float], period: float, *, folded: bool
) -> tuple[str, ...]:
    """Return the contradictions to Gore's two criteria in the compensator's charts, in words.

    The trajectory ends with the run, of which ``errors``, m, has one a tick, and a tenth of it is
    lost to the camera. ``folded``: the chart of Fig. 3 is the one that runs, with a lap in one
    tick; otherwise as it is drawn.
    """
    blind = range(len(errors) // 2, len(errors) // 2 + len(errors) // 10)
    seen = [math.nan if i in blind else error for i, error in enumerate(errors)]
    params = CompensatorParams(axes=(axis,), period=period, end_time=(len(errors) - 1) * period)
    fig3 = make_compensator_chart(params) if folded else lap_chart(params)
    ticks = 1 if folded else 2  # of a lap
    fig3_inputs = [CompensatorInputs((error,), None, None) for error in seen for _ in range(ticks)]
    fig4 = make_axis_chart(axis)
    fig4_inputs = [error for error in seen if math.isfinite(error)]
    local: list[str] = []
    unused: list[str] = []
    apart: list[str] = []
    runs: tuple[tuple[Chart[Any, Any], Sequence[Any], float], ...] = (
        (fig3, fig3_inputs, period / ticks),
        (fig4, fig4_inputs, period),
    )
    for chart, inputs, step in runs:
        local += not_local(chart, inputs, period=step)
        unused += [
            f"{name} not used" for name in not_used(chart, replay(chart, inputs, period=step))
        ]
        apart += [f"no way from {start} to {end}" for start, end in not_connected(chart)]
    findings = []
    if local:
        findings.append(f"criterion 1: the rest depends on what {', '.join(local)} does")
    if unused or apart:
        findings.append(f"criterion 2: {', '.join(unused + apart)}")
    return tuple(findings)


def _velocity_search(
    scenario: StepScenario, count: int, rate: int, seed: int, progress: Progress
) -> dict[str, Metric]:
    """Search increments and thresholds on the force-to-velocity plant, without overshoot."""
    generator = np.random.default_rng(seed)
    height, period = scenario.desired.amplitude, 1 / rate
    rule = replace(scenario, fsm=replace(scenario.fsm, period=period))
    hold = scenario.plant.stiffness * period * height  # N per tick that hold the step's height
    increments = hold * 10 ** generator.uniform(-1.0, 1.0, count)
    large_errors = np.geomspace(scenario.fsm.dead_zone, height, count)
    generator.shuffle(large_errors)
    axes = [
        AxisParams(
            dead_zone=scenario.fsm.dead_zone,
            large_error=max(large_error, scenario.fsm.dead_zone),
            increment=increment,
            divider=scenario.fsm.divider,
        )
        for increment, large_error in zip(increments.tolist(), large_errors.tolist(), strict=True)
    ]
    axes[0] = fsm_axis(rule, "velocity")  # the one of step-response
    step = period / 8 if rate < 500 else period
    progress(0.0, f"force to velocity at {rate} Hz")
    response = run_fsm_trials(
        rule, "velocity", duration=_SEARCH_DURATION, step=step, axes=axes, seed=seed
    ).actual_trajectory
    end = response[:, int((1 - FINAL_PART) * response.shape[1]) :]
    error = np.abs(height - end).max(axis=1)
    ripple = 100 * np.ptp(end, axis=1) / height
    fits = response.max(axis=1) <= _WITHOUT_OVERSHOOT * height
    prefix = f"velocity_{rate}hz"
    if not fits.any():
        note = "every setting overshoots"
        return {f"{prefix}.least_error": Metric(value=None, unit="m", note=note)}
    best = int(np.argmin(np.where(fits, error, np.inf)))
    note = f"best of {count} settings without overshoot"
    found = metrics_of(
        {
            "least_error": (float(error[best]), "m", note),
            "ripple": (float(ripple[best]), "%", "of that setting, peak to peak"),
            "increment": (axes[best].increment, "N"),
            "large_error": (axes[best].large_error, "m"),
        }
    )
    return prefixed(prefix, found)


def classify(
    axes: Sequence[AxisParams], scenario: StepScenario, *, trials: int, seed: int
) -> NDArray[np.int64]:
    """Simulate settings from rest at random large errors and classify each.

    The initial errors are uniform between one and one and a half times the large error, so that
    both increments are used and the last small one falls anywhere in the dead zone. Plant, in the
    position form, and camera are the scenario's.

    Returns:
        The worst of each setting's trials, shape (n,): SETTLES, REVERSES (and then settles),
        CYCLES, or UNFINISHED where a trial was too short to tell.
    """
    generator = np.random.default_rng(seed)
    errors = np.array([axis.large_error for axis in axes])[:, None] * generator.uniform(
        1.0, 1.5, (len(axes), trials)
    )
    period = scenario.fsm.period
    increments = run_fsm_trials(
        scenario,
        "position",
        duration=TICKS * period,
        step=period,
        axes=[axis for axis in axes for _ in range(trials)],
        amplitudes=errors.ravel(),
        feedforward=False,
        seed=seed,
    ).increment
    reversed_ = np.any(increments < 0, axis=1)
    acting = np.any(increments[:, int((1 - _QUIET) * TICKS) :] != 0, axis=1)
    verdict = np.where(
        reversed_, np.where(acting, CYCLES, REVERSES), np.where(acting, UNFINISHED, SETTLES)
    )
    worst: NDArray[np.int64] = verdict.reshape(errors.shape).max(axis=1).astype(np.int64)
    return worst


def oscillation(
    axes: Sequence[AxisParams], scenario: StepScenario, *, seed: int = 0
) -> tuple[Array, Array]:
    """Simulate settings from rest at their large error and measure how they keep oscillating.

    Plant, in the position form, and camera are the scenario's.

    Returns:
        Frequency, rad/s, and amplitude of the error, m, half of peak to peak, shape (n,) each;
        NaN where it came to rest.
    """
    period = scenario.fsm.period
    errors = np.array([axis.large_error for axis in axes])
    run = run_fsm_trials(
        scenario,
        "position",
        duration=4 * TICKS * period,
        step=period / 8,
        axes=axes,
        amplitudes=errors,
        feedforward=False,
        seed=seed,
    )
    late = run.time >= run.time[-1] / 2
    time = run.time[late]
    acting = np.any(run.increment[:, 2 * TICKS :], axis=1)
    frequency, amplitude = np.full(len(axes), np.nan), np.full(len(axes), np.nan)
    for i in np.flatnonzero(acting):
        error = errors[i] - run.actual_trajectory[i, late]
        middle = error - (error.max() + error.min()) / 2
        rising = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
        if len(rising) > 1:
            lasted = time[rising[-1]] - time[rising[0]]
            frequency[i] = 2 * np.pi * (len(rising) - 1) / lasted
            amplitude[i] = float(np.ptp(error)) / 2
    return frequency, amplitude


def make_diagram(scenario: StabilityScenario) -> Diagram:
    """Return the wiring, for the block diagram."""
    return make_servo_diagram(scenario.loop, loops=("fsm",))


def make_loops(scenario: StabilityScenario) -> tuple[Diagram, ...]:
    """Return the loop that Gore's criteria are checked with."""
    return (make_servo_diagram(_sinusoid(scenario.loop), loops=("fsm_compensation",)),)


def figures(scenario: StabilityScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {
        "settling-map": plot_map(scenario.loop, outcome),
        "limit-cycles": plot_limit_cycles(outcome),
    }


_VERDICTS = (
    ("settles", "#f5e6c8"),
    ("reverses, then settles", "#e8a13a"),
    ("cycles", "#5a2d00"),
    ("not finished", "#ffffff"),
)
_PREDICTED: Final[Style] = {
    "color": "#333333",
    "linestyle": "--",
    "marker": "s",
    "ms": 5,
    "mfc": "white",
}
_SIMULATED: Final[Style] = FSM | {"marker": "o", "ms": 4}


def plot_map(scenario: StepScenario, outcome: Outcome) -> Figure:
    """Draw the behaviour of each cell and, over it, the theorem's guarantee."""
    cells = outcome.traces
    x, y = np.unique(cells["dead_zone"]), np.unique(cells["increment"])
    shape = (len(x), len(y))
    resolution = 1e3 * scenario.camera.resolution
    figure = new_figure(
        height=6.4,
        caption="Simulated FSM loop, worst trial of each cell, against the settling theorem: the "
        "increments inside its bound (hatched) are the ones that it guarantees. "
        f"The steps are the camera's resolution, {resolution:g} mm.",
    )
    axes = figure.subplots()
    axes.pcolormesh(
        1e3 * x,
        1e3 * y,
        cells["verdict"].reshape(shape).T,
        cmap=ListedColormap([color for _, color in _VERDICTS]),
        norm=BoundaryNorm([-0.5, 0.5, 1.5, 2.5, 3.5], 4),
        shading="nearest",
        rasterized=True,
    )
    axes.set_yscale("log")
    share = cells["share"].reshape(shape).T
    axes.contour(1e3 * x, 1e3 * y, share, levels=[1.0], colors="black", linewidths=1.8)
    guaranteed = cells["guaranteed"].reshape(shape).T
    axes.contourf(1e3 * x, 1e3 * y, guaranteed, levels=[0.5, 1.5], colors="none", hatches=["////"])
    handles: list[Patch | Line2D] = [
        Patch(facecolor=color, edgecolor="#777777", label=label) for label, color in _VERDICTS
    ]
    handles += [
        Patch(facecolor="none", edgecolor="black", hatch="////", label="settling theorem holds"),
        Line2D([], [], color="black", linewidth=1.8, label="its bound on the small increment"),
    ]
    axis = fsm_axis(scenario, "position")
    axes.plot(
        1e3 * axis.dead_zone, 1e3 * axis.increment, "o", ms=9, mfc="white", mec="black", mew=2
    )
    handles.append(
        Line2D([], [], ls="", marker="o", ms=9, mfc="white", mec="black", label="scenario")
    )
    count, cycling = (
        int(np.sum(guaranteed > 0)),
        int(np.sum(cells["verdict"][cells["guaranteed"] > 0] > 1)),
    )
    title = f"All {count} cells inside the theorem's bound settle"
    if cycling:
        title = f"{cycling} of {count} cells inside the theorem's bound do not settle"
    dress(axes, title=title, x="dead zone / mm", y="large increment n / mm per tick")
    ticks = [2, 5, 10, 20, 50]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.set_yticks([], minor=True)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def plot_limit_cycles(outcome: Outcome) -> Figure:
    """Draw frequency and amplitude of the limit cycles, predicted and simulated."""
    cycles = outcome.tables["limit_cycles"]
    figure = new_figure(
        height=4.0,
        caption="Limit cycles beyond the theorem's bound: frequency and amplitude by the "
        "describing function and in simulation, over the increment.",
    )
    off = metric_value(outcome.metrics, "describing_function.frequency_error")
    within = f": prediction within {off:.2g} %" if np.isfinite(off) else " of the limit cycle"
    left, right = figure.subplots(1, 2)
    for axes, name, scale, title, unit in (
        (left, "frequency", 1.0, f"(a) Frequency{within}", "frequency / (rad/s)"),
        (right, "amplitude", 1e3, "(b) Amplitude of the limit cycle", "amplitude / mm"),
    ):
        draw_lines(
            axes,
            cycles["share"],
            [
                Curve(scale * cycles[f"predicted_{name}"], "describing function", _PREDICTED),
                Curve(scale * cycles[f"measured_{name}"], "simulation", _SIMULATED),
            ],
            title=title,
            y=unit,
            over="increment / that of the bound",
            levels=[ReferenceLine(1.0, "bound of the settling theorem", PUBLISHED, upright=True)],
        )
        axes.set_xscale("log")
        axes.set_ylim(0.0, 1.15 * axes.dataLim.y1)
        axes.set_xticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    legend(left)
    return figure
