"""Where the centre of a compliance should be for a part: push, margin and deflection over it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.cell.wedging_diagram import InitialErrors
from chamfer.analysis.drawing.figure_style import LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome, Progress, column
from chamfer.models.arms.position_arm import Compliance, ComplianceParams
from chamfer.models.peg.peg_and_hole import PRESETS, PegAndHole
from chamfer.models.peg.support import Support, stacked, strain
from chamfer.models.peg_theory import insertion_statics as simple
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.wedging import Form, require_stiff, rotation_margin
from chamfer.models.validation import ParameterError, require_finite, require_positive, within

Array = NDArray[np.float64]

_MOST_POINTS: Final = 10_000
_NIST_16MM: Final[Mapping[str, Any]] = PRESETS["nist-16mm"]
_REACH: Final = 2.0  # clearances above the chamfer, where a tilted peg touches it first
_FORMS: Final[tuple[Form, ...]] = ("exact", "simple")
_SIGNS: Final[Mapping[str, float]] = {"adding": 1.0, "opposing": -1.0}  # of the tilt


@dataclass(frozen=True, kw_only=True)
class CentreScenario:
    """A part, its errors of either sign, and what gives way, with its centre in many places."""

    parts: PegAndHole = field(default_factory=lambda: PegAndHole(**_NIST_16MM))
    compliance: ComplianceParams = ComplianceParams(kind="rcc")  # its own centre is marked
    arm: Support | None = None  # that gives way behind it, from the tip; None: none does
    start: InitialErrors = InitialErrors(lateral=0.001, rotation=0.01)
    # of equal signs they add; assumed
    nearest: float = -0.02  # m, the first centre, from the tip away from the hole
    farthest: float = 0.15  # m, the last
    points: int = 41  # centres between them
    depth: float = 0.02  # m, of the tip in the bore at the end
    depths: int = 161  # at which the push is computed

    def __post_init__(self) -> None:
        require_finite(self, "nearest")
        require_positive(self, "depth")
        if not self.nearest < self.farthest <= 1.0:
            raise ParameterError("farthest", self.farthest, "more than nearest, 1 m at most")
        for name in ("points", "depths"):
            if not 2 <= getattr(self, name) <= _MOST_POINTS:
                raise ParameterError(name, getattr(self, name), f"2 to {_MOST_POINTS}")
        if not abs(self.start.lateral) < (reach := self.parts.chamfer_limit):
            allowed = f"less than the chamfers reach, {reach:g} m"
            raise ParameterError("start.lateral", self.start.lateral, allowed)


@dataclass(frozen=True, kw_only=True)
class ResolvedCentreScenario(CentreScenario):
    """The same with the compliance resolved."""

    compliance: Compliance

    def support(self, centre: float) -> Support:
        """Return what holds the peg with the compliance's centre at a height above the tip, m."""
        device = replace(self.compliance.support, centre_distance=centre)
        return stacked(device, self.arm) if self.arm else device


COMPLIANCE_CENTRE: Final = CentreScenario()


def resolve(scenario: CentreScenario) -> ResolvedCentreScenario:
    """Resolve the compliance; refuse one on which a peg can turn over."""
    compliance = scenario.compliance.resolved()
    resolved = ResolvedCentreScenario(**vars(scenario) | {"compliance": compliance})
    with within("compliance"):
        require_stiff(resolved.parts, resolved.support(compliance.centre_distance))
    return resolved


class Insertion(NamedTuple):
    """What the statics say of one centre and one pair of errors."""

    push: float  # N, the largest on the way; infinite: none slides the peg
    simple: float  # N, Whitney's, in the bore
    margin: float  # %, of theta_w, to wedging and to where no push slides the peg
    simple_margin: float  # %, to Whitney's parallelogram
    deflection: float  # %, of the compliance's limits


def insertion(scenario: ResolvedCentreScenario, centre: float, sign: float) -> Insertion:
    """Return what becomes of the peg, from the chamfer to the depth."""
    parts, compliance, support = scenario.parts, scenario.compliance, scenario.support(centre)
    lateral, tilt = scenario.start.lateral, sign * scenario.start.rotation
    above = float(simple.chamfer_depth(parts, lateral)) + _REACH * parts.clearance
    depth = np.linspace(-above, scenario.depth, scenario.depths)
    found = equilibrium(parts, support, lateral, tilt, depth)
    device = replace(compliance.support, centre_distance=centre)
    across, turned = strain(device, support, lateral - found.tip, tilt - found.tilt)
    none = np.zeros_like(across)
    along = found.insertion_force / compliance.axial
    moved = np.stack([none, turned, none, across, none, along], axis=-1)
    by_whitney = simple.bore_contact(parts, support, lateral, tilt, depth[depth >= 0])
    exact, parallelogram = (
        float(rotation_margin(parts, support, lateral, tilt, form)) for form in _FORMS
    )
    return Insertion(
        push=float(found.insertion_force.max()),
        simple=float(by_whitney.insertion_force.max()),
        margin=100 * exact,
        simple_margin=100 * parallelogram,
        deflection=100 * float(np.nanmax(compliance.deflection(moved))),
    )


