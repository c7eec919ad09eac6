"""Compares the verdicts of designs with simulated insertions of random cells."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import rate, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.design.design import BOUNDED, assess, insert_drawn, interval, is_within
from chamfer.analysis.design.design_map import VERDICTS
from chamfer.analysis.design.design_scenario import FEWEST, DesignScenario, resolve_design
from chamfer.analysis.drawing.figure_kit import draw_counts
from chamfer.analysis.drawing.figure_style import Style, dress, new_figure
from chamfer.analysis.scenario.experiment import (
    Metric,
    Outcome,
    Progress,
    Table,
    column,
    measured,
    part_of,
)
from chamfer.diagrams.cell.work_cell import HOLE_ARM, PEG_ARM, CellArmSettings
from chamfer.diagrams.insertion.insertion import FEED_SPEED
from chamfer.models.validation import ParameterError, require_one_of, require_positive

_MOST: Final = 10_000
_DEPTH: Final = 3.5  # of the hole's radius, that the tip is to go

_LENGTHS: Final = ("chamfer_width", "peg_length", "hole_length", "outer_radius")

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class DrawnDesignsScenario:
    """The ranges of random designs, and the number of insertions of each.

    Lengths of the parts scale with their radius as the default ones do, the turning stiffness with
    the root of the stiffness. All cameras have the default field of view.
    """

    designs: int = 20  # number of random designs
    trials: int = 4  # simulated insertions of each
    draws: int = 200  # random cells, for each prediction
    radius: Range = (0.0015, 0.015)  # m, of the hole, evenly in its logarithm
    clearance: Range = (0.005, 0.05)  # radial, over the hole's radius, likewise
    friction: Range = (0.1, 0.6)  # between peg and hole, evenly
    stiffness: Range = (100.0, 5000.0)  # N/m, of the arms, evenly in its logarithm
    width: Range = (160.0, 1280.0)  # pixels, of the cameras, likewise
    peg: CellArmSettings = PEG_ARM  # the peg's arm, of all designs
    hole: Literal["arm", "fixture", "either"] = "either"  # support of the hole
    controller: Literal["fsm", "pid", "either"] = "either"  # of the compensation
    section: Literal["round", "square", "either"] = "either"  # of the parts
    unchamfered: float = 0.1  # share of the designs without chamfers on the peg
    duration: float = 30.0  # s, limit of an insertion

    def __post_init__(self) -> None:
        for name, least in (("designs", 1), ("trials", 1), ("draws", FEWEST)):
            if not least <= getattr(self, name) <= _MOST:
                raise ParameterError(name, getattr(self, name), f"{least} to {_MOST}")
        for name in ("radius", "clearance", "friction", "stiffness", "width"):
            low, high = getattr(self, name)
            if not (0 < low <= high < math.inf):
                allowed = "two finite numbers > 0, the lower one first"
                raise ParameterError(name, getattr(self, name), allowed)
        if not self.clearance[1] < 1:
            raise ParameterError("clearance", self.clearance, "less than 1")
        for name, kinds in _EITHER.items():
            require_one_of(self, name, (*kinds, "either"))
        if not 0 <= self.unchamfered <= 1:
            raise ParameterError("unchamfered", self.unchamfered, "a share, from 0 to 1")
        require_positive(self, "duration")

    def sizes(self, seed: int, design: int) -> dict[str, float]:
        """Return the random sizes of one of a seed's designs, in the fields' units."""
        generator = np.random.default_rng([seed, design])

        def logarithmic(ends: Range) -> float:
            return float(np.exp(generator.uniform(*np.log(ends))))

        return {
            "radius": logarithmic(self.radius),
            "clearance": logarithmic(self.clearance),
            "friction": float(generator.uniform(*self.friction)),
            "stiffness": logarithmic(self.stiffness),
            "width": round(logarithmic(self.width)),
            **self._kinds(generator),
        }

    def _kinds(self, generator: np.random.Generator) -> dict[str, float]:
        """Return the design's kind in each pair, by number, and whether it has chamfers."""
        found = {}
        for name, kinds in _EITHER.items():
            drawn, given = int(generator.integers(len(kinds))), getattr(self, name)
            found[name] = float(drawn if given == "either" else kinds.index(given))
        return {**found, "chamfers": float(generator.uniform() >= self.unchamfered)}

    def drawn(self, seed: int, design: int) -> DesignScenario:
        """Return one of a seed's designs, not resolved.

        Raises:
            ParameterError: If such a design is not possible.
        """
        sizes = self.sizes(seed, design)
        radius, stiffness, width = sizes["radius"], sizes["stiffness"], int(sizes["width"])
        kinds: dict[str, Any] = {name: of[int(sizes[name])] for name, of in _EITHER.items()}
        default = DesignScenario()
        usual = default.parts.hole_radius
        parts = replace(
            default.parts,
            hole_radius=radius,
            peg_radius=radius * (1 - sizes["clearance"]),
            friction=sizes["friction"],
            section=kinds["section"],
            **{one: getattr(default.parts, one) / usual * radius for one in _LENGTHS},
        )
        if not sizes["chamfers"]:
            parts = replace(parts, chamfer_width=0.0)
        impedance, hole, cameras = default.impedance, default.hole, default.cameras
        stiffer = math.sqrt(stiffness / impedance.stiffness[0])
        a, b, c = impedance.rotational_stiffness
        seen = cameras.width * cameras.pixel_size
        steps = math.ceil(FEED_SPEED * impedance.period / (2 * parts.clearance))
        return replace(
            default,
            parts=parts,
            impedance=replace(
                impedance,
                stiffness=(stiffness,) * 3,
                rotational_stiffness=(stiffer * a, stiffer * b, stiffer * c),
            ),
            peg=self.peg,
            hole=hole if kinds["hole"] == "arm" else FIXTURE,
            controller=replace(default.controller, kind=kinds["controller"]),
            cameras=replace(
                cameras, width=width, height=round(0.75 * width), pixel_size=seen / width
            ),
            insert=replace(default.insert, speed=FEED_SPEED, depth=_DEPTH * radius),
            step=impedance.period / steps,
            duration=self.duration,
            draws=self.draws,
        )


