"""Where in the workspace the hybrid laws are kinematically unstable, and what the loop bears."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.contact.hybrid_margins import margin_metrics, margin_tables, poles
from chamfer.analysis.contact.hybrid_stability_figures import plot_margins, plot_stability
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.hybrid_loop_stability import growth_rate
from chamfer.diagrams.contact.planar_scenarios import LATE, PlanarLoop
from chamfer.models.arms.arm import Elbow
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError, within
from chamfer.systems.force.hybrid_controller import HybridGains, Law
from chamfer.systems.force.hybrid_stability import free_growth_rate, stiffness_eigenvalues
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.force.selection import position_selection

CASES: Final[tuple[tuple[Elbow, Law], ...]] = (
    ("negative", "inverse"),
    ("positive", "inverse"),
    ("positive", "projected"),
    ("positive", "transpose"),
)
_ROUNDING: Final = 1e-9  # of the largest eigenvalue, what counts as zero
_MOST_POINTS: Final = 1000
_CONTINUOUS: Final = 1e-5  # s, a period so short that its length does not count


_PLANAR: Final = PlanarLoop()


def _gains(of: HybridGains) -> dict[str, object]:
    return {one.name: getattr(of, one.name) for one in fields(HybridGains)}


@dataclass(frozen=True, kw_only=True)
class HybridStabilityScenario:
    """What the planar loop's stability depends on, and the grid over its workspace.

    The laws are compared with the same gains.
    """

    controller: HybridGains = HybridGains(**_gains(_PLANAR.controller))  # type: ignore[arg-type]
    late: HybridGains = HybridGains(**_gains(LATE))  # type: ignore[arg-type]
    # that are to bear a torque one sample late
    viscous: tuple[float, ...] = _PLANAR.arm.joint_friction.viscous  # N m s/rad, joint friction
    start: tuple[float, ...] = _PLANAR.task.start  # m, of the approach
    direction: tuple[float, ...] = _PLANAR.task.direction  # of approach and push
    points: int = 61  # in each direction
    reach: float = 2.0  # m, from -reach to reach in x and y

    def __post_init__(self) -> None:
        if not 2 <= self.points <= _MOST_POINTS:
            raise ParameterError("points", self.points, f"2 to {_MOST_POINTS}")
        if not 0 < self.reach < math.inf:
            raise ParameterError("reach", self.reach, "a finite number > 0")

    @property
    def gain_sets(self) -> dict[str, PlanarLoop]:
        """The loops that are compared."""
        elbow, law = CASES[0]
        return {"chapter 2": self.loop(elbow, law), "late": self.loop(elbow, law, self.late)}

    def loop(self, elbow: Elbow, law: Law, controller: HybridGains | None = None) -> PlanarLoop:
        """Return the planar arm's loop with one of its elbows, a law and gains, or its own."""
        friction = replace(_PLANAR.arm.joint_friction, viscous=self.viscous)
        gains = _gains(controller or self.controller)
        return replace(
            _PLANAR,
            arm=replace(_PLANAR.arm, elbow=elbow, joint_friction=friction),
            controller=replace(_PLANAR.controller, law=law, **gains),  # type: ignore[arg-type]
            task=replace(_PLANAR.task, start=self.start, direction=self.direction),
        )


