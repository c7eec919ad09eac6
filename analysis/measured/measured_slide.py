"""Observers of the normal on a real wrench, and further results of the recording.

A real arm slides a tool over a flat table. The observers get what they get in a loop: the force,
its difference, and the measured position as the nominal one, all as means over their period. The
stiffness is then that of tool and table together: how far the measured tip sinks in with the load.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

from chamfer.analysis.campaign.trial_metrics import prefixed
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.drawing.figure_style import (
    AXIS_LOOKS,
    BAND,
    FORCE,
    OBSERVER_LOOKS,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.identify.identified import identify
from chamfer.analysis.identify.log import Log, read_log
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column, measured
from chamfer.analysis.surface.normal_metrics import (
    DEVIATIONS,
    TELLS,
    angle_between,
    normalised_square,
)
from chamfer.models.recordings.recordings import SLIDES, slide_path
from chamfer.models.validation import (
    ParameterError,
    known,
    require_not_negative,
    require_numbers,
    require_positive,
    require_same,
)
from chamfer.systems.estimation.model_error import ModelErrorParams
from chamfer.systems.estimation.normal_filter import (
    CONTACT_THRESHOLD,
    KINDS,
    NormalStatus,
    ObserverKind,
    ResolvedSurfaceObserverParams,
    Sample,
    SurfaceObserverParams,
    tangential_deviation,
)
from chamfer.systems.estimation.surface_observer_law import make_filter
from chamfer.systems.force.contact_detection_law import (
    CONTACT,
    ContactDetectionLaw,
    ContactDetectionParams,
)

Array = NDArray[np.float64]

_BAND: Final = float(chi2.ppf(0.95, 3))  # as the thesis' uncertainties are, of three axes (4-9)
_TOLD: Final = ("friction", "stiffness", "damping", "contact.stiffness")
_TURNED: Final = 0.1  # rad, by which a sensor is turned beyond doubt
_WORST: Final = {
    "adaptive.coverage": min,
    "rms_ratio": max,
    "adaptive.pulls": max,
    "adaptive.unfit": max,
}
_BOUNCE: Final = 1.0  # s after the touch; contact that is lost later is no bounce


@dataclass(frozen=True, kw_only=True)
class MeasuredSlideScenario:
    """The recording, and the observers' settings for it.

    Told is what one half of ``table_a`` shows; the others were not fitted, but seen.
    """

    recording: str | None = None  # a recording's name or a log's file; None: all that are included
    free: float = 2.0  # s, at the start, without contact: their mean is the sensor's offset
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)  # as believed before contact; base axes
    straight: float = 0.02  # rad, height of the path over its width; above it no plane is fitted
    settle: float = 2.0  # s, from the touch on, in which errors don't count
    detection: ContactDetectionParams = ContactDetectionParams()  # None: of the noise without load
    observer: SurfaceObserverParams = SurfaceObserverParams(
        stiffness=((1e5, 0.0, 0.0), (0.0, 1e5, 0.0), (0.0, 0.0, 1e5)),  # of tip and table
        force_noise=1.0,  # N, by which the force varies in contact; at rest it is 0.06
        model_error=ModelErrorParams(
            stiffness=0.3,  # halves of table_a show 1.1e5 to 1.6e5 N/m
            position=1e-4,  # m, of table_a's plane
            position_length=0.02,  # m, where the error's correlation is 1 / e
            friction=0.1,  # rad, 0.074 of samples of which neighbours are correlated
        ),
    )

    def __post_init__(self) -> None:
        require_positive(self, "free", "straight")
        require_not_negative(self, "settle")
        require_numbers(self, 3, "normal")
        if not any(self.normal):
            raise ParameterError("normal", self.normal, "a vector other than 0")
        require_same(self.observer, SurfaceObserverParams(), "observer", "kind", why="all run")
        for name in ("stiffness", "force_noise"):
            if getattr(self.observer, name) is None:
                raise ParameterError(f"observer.{name}", None, "given: no log has it")


MEASURED_SLIDE: Final = MeasuredSlideScenario()


def resolve_measured(scenario: MeasuredSlideScenario) -> MeasuredSlideScenario:
    """Return the scenario; every recording must be readable and have the base's axes."""
    for name, path in _paths(scenario).items():
        log = read_log(path)
        _recorded(scenario, name, log)
        if name not in SLIDES:
            _require_axes(name, log)
    return scenario


def _require_axes(name: str, log: Log) -> None:
    """Refuse forces in other axes than the base's, in which no observer could be right."""
    turned = identify(log).quantities.get("sensor.rotation")
    if turned is not None and turned.low is not None and turned.low > _TURNED:
        allowed = (
            f"forces in the base's axes, not turned by {turned.value:.2f} rad ({turned.note})"
        )
        raise ParameterError("recording", name, allowed)