_EITHER: Final[dict[str, tuple[str, str]]] = {
    "hole": ("arm", "fixture"),
    "controller": ("fsm", "pid"),
    "section": ("round", "square"),
}
FIXTURE: Final = replace(HOLE_ARM, kind="fixture")
DRAWN_DESIGNS: Final = DrawnDesignsScenario()
REFUSED: Final = "refused"  # no verdict: there can be no such cell
# What the verdicts are to be worth, %.
CERTAIN_SEATED: Final = 99.0
NO_SEATED: Final = 2.0
COVERED: Final = 95.0
DARES: Final = 70.0
_ASSESSED: Final = 0.05  # of the whole run

Task = tuple[int, int]  # a design and a trial of it


def assess_drawn(scenario: DrawnDesignsScenario, seed: int, design: int) -> Row:
    """Draw and assess a design; it depends on its arguments alone.

    The row has the promised bounds as ``bound.<name>``, None where there is none.
    """
    row: Row = dict.fromkeys(("margin", "share", "share.low", "share.high"))
    bounds: Row = dict.fromkeys(f"bound.{name}" for name in BOUNDED)
    try:
        cell = resolve_design(scenario.drawn(seed, design))
        found = assess(cell, trial_seed(seed, design))
    except ParameterError as error:
        return {**row, **bounds, "verdict": REFUSED, "limiting_link": str(error)}
    numbers = (found.margin, found.share, found.share_low, found.share_high)
    said = {"verdict": found.verdict, "limiting_link": found.limiting_link}
    promised = {f"bound.{name}": one.bound for name, one in found.bounds.items()}
    return {**dict(zip(row, numbers, strict=True)), **bounds, **promised, **said}


def insert_once(scenario: DrawnDesignsScenario, seed: int, task: Task) -> Row:
    """Simulate one insertion of a random design, see :func:`insert_drawn`."""
    design, trial = task
    cell = resolve_design(scenario.drawn(seed, design))
    return insert_drawn(cell, trial_seed(seed, design), trial)  # no two designs share their errors


