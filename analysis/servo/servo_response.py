"""Figs. 8 and 9: the PID and the FSM loop answer a step and a sinusoid."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.systems.analysis import DiscreteTimeApproximation
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import LinearSystem

from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    draw_lines,
    metric_value,
)
from chamfer.analysis.drawing.figure_style import DESIRED, NOTE, PID, PUBLISHED, Style, new_figure
from chamfer.analysis.drawing.figure_style import LOOPS as LOOKS
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.published.fsm_visual_servoing import OVERSHOOT, RISE_TIME
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column, measured
from chamfer.analysis.servo.response_metrics import (
    TrackingMetrics,
    step_metrics,
    tracking_metrics,
)
from chamfer.diagrams.servo.servo_loops import (
    LOOPS,
    camera_pid,
    make_pid_loop,
    make_servo_diagram,
)
from chamfer.diagrams.servo.servo_scenario import (
    RADIANS_PER_STEP,
    STEP,
    ResolvedServoScenario,
    SinusoidScenario,
    resolve,
)
from chamfer.models.plants.linear_response import fastest_mode
from chamfer.models.validation import ParameterError
from chamfer.systems.exact_discretisation import count_samples, fuse
from chamfer.systems.servo.compensator_law import (
    AxisParams,
    CompensatorParams,
    make_axis_chart,
    make_compensator_chart,
)
from chamfer.systems.servo.desired_trajectory import Sinusoid
from chamfer.systems.statechart.chart import Chart

Array = NDArray[np.float64]

SIGNALS: Final = ("desired_trajectory", "controller", "actual_trajectory")
_MOST_STEPS: Final = 5_000_000
_LARGEST_ROUNDING: Final = 1e-2  # of a loop, of the exponents of its response at its end
_LARGEST_GROWTH: Final = 6.0  # e-foldings of an unstable loop that are simulated
_STEP_LOOPS = (
    *("pid", "fsm", "fsm_velocity", "fsm_feedforward", "pid_position", "pid_command"),
    *("pid_camera", "pid_designed"),
)
_SINUSOID_LOOPS = ("pid", "fsm", "fsm_compensation", "fsm_velocity", "pid_position")
_SWEPT = ("pid", "fsm", "fsm_compensation")
_SWEEP = tuple(np.geomspace(0.1, 5.0, 9).tolist())  # rad/s
_TRANSIENT = 0.1  # of the first period


@dataclass(frozen=True, kw_only=True)
class ServoRun:
    """The results of the loops."""

    traces: dict[str, Array]  # time, desired_trajectory and <loop>.<signal>
    growth: dict[str, float]  # 1/s, of each unstable loop
    pid_loops: dict[str, LinearSystem]  # each as one block


def run_loops(
    scenario: ResolvedServoScenario,
    loops: Sequence[str],
    *,
    seed: int,
    progress: Progress | None = None,
    compiled: bool = False,
) -> ServoRun:
    """Simulate loops, exactly and on the same times.

    Each runs on its own, so that all FSM loops see the same noise of the camera; ``compiled``
    without Drake's simulator, for the points of a sweep. The traces of an unstable loop end, with
    NaN, after at most six e-foldings; a PID behind the camera is drawn from frame to frame.
    """
    duration, step = scenario.duration, scenario.step
    machines: dict[str, dict[str, Array]] = {}
    names = [name for name in loops if LOOPS[name].controller == "FSM"]
    for i, name in enumerate(names):
        machines[name] = _run_machine(scenario, name, seed, compiled)
        if progress is not None:
            progress((i + 1) / len(names))
    last = machines[names[-1]]
    traces = {name: last[name] for name in ("time", "desired_trajectory")}
    growth, pid_loops = {}, {}
    for name in loops:
        if name in machines:
            traces |= {f"{name}.{signal}": machines[name][signal] for signal in SIGNALS[1:]}
            continue
        by_camera = LOOPS[name].controller != "PID"
        if by_camera:
            rate = frame_growth(scenario, name)
        else:
            form = LOOPS[name].form or scenario.plant.form
            loop = pid_loops[name] = fuse(make_pid_loop(scenario, form))
            _require_exact(name, loop, duration)
            rate = growth_rate(loop)
        if rate > 0:
            growth[name] = rate
        lasts = duration if rate == 0 else min(duration, _LARGEST_GROWTH / rate)
        if by_camera:
            period = scenario.fsm.period
            diagram = make_servo_diagram(scenario, loops=(name,), step=period)
            frames = simulate(diagram, duration=lasts + period, step=period, seed=seed)
            time = traces["time"][: count_samples(lasts, step)]
            actual = frames.outputs[f"{name}.actual_trajectory"]
            outputs = {SIGNALS[2]: np.interp(time, frames.time, actual)}
        else:
            rows = simulate(loop, duration=lasts, step=step).outputs["y0"]
            outputs = dict(zip(SIGNALS[1:], rows.T[1:], strict=True))
        for signal, values in outputs.items():
            missing = np.full(len(traces["time"]) - len(values), math.nan)
            traces[f"{name}.{signal}"] = np.concatenate([values, missing])
    return ServoRun(traces=traces, growth=growth, pid_loops=pid_loops)


def _run_machine(
    scenario: ResolvedServoScenario, name: str, seed: int, compiled: bool
) -> dict[str, Array]:
    """Return time and signals of an FSM loop."""
    loop, duration, step = LOOPS[name], scenario.duration, scenario.step
    if not compiled:
        diagram = make_servo_diagram(scenario, loops=(name,), signals=SIGNALS, step=step)
        run = simulate(diagram, duration=duration, step=step, seed=seed)
        return {"time": run.time, **{one: run.outputs[f"{name}.{one}"] for one in SIGNALS}}
    # Loading the compiler takes longer than one run, which has no use for it.
    from chamfer.diagrams.servo.compiled_loop import run_fsm_trials

    trials = run_fsm_trials(
        scenario,
        loop.form or scenario.plant.form,
        duration=duration,
        step=step,
        feedforward=loop.feedforward,
        seed=seed,
    )
    return {"time": trials.time, **{one: getattr(trials, one)[0] for one in SIGNALS}}


def frame_growth(scenario: ResolvedServoScenario, name: str, *, later: int = 0) -> float:
    """Return the growth rate of a PID loop behind the camera, 1/s, or 0 for a stable loop.

    Its frames come later than the camera's by so many; what is rounded or noise is left out.
    """
    (gains, system), period = camera_pid(scenario, name), scenario.fsm.period
    plant, late = DiscreteTimeApproximation(fuse(system), period), later
    late += scenario.measurement.delay_samples
    n, summed = len(plant.A()), gains.integral * period
    # States: the plant's, the integral part, the errors on their way.
    frame = np.eye(n + 1 + late, k=-1)
    frame[: n + 2], error = 0.0, np.zeros(n + 1 + late)
    frame[n + 1 : n + 2, :n] = -plant.C()
    error[:n] = -plant.C()[0]
    if late:
        error = np.eye(n + 1 + late)[-1]
    frame[:n, :n], frame[n, n] = plant.A(), 1.0
    frame[n] += summed * error
    frame[:n] += plant.B() * ((gains.proportional + summed) * error + np.eye(n + 1 + late)[n])
    largest = float(np.abs(np.linalg.eigvals(frame)).max())
    return math.log(largest) / period if largest > 1 + 1e-9 else 0.0


def eq_2_delay_margin(scenario: ResolvedServoScenario) -> float:
    """Return how much dead time, s, makes the loop of eq. (2) unstable, infinite if none does."""
    ratio = fuse(camera_pid(scenario, "pid_camera")[1])
    a, b, c = ratio.A(), ratio.B(), ratio.C()
    # Where the gain is 1 the Hamiltonian matrix has eigenvalues on the imaginary axis.
    modes = np.linalg.eigvals(np.block([[a, b @ b.T], [-c.T @ c, -a.T]]))
    least = 1e-9 * float(np.abs(modes).max())  # the integrator, which the plant's zero hides
    crossovers = [one.imag for one in modes if one.imag > max(least, 1e3 * abs(one.real))]
    returned = [(c @ np.linalg.solve(1j * w * np.eye(len(a)) - a, b))[0, 0] for w in crossovers]
    phases = np.mod(math.pi + np.angle(returned), 2 * math.pi)
    return float((phases / crossovers).min(initial=math.inf))


def pid_response(scenario: ResolvedServoScenario, run: ServoRun, name: str) -> tuple[Array, Array]:
    """Return times and actual trajectory of a PID loop, fine enough for its fastest mode.

    They are the run's unless the loop is faster than the plant, which the run's steps follow.

    Raises:
        ParameterError: If it takes too many steps.
    """
    duration, step = scenario.duration, scenario.step
    loop = run.pid_loops[name]
    initial = loop.CreateDefaultContext().get_continuous_state_vector().CopyToVector()
    fastest = fastest_mode(loop.A(), loop.C()[-1], initial)
    if step * fastest <= RADIANS_PER_STEP:
        return run.traces["time"], run.traces[f"{name}.actual_trajectory"]
    finer = step / 2.0 ** math.ceil(math.log2(step * fastest / RADIANS_PER_STEP))
    if duration / finer > _MOST_STEPS:
        raise ParameterError(
            f"the fastest mode of {name}",
            fastest,
            f"at most {RADIANS_PER_STEP * _MOST_STEPS / duration:.4g} 1/s in {duration:g} s",
        )
    fine = simulate(loop, duration=duration, step=finer)
    return fine.time, fine.outputs["y0"][:, -1]


def _require_exact(name: str, loop: LinearSystem, duration: float) -> None:
    """Refuse a loop of which rounding leaves nothing: poles and response would be made up."""
    fastest = float(np.abs(loop.A()).max())
    most = _LARGEST_ROUNDING / (np.finfo(np.float64).eps * duration)
    if not fastest <= most:
        raise ParameterError(
            f"the largest coefficient of {name}",
            fastest,
            f"at most {most:.4g}, gains and plant make the loop overflow",
        )


def growth_rate(loop: LinearSystem) -> float:
    """Return the largest real part of a PID loop's poles, 1/s, or 0 for a stable loop.

    The poles on the imaginary axis are those of the desired trajectory.
    """
    poles = np.linalg.eigvals(loop.A())
    largest = float(poles.real.max())
    return largest if largest > 1e-9 * float(np.abs(poles).max()) else 0.0


def run_step(
    scenario: ResolvedServoScenario, seed: int, progress: Progress, *, compiled: bool = False
) -> Outcome:
    """Run Fig. 8: a step, on the plants that the paper and the hardware have."""
    run = run_loops(scenario, _STEP_LOOPS, seed=seed, progress=progress, compiled=compiled)
    reference = _amplitude(scenario)
    metrics: dict[str, Metric] = {}
    for name in _STEP_LOOPS:
        if name in run.growth:
            metrics |= _unstable(name, run.growth[name], "overshoot", "%")
            continue
        if name in run.pid_loops:
            time, actual = pid_response(scenario, run, name)
        else:
            time, actual = run.traces["time"], run.traces[f"{name}.actual_trajectory"]
        metrics |= step_metrics(time, actual, reference).as_metrics(name, "m")
        if name.startswith("pid"):
            metrics[f"{name}.growth_rate"] = Metric(value=0.0, unit="1/s", note="stable")
    metrics |= _compensator_metrics(scenario) | _camera_metrics(scenario, run)
    metrics["fsm.slope_ratio"] = _slope_ratio(scenario.axis, reference, run)
    return Outcome(metrics=metrics, traces=run.traces, simulated_seconds=scenario.duration)


def _amplitude(scenario: ResolvedServoScenario) -> float:
    if scenario.desired.amplitude == 0:
        raise ParameterError("desired.amplitude", 0.0, "a finite number other than 0")
    return scenario.desired.amplitude


run_step_compiled = partial(run_step, compiled=True)  # for a point of a sweep


def run_sinusoid(
    scenario: ResolvedServoScenario, seed: int, progress: Progress, *, compiled: bool = False
) -> Outcome:
    """Run Fig. 9: a sinusoid, and the error over its frequency."""
    run = run_loops(
        scenario,
        _SINUSOID_LOOPS,
        seed=seed,
        progress=lambda done, doing="": progress(0.3 * done, doing),
        compiled=compiled,
    )
    _amplitude(scenario)
    metrics: dict[str, Metric] = {}
    for name in _SINUSOID_LOOPS:
        if name in run.growth:
            metrics |= _unstable(name, run.growth[name], "error_rms", "m")
            continue
        metrics |= _tracking(scenario.frequency, run, name).as_metrics(name, "m")
    for ratio, loop, error in (
        ("error_rms_ratio", "fsm", "error_rms"),
        ("error_rms_ratio_compensation", "fsm_compensation", "error_rms"),
        ("error_rms_ratio_velocity", "fsm_velocity", "error_rms"),
        ("transient_error_ratio", "fsm", "transient_error_rms"),
    ):
        metrics[ratio] = _ratio(metrics, f"{loop}.{error}", f"pid.{error}")
    metrics |= _compensator_metrics(scenario)
    sweep = _sweep(scenario, seed, progress)
    for name in ("fsm", "fsm_compensation"):
        metrics[f"{name}.better_below"] = _crossover(sweep, name)
    return Outcome(
        metrics=metrics,
        traces=run.traces,
        simulated_seconds=scenario.duration,
        tables={"frequencies": sweep},
    )


run_sinusoid_compiled = partial(run_sinusoid, compiled=True)


def _tracking(frequency: float, run: ServoRun, name: str) -> TrackingMetrics:
    period = 2 * math.pi / frequency
    return tracking_metrics(
        run.traces["time"],
        run.traces["desired_trajectory"],
        run.traces[f"{name}.actual_trajectory"],
        frequency=frequency,
        transient=_TRANSIENT * period,
        steady=period,
    )


def _sweep(scenario: ResolvedServoScenario, seed: int, progress: Progress) -> dict[str, Array]:
    rows: dict[str, list[float]] = {"frequency": [], **{name: [] for name in _SWEPT}}
    for i, frequency in enumerate(_SWEEP):
        progress(0.3 + 0.7 * i / len(_SWEEP), f"{frequency:.2g} rad/s")
        desired = Sinusoid(amplitude=scenario.desired.amplitude, frequency=frequency)
        other = {"desired": desired, "duration": None, "step": None}
        at = resolve(SinusoidScenario(**vars(scenario) | other))
        run = run_loops(at, _SWEPT, seed=seed, compiled=True)
        rows["frequency"].append(frequency)
        for name in _SWEPT:
            unstable = name in run.growth
            rows[name].append(math.nan if unstable else _tracking(frequency, run, name).error_rms)
    return {name: column(values) for name, values in rows.items()}


def _crossover(sweep: Mapping[str, Array], name: str) -> Metric:
    advantage = np.log(sweep[name] / sweep["pid"])
    worse = np.flatnonzero(~(advantage < 0))
    i = int(worse[0]) if len(worse) else 0
    if i == 0:
        which = "worse" if len(worse) else "better"
        note = f"{which} than the PID at every frequency tried"
        return Metric(value=None, unit="rad/s", note=note)
    part = advantage[i - 1] / (advantage[i - 1] - advantage[i])
    logs = np.log(sweep["frequency"])
    return Metric(value=float(np.exp(logs[i - 1] + part * (logs[i] - logs[i - 1]))), unit="rad/s")


def _unstable(name: str, growth: float, undefined: str, unit: str) -> dict[str, Metric]:
    note = f"unstable, grows at {growth:.4g} 1/s"
    return {
        f"{name}.growth_rate": Metric(value=growth, unit="1/s", note=note),
        f"{name}.{undefined}": Metric(value=None, unit=unit, note=note),
    }


def _ratio(metrics: Mapping[str, Metric], over: str, under: str) -> Metric:
    a, b = metrics[over].value, metrics[under].value
    if a is None or not b:
        return Metric(value=None, unit="", note=f"{under} is undefined or zero")
    return Metric(value=a / b, unit="")


def _compensator_metrics(scenario: ResolvedServoScenario) -> dict[str, Metric]:
    axis, unit = scenario.axis, "m" if scenario.plant.form == "position" else "N"
    return {
        "fsm.increment": Metric(value=axis.increment, unit=unit),
        "fsm.large_error": Metric(value=axis.large_error, unit="m"),
    }


def _camera_metrics(scenario: ResolvedServoScenario, run: ServoRun) -> dict[str, Metric]:
    """Return the delay margins of both PIDs, and the gains of the camera's."""
    gains, period = camera_pid(scenario, "pid_designed")[0], scenario.fsm.period
    frames = 0
    for more in (64, 32, 16, 8, 4, 2, 1):
        if frame_growth(scenario, "pid_designed", later=frames + more) == 0:
            frames += more
    held = f"a frame is held for {1e3 * period:.3g} ms, on average {500 * period:.3g} ms late"
    metrics = {
        "pid_camera.growth_rate_late": Metric(
            value=frame_growth(scenario, "pid_camera", later=1),
            unit="1/s",
            note="with frames that come one period later",
        ),
        "pid_designed.proportional": Metric(value=gains.proportional, unit=""),
        "pid_designed.integral": Metric(value=gains.integral, unit="1/s"),
    }
    for name, margin, note in (
        ("pid", eq_2_delay_margin(scenario), held),
        ("pid_designed", frames * period, "in whole frames, 127 at most, beyond hold and latency"),
    ):
        missing = "unstable" if name in run.growth else "infinite"
        value = None if name in run.growth else margin
        metrics[f"{name}.delay_margin"] = measured(value, "s", note=note, missing=missing)
    return metrics