def _paths(scenario: MeasuredSlideScenario) -> dict[str, Path]:
    given = scenario.recording
    if given is None:
        return {name: slide_path(name) for name in SLIDES}
    path = Path(given)
    if given in SLIDES or not path.is_file():
        return {given: slide_path(given)}
    return {re.sub(r"[^a-z0-9_-]", "_", path.stem.lower()): path}


class Recorded(NamedTuple):
    """A recording as means over the observers' period, n rows; base axes."""

    time: Array  # (n,), s
    force: Array  # (n, 3), N, of the surface on the tool, without offset
    force_rate: Array  # (n, 3), N/s
    position: Array  # (n, 3), m
    velocity: Array  # (n, 3), m/s
    contact: NDArray[np.bool_]  # (n,)
    normal: Array  # (3,), the true one
    plane: str  # how it was found
    detected: tuple[Array, ...]  # s, of touches, and of losses


def _recorded(scenario: MeasuredSlideScenario, name: str, log: Log) -> Recorded:
    """Return the recording of a log.

    Raises:
        ParameterError: If it lacks force or position, or a part without contact.
    """
    if log.force is None or log.position is None:
        raise ParameterError("recording", name, "a log with force and position of the tip")
    free = log.time < log.time[0] + scenario.free
    force = log.force - log.force[free].mean(axis=0)
    rows, period = round(scenario.observer.period / log.period), scenario.observer.period
    count = len(force) // max(rows, 1)
    if rows < 1 or count < 2:
        raise ParameterError(
            "observer.period", period, f"at least that of the log, {log.period:g}"
        )

    def mean(values: Array) -> Array:
        return np.asarray(values[: rows * count].reshape(count, rows, -1).mean(axis=1))

    def rate(values: Array) -> Array:
        return np.diff(values, axis=0, prepend=values[:1]) / (rows * log.period)

    time, pushed, position = mean(log.time)[:, 0], mean(force), mean(log.position)
    least = CONTACT_THRESHOLD * known("force_noise", scenario.observer.force_noise)
    contact = np.linalg.norm(pushed, axis=1) > least
    if np.any(contact & (time < time[0] + scenario.free - period)):
        allowed = f"a time without contact: {name} has more than {least:g} N then"
        raise ParameterError("free", scenario.free, allowed)
    believed = np.array(scenario.normal) / np.linalg.norm(scenario.normal)
    normal, plane = _plane(position[contact], believed, scenario.straight)
    detected = _detected(scenario.detection, log.time, force, free, believed)
    return Recorded(
        time, pushed, rate(pushed), position, rate(position), contact, normal, plane, detected
    )


def _plane(path: Array, believed: Array, straight: float) -> tuple[Array, str]:
    """Return the normal of a path's plane, and the method behind it."""
    if len(path) < 3:
        return believed, "as believed: no contact"
    sizes, axes = np.linalg.svd(path - path.mean(axis=0), full_matrices=False)[1:]
    if sizes[2] > straight * sizes[1]:
        return believed, "as believed: the path is too straight for a plane"
    return axes[2] * math.copysign(1.0, axes[2] @ believed), "of the plane through the path"


def _detected(
    params: ContactDetectionParams, time: Array, force: Array, free: Array, up: Array
) -> tuple[Array, ...]:
    """Return the times of detected contacts and losses, s, by the push against the normal."""
    push = force @ up
    resolved = params.resolved(float(np.abs(push[free]).max()))
    law = ContactDetectionLaw(resolved, -up, period=float(np.median(np.diff(time))))
    state, modes = law.start(), np.empty(len(time))
    for i, (now, row) in enumerate(zip(time.tolist(), -force, strict=True)):
        state = law.update(state, law.observe({"measured_force": row}), now)
        modes[i] = law.command(state).state[0]
    touching = np.diff((modes == CONTACT).astype(int), prepend=0)
    return time[touching > 0], time[touching < 0]


def _told(scenario: MeasuredSlideScenario, kind: ObserverKind) -> ResolvedSurfaceObserverParams:
    """Return the settings of an observer of a kind.

    Observers without an error of the position get one of the velocity.
    """
    given = scenario.observer
    K, force = known("stiffness", given.stiffness), known("force_noise", given.force_noise)
    noise, error = given.force_rate_noise, given.model_error
    if noise is None:
        noise = math.sqrt(2.0) * force / given.period
    if kind != "adaptive":
        off = math.sqrt(3.0) * error.position / given.period
        noise = math.hypot(noise, off * float(np.linalg.eigvalsh(np.array(K))[0]))
        error = ModelErrorParams()
    told = {"stiffness": K, "force_noise": force, "force_rate_noise": noise, "kind": kind}
    return ResolvedSurfaceObserverParams(**vars(given) | told | {"model_error": error})