def run(scenario: DrawnDesignsScenario, seed: int, progress: Progress) -> Outcome:
    """Assess all designs, and simulate those that can exist."""
    # What is kept of a trial doesn't depend on how many there are: more can be asked for later.
    drawn = replace(scenario, designs=1, trials=1)
    assessed = run_each(
        partial(assess_drawn, drawn, seed),
        range(scenario.designs),
        part_of(progress, 0.0, _ASSESSED),
    )
    tasks = [
        (design, trial)
        for design, row in zip(assessed.tasks, assessed.rows, strict=True)
        for trial in range(scenario.trials)
        if row["verdict"] != REFUSED
    ]
    if not tasks:
        raise ParameterError("designs", scenario.designs, "so many that there can be one of them")
    inserted = run_each(
        partial(insert_once, drawn, seed), tasks, part_of(progress, _ASSESSED, 1.0)
    )
    traces = _designs(scenario, seed, assessed, inserted)
    return Outcome(
        metrics=accuracy(traces),
        traces=traces,
        simulated_seconds=float(inserted.column("simulated_seconds").sum()),
    )


def _designs(
    scenario: DrawnDesignsScenario, seed: int, assessed: Trials[int], inserted: Trials[Task]
) -> Table:
    """Return a row for each design: its kind, its verdict, and the outcomes of its insertions."""
    good = dict.fromkeys(assessed.tasks, 0.0)
    promised = dict(zip(assessed.tasks, assessed.rows, strict=True))
    within = {f"{name}.{end}": good.copy() for name in BOUNDED for end in ("within", "of")}
    count = Counter(design for design, _ in inserted.tasks)
    for (design, _), row in zip(inserted.tasks, inserted.rows, strict=True):
        good[design] += row["seated"]
        for name in BOUNDED:
            bound, value = promised[design][f"bound.{name}"], row[name]
            if bound is not None and value is not None:
                within[f"{name}.of"][design] += 1
                within[f"{name}.within"][design] += is_within(name, value, bound)
    ends = [
        interval(int(good[one]), count[one]) if count[one] else (np.nan, np.nan) for one in good
    ]
    sizes = [scenario.sizes(seed, design) for design in assessed.tasks]
    return {
        "design": column(assessed.tasks),
        **{name: column([one[name] for one in sizes]) for name in sizes[0]},
        "verdict": np.array([row["verdict"] for row in assessed.rows]),
        "limiting_link": np.array([row["limiting_link"] for row in assessed.rows]),
        **{
            # NaN for the numbers of links that are without bound.
            name.replace(".", "_"): np.where(
                np.isfinite(one := assessed.column(name)), one, np.nan
            )
            for name in ("margin", "share", "share.low", "share.high")
        },
        "seated": column(list(good.values())),
        "trials": column([count[one] for one in good]),
        **{
            f"bound_{name}": np.where(
                np.isfinite(one := assessed.column(f"bound.{name}")), one, np.nan
            )
            for name in BOUNDED
        },
        **{name.replace(".", "_"): column(list(of.values())) for name, of in within.items()},
        "low": column([low for low, _ in ends]),
        "high": column([high for _, high in ends]),
    }


def accuracy(traces: Table) -> dict[str, Metric]:
    """Return the accuracy of verdicts on simulated designs."""
    verdict, seated, trials = traces["verdict"], traces["seated"], traces["trials"]
    simulated = trials > 0
    became = {
        "all": simulated & (seated == trials),
        "some": simulated & (seated > 0) & (seated < trials),
        "none": simulated & (seated == 0),
    }
    metrics = {
        f"confusion.{said}.{name}": Metric(
            value=float(np.sum(of & (verdict == said))),
            unit="",
            note=f"designs called {said} of whose insertions {name} were seated",
        )
        for said in VERDICTS
        for name, of in became.items()
    }
    metrics["refused"] = Metric(
        value=float(np.sum(verdict == REFUSED)), unit="", note="designs that there can't be"
    )
    for said, asked in (
        ("certain", f"at least {CERTAIN_SEATED:g}"),
        ("no", f"at most {NO_SEATED:g}"),
    ):
        of = simulated & (verdict == said)
        note = f"insertions of designs called {said}, {asked} % is asked for"
        metrics |= _share(f"{said}.seated", int(seated[of].sum()), int(trials[of].sum()), note)
    for name, said in (("all", "certain"), ("none", "no")):
        of = became[name]
        note = f"designs of which {name} were seated, at least {DARES:g} % is asked for"
        called = int(np.sum(of & (verdict == said)))
        metrics |= _share(f"{name}_seated.called_{said}", called, int(of.sum()), note)
    for name in BOUNDED:
        held, of = (int(traces[f"{name}_{end}"].sum()) for end in ("within", "of"))
        note = f"insertions within the bound of the {name}, at least {COVERED:g} % is asked for"
        metrics |= _share(f"bounds.{name}.coverage", held, of, note)
    likely = simulated & (verdict == "likely")
    agree = (traces["share"] >= traces["low"]) & (traces["share"] <= traces["high"])
    note = "likely designs whose predicted share is in the interval of the simulated one"
    metrics |= _share("likely.agree", int(np.sum(likely & agree)), int(likely.sum()), note)
    error = traces["share"][likely] - seated[likely] / trials[likely]
    note = f"predicted less simulated share seated, mean of {int(likely.sum())} designs"
    mean = 100 * float(np.mean(error)) if likely.any() else None
    metrics["likely.share_error"] = measured(mean, "%", note=note, missing="no design is likely")
    return metrics