def _slope_ratio(axis: AxisParams, height: float, run: ServoRun) -> Metric:
    """Compare the response's slope while the error is large with that while it is small."""
    time = run.traces["time"]
    error = abs(height) - np.abs(run.traces["fsm.actual_trajectory"])
    moving = np.flatnonzero(error < axis.dead_zone)
    until = int(moving[0]) if len(moving) else len(error)
    slope = -np.gradient(error, time)
    far = slope[:until][error[:until] >= axis.large_error]
    near = slope[:until][error[:until] < (axis.dead_zone + axis.large_error) / 2]
    if len(far) < 2 or len(near) < 2 or np.median(near) <= 0:
        return Metric(value=None, unit="", note="the error does not pass through both classes")
    return Metric(value=float(np.median(far) / np.median(near)), unit="")


def make_diagram(scenario: ResolvedServoScenario) -> Diagram:
    """Return the wiring, for the block diagram."""
    return make_servo_diagram(scenario)


def make_step_loops(scenario: ResolvedServoScenario) -> tuple[Diagram, ...]:
    """Return all loops of Fig. 8."""
    return (make_servo_diagram(scenario, loops=_STEP_LOOPS),)


def make_sinusoid_loops(scenario: ResolvedServoScenario) -> tuple[Diagram, ...]:
    """Return all loops of Fig. 9."""
    return (make_servo_diagram(scenario, loops=_SINUSOID_LOOPS),)