def _observe(on: Recorded, told: ResolvedSurfaceObserverParams, believed: Array) -> Table:
    """Return an observer's results on a recording, a row for each sample.

    ``error``, deg; ``band``, deg, of three deviations; ``nees``; ``push``, N, of the force along
    the estimate; ``status``.
    """
    observer = make_filter(told)
    memory, n = observer.start(believed), len(on.time)
    normals, covariances, status = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty(n)
    for i, row in enumerate(zip(on.force, on.force_rate, on.position, on.velocity, strict=True)):
        found = observer.update(memory, Sample(*row))
        memory, normals[i], covariances[i] = found.memory, found.normal, found.covariance
        status[i] = found.status
    truth = np.where(on.contact[:, np.newaxis], on.normal, 0.0)
    bands = [tangential_deviation(*one) for one in zip(normals, covariances, strict=True)]
    return {
        "error": angle_between(normals, truth),
        "band": DEVIATIONS * np.degrees(bands),
        "nees": normalised_square(normals, truth, covariances),
        "push": np.sum(normals * on.force, axis=1),
        "status": status,
    }


def run_measured(scenario: MeasuredSlideScenario, seed: int, progress: Progress) -> Outcome:
    """Run all observers on each recording; nothing is random, the seed has no effect."""
    metrics: dict[str, Metric] = {}
    traces: list[Table] = []
    paths = _paths(scenario)
    believed = np.array(scenario.normal) / np.linalg.norm(scenario.normal)
    for i, (name, path) in enumerate(paths.items()):
        log = read_log(path)
        on = _recorded(scenario, name, log)
        begin = on.time[on.contact][0] if on.contact.any() else math.inf
        counts = on.contact & (on.time >= begin + scenario.settle)
        found, residual = _identified(log, on.time)
        found |= _of_recording(on)
        rows = {"recording": np.full(len(on.time), float(i)), "time": on.time, "counts": counts}
        rows |= {f"force_{axis}": on.force[:, k] for k, axis in enumerate("xyz")}
        rows |= {f"residual_{axis}": residual[:, k] for k, axis in enumerate("xyz")}
        made = {}
        for j, kind in enumerate(KINDS):
            progress((i + j / len(KINDS)) / len(paths), f"{name} {kind}")
            made[kind] = _observe(on, _told(scenario, kind), believed)
            rows |= {f"{kind}.{column}": values for column, values in made[kind].items()}
        found |= _of_observers(made, on, counts)
        metrics |= prefixed(name, found)
        traces.append(rows)
    metrics |= _of_all(metrics)
    together = {key: np.concatenate([column(one[key]) for one in traces]) for key in traces[0]}
    return Outcome(metrics=metrics, traces=together, simulated_seconds=0.0)