def _share(name: str, good: int, count: int, note: str) -> dict[str, Metric]:
    """Return a share of a count that may be zero, %."""
    if count:
        return rate(name, good, count, f"of {count} {note}")
    return {
        f"{name}{end}": Metric(value=None, unit="%", note=f"there are none: {note}")
        for end in ("", ".low", ".high")
    }


_BECAME: Final = ("all", "some", "none")
_MARKERS: Final = {"certain": "o", "likely": "s", "no": "X"}
_MOST_MARGIN: Final = 1.5  # that is drawn, to both sides


def plot_accuracy(traces: Table, metrics: Mapping[str, Metric]) -> Figure:
    """Draw the confusion table, and the seated share over the margin and the predicted share."""
    contradicted = sum(
        round(metrics[f"confusion.{said}.{became}"].value or 0.0)
        for said, became in (
            ("certain", "some"),
            ("certain", "none"),
            ("no", "some"),
            ("no", "all"),
        )
    )
    caption = (
        "Verdicts of random designs against what was simulated, and the seated share over the "
        "smallest margin and over the predicted share, with 95 % intervals."
    )
    figure = new_figure(8.0, 6.4, caption=caption)
    grid = figure.add_gridspec(2, 2, height_ratios=[0.8, 1.0])
    table = figure.add_subplot(grid[0, :])
    margin, share = (figure.add_subplot(grid[1, i]) for i in range(2))
    counts = [
        [round(metrics[f"confusion.{said}.{became}"].value or 0.0) for became in _BECAME]
        for said in VERDICTS
    ]
    title = f"(a) Simulation contradicts {contradicted} of {np.sum(counts)} verdicts"
    dress(table, title=title, x="", y="")
    table.grid(False)
    called, seated = [f"called\n{one}" for one in VERDICTS], [f"{one} seated" for one in _BECAME]
    draw_counts(table, np.array(counts), called, seated)
    # That of a link without bound is undefined.
    bounded = np.clip(np.nan_to_num(traces["margin"], nan=-np.inf), -_MOST_MARGIN, _MOST_MARGIN)
    for axes, over, line, title, x in (
        (
            margin,
            bounded,
            [0, 0],
            "(b) Seated share over the margin",
            "margin / share of what is allowed",
        ),
        (
            share,
            traces["share"],
            [0, 1],
            "(c) Seated share over the prediction",
            "random cells within the limits / share",
        ),
    ):
        _seated(axes, traces, over)
        axes.plot(line, [0, 1], color="#555555", linewidth=0.8)
        dress(axes, title=title, x=x, y="seated / share of the insertions")
    if len(margin.get_legend_handles_labels()[0]):
        below: Style = {"loc": "outside lower center", "fontsize": 8, "frameon": False, "ncols": 3}
        figure.legend(*margin.get_legend_handles_labels(), **below)
    return figure


def _seated(axes: Axes, traces: Table, over: NDArray[np.float64]) -> None:
    simulated = traces["trials"] > 0
    for said, colour in VERDICTS.items():
        of = simulated & (traces["verdict"] == said)
        if not of.any():
            continue
        seated = traces["seated"][of] / traces["trials"][of]
        ends = np.maximum([seated - traces["low"][of], traces["high"][of] - seated], 0.0)
        look: Style = {"color": colour, "marker": _MARKERS[said], "linestyle": "", "capsize": 2}
        axes.errorbar(over[of], seated, yerr=ends, elinewidth=0.8, label=said, **look)
    axes.set_ylim(-0.05, 1.05)


def figures(scenario: DrawnDesignsScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"accuracy": plot_accuracy(outcome.traces, outcome.metrics)}
