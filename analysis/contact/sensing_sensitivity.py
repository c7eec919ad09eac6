"""Cost of each imperfection of sensors and computer, alone and all together.

The limit of detection is no false contact in 100 runs of 15 s at three times the noise. It needs
``approaches=100``, some six CPU minutes; 8 ``trials`` take ten.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.contact.contact_metrics import mean_over_seeds
from chamfer.analysis.contact.contact_runs import Traces, measure, run_contact
from chamfer.analysis.drawing.figure_kit import draw_means, name_rows
from chamfer.analysis.drawing.figure_style import FORCE, LIMIT, NOTE, POSITION, dress, new_figure
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_MOTION,
    PLANAR_SLIDE,
    AdeptLoop,
    PlanarLoop,
    PumaLoop,
)
from chamfer.diagrams.contact.hybrid_loop_stability import linear_loops, resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
from chamfer.diagrams.contact.sensing import EXACT, ideal
from chamfer.models.validation import ParameterError, known, within
from chamfer.systems.force.contact_detection_law import APPROACH
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.sensing.force_sensor import ForceSensorParams

_MOST_TRIALS: Final = 1000
_PLANAR: Final = PlanarLoop(
    sensing="realistic",
    task=replace(PLANAR_SLIDE.task, start=(1.0, -1.3)),
    duration=10.3,
    measure_after=4.0,
)
_PUMA: Final = PumaLoop(sensing="realistic", duration=9.0, measure_after=5.0)
_ADEPT: Final = AdeptLoop(
    sensing="realistic", task=ADEPT_NUGGET_MOTION.task, duration=7.5, measure_after=2.0
)
_APPROACH: Final = AdeptLoop(
    sensor=ForceSensorParams(noise=1.5),  # N, three times what section 3.2.3 gives
    task=replace(AdeptLoop().task, start=(0.35, -0.3, 0.3, 0.0), distance=0.15),
    duration=15.5,  # s, of which 15 s in free motion
)


@dataclass(frozen=True, kw_only=True)
class SensitivityScenario:
    """The loops with realistic sensors and computers, and an approach in noise."""

    planar: PlanarLoop = _PLANAR  # slides, Fig. 2-6
    puma: PumaLoop = _PUMA  # presses its roller, Fig. 3-5
    adept: AdeptLoop = _ADEPT  # slides, Fig. 3-14
    approach: AdeptLoop = _APPROACH  # in free motion, and contact
    trials: int = 1  # seeds over which each loop and imperfection is averaged
    approaches: int = 2  # seeds in which contact may be found where there is none

    def __post_init__(self) -> None:
        for name in ("trials", "approaches"):
            if not 1 <= getattr(self, name) <= _MOST_TRIALS:
                raise ParameterError(name, getattr(self, name), f"1 to {_MOST_TRIALS}")


SENSING_SENSITIVITY: Final = SensitivityScenario()
LOOPS: Final = ("planar", "puma", "adept")
# By imperfection, what of a realistic loop it leaves as it is.
_KEPT: Final[dict[str, tuple[str, ...]]] = {
    "none": (),
    "noise": ("sensor.noise",),
    "cross_talk": ("sensor.cross_talk", "sensor.position"),
    "drift": ("sensor.bias", "sensor.drift", "sensor.tare"),
    "no_tare": ("sensor.bias", "sensor.drift"),
    "filter": ("sensor.bandwidth", "sensor.delay"),
    "quanta": ("sensor.resolution", "sensor.full_scale", "encoders.counts"),
    "velocity": ("encoders.velocity", "encoders.bandwidth"),
    "friction": ("surface.friction_noise",),
    "computation": ("controller.computation_delay", "controller.computation_jitter"),
}
_ALL: Final = tuple(path for name in _KEPT for path in _KEPT[name])
IMPERFECTIONS: Final = (*_KEPT, "sample_late", "all", "all_sample_late")
_MEASURED: Final = {"force": "N", "position": "m", "losses": "", "diverged": "", "growth": "1/s"}
_FROM_RUN: Final = {
    "force": "force.true_deviation",
    "position": "position.lag_error",
    "losses": "contact.losses_seen",
}


class SensingTrial(NamedTuple):
    """One of the seeds of a loop with an imperfection."""

    loop: str
    imperfection: str
    trial: int


def imperfect(loop: HybridScenario, imperfection: str) -> HybridScenario:
    """Return a resolved loop with one of :data:`IMPERFECTIONS` alone, or all of them.

    ``sample_late`` is a torque that comes a whole period late, without jitter.
    """
    late = imperfection.endswith("sample_late")
    kept = _ALL if imperfection.startswith("all") else _KEPT.get(imperfection, ())
    left_open: Any = {one.name: None for one in fields(loop.sensor) if one.default is None}
    delay = loop.controller.period if late else 0.0
    changed: dict[str, Any] = {
        "sensor": ideal(replace(loop.sensor, **left_open)),
        "encoders": EXACT,
        "surface": replace(loop.surface, friction_noise=0.0),
        "controller": replace(
            loop.controller,
            computation_delay=delay,
            computation_jitter=0.0,
            allow_unstable=True,
        ),
    }
    for path in kept:
        part, _, name = path.partition(".")
        if hasattr(changed[part], name) and not (late and part == "controller"):
            value = getattr(getattr(loop, part), name)
            changed[part] = replace(changed[part], **{name: value})
    if imperfection == "no_tare":  # which detection is told of
        changed["detection"] = replace(loop.detection, detect=None, release=None, samples=None)
    return fill(replace(loop, **changed))


def run_sensitivity(scenario: SensitivityScenario, seed: int, progress: Progress) -> Outcome:
    """Run every loop with every imperfection and every seed, and the approaches."""
    tasks = [
        SensingTrial(loop, imperfection, trial)
        for loop in LOOPS
        for imperfection in IMPERFECTIONS
        for trial in range(scenario.trials)
    ]
    tasks += [SensingTrial("approach", "noise", trial) for trial in range(scenario.approaches)]
    finished = run_each(partial(_run_task, scenario, seed), tasks, progress)
    loops = finished.select(lambda task: task.loop != "approach")
    approaches = finished.select(lambda task: task.loop == "approach")
    traces = {
        "loop": column([LOOPS.index(task.loop) for task in loops.tasks]),
        "imperfection": column([IMPERFECTIONS.index(task.imperfection) for task in loops.tasks]),
        "trial": column([task.trial for task in loops.tasks]),
        **{name: loops.column(name) for name in _MEASURED},
    }
    found = {name: approaches.column(name) for name in ("false_contacts", "latency")}
    return Outcome(
        metrics={**_metrics(traces), **_detection(found)},
        traces=traces,
        simulated_seconds=sum(getattr(scenario, task.loop).duration for task in finished.tasks),
        tables={"approaches": found},
    )


def _run_task(scenario: SensitivityScenario, seed: int, task: SensingTrial) -> Row:
    if task.loop == "approach":
        traces = run_contact(scenario.approach, trial_seed(seed, task.trial))
        late = latency(traces, 2 * known("noise", scenario.approach.sensor.noise))
        return {"false_contacts": float(contacts_in_air(traces)), "latency": late}
    loop = imperfect(getattr(scenario, task.loop), task.imperfection)
    growth = max(one.growth_rate() for one in linear_loops(loop))
    row = {"diverged": 0.0, "growth": growth if growth > NEUTRAL else 0.0}
    try:
        measured = measure(loop, run_contact(loop, trial_seed(seed, task.trial)))
    except ParameterError:  # all was well with the same loop at the start
        return {**row, **dict.fromkeys(_FROM_RUN), "diverged": 1.0}
    return {**row, **{name: measured[metric] for name, metric in _FROM_RUN.items()}}


def contacts_in_air(traces: Traces) -> int:
    """Return how often the mode changes to contact without a force."""
    made = np.flatnonzero((traces["mode"][1:] == 1) & (traces["mode"][:-1] != 1)) + 1
    touched = np.maximum.accumulate(traces["peak_force"] > 0)
    return int(np.sum(~touched[made]))


def latency(traces: Traces, level: float) -> float | None:
    """Return the delay of detection after the force passed a level, s; None without one.

    At most: the force may have passed it just after the row before.
    """
    passed = np.flatnonzero(traces["force"] > level)
    made = np.flatnonzero(traces["mode"] != APPROACH)
    if not len(passed) or not len(made):
        return None
    time = traces["time"]
    return max(0.0, float(time[made[0]] - time[max(passed[0] - 1, 0)]))


def _metrics(traces: Mapping[str, np.ndarray]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    undefined = "the run diverges, or there is no contact"
    for i, loop in enumerate(LOOPS):
        for j, imperfection in enumerate(IMPERFECTIONS):
            of = (traces["loop"] == i) & (traces["imperfection"] == j)
            for name, metric in {**_FROM_RUN, "growth": "loop.growth"}.items():
                mean = mean_over_seeds(traces[name][of], _MEASURED[name], undefined)
                metrics[f"{loop}.{imperfection}.{metric}"] = mean
    return metrics


def _detection(found: Mapping[str, np.ndarray]) -> dict[str, Metric]:
    late = found["latency"]
    return {
        "detection.false_contacts": Metric(
            value=float(found["false_contacts"].sum()), unit="", note=f"in {len(late)} approaches"
        ),
        "detection.latency": Metric(
            value=float(late.max()) if np.all(np.isfinite(late)) else None,
            unit="s",
            note="largest, after the force passes twice the noise",
        ),
    }


def resolve_sensing_sensitivity(scenario: SensitivityScenario) -> SensitivityScenario:
    """Return the scenario with its open fields filled in, and checked."""
    found: dict[str, Any] = {}
    for name in (*LOOPS, "approach"):
        with within(name):
            given = getattr(scenario, name)
            found[name] = resolve(given) if name == "approach" else fill(given)
            found[name].make_surface()
    return replace(scenario, **found)


_LABELS: Final = {
    "none": "none: ideal",
    "noise": "noise",
    "cross_talk": "cross-talk",
    "drift": "bias and drift, tared",
    "no_tare": "bias and drift, no tare",
    "filter": "filter and delay of the sensor",
    "quanta": "resolution and range, counts",
    "velocity": "differenced velocity",
    "friction": "uneven friction",
    "computation": "computation delay",
    "sample_late": "torque a period late",
    "all": "all but a period late",
    "all_sample_late": "all, and a period late",
}
_SAID: Final = ("diverged", "growth", "losses")
_LOOP_LABELS: Final = {
    "planar": "planar arm, slides",
    "puma": "Puma, presses",
    "adept": "Adept, slides",
}


def figures(scenario: SensitivityScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw force deviation and position error for each loop and imperfection, a dot a seed."""
    desired = {name: getattr(scenario, name).task.force for name in LOOPS}
    figure = new_figure(
        height=8.2,
        caption="Largest force deviation and position error of each loop with each imperfection "
        "of sensors and computer, alone and together (dots: seeds; dotted: ideal loop).",
    )
    panels = figure.subplots(2, len(desired), sharey=True, sharex="row")
    traces = outcome.traces
    force, position = panels
    for i, (loop, newtons) in enumerate(desired.items()):
        of = traces["loop"] == i
        which = traces["imperfection"][of]
        _bars(force[i], 100 * traces["force"][of] / newtons, which, FORCE["color"])
        _bars(position[i], 1e3 * traces["position"][of], which, POSITION["color"])
        force[i].axvline(100, **LIMIT)
        dress(
            force[i],
            title=f"{_LOOP_LABELS[loop]}, {newtons:g} N",
            x="force deviation / % of desired",
            y="",
        )
        dress(position[i], title="", x="position error / mm", y="")
        _say(force[i], {name: traces[name][of] for name in _SAID}, which)
    values = 100 * traces["force"] / np.array(list(desired.values()))[traces["loop"].astype(int)]
    known = values[np.isfinite(values) & (values > 0)]
    # With room to say more; a logarithmic axis can't find limits where all have diverged.
    force[0].set_xlim(known.min(initial=100.0) / 2, known.max(initial=100.0) * 8)
    force[0].set_xscale("log")
    force[0].xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    for panel in (force[0], position[0]):
        name_rows(panel, [_LABELS[name] for name in IMPERFECTIONS])
    return {"sensing-sensitivity": figure}


def _bars(axes: Axes, values: np.ndarray, which: np.ndarray, color: str) -> None:
    """Draw the means as bars, every seed, and the ideal loop's mean as a line."""
    draw_means(axes, values, which, color)
    ideal = values[np.isfinite(values) & (which == 0)]
    if len(ideal):
        axes.axvline(float(ideal.mean()), color="#555555", linewidth=0.8, linestyle=":")


def _say(axes: Axes, measured: Mapping[str, np.ndarray], which: np.ndarray) -> None:
    """Write the unstable loops that diverge, and where contact is lost unlike the ideal."""
    ideal = measured["losses"][which == 0]
    for row in np.unique(which):
        diverged, growth, lost = (measured[name][which == row] for name in _SAID)
        said = []
        if np.any(diverged > 0):
            said = ["diverges"]
        elif np.all(np.isfinite(lost)) and lost.mean() != ideal.mean():
            said = [f"losses: {lost.mean():.3g}"]
        if growth.max() > 0:
            said.insert(0, "unstable")
        place = axes.get_yaxis_transform()
        if said:
            text = ", ".join(said)
            box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
            axes.text(0.99, row, text, transform=place, ha="right", va="center", bbox=box, **NOTE)