def run(scenario: ResolvedCentreScenario, seed: int, progress: Progress) -> Outcome:
    """Look at every centre, with errors that add and that oppose each other; nothing is random."""
    own = scenario.compliance.centre_distance
    grid = np.linspace(scenario.nearest, scenario.farthest, scenario.points)
    centres = np.unique([*grid, *(one for one in (0.0, own) if grid[0] <= one <= grid[-1])])
    traces = {"centre_distance": column(centres)}
    looked = []
    for k, centre in enumerate(centres.tolist()):
        progress(k / len(centres))
        looked.append([insertion(scenario, centre, sign) for sign in _SIGNS.values()])
    for i, name in enumerate(_SIGNS):
        for quantity in Insertion._fields:
            traces[f"{name}.{quantity}"] = column([getattr(one[i], quantity) for one in looked])
    push = np.maximum(traces["adding.push"], traces["opposing.push"])
    margin = np.minimum(traces["adding.margin"], traces["opposing.margin"])
    softest, widest = int(np.argmin(push)), int(np.argmax(margin))
    there = [insertion(scenario, own, sign) for sign in _SIGNS.values()]
    most, stuck = max(one.push for one in there), "no push slides the peg"
    worst = "of errors that add and that oppose, the worse"
    pushed = (most, "N", worst) if np.isfinite(most) else (None, "N", stuck)
    values = {
        "least_push.centre_distance": (centres[softest], "m", "from the tip, away from the hole"),
        "least_push": (push[softest], "N", worst) if np.isfinite(push[softest]) else pushed,
        "most_margin.centre_distance": (centres[widest], "m", "likewise"),
        "most_margin": (margin[widest], "%", f"of theta_w; {worst}"),
        "own.push": pushed,
        "own.margin": (min(one.margin for one in there), "%", f"at {own:g} m"),
    }
    if scenario.compliance.most_lateral is not None:
        share = max(one.deflection for one in there)
        values["compliance.deflection"] = (share, "%", "of its limits; 100: at a stop")
    return Outcome(metrics=metrics_of(values), traces=traces, simulated_seconds=0.0)


_LOOKS: Final[Mapping[str, Style]] = {
    "adding": {"color": "#b00020"},
    "opposing": {"color": "#1b4f9c"},
}
_SIMPLE: Final[Style] = {"linestyle": (0, (4, 2)), "linewidth": 1.0}
_OWN: Final[Style] = {"color": "#1b7f5c", "linestyle": ":", "linewidth": 1.4}
_MM: Final = 1e3
_TALL: Final = 4.0  # times the push with the compliance's own centre, beyond which it is cut


def figures(scenario: ResolvedCentreScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw push, margin and deflection over the place of the centre."""
    traces, limited = outcome.traces, scenario.compliance.most_lateral is not None
    figure = new_figure(8.0, 9.0 if limited else 6.4)
    panels = [("push", "simple", "(a) Largest push; dashed: Whitney's, in the bore", "push / N")]
    title = r"(b) Margin to the wedge, of $\theta_w$; dashed: Whitney's"
    panels += [("margin", "simple_margin", title, "margin / %")]
    panels += [
        ("deflection", "", "(c) Deflection of the RCC", "share of its limits / %")
    ] * limited
    x = traces["centre_distance"] * _MM
    for axes, (name, by_whitney, title, y) in zip(
        figure.subplots(len(panels), 1, sharex=True), panels, strict=True
    ):
        for errors, look in _LOOKS.items():
            values = traces[f"{errors}.{name}"]
            shown = np.where(np.isinf(values), np.nan, values)
            axes.plot(x, shown, label=f"{errors} errors", **look)
            if by_whitney:
                axes.plot(x, traces[f"{errors}.{by_whitney}"], **look, **_SIMPLE)
        axes.axvline(scenario.compliance.centre_distance * _MM, label="its own centre", **_OWN)
        if name == "margin":
            axes.axhline(0.0, **LIMIT)
        if name == "deflection":
            axes.axhline(100.0, **LIMIT)
            axes.set_ylim(bottom=0.0)
        last = "centre of compliance above the tip / mm" if name == panels[-1][0] else ""
        dress(axes, title=title, x=last, y=y)
    legend(figure.axes[0], ncols=3, loc="upper left")
    own = outcome.metrics["own.push"].value
    if own is not None:
        figure.axes[0].set_ylim(0.0, _TALL * own)
    return {"compliance-centre": figure}
