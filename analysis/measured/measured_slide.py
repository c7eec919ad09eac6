"""What observers of the normal make of a real wrench, and what the recording says beside it.

A real arm slides a tool over a flat table. The observers get what they get in a loop: the force,
its difference, and the measured position as the nominal one, all as means over their period. The
stiffness is then that of tool and table together: how far the measured tip sinks in with the load.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

from chamfer.analysis.campaign.trial_metrics import prefixed
from chamfer.analysis.drawing.figure_style import BAND, FORCE, dress, legend, new_figure
from chamfer.analysis.identify.log import Log, read_log
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column, measured
from chamfer.analysis.surface.normal_metrics import (
    DEVIATIONS,
    angle_between,
    errors,
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
_SLIDES: Final = 0.02  # m/s, above which the tip slides beyond doubt
_MOVES: Final = 5e-3  # m/s, rms; less tells no damping
_BOUNCE: Final = 1.0  # s after the touch; contact that is lost later is no bounce


@dataclass(frozen=True, kw_only=True)
class MeasuredSlideScenario:
    """Which recording, and what the observers are told of it.

    Told is what one half of ``table_a`` shows; the other half and the other recordings judge it.
    """

    recording: str | None = None  # a recording's name or a log's file; None: all that come along
    free: float = 2.0  # s, from the begin, without contact: their mean is the sensor's offset
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)  # as believed before contact; base axes
    straight: float = 0.02  # rad, height of the path over its width; of more no plane is fitted
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
    """Return the scenario, of which every recording can be read."""
    for name, path in _paths(scenario).items():
        _recorded(scenario, name, read_log(path))
    return scenario


def _paths(scenario: MeasuredSlideScenario) -> dict[str, Path]:
    given = scenario.recording
    if given is None:
        return {name: slide_path(name) for name in SLIDES}
    path = Path(given)
    if given in SLIDES or not path.is_file():
        return {given: slide_path(given)}
    return {path.stem: path}


class Recorded(NamedTuple):
    """A recording as means over the observers' period, n rows; base axes."""

    time: Array  # (n,), s
    force: Array  # (n, 3), N, of the surface on the tool, without offset
    force_rate: Array  # (n, 3), N/s
    position: Array  # (n, 3), m
    velocity: Array  # (n, 3), m/s
    stretch: Array | None  # (n, 3), m, from the tip to the impedance's reference
    contact: NDArray[np.bool_]  # (n,)
    normal: Array  # (3,), the true one
    plane: str  # how it was found
    flat: float  # m, rms of the height over that plane
    detected: tuple[Array, ...]  # s, of touches, and of losses
    noise: float  # N, rms length of the force's error without contact


def _recorded(scenario: MeasuredSlideScenario, name: str, log: Log) -> Recorded:
    """Return what a log shows.

    Raises:
        ParameterError: If it lacks force or position, or a part without contact.
    """
    where = scenario.recording or name
    if log.force is None or log.position is None:
        raise ParameterError("recording", where, "a log with force and position of the tip")
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
        allowed = f"a time without contact: {where} has more than {least:g} N then"
        raise ParameterError("free", scenario.free, allowed)
    believed = np.array(scenario.normal) / np.linalg.norm(scenario.normal)
    normal, plane, flat = _plane(position[contact], believed, scenario.straight)
    reference = log.reference_position
    return Recorded(
        time, pushed, rate(pushed), position, rate(position),
        None if reference is None else mean(reference) - position,
        contact, normal, plane, flat,
        _detected(scenario.detection, log.time, force, free, believed),
        math.sqrt(3.0 * float(force[free].var(axis=0).mean())),
    )  # fmt: skip


def _plane(path: Array, believed: Array, straight: float) -> tuple[Array, str, float]:
    """Return the normal of a path's plane, how it was found, and the rms height over it, m."""
    if len(path) < 3:
        return believed, "as believed: no contact", math.nan
    off = path - path.mean(axis=0)
    _, sizes, axes = np.linalg.svd(off, full_matrices=False)
    if sizes[2] > straight * sizes[1]:
        return believed, "as believed: the path is too straight for a plane", math.nan
    normal = axes[2] * math.copysign(1.0, float(axes[2] @ believed))
    return normal, "of the plane through the path", float(sizes[2]) / math.sqrt(len(path))


