"""Recorded tosses of a cube and simulations with the same start, by contact settings.

Friction and dissipation are fitted on tosses with even numbers; all settings are judged, with that
friction, on tosses with odd ones.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import bootstrap_interval, rate
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.drawing.figure_style import Style, dress, legend_below, new_figure
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column, part_of
from chamfer.analysis.scenario.experiment import measured as metric_of
from chamfer.diagrams.contact.cube_toss import TossContact, fly, make_toss_diagram, rotations
from chamfer.diagrams.insertion.peg_insertion import PEG_INSERTION
from chamfer.diagrams.skills.connector_scenario import RJ45_CONNECTOR
from chamfer.models.connectors.connector import ContactMaterial
from chamfer.models.recordings.recordings import CUBE_RATE, CUBE_WIDTH, Toss, tosses
from chamfer.models.validation import MOST_FRICTION, ParameterError, require_positive

Array = NDArray[np.float64]
Setting = Literal["drake", "insertion", "connectors", "lagged", "similar", "tamsi", "sap"]
Variation = Literal["half_step", "tenth_step", "soft", "corners"]

_PEG, _PLUG = PEG_INSERTION.contact, ContactMaterial()
_OURS: Final = TossContact(
    PEG_INSERTION.approximation, _PEG.stiffness, _PEG.dissipation, PEG_INSERTION.stiction
)
CONTACTS: Final[dict[str, TossContact]] = {
    "drake": TossContact("lagged", None, None),
    "insertion": _OURS,
    "connectors": TossContact(RJ45_CONNECTOR.approximation, _PLUG.stiffness, _PLUG.dissipation),
    "lagged": _OURS._replace(approximation="lagged"),
    "similar": _OURS._replace(approximation="similar"),
    "tamsi": _OURS._replace(approximation="tamsi"),
    "sap": _OURS._replace(approximation="sap"),
}
FITTED: Final = "similar"  # the setting with which friction and dissipation are found
_VARIED: Final = ("lagged", "similar")
_VARIATIONS: Final[dict[Variation, dict[str, Any]]] = {
    "half_step": {"step": 5e-4},
    "tenth_step": {"step": 1e-4},
    "soft": {"stiffness": 2e4},
    "corners": {"shape": "corners"},
}
DISSIPATIONS: Final = (0.3, 1.0, 3.0, 10.0, 30.0)  # s/m, of the fit
# What of a toss is measured: unit, and what it is.
MEASURED: Final = {
    "position": ("%", "error of the width, mean over time"),
    "position_rest": ("%", "error of the width where it is last seen"),
    "angle": ("deg", "error, mean over time"),
    "angle_rest": ("deg", "error where it is last seen"),
    "travel": ("%", "way along the board, of the recorded"),
    "rebound": ("%", "fastest rise over fastest fall, less the recorded"),
    "coulomb": ("%", "impulse of friction, of mu times the normal one"),
}
_MORE: Final = ("toss", "same_face", "way", "recorded_way")
_INTERVAL: Final = "95 % interval, bootstrap over tosses"
_TOSSES: Final = 200  # recorded


@dataclass(frozen=True, kw_only=True)
class MeasuredTossScenario:
    """The number of tosses, and the contact settings tried on them."""

    tosses: int = 40  # spread over the recorded 200; half for the fit, half judged
    friction: float | None = None  # mu of cube on board, for all judged tosses; None: fitted
    settings: tuple[Setting, ...] = get_args(Setting)  # of contact that are tried
    variations: tuple[Variation, ...] = get_args(Variation)  # of lagged and similar
    frictions: tuple[float, ...] = (0.06, 0.09, 0.12, 0.15, 0.18, 0.21, 0.24)  # mu, of the fit

    def __post_init__(self) -> None:
        if self.tosses not in range(2, _TOSSES + 1, 2):
            raise ParameterError("tosses", self.tosses, f"an even number from 2 to {_TOSSES}")
        require_positive(self, "friction", most=MOST_FRICTION)
        if not self.settings:
            raise ParameterError("settings", self.settings, "at least one")
        rising = list(self.frictions) == sorted(set(self.frictions))
        if not (rising and self.frictions and 0 < self.frictions[0] < math.inf):
            raise ParameterError("frictions", self.frictions, "rising numbers > 0, at least one")

    def half(self, odd: int) -> list[int]:
        """Return the indices of the tosses that are fitted, 0, or judged, 1."""
        all_of = [k for k, toss in enumerate(recorded()) if toss.number % 2 == odd]
        spread = np.linspace(0, len(all_of) - 1, self.tosses // 2).astype(int)
        return [all_of[k] for k in spread]

    def contacts(self, friction: float) -> dict[str, TossContact]:
        """Return the judged contacts by name: the settings, then the variations of two of them."""
        found = {str(one): CONTACTS[one]._replace(friction=friction) for one in self.settings}
        varied = [(one, name) for one in _VARIED if one in found for name in self.variations]
        more = {f"{one}.{name}": found[one]._replace(**_VARIATIONS[name]) for one, name in varied}
        return found | more


MEASURED_TOSS: Final = MeasuredTossScenario()


class Throw(NamedTuple):
    """A toss to simulate: its contact, and its index among the recorded ones."""

    contact: TossContact
    toss: int


@cache
def recorded() -> list[Toss]:
    """Return the recorded tosses."""
    return tosses()


_diagram = lru_cache(maxsize=4)(make_toss_diagram)


def measure(throw: Throw) -> Row:
    """Simulate a toss; return :data:`MEASURED`, and over time the error, %, and the path, m."""
    toss = recorded()[throw.toss]
    flight = fly(_diagram(throw.contact), toss)
    both = flight.position, toss.position
    error = 100 * np.linalg.norm(both[0] - both[1], axis=1) / CUBE_WIDTH
    R_BW, R_BW_recorded = (rotations(one.orientation).inv() for one in (flight, toss))
    angle = np.degrees((R_BW * R_BW_recorded.inv()).magnitude())
    ways = [np.linalg.norm(one[-1, :2] - one[0, :2]) for one in both]
    rises = [np.diff(one[:, 2]) for one in both]
    rebounds = [one[one.argmin() :].max() / -one.min() for one in rises]
    up = [R.as_matrix()[-1, :, 2] for R in (R_BW, R_BW_recorded)]  # in the cube's axes
    top = [int(np.abs(one).argmax()) for one in up]
    return {
        "position": error.mean(),
        "position_rest": error[-1],
        "angle": angle.mean(),
        "angle_rest": angle[-1],
        "travel": 100 * ways[0] / ways[1],
        "rebound": 100 * (rebounds[0] - rebounds[1]),
        "coulomb": 100 * flight.friction_impulse / throw.contact.friction / flight.normal_impulse,
        "toss": throw.toss,
        "same_face": top[0] == top[1] and up[0][top[0]] * up[1][top[0]] > 0,
        "way": ways[0],
        "recorded_way": ways[1],
        "error": error,
        "path": flight.position,
    }


def fit(values: Sequence[float], errors: Array, seed: int) -> tuple[float, float, float]:
    """Return the value with the least mean error, and its 95 % interval, from rising values.

    Errors are of m tosses, shape (m, n). Between values the mean is a parabola through the least
    and its neighbours; the interval is a bootstrap's over tosses.
    """
    drawn = np.random.default_rng(seed).integers(len(errors), size=(1000, len(errors)))

    def best(mean: Array) -> float:
        k = int(mean.argmin())
        if not 0 < k < len(values) - 1:
            return values[k]
        square, slope, _ = np.polyfit(values[k - 1 : k + 2], mean[k - 1 : k + 2], 2)
        return float(-slope / (2 * square))

    low, high = np.quantile([best(one) for one in errors[drawn].mean(1)], [0.025, 0.975])
    return best(errors.mean(0)), float(low), float(high)


def _with_interval(name: str, found: Sequence[float], unit: str, note: str) -> dict[str, Metric]:
    names, notes = (name, f"{name}.low", f"{name}.high"), (note, _INTERVAL, _INTERVAL)
    each = zip(names, found, notes, strict=True)
    return {one: metric_of(x, unit, note=of, missing="one toss has none") for one, x, of in each}


def run(scenario: MeasuredTossScenario, seed: int, progress: Progress) -> Outcome:
    """Fit friction and dissipation on one half of the tosses, and judge on the other."""

    def throw(contacts: Sequence[TossContact], odd: int, told: Progress) -> list[list[Row]]:
        """Return each contact's rows, of the tosses that finished with every one."""
        places = scenario.half(odd)
        tasks = dict.fromkeys(Throw(one, place) for one in contacts for place in places)
        found = run_each(measure, list(tasks), told)
        rows = dict(zip(found.tasks, found.rows, strict=True))
        whole = [at for at in places if all(Throw(one, at) in rows for one in contacts)]
        return [[rows[Throw(one, at)] for at in whole] for one in contacts]

    names: list[str] = list(dict.fromkeys((*scenario.settings, FITTED)))
    frictions, m = scenario.frictions, len(scenario.frictions)
    tried = [CONTACTS[one]._replace(friction=each) for one in names for each in frictions]
    thrown = throw(tried, 0, part_of(progress, 0.0, 0.5, "fit"))
    errors = np.array([[row["position"] for row in of] for of in thrown])
    curves = errors.mean(1).reshape(-1, m)
    metrics: dict[str, Metric] = {}
    for k, name in enumerate(names):
        mu = fit(frictions, errors[k * m : (k + 1) * m].T, seed)
        note = "at the end of what was tried" if mu[0] in (frictions[0], frictions[-1]) else ""
        metrics |= _with_interval(f"{name}.friction", mu, "", note)
    found = metrics[f"{FITTED}.friction"].value if scenario.friction is None else scenario.friction
    assert found is not None
    contacts = scenario.contacts(found)
    base = CONTACTS[FITTED]._replace(friction=found)
    softer = [base._replace(dissipation=one) for one in DISSIPATIONS]
    bounced = throw(softer, 0, part_of(progress, 0.5, 0.6, "fit"))
    rebounds = np.array([[abs(row["rebound"]) for row in of] for of in bounced]).T
    best = np.exp(fit(np.log(DISSIPATIONS).tolist(), rebounds, seed)).tolist()
    metrics |= _with_interval("dissipation", best, "s/m", f"of {FITTED}, by the rebound")
    contacts[f"{FITTED}.fitted"] = base._replace(dissipation=best[0])
    metrics["friction"] = Metric(value=found, unit="", note="mu, with which all are judged")

    judged = throw(list(contacts.values()), 1, part_of(progress, 0.6, 1.0, "judge"))
    for name, of in zip(contacts, judged, strict=True):
        for one, (unit, note) in MEASURED.items():
            values = column([row[one] for row in of])
            mean = float(values.mean()), *bootstrap_interval(values)
            metrics |= _with_interval(f"{name}.{one}", mean, unit, note)
        same = sum(row["same_face"] for row in of)
        metrics |= rate(f"{name}.same_face", same, len(of), "that land on the recorded face")
    every = (*thrown, *bounced, *judged)
    flat = [(k, row) for k, of in enumerate(judged) for row in of]
    shown: dict[str, list[Row]] = dict(zip(scenario.settings, judged, strict=False))
    shortest = min(len(row["error"]) for _, row in flat)
    cut = {one: [row["error"][:shortest] for row in of] for one, of in shown.items()}
    over_time = {one: np.mean(errors, axis=0) for one, errors in cut.items()}
    paths = [("recorded", recorded()[judged[0][0]["toss"]].position)]
    paths += [(one, of[0]["path"]) for one, of in shown.items()]
    return Outcome(
        metrics=metrics,
        traces={
            "contact": column([k for k, _ in flat]),
            **{name: column([row[name] for _, row in flat]) for name in (*MEASURED, *_MORE)},
        },
        tables={
            "fits": {"friction": column(frictions), **dict(zip(names, curves, strict=True))},
            "over_time": {"time": np.arange(shortest) / CUBE_RATE, **over_time},
            "example": {
                f"{one}_{x}": path[:, k] for one, path in paths for k, x in enumerate("xyz")
            },
        },
        simulated_seconds=sum(len(row["error"]) for of in every for row in of) / CUBE_RATE,
    )


