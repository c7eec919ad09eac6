"""The verdict over any two fields of a design.

A coarse grid comes first. Between four points with the same verdict and the same limiting link
nothing more is computed, and numbers are interpolated. Elsewhere the grid is halved until it is as
fine as requested, the last time only where verdicts differ. So borders of the verdict are exact to
a point, those of a link to two, but an island between the points of the coarse grid is missed.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from types import NoneType
from typing import Final, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import try_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.command.scenario_fields import leaves, matching
from chamfer.analysis.design.changes import FIELDS
from chamfer.analysis.design.design import assess
from chamfer.analysis.design.design_scenario import FEWEST, DesignScenario, resolve_design
from chamfer.analysis.design.design_words import scaled
from chamfer.analysis.drawing.figure_style import Style, dress, new_figure
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Progress, Table, part_of
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.models.validation import ParameterError

POINTS: Final = 41  # along each axis
_STRIDES: Final = (4, 2, 1)  # of grids one after the other
_COMPUTED: Final = ("verdict", "limiting", "margin", "inside")
REFUSED: Final = "refused"  # beside the verdicts: there is no such design
_NUMBER: Final = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
_AXIS: Final = re.compile(rf"([^:\s]+):({_NUMBER}):({_NUMBER})")


@dataclass(frozen=True, kw_only=True)
class MapAxis:
    """A field along an axis of a map."""

    path: str
    unit: str
    values: tuple[float, ...]  # in order
    here: float  # the design's own


@dataclass(frozen=True, kw_only=True)
class DesignMap:
    """The design over two fields; all arrays have shape (y, x)."""

    x: MapAxis
    y: MapAxis
    verdict: NDArray[np.str_]  # certain, likely, no or refused
    limiting: NDArray[np.str_]  # the limiting link's name, or why a design is refused
    margin: NDArray[np.float64]  # the smallest one, as a share of what is allowed; NaN: refused
    inside: NDArray[np.float64]  # share of the drawn errors inside; NaN: refused
    computed: NDArray[np.bool_]  # or else interpolated

    def table(self) -> Table:
        """Return a row for each point."""
        y, x = np.meshgrid(self.y.values, self.x.values, indexing="ij")
        columns = {"verdict": self.verdict, "limiting_link": self.limiting}
        numbers = {"margin": self.margin, "inside": self.inside, "computed": self.computed}
        return {
            self.x.path: x.ravel(),
            self.y.path: y.ravel(),
            **{name: one.ravel() for name, one in {**columns, **numbers}.items()},
        }


def parse_map(resolved: DesignScenario, texts: Sequence[str], points: int) -> list[MapAxis]:
    """Return the two axes of ``--map``, texts ``PATH:a:b``, of a resolved design.

    A field is one of :data:`chamfer.analysis.design.changes.FIELDS`, which may stand for several
    that change together, or any other number of the scenario.

    Raises:
        UserError: If they are not two different fields, or one is no number.
    """
    axes = [_axis(resolved, text, points) for text in texts]
    if len(axes) != 2:
        raise UserError(f"--map has {len(axes)} fields, allowed: two, PATH:a:b PATH:a:b")
    if axes[0].path == axes[1].path:
        raise UserError(f"--map has {axes[0].path} twice, allowed: two fields")
    return axes


def map_design(
    scenario: DesignScenario, axes: Sequence[MapAxis], seed: int, progress: Progress
) -> DesignMap:
    """Return the verdict at every point; an impossible point is refused, and the others go on.

    Open fields of the unresolved scenario follow from the two fields too.
    """
    x, y = axes
    shape = len(y.values), len(x.values)
    found = DesignMap(
        x=x,
        y=y,
        verdict=np.full(shape, "", dtype=object),
        limiting=np.full(shape, "", dtype=object),
        margin=np.full(shape, np.nan),
        inside=np.full(shape, np.nan),
        computed=np.zeros(shape, dtype=np.bool_),
    )
    first = next(one for one in _STRIDES if not any((size - 1) % one for size in shape))
    strides = [one for one in _STRIDES if one <= first]
    count = len(strides)
    wanted = np.zeros(shape, dtype=np.bool_)
    wanted[::first, ::first] = True
    for k, stride in enumerate(strides):
        if k:
            wanted = _refined(found, stride)
        begin, end, name = k / count, (k + 1) / count, f"grid {k + 1} of {count},"
        _compute(found, wanted, scenario, seed, part_of(progress, begin, end, name))
    return replace(
        found, verdict=found.verdict.astype(np.str_), limiting=found.limiting.astype(np.str_)
    )


def _refined(found: DesignMap, stride: int) -> NDArray[np.bool_]:
    """Fill in points between equal ones of twice the stride; return which are to be computed."""
    wanted = np.zeros(found.verdict.shape, dtype=np.bool_)
    wide = 2 * stride
    for row, column in product(*(range(0, count - 1, wide) for count in found.verdict.shape)):
        rows, columns = (slice(one, one + wide + 1, stride) for one in (row, column))
        corners = np.ix_([row, row + wide], [column, column + wide])
        verdicts, links = set(found.verdict[corners].flat), set(found.limiting[corners].flat)
        # Why a design is refused says a value, which no two points share.
        if len(verdicts) > 1 or (stride > 1 and len(links) > 1 and verdicts != {REFUSED}):
            wanted[rows, columns] = True
            continue
        new = found.verdict[rows, columns] == ""
        for of in (found.verdict, found.limiting):
            of[rows, columns] = np.where(new, of[row, column], of[rows, columns])
        for values in (found.margin, found.inside):
            between = _bilinear(values[corners])
            values[rows, columns] = np.where(new, between, values[rows, columns])
    return wanted & ~found.computed


def _bilinear(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values between four corner values, with the corners, shape (3, 3)."""
    left, right = corners[:, 0], corners[:, 1]
    low, high = np.stack([left, (left + right) / 2, right], axis=1)
    return np.stack([low, (low + high) / 2, high])