def run_stability(scenario: HybridStabilityScenario, seed: int, progress: Progress) -> Outcome:
    """Map the least eigenvalue of ``M^-1 J^-1 P J`` (and its kin) and the loop's growth."""
    grid = np.linspace(-scenario.reach, scenario.reach, scenario.points)
    rows: dict[str, list[float]] = {name: [] for name in ("case", "x", "y", "least", "growth")}
    metrics: dict[str, Metric] = {}
    for i, (elbow, law) in enumerate(CASES):
        loop = scenario.loop(elbow, law)
        crucible = loop.make_surface()
        measured = _Loop(loop)
        bad, inside_bad, reached, inside = 0, 0, 0, 0
        for j, y in enumerate(grid.tolist()):
            progress((i + j / len(grid)) / len(CASES), f"{law}, {elbow} elbow")
            for x in grid.tolist():
                least, growth = measured.stability((x, y))
                rows["case"].append(i)
                rows["x"].append(x)
                rows["y"].append(y)
                rows["least"].append(least)
                rows["growth"].append(growth)
                if math.isfinite(least):
                    in_crucible = locate(crucible, np.array([x, y, 0.0])).gap >= 0
                    reached, inside = reached + 1, inside + in_crucible
                    bad, inside_bad = bad + (least < 0), inside_bad + (in_crucible and least < 0)
        name = f"{elbow}.{law}"
        nominal = tuple(loop.touching.tolist())
        least, growth = measured.stability(nominal)
        metrics[f"{name}.unstable_share"] = Metric(
            value=100 * bad / max(1, reached), unit="%", note="of the reachable grid"
        )
        metrics[f"{name}.unstable_share_in_crucible"] = Metric(
            value=100 * inside_bad / max(1, inside), unit="%", note="of the grid in the crucible"
        )
        metrics[f"{name}.eigenvalue"] = Metric(
            value=least, unit="1/(kg m^2)", note=f"the least one at {nominal}, per unit of gain"
        )
        metrics[f"{name}.growth"] = Metric(
            value=_or_zero(growth),
            unit="1/s",
            note=f"of the loop at {nominal}, in continuous time",
        )
        metrics[f"{name}.sampled_growth"] = Metric(
            value=_or_zero(measured.sampled_growth()),
            unit="1/s",
            note=f"the same with the torque held over {loop.controller.period:g} s",
        )
        metrics |= margin_metrics(name, loop)
    sets = scenario.gain_sets
    metrics |= margin_metrics("late", sets["late"])
    drawn, metrics["pole_difference"] = poles(sets["chapter 2"])
    return Outcome(
        metrics=metrics,
        traces={name: column(values) for name, values in rows.items()},
        simulated_seconds=0.0,
        tables={**margin_tables(sets), "poles": drawn},
    )


def _or_zero(growth: float) -> float:
    """Return 0 for what is a neutral pole in floating point."""
    return growth if abs(growth) > NEUTRAL else 0.0


class _Loop:
    """A loop with all that does not depend on the pose."""

    def __init__(self, loop: PlanarLoop) -> None:
        self._loop = loop
        self._dynamics = loop.dynamics()
        self._control = replace(loop.controller, period=_CONTINUOUS)
        self._selection = position_selection(loop.direction)
        self._viscous = np.array(loop.arm.joint_friction.viscous)

    def sampled_growth(self) -> float:
        """Return the growth at the intended contact point with the controller's period, 1/s."""
        loop = self._loop
        q = loop.joint_positions(loop.touching)
        mass = self._dynamics.evaluate(q, np.zeros(len(q))).mass
        J = loop.ARM.jacobian(q)
        return free_growth_rate(mass, J, self._selection, loop.controller, self._viscous)

    def stability(self, endpoint: tuple[float, ...]) -> tuple[float, float]:
        """Return the least eigenvalue, to rounding, and the growth in continuous time, 1/s.

        Both are NaN out of reach.
        """
        loop = self._loop
        try:
            q = loop.joint_positions(np.array(endpoint))
        except ParameterError:
            return math.nan, math.nan
        mass = self._dynamics.evaluate(q, np.zeros(len(q))).mass
        J = loop.ARM.jacobian(q)
        law = loop.controller.law
        values = stiffness_eigenvalues(mass, J, self._selection, law).real
        least = float(values.min())
        if abs(least) < _ROUNDING * float(np.abs(values).max()):
            least = 0.0
        return least, free_growth_rate(mass, J, self._selection, self._control, self._viscous)


def resolve_hybrid_stability(scenario: HybridStabilityScenario) -> HybridStabilityScenario:
    """Return the scenario with what it leaves open filled in, and checked."""
    with within("late"):
        scenario.late.for_joints(_PLANAR.ARM.num_joints)
    try:
        for case in CASES:
            growth_rate(scenario.loop(*case))  # checks that start and contact are reached
    except ParameterError as error:
        name = error.name.removeprefix("task.")
        raise ParameterError(name, error.value, error.allowed) from error
    return scenario


def figures(scenario: HybridStabilityScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {
        "hybrid-stability": plot_stability(scenario.loop(*CASES[0]), CASES, outcome),
        "hybrid-stability-margins": plot_margins(scenario.gain_sets, outcome),
    }
