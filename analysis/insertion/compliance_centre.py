"""Where the centre of a compliance should be for a part: push, margin and deflection over it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.cell.wedging_diagram import InitialErrors
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.drawing.figure_style import LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome, Progress, column
from chamfer.models.arms.position_arm import Compliance, ComplianceParams
from chamfer.models.peg.peg_and_hole import PRESETS, PegAndHole
from chamfer.models.peg.support import Support, stacked, strain
from chamfer.models.peg_theory import insertion_statics as simple
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.wedging import require_stiff, rotation_margin
from chamfer.models.validation import ParameterError, require_finite, require_positive

Array = NDArray[np.float64]

_MOST_POINTS: Final = 10_000
_NIST_16MM: Final[Mapping[str, Any]] = PRESETS["nist-16mm"]
_REACH: Final = 2.0  # clearances above the chamfer, where a tilted peg touches it first
_SIGNS: Final[Mapping[str, float]] = {"adding": 1.0, "opposing": -1.0}  # of the tilt


@dataclass(frozen=True, kw_only=True)
class CentreScenario:
    """A part, its errors of either sign, and a compliance with its centre at many heights."""

    parts: PegAndHole = field(default_factory=lambda: PegAndHole(**_NIST_16MM))
    compliance: ComplianceParams = ComplianceParams(kind="rcc")  # its own centre is marked
    arm: Support | None = None  # compliance of the arm behind it, from the tip; None: a rigid arm
    start: InitialErrors = InitialErrors(lateral=0.001, rotation=0.01)
    # errors; with equal signs they add; assumed
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
    """The scenario with the compliance resolved."""

    compliance: Compliance

    def support(self, centre: float) -> Support:
        """Return the peg's support with the compliance's centre at a height above the tip, m."""
        device = replace(self.compliance.support, centre_distance=centre)
        return stacked(device, self.arm) if self.arm else device


COMPLIANCE_CENTRE: Final = CentreScenario()


def resolve(scenario: CentreScenario) -> ResolvedCentreScenario:
    """Resolve the compliance; refuse one on which a peg can turn over."""
    compliance = scenario.compliance.resolved()
    resolved = ResolvedCentreScenario(**vars(scenario) | {"compliance": compliance})
    try:
        require_stiff(resolved.parts, resolved.support(compliance.centre_distance))
    except ParameterError as error:
        raise ParameterError("compliance.angular", compliance.angular, error.allowed) from error
    return resolved


def insertion(scenario: ResolvedCentreScenario, centre: float, sign: float) -> dict[str, float]:
    """Return the statics' results for a centre, from the chamfer to the depth.

    The largest push, N, NaN where none slides the peg, and Whitney's in the bore; the margin
    to wedging, and to where no push slides the peg, %, and that to Whitney's parallelogram; the
    deflection, % of the limits.
    """
    parts, compliance, support = scenario.parts, scenario.compliance, scenario.support(centre)
    lateral, tilt = abs(scenario.start.lateral), sign * abs(scenario.start.rotation)
    above = float(simple.chamfer_depth(parts, lateral)) + _REACH * parts.clearance
    depth = np.linspace(-above, scenario.depth, scenario.depths)
    found = equilibrium(parts, support, lateral, tilt, depth)
    device = replace(compliance.support, centre_distance=centre)
    across, turned = strain(device, support, lateral - found.tip, tilt - found.tilt)
    none, along = np.zeros_like(across), found.insertion_force / compliance.axial
    moved = np.stack([none, turned, none, across, none, along], axis=-1)
    push = float(found.insertion_force.max())
    by_whitney = simple.bore_contact(parts, support, lateral, tilt, depth[depth >= 0])
    return {
        "push": push if np.isfinite(push) else math.nan,
        "simple_push": float(by_whitney.insertion_force.max()),
        "margin": 100 * float(rotation_margin(parts, support, lateral, tilt)),
        "simple_margin": 100 * float(rotation_margin(parts, support, lateral, tilt, "simple")),
        "deflection": 100 * float(np.nanmax(compliance.deflection(moved), initial=0.0)),
    }


def run(scenario: ResolvedCentreScenario, seed: int, progress: Progress) -> Outcome:
    """Evaluate every centre, with errors that add and that oppose; nothing is random."""
    own = scenario.compliance.centre_distance
    grid = np.linspace(scenario.nearest, scenario.farthest, scenario.points)
    centres = np.unique([*grid, own])
    looked = []
    for k, centre in enumerate(centres.tolist()):
        progress(k / len(centres))
        looked.append({name: insertion(scenario, centre, sign) for name, sign in _SIGNS.items()})
    traces = {"centre_distance": column(centres)} | {
        f"{name}.{quantity}": column([one[name][quantity] for one in looked])
        for name in _SIGNS
        for quantity in looked[0][name]
    }
    push, margin, deflection = (
        worse([traces[f"{name}.{quantity}"] for name in _SIGNS], axis=0)
        for quantity, worse in (("push", np.max), ("margin", np.min), ("deflection", np.max))
    )
    at = int(np.searchsorted(centres, own))
    worst = "the worse of errors that add and that oppose each other"
    values: dict[str, tuple[float | None, str, str]] = {}
    push = np.where(np.isnan(push), np.inf, push)
    best = {"least_push": int(np.argmin(push)), "most_margin": int(np.argmax(margin))}
    for name, k in {"own": at, **best}.items():
        slides = bool(np.isfinite(push[k]))
        values |= {
            f"{name}.centre_distance": (centres[k], "m", "from the tip, away from the hole"),
            f"{name}.push": (push[k], "N", worst) if slides else (None, "N", "none slides it"),
            f"{name}.margin": (margin[k], "%", f"of theta_w; {worst}"),
        }
    if scenario.compliance.most_lateral is not None:
        values["compliance.deflection"] = (deflection[at], "%", "of its limits; 100: at a stop")
    return Outcome(metrics=metrics_of(values), traces=traces, simulated_seconds=0.0)


_COLOURS: Final = ("#b00020", "#1b4f9c")
_SIMPLE: Final[Style] = {"linestyle": (0, (4, 2)), "linewidth": 1.0}
_OWN: Final[Style] = {"color": "#1b7f5c", "linestyle": ":", "linewidth": 1.4}
_MM: Final = 1e3
_TALL: Final = 4.0  # times the push with the compliance's own centre, beyond which it is cut


def figures(scenario: ResolvedCentreScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw push, margin and deflection over the place of the centre."""
    traces, limited = outcome.traces, scenario.compliance.most_lateral is not None
    push, margin, deflection = (
        f"{value:.2g} {unit}" if np.isfinite(value) else "none"
        for name, unit in (("own.push", "N"), ("own.margin", "%"), ("compliance.deflection", "%"))
        for value in (metric_value(outcome.metrics, name),)
    )
    figure = new_figure(
        height=9.0 if limited else 6.4,
        caption=f"With its own centre of compliance the peg needs a push of {push} and keeps a "
        f"margin of {margin} to wedging; both depend on the place of the centre. Dashed: Whitney.",
    )
    title = rf"(b) Margin to wedging: {margin} of $\theta_w$ at its own centre"
    panels = {
        "push": (f"(a) Largest push: {push} at its own centre", "push / N"),
        "margin": (title, "margin / %"),
        "deflection": (f"(c) Deflection of the RCC: {deflection} of its limits", "deflection / %"),
    }
    rows = figure.subplots(3 if limited else 2, 1, sharex=True)
    x = traces["centre_distance"] * _MM
    for axes, (name, (title, y)) in zip(rows, panels.items(), strict=False):
        for errors, colour in zip(_SIGNS, _COLOURS, strict=True):
            axes.plot(x, traces[f"{errors}.{name}"], color=colour, label=f"{errors} errors")
            if (of := f"{errors}.simple_{name}") in traces:
                axes.plot(x, traces[of], color=colour, **_SIMPLE)
        axes.axvline(scenario.compliance.centre_distance * _MM, label="its own centre", **_OWN)
        dress(axes, title=title, x="", y=y)
    rows[1].axhline(0.0, **LIMIT)
    if limited:
        rows[2].axhline(100.0, **LIMIT)
        rows[2].set_ylim(bottom=0.0)
    rows[-1].set_xlabel("centre of compliance above the tip / mm", fontsize=9)
    legend(rows[-1], ncols=3)
    own = outcome.metrics["own.push"].value
    if own:
        rows[0].set_ylim(0.0, _TALL * own)
    return {"compliance-centre": figure}