def _compute(
    found: DesignMap,
    wanted: NDArray[np.bool_],
    scenario: DesignScenario,
    seed: int,
    progress: Progress,
) -> None:
    """Compute points, a row at a time, because their designs share results."""
    x, y = found.x, found.y
    rows = [row for row in range(len(y.values)) if wanted[row].any()]
    tasks = [
        (y.values[row], tuple(x.values[column] for column in np.flatnonzero(wanted[row])))
        for row in rows
    ]
    if not tasks:
        return
    done = try_each(partial(_row, scenario, x.path, y.path, seed), tasks, progress)
    if done.failed:
        raise ExperimentError(f"--map {y.path}: {done.failed[0][1].reason}")
    for row, values in zip(rows, done.rows, strict=True):
        of = wanted[row]
        for name in _COMPUTED:
            getattr(found, name)[row, of] = values[name]
        found.computed[row, of] = True


def _row(
    scenario: DesignScenario,
    x_path: str,
    y_path: str,
    seed: int,
    task: tuple[float, tuple[float, ...]],
) -> Row:
    y, x_values = task
    points = [_point(scenario, ((y_path, y), (x_path, x)), seed) for x in x_values]
    return {
        name: np.array(values)
        for name, values in zip(_COMPUTED, zip(*points, strict=True), strict=True)
    }


def _point(
    scenario: DesignScenario, fields: Sequence[tuple[str, float]], seed: int
) -> tuple[str, str, float, float]:
    try:
        for path, value in fields:
            scenario = _with(scenario, path, value)
        found = assess(resolve_design(scenario), seed, draws=FEWEST)
    except (ParameterError, UserError) as error:
        return REFUSED, str(error), np.nan, np.nan
    return found.verdict, found.limiting_link, found.margin, found.share


def _axis(resolved: DesignScenario, text: str, points: int) -> MapAxis:
    match = _AXIS.fullmatch(text)
    if match is None:
        raise UserError(f"--map is {text!r}, allowed: PATH:a:b, a field and its ends")
    path, low, high = match[1], float(match[2]), float(match[3])
    if not (np.isfinite([low, high]).all() and low < high):
        raise UserError(f"--map {path} is {low:g}:{high:g}, allowed: finite, the lower end first")
    values = np.linspace(low, high, points)
    if field := FIELDS.get(path):
        here = field.get(resolved)
        return MapAxis(path=path, unit=field.unit, values=tuple(values.tolist()), here=here)
    known = {leaf.path: leaf for leaf in leaves(resolved)}
    if path not in known:
        matching(list(known.values()), path)  # says what is close
        raise UserError(f"--map {path} is several fields, allowed: one, a number")
    leaf = known[path]
    kinds = {kind for kind in (leaf.kind, *get_args(leaf.kind)) if kind is not NoneType}
    if not kinds & {int, float}:
        raise UserError(f"--map {path} is no number, allowed: fields that are")
    if float not in kinds:
        values = np.unique(np.rint(values))
    return MapAxis(path=path, unit=leaf.unit, values=tuple(values.tolist()), here=leaf.value)