def _detected(
    params: ContactDetectionParams, time: Array, force: Array, free: Array, up: Array
) -> tuple[Array, ...]:
    """Return when contact was detected, and when its loss, s, by the push against the normal."""
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
    """Return what an observer of a kind is told.

    Those that know of no error of the position are told of one of the velocity.
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
    """Return what an observer made of a recording, a row a sample.

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
    """Run all observers on each recording; nothing is drawn, the seed is without effect."""
    metrics: dict[str, Metric] = {}
    traces: list[Table] = []
    paths = _paths(scenario)
    believed = np.array(scenario.normal) / np.linalg.norm(scenario.normal)
    for i, (name, path) in enumerate(paths.items()):
        on = _recorded(scenario, name, read_log(path))
        begin = on.time[on.contact][0] if on.contact.any() else math.inf
        counts = on.contact & (on.time >= begin + scenario.settle)
        found, residual = _impedance(on)
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
    together = {key: np.concatenate([column(one[key]) for one in traces]) for key in traces[0]}
    return Outcome(metrics=metrics, traces=together, simulated_seconds=0.0)


_NO_ERRORS: Final = "no sample in contact after it has settled"
_NO_REFERENCE: Final = "no reference of an impedance was recorded, or no contact"
_STILL: Final = "the tip hardly moves along that axis in contact"


def _of_observers(
    made: Mapping[ObserverKind, Table], on: Recorded, counts: NDArray[np.bool_]
) -> dict[str, Metric]:
    """Return what each observer's errors are like where they count, and how two compare."""
    found: dict[str, Metric] = {}
    for kind, of in made.items():
        found |= prefixed(kind, _of_observer(of, on, counts))
    rms, least = found["adaptive.rms"].value, found["thesis.rms"].value
    ratio = rms / least if rms is not None and least else None
    note = "rms of adaptive over the thesis'"
    return found | {"rms_ratio": measured(ratio, "", note=note, missing=_NO_ERRORS)}


def _of_observer(made: Table, on: Recorded, counts: NDArray[np.bool_]) -> dict[str, Metric]:
    """Return what an observer's errors are like where they count."""
    rows = {name: values[counts] for name, values in {"time": on.time, **made}.items()}
    always = (-math.inf, math.inf)
    found = errors(rows, always, largest=always)
    values: dict[str, tuple[float | None, str]] = {
        "rms": (found["error.rms"], "deg"),
        "quantile_95": (None, "deg"),
        "coverage": (found["coverage"], "%"),
        "coverage_95": (None, "%"),
        "nees": (found["nees"], ""),
        "band": (None, "deg"),
        "pulls": (None, "%"),
        "unfit": (None, "%"),
    }
    if counts.any():
        doubted = np.isin(rows["status"], (NormalStatus.PULLED, NormalStatus.UNFIT))
        values |= {
            "quantile_95": (float(np.quantile(rows["error"], 0.95)), "deg"),
            "coverage_95": (100 * float(np.mean(2 * rows["nees"] <= _BAND)), "%"),
            "band": (float(np.median(rows["band"])), "deg"),
            "pulls": (100 * float(np.mean(rows["push"] < 0)), "%"),
            "unfit": (100 * float(np.mean(doubted)), "%"),
        }
    return {
        name: measured(value, unit, note=on.plane, missing=_NO_ERRORS)
        for name, (value, unit) in values.items()
    }


def _of_recording(on: Recorded) -> dict[str, Metric]:
    """Return friction, the plane and the contacts of a recording."""
    push = on.force @ on.normal
    tangent = on.velocity - np.outer(on.velocity @ on.normal, on.normal)
    speed = np.linalg.norm(tangent, axis=1)
    slides = on.contact & (speed > _SLIDES)
    share = -np.sum(on.force * tangent, axis=1)[slides] / (speed * push)[slides]
    friction, note = math.nan, ""
    if slides.any():
        low, friction, high = np.quantile(share, (0.05, 0.5, 0.95)).tolist()
        note = f"median, nine of ten samples from {low:.3g} to {high:.3g}"
    touches, losses = on.detected
    first = float(touches[0]) if len(touches) else math.nan
    never = "no contact was detected"
    found = {
        "friction": measured(friction, "", note=note, missing="no sample slides in contact"),
        "plane": measured(on.flat, "m", note="rms of the height over it", missing=on.plane),
        "noise": Metric(value=on.noise, unit="N", note="rms length without contact"),
    }
    if not on.contact.any():
        note = f"of {on.time[-1] - on.time[0]:.0f} s in free motion"
        return found | {"false_alarms": Metric(value=float(len(touches)), unit="", note=note)}
    bounces = float(np.sum(losses < first + _BOUNCE)) if len(touches) else math.nan
    return found | {
        "touch": measured(first, "s", missing=never),
        "bounces": measured(bounces, "", note=f"losses within {_BOUNCE:g} s", missing=never),
        "losses": Metric(value=float(len(losses)), unit="", note="in all"),
    }