def make_charts(scenario: ResolvedServoScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the state charts."""
    axis = scenario.axis
    return (
        make_compensator_chart(CompensatorParams(axes=(axis,), period=scenario.fsm.period)),
        make_axis_chart(axis),
    )


_OTHERS = ("fsm_feedforward", "fsm_velocity", "pid_position", "pid_command")
_ERROR, _RESPONSE = "desired minus actual / mm", "trajectory / m"


def step_figures(scenario: ResolvedServoScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw Fig. 8: responses, rise, errors at the end, other plants, and the PID by camera."""
    metrics = outcome.metrics
    figure = new_figure(
        height=11.5,
        caption=f"{_rise(outcome, 'fsm')}; {_rise(outcome, 'pid')} (a, b). The PID has a "
        "continuous error and its own plant there; in (f) both have the same camera and plant.",
    )
    overview, rise, errors, others, camera, fair = figure.subplots(3, 2).ravel()
    time, height = outcome.traces["time"], scenario.desired.amplitude
    lines = [_desired(outcome), *_responses(outcome, "pid", "fsm")]
    title = f"(a) {_rise(outcome, 'fsm')}; {_rise(outcome, 'pid')}"
    draw_lines(overview, time, lines, title=title, y=_RESPONSE, key="below", columns=3)
    _step_rise(rise, scenario, outcome)
    zone, lines = _dead_zone(scenario), _errors(outcome, "pid", "fsm", "fsm_velocity")
    ends = [
        f"{name.upper()} {'inside' if rest <= scenario.fsm.dead_zone else 'outside'}"
        for name in ("fsm", "pid")
        if math.isfinite(rest := metric_value(metrics, f"{name}.error_max"))
    ]
    title = f"(c) Error at the end, dead zone: {', '.join(ends)}"
    draw_lines(errors, time, lines, title=title, y=_ERROR, bands=[zone], key="below", columns=2)
    errors.set_ylim(-6e3 * scenario.fsm.dead_zone, 6e3 * scenario.fsm.dead_zone)
    lines = [_desired(outcome, None), *_responses(outcome, *_OTHERS, beyond=3.0 * abs(height))]
    settled = sum(math.isfinite(metric_value(metrics, f"{one}.settling_time")) for one in _OTHERS)
    title = f"(d) On other plants {settled} of {len(_OTHERS)} loops settle"
    draw_lines(others, time, lines, title=title, y=_RESPONSE, key="below")
    growth = metrics["pid_command.growth_rate"].value
    if growth:
        others.text(
            0.06, 2.1 * height, f"PID, commanded position:\ngrows, {growth:.3g} 1/s", fontsize=8
        )
    others.set_ylim(*sorted((-0.6 * height, 3.4 * height)))
    others.set_xlim(0, min(1.0, float(time[-1])))
    _step_by_camera(camera, scenario, outcome)
    lines = [_desired(outcome), *_responses(outcome, "fsm", "pid_designed")]
    times = [
        _seconds(metric_value(metrics, f"{one}.rise_time")) for one in ("pid_designed", "fsm")
    ]
    title = f"(f) Same camera and plant: PID rises in {times[0]}, FSM in {times[1]}"
    draw_lines(fair, time, lines, title=title, y=_RESPONSE, key="below")
    says = ["error at the end"]
    for name in ("fsm", "pid_designed"):
        rest = metric_value(metrics, f"{name}.steady_state_error", 1e3)
        says.append(f"{name[:3].upper()}: {rest:.1f} mm")
    fair.text(0.98, 0.3, "\n".join(says), transform=fair.transAxes, ha="right", **NOTE)
    return {"step-response": figure}


def _rise(outcome: Outcome, name: str) -> str:
    """Say how a loop rises; an overshoot below 1 % is none."""
    rise, over = (
        metric_value(outcome.metrics, f"{name}.{of}") for of in ("rise_time", "overshoot")
    )
    if not math.isfinite(rise):
        return f"{name.upper()} does not settle"
    said = f"with {over:.3g} % overshoot" if over >= 1 else "without overshoot"
    return f"{name.upper()} rises in {_seconds(rise)} {said}"


def _seconds(time: float) -> str:
    return f"{1e3 * time:.2g} ms" if time < 0.1 else f"{time:.2g} s"


def _step_by_camera(axes: Axes, scenario: ResolvedServoScenario, outcome: Outcome) -> None:
    height, period = scenario.desired.amplitude, scenario.fsm.period
    margin, rate, late = (
        metric_value(outcome.metrics, name)
        for name in ("pid.delay_margin", "pid_camera.growth_rate", "pid_camera.growth_rate_late")
    )
    verdict = "diverges" if rate else "diverges a frame late" if late else "is stable"
    title = f"(e) With the FSM's camera the PID of eq. (2) {verdict}"
    seen = Curve(outcome.traces["pid.actual_trajectory"], "eq. (2), continuous error", PID)
    lines = [*_responses(outcome, "pid_camera"), _desired(outcome, None), seen]
    draw_lines(axes, outcome.traces["time"], lines, title=title, y=_RESPONSE, key="below")
    axes.set_xlim(0, min(40 * period, float(outcome.traces["time"][-1])))
    axes.set_ylim(*sorted((-3.2 * height, 5.2 * height)))
    says = f"a frame every {1e3 * period:.3g} ms"
    if math.isfinite(margin):
        says = f"delay margin {1e3 * margin:.3g} ms, {says}"
    for one, when in ((rate, "behind the camera"), (late, "frames a period later")):
        share = f"grows by {100 * math.expm1(one * period):.2g} % a frame" if one else "stable"
        says += f"\n{when}: {share}"
    axes.text(0.98, 0.04, says, transform=axes.transAxes, ha="right", **NOTE)


def _step_rise(axes: Axes, scenario: ResolvedServoScenario, outcome: Outcome) -> None:
    traces, metrics = outcome.traces, outcome.metrics
    time, lines = traces["time"], _responses(outcome, "pid", "fsm")
    rise = metric_value(metrics, "pid.rise_time")
    title, over = "(b) Rise and overshoot of the PID", "time / ms"
    if not np.isfinite(rise):
        draw_lines(axes, 1e3 * time, lines, title=title, y=_RESPONSE, over=over)
        axes.text(0.05, 0.9, "the PID loop does not settle", transform=axes.transAxes, **NOTE)
        return
    final = scenario.desired.amplitude - (metrics["pid.steady_state_error"].value or 0.0)
    levels = [ReferenceLine(final, None, {"color": "#999999", "linewidth": 0.8})]
    if scenario == resolve(STEP):  # the published values are of no other
        peak = final * (1 + OVERSHOOT / 100)
        levels.append(ReferenceLine(peak, f"published overshoot {OVERSHOOT:g} %", PUBLISHED))
        response = traces["pid.actual_trajectory"]
        start = float(np.interp(0.1, np.maximum.accumulate(response / final), time))
        end = (start + RISE_TIME) * 1e3
        bar = {"arrowstyle": "|-|", "color": PUBLISHED["color"], "mutation_scale": 3}
        axes.annotate("", (end, 0.9 * final), (start * 1e3, 0.9 * final), arrowprops=bar)
        said = f"published rise time {RISE_TIME * 1e3:g} ms\nmeasured {rise * 1e3:.3g} ms"
        axes.text(end * 1.15, 0.85 * final, said, **NOTE)
    draw_lines(
        axes,
        1e3 * time,
        lines,
        title=title,
        y=_RESPONSE,
        over=over,
        levels=levels,
        key="below",
        columns=2,
    )
    axes.set_xlim(0, 8e3 * rise)
    look: Style = {"ha": "right", "va": "top", "fontsize": 8}
    axes.text(8e3 * rise, 0.94 * final, f"final {final:.3f} m ", **look)


def sinusoid_figures(scenario: ResolvedServoScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw Fig. 9: the responses, the errors, and the error over the frequency."""
    found = outcome.metrics["fsm.better_below"]  # its note says it where there is no crossing
    better = f"better than the PID below {found.value:.2g} rad/s" if found.value else found.note
    figure = new_figure(
        height=7.5,
        caption=f"By rms error the FSM is {better} (c). Without "
        "its feedforward (compensation only) it lags the sinusoid.",
    )
    panels = figure.subplot_mosaic([["response", "response"], ["error", "sweep"]])
    time, sweep = outcome.traces["time"], outcome.tables["frequencies"]
    response, error = panels["response"], panels["error"]
    lines = [_desired(outcome), *_responses(outcome, *_SWEPT)]
    lags = [
        metric_value(outcome.metrics, f"{name}.phase_lag") for name in ("fsm", "fsm_compensation")
    ]
    title = f"(a) FSM lags by {lags[0]:.2g} deg, with compensation only by {lags[1]:.2g} deg"
    draw_lines(response, time, lines, title=title, y=_RESPONSE, key="below", columns=4)
    zone, lines = _dead_zone(scenario), _errors(outcome, "pid", "fsm")
    errors = [metric_value(outcome.metrics, f"{name}.error_rms", 1e3) for name in ("fsm", "pid")]
    title = f"(b) RMS error after a period: FSM {errors[0]:.2g} mm, PID {errors[1]:.2g} mm"
    draw_lines(error, time, lines, title=title, y=_ERROR, bands=[zone], key="below", columns=3)
    loops, marked = {name: LOOKS[name] for name in _SWEPT}, {"marker": "o", "ms": 3}
    here = ReferenceLine(scenario.frequency, "frequency of (a), (b)", DESIRED, upright=True)
    draw_lines(
        panels["sweep"],
        sweep["frequency"],
        [Curve(1e3 * sweep[name], label, marked | look) for name, (label, look) in loops.items()],
        title=f"(c) FSM is {better}",
        y="rms error / mm",
        over="frequency / (rad/s)",
        levels=[here],
        log=True,
        key="below",
        columns=2,
    )
    return {"sinusoid-response": figure}


def _desired(outcome: Outcome, label: str | None = "desired") -> Curve:
    return Curve(outcome.traces["desired_trajectory"], label, DESIRED)


def _dead_zone(scenario: ResolvedServoScenario) -> FilledBand:
    zone = 1e3 * scenario.fsm.dead_zone
    return FilledBand(-zone, zone, "dead zone")


def _responses(outcome: Outcome, *names: str, beyond: float = np.inf) -> list[Curve]:
    """Return what loops do, up to where they leave the picture."""
    lines = []
    for name in names:
        shown = outcome.traces[f"{name}.actual_trajectory"].copy()
        gone = np.flatnonzero(~(np.abs(shown) < beyond))
        if len(gone):
            shown[gone[0] + 1 :] = np.nan
        lines.append(Curve(shown, *LOOKS[name]))
    return lines


def _errors(outcome: Outcome, *names: str) -> list[Curve]:
    desired = outcome.traces["desired_trajectory"]
    actual = ((name, outcome.traces[f"{name}.actual_trajectory"]) for name in names)
    return [Curve(1e3 * (desired - values), *LOOKS[name]) for name, values in actual]