def _of_all(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return the worst of all recordings with contact, on which any recording is judged."""
    found = {}
    for name, worst in _WORST.items():
        each = [one for key, one in metrics.items() if key.endswith(f".{name}")]
        values = [one.value for one in each if one.value is not None]
        if values:
            note = "the worst of the recordings with contact"
            found[name] = Metric(
                value=worst(values), unit=each[0].unit, note=note, trials=tuple(values)
            )
    return found


_NO_ERRORS: Final = "no sample in contact after it has settled"


def _of_observers(
    made: Mapping[ObserverKind, Table], on: Recorded, counts: NDArray[np.bool_]
) -> dict[str, Metric]:
    """Return statistics of each observer's errors where they count, and the ratio of two."""
    found: dict[str, Metric] = {}
    for kind, of in made.items():
        found |= prefixed(kind, _of_observer(of, on, counts))
    rms, least = found["adaptive.rms"].value, found["thesis.rms"].value
    ratio = rms / least if rms is not None and least else None
    return found | {"rms_ratio": measured(ratio, "", note="over the thesis'", missing=_NO_ERRORS)}


def _of_observer(made: Table, on: Recorded, counts: NDArray[np.bool_]) -> dict[str, Metric]:
    """Return statistics of an observer's errors where they count."""
    columns = ("error", "band", "nees", "push", "status")
    error, band, nees, push, status = (
        made[name][counts] if counts.any() else np.full(1, np.nan) for name in columns
    )

    def share(rows: NDArray[np.bool_]) -> float:
        return 100 * float(np.mean(np.where(np.isnan(error), np.nan, rows)))

    values = {
        "rms": (math.sqrt(float(np.mean(error**2))), "deg"),
        "quantile_95": (float(np.quantile(error, 0.95)), "deg"),
        "coverage": (share((error <= band) & (band < TELLS)), "%"),
        "coverage_95": (share(2 * nees <= _BAND), "%"),
        "nees": (float(np.mean(nees)), ""),
        "band": (float(np.median(band)), "deg"),
        "pulls": (share(push < 0), "%"),
        "unfit": (share(np.isin(status, (NormalStatus.PULLED, NormalStatus.UNFIT))), "%"),
    }
    return {
        name: measured(value, unit, note=on.plane, missing=_NO_ERRORS)
        for name, (value, unit) in values.items()
    }


def _of_recording(on: Recorded) -> dict[str, Metric]:
    """Return the contacts that were detected in a recording."""
    touches, losses = on.detected
    if not on.contact.any():
        note = f"of {on.time[-1] - on.time[0]:.0f} s in free motion"
        return {"false_alarms": Metric(value=float(len(touches)), unit="", note=note)}
    first = float(touches[0]) if len(touches) else math.nan
    bounces = float(np.sum(losses < first + _BOUNCE))
    return {
        "touch": measured(first, "s", missing="no contact was detected"),
        "bounces": Metric(value=bounces, unit="", note=f"losses within {_BOUNCE:g} s"),
        "losses": Metric(value=float(len(losses)), unit="", note="in all"),
    }


def _identified(log: Log, time: Array) -> tuple[dict[str, Metric], Array]:
    """Return friction and impedance with intervals, and the fit's residual, (n, 3), m."""
    told = identify(log)
    found = {
        name: measured(
            one.value, one.unit, missing=one.note,
            note=f"95 % from {one.low:.3g} to {one.high:.3g}" if one.low and one.high else "",
        )
        for name, one in told.quantities.items()
        if name.startswith(_TOLD)
    }  # fmt: skip
    left = np.full((len(time), 3), np.nan)
    for one in told.residuals:
        if one.title == "Impedance":
            at = np.argmin(np.abs(one.time[:, np.newaxis] - time), axis=0)
            left = 1e-3 * one.values[at]
    rms = math.sqrt(float(np.nanmean(left**2))) if np.isfinite(left).any() else math.nan
    return found | {"residual": measured(rms, "m", missing="no impedance was recorded")}, left


def figures(scenario: MeasuredSlideScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw, a row a recording, errors with their bands, the push, and the impedance's residual."""
    names, traces = tuple(_paths(scenario)), outcome.traces
    rms = (metric_value(outcome.metrics, f"{name}.adaptive.rms") for name in names)
    known = [f"{one:.2g} deg ({name})" for one, name in zip(rms, names, strict=True) if one >= 0]
    figure = new_figure(
        height=2.6 * len(names) + 1.2,
        caption=f"RMS error of the adaptive observer: {', '.join(known) or 'no contact'}. A row "
        "for each recording: error of the normal, force, and what the impedance law leaves.",
    )
    panels = figure.subplots(len(names), 3, squeeze=False)
    for i, (name, row) in enumerate(zip(names, panels, strict=True)):
        here = traces["recording"] == i
        _draw(name, row, {key: values[here] for key, values in traces.items()})
    for axes in panels[-1]:
        legend(axes)
    return {"measured-slide": figure}


def _draw(name: str, row: Array, rows: Table) -> None:
    errors_of, push, left = row
    time, touches = rows["time"], np.isfinite(rows["thesis.error"])
    begin = time[rows["counts"] > 0][0] if rows["counts"].any() else None
    for label, colour, _ in (OBSERVER_LOOKS[kind] for kind in ("thesis", "adaptive")):
        kind = label
        errors_of.plot(time, rows[f"{kind}.error"], color=colour, linewidth=1.0, label=label)
        band = np.where(touches, rows[f"{kind}.band"], np.nan)
        three = f"{label}, 3 deviations"
        errors_of.plot(time, band, color=colour, linewidth=0.8, linestyle=":", label=three)
        push.plot(time, rows[f"{kind}.push"], color=colour, linewidth=1.0, label=f"along {label}")
    push.plot(
        time,
        np.sqrt(sum(rows[f"force_{axis}"] ** 2 for axis in "xyz")),
        label="magnitude",
        **FORCE,
    )
    push.axhline(0.0, color="#b00020", linewidth=0.8, label="0: below, it would pull")
    for axis, style in AXIS_LOOKS.items():
        look = {"color": style["color"], "linewidth": 0.8, "label": axis}
        left.plot(time, rows[f"residual_{axis}"], **look)
    if begin is not None:
        errors_of.axvspan(time[touches][0], begin, **BAND)
        errors_of.set_ylim(0.0, 6.0)
    else:
        where = errors_of.transAxes
        errors_of.text(0.5, 0.5, "no contact: no normal", ha="center", transform=where)
    dress(
        errors_of,
        title=f"{name}: error of the normal (grey: not counted)",
        x="time / s",
        y="angle / °",
    )
    dress(push, title="Recorded force along the normals", x="time / s", y="force / N")
    dress(
        left,
        title="Residual of the impedance law",
        x="time / s",
        y="displacement / m",
    )