def _with(scenario: DesignScenario, path: str, value: float) -> DesignScenario:
    """Return a scenario with another value of a field, and of the fields that change with it."""
    if path in FIELDS:
        return FIELDS[path].set(scenario, value)
    text = int(value) if value == int(value) else value
    return make_scenario(scenario, settings=[f"{path}={text!r}"])


Array = NDArray[np.float64]

# Of the verdicts, told apart in grey too.
VERDICTS: Final = {"certain": "#1b4f9c", "likely": "#e9c46a", "no": "#b5482a"}
_REFUSED: Final = "#d9d9d9"
_LINKS: Final = (
    *("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#000000", "#994f00"),
    *("#006cd1", "#e1be6a", "#40b0a6", "#5d3a9b", "#d35fb7"),
)
_HERE: Final[Style] = {
    "marker": "*",
    "markersize": 13,
    "color": "white",
    "markeredgecolor": "black",
    "linestyle": "",
}


def plot_map(found: DesignMap) -> Figure:
    """Draw the verdict over two fields, next to the limiting link."""
    fields = f"{found.x.path} and {found.y.path}"
    figure = new_figure(8.0, 4.6, caption=f"Verdict and limiting link of a design over {fields}.")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    refused = found.verdict == REFUSED
    shown = {name: colour for name, colour in VERDICTS.items() if (found.verdict == name).any()}
    _show(left, found, _verdict_colours(found), shown)
    names, counts = np.unique(found.limiting[~refused], return_counts=True)
    links = dict(zip(names[np.argsort(-counts)].tolist(), _LINKS, strict=False))
    colours = np.full((*refused.shape, 3), to_rgb(_REFUSED))
    for name, colour in links.items():
        colours[~refused & (found.limiting == name)] = to_rgb(colour)
    _show(right, found, colours, links)
    certain = int((found.verdict == "certain").sum())
    title = f"{certain} of {found.verdict.size} points are certain"
    dress(left, title=title, x=_label(found.x), y=_label(found.y))
    dress(right, title="Limiting link", x=_label(found.x), y="")
    for axes in (left, right):
        axes.grid(False)
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.13),
            ncols=3,
            fontsize=8,
            frameon=False,
        )
    return figure


def _verdict_colours(found: DesignMap) -> Array:
    """Return colours, shape (y, x, 3): the fewer errors inside, the deeper likely is."""
    colours = np.full((*found.verdict.shape, 3), to_rgb(_REFUSED))
    for name, colour in VERDICTS.items():
        colours[found.verdict == name] = to_rgb(colour)
    likely = found.verdict == "likely"
    inside = found.inside[likely, np.newaxis]
    pale, deep = (np.array(to_rgb(one)) for one in ("#f6e7b4", VERDICTS["likely"]))
    colours[likely] = inside * pale + (1 - inside) * deep
    return colours


def _show(axes: Axes, found: DesignMap, colours: Array, names: dict[str, str]) -> None:
    x, y = _places(found.x), _places(found.y)
    half_x, half_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    axes.imshow(
        colours,
        origin="lower",
        extent=(x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y),
        aspect="auto",
        interpolation="nearest",
    )
    if (found.verdict == REFUSED).any():
        names = {**names, "no such design": _REFUSED}
    for name, colour in names.items():
        axes.plot([], [], marker="s", linestyle="", markersize=8, color=colour, label=name)
    at = scaled(found.x.here, found.x.unit)[0], scaled(found.y.here, found.y.unit)[0]
    if x[0] <= at[0] <= x[-1] and y[0] <= at[1] <= y[-1]:
        axes.plot(*at, **_HERE, label="this design")


def _places(axis: MapAxis) -> Array:
    return np.array([scaled(value, axis.unit)[0] for value in axis.values])


def _label(axis: MapAxis) -> str:
    unit = scaled(0.0, axis.unit)[1]
    return f"{axis.path} / {unit}" if unit else axis.path