def _impedance(on: Recorded) -> tuple[dict[str, Metric], Array]:
    """Fit ``F = K (x0 - x) - D v`` in each axis in contact; return what is left too, (n, 3), N.

    F is that of the tool on the surface. Displacement is fitted on force, velocity and
    acceleration: noise of the displacement would make the stiffness of a fit the other way round
    too small.
    """
    residual = np.full(on.force.shape, np.nan)
    found: dict[str, Metric] = {}
    enough = on.stretch is not None and np.count_nonzero(on.contact) > 10
    acceleration = np.gradient(on.velocity, on.time, axis=0)
    for k, axis in enumerate("xyz"):
        stiffness = damping = math.nan
        if enough and on.stretch is not None:
            causes = np.column_stack([-on.force[:, k], on.velocity[:, k], acceleration[:, k]])
            stretch = on.stretch[:, k]
            slopes = np.linalg.lstsq(causes[on.contact], stretch[on.contact], rcond=None)[0]
            stiffness, damping = 1 / slopes[0], slopes[1] / slopes[0]
            left = stiffness * (stretch - causes @ slopes)
            residual[on.contact, k] = left[on.contact]
            if math.sqrt(float(np.mean(on.velocity[on.contact, k] ** 2))) < _MOVES:
                damping = math.nan
        found |= {
            f"stiffness.{axis}": measured(stiffness, "N/m", missing=_NO_REFERENCE),
            f"damping.{axis}": measured(damping, "N s/m", missing=_STILL),
        }
    rms = math.sqrt(float(np.nanmean(residual**2))) if enough else math.nan
    found["residual"] = measured(rms, "N", note="rms of an axis", missing=_NO_REFERENCE)
    return prefixed("impedance", found), residual


_LOOK: Final = {"thesis": ("thesis", "#555555"), "adaptive": ("adaptive", "#e07b00")}
_AXES: Final = {"x": "#1b4f9c", "y": "#6fa0e8", "z": "#7a0060"}


def figures(scenario: MeasuredSlideScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw, a row a recording, errors with their bands, the push, and the impedance's residual."""
    names, traces = tuple(_paths(scenario)), outcome.traces
    figure = new_figure(15.0, 3.0 * len(names) + 0.5)
    panels = figure.subplots(len(names), 3, squeeze=False)
    for i, (name, row) in enumerate(zip(names, panels, strict=True)):
        here = traces["recording"] == i
        _draw(name, row, {key: values[here] for key, values in traces.items()})
    for axes in panels[-1]:
        legend(axes, loc="upper left", bbox_to_anchor=(0.0, -0.22), ncols=3)
    return {"measured-slide": figure}


def _draw(name: str, row: Array, rows: Table) -> None:
    errors_of, push, left = row
    time, touches = rows["time"], np.isfinite(rows["thesis.error"])
    begin = time[rows["counts"] > 0][0] if rows["counts"].any() else None
    for kind, (label, colour) in _LOOK.items():
        errors_of.plot(time, rows[f"{kind}.error"], color=colour, linewidth=1.0, label=label)
        band = np.where(touches, rows[f"{kind}.band"], np.nan)
        three = f"{label}, three deviations"
        errors_of.plot(time, band, color=colour, linewidth=0.8, linestyle=":", label=three)
        push.plot(time, rows[f"{kind}.push"], color=colour, linewidth=1.0, label=f"along {label}")
    push.plot(
        time, np.sqrt(sum(rows[f"force_{axis}"] ** 2 for axis in "xyz")), label="whole", **FORCE
    )
    push.axhline(0.0, color="#b00020", linewidth=0.8, label="below it a surface would pull")
    for axis, colour in _AXES.items():
        left.plot(time, rows[f"residual_{axis}"], color=colour, linewidth=0.8, label=axis)
    if begin is not None:
        errors_of.axvspan(time[touches][0], begin, **BAND)
        errors_of.set_ylim(0.0, 6.0)
    else:
        _say(errors_of, "no contact: no normal")
        _say(left, "no contact: no residual")
    dress(
        errors_of,
        title=f"{name}: error of the normal (grey: does not count)",
        x="time / s",
        y="angle / °",
    )
    dress(push, title="recorded force, along the estimated normals", x="time / s", y="force / N")
    dress(left, title="K (x0 - x) - D v - F, as fitted", x="time / s", y="force / N")


def _say(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