_COLOURS: Final = ("#b00020", "#e07b00", "#1b4f9c", "#7a0060", "#2e8b57", "#6fa0e8", "#555555")
_STYLES: Final[dict[str, Style]] = {
    name: {"color": colour, "linestyle": line, "marker": marker}
    for name, colour, line, marker in zip(
        CONTACTS, _COLOURS, ("-", "--", "--", ":", "-", "-.", ":"), "vsD^ox+", strict=True
    )
} | {"recorded": {"color": "#000000", "linestyle": "-", "marker": ""}}
_CM: Final = 100


def figures(scenario: MeasuredTossScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw a toss, errors over time and over friction, and the cubes' distances."""
    least = {name: metric_value(outcome.metrics, f"{name}.position") for name in scenario.settings}
    known = {name: error for name, error in least.items() if np.isfinite(error)}
    best = min(known, key=lambda name: known[name], default=scenario.settings[0])
    figure = new_figure(
        height=7.6,
        caption=f"The contact model {best} is closest to the recorded tosses: "
        f"{least[best]:.3g} % of the cube's width off on average. Markers end each path.",
    )
    (path, over), (fitted, travel) = figure.subplots(2, 2)
    traces, tables = outcome.traces, outcome.tables
    example, friction = tables["example"], outcome.metrics["friction"].value
    start, end = (np.array([example[f"recorded_{axis}"][at] for axis in "xy"]) for at in (0, -1))
    ahead = (end - start) / np.linalg.norm(end - start)
    for name in ("recorded", *scenario.settings):
        x, y, z = (example[f"{name}_{axis}"] for axis in "xyz")
        along = (np.stack([x, y], axis=1) - start) @ ahead
        path.plot(_CM * along, _CM * z, label=name, **{**_STYLES[name], "markevery": [-1]})
    for k, name in enumerate(scenario.settings):
        times = tables["over_time"]
        over.plot(times["time"], times[name], label=name, **{**_STYLES[name], "marker": ""})
        mine, points = traces["contact"] == k, {**_STYLES[name], "linestyle": ""}
        ways = (_CM * traces[one][mine] for one in ("recorded_way", "way"))
        travel.plot(*ways, label=name, alpha=0.7, **points)
    for name, errors in list(tables["fits"].items())[1:]:
        fitted.plot(tables["fits"]["friction"], errors, label=name, **_STYLES[name])
    ends = _CM * np.array([traces["recorded_way"].min(), traces["recorded_way"].max()])
    travel.plot(ends, ends, label="recorded", **_STYLES["recorded"])
    count, error = scenario.tosses // 2, "position error / % of the width"
    dress(path, title="(a) One toss from the side", x="along the board / cm", y="height / cm")
    title = f"(b) Mean error of {count} tosses, friction {friction:.3g}"
    dress(over, title=title, x="time / s", y=error)
    title = f"(c) Mean error of {count} other tosses by friction"
    dress(fitted, title=title, x="friction", y=error)
    dress(travel, title="(d) Travel along the board", x="recorded / cm", y="simulated / cm")
    for axes in (path, over, fitted, travel):
        axes.set_ylim(bottom=0.0)
    legend_below(figure, path, columns=4)
    return {"measured-toss": figure}
