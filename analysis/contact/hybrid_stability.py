"""Kinematic instability of the hybrid laws over the workspace, and the loop's margins."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, TypeVar

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    LIMIT,
    NOTE,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.linear.to_control import to_control
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
from chamfer.diagrams.contact.contact_scenarios import LATE_GAINS, PlanarLoop
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import (
    linear_loop,
    linear_loops,
    stability,
)
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
from chamfer.models.arms.arm import Elbow
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError, within
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.force.hybrid_law import HybridGains, LawKind
from chamfer.systems.force.hybrid_linear import free_growth_rate, stiffness_eigenvalues
from chamfer.systems.force.projection import position_selection
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.recording import recording

HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


def smooth(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return a scenario that holds its place, without dry friction, noise and quantisation."""
    friction = scenario.arm.joint_friction
    still = replace(friction, coulomb=(0.0,) * len(friction.coulomb))
    return replace(
        scenario,
        arm=replace(scenario.arm, joint_friction=still),
        surface=replace(scenario.surface, friction=SurfaceFriction(coefficient=0.0)),
        sensor=replace(scenario.sensor, noise=0.0, drift=0.0, resolution=0.0),
        encoders=replace(scenario.encoders, counts=0.0),
        controller=replace(scenario.controller, computation_jitter=0.0),
    )


@recording(None)
def settled(diagram: Diagram, time: float) -> Context:
    """Return the diagram's context after a time, s."""
    simulator = Simulator(diagram)
    simulator.AdvanceTo(time)
    context: Context = simulator.get_context()
    return context


MODES: Final = {"the approach's end": "approach", "lost contact": "lost", "contact": "contact"}
_DELAYS: Final = np.linspace(0.0, 2.0, 41)  # periods
_FORCE_INTEGRALS: Final = np.linspace(0.0, 25.0, 26)  # 1/s
_SETTLED: Final = 2.0  # s after the time of the contact


def margin_metrics(name: str, loop: PlanarLoop) -> dict[str, Metric]:
    """Return growth in contact and a sample late, and margins, of any loop."""
    found = stability(loop)
    late = replace(loop.controller, computation_delay=loop.controller.period)
    worst = max(one.growth_rate() for one in linear_loops(replace(loop, controller=late)))
    return {
        f"{name}.growth_contact": Metric(value=_clipped(found.growth_contact), unit="1/s"),
        f"{name}.growth_one_sample_late": Metric(value=_clipped(worst), unit="1/s"),
        f"{name}.gain_margin": Metric(
            value=found.gain_margin, unit="", note=found.least_gain or "none up to 1000"
        ),
        f"{name}.delay_margin": Metric(
            value=found.delay_margin, unit="s", note=found.least_delay or "none up to 10 periods"
        ),
    }


def margin_tables(sets: Mapping[str, PlanarLoop]) -> dict[str, Table]:
    """Return growth by delay and by force integral.

    ``delays``: ``gains`` and ``mode``, numbers in ``sets`` and :data:`MODES`; ``delay`` s;
    ``growth`` 1/s. ``force_integrals``: ``gains``, ``force_integral`` 1/s and ``growth``, in
    contact.
    """
    delays: list[tuple[float, ...]] = []
    integrals: list[tuple[float, ...]] = []
    for i, loop in enumerate(sets.values()):
        control = loop.controller
        modes = [one for one in linear_loops(loop) if one.name in MODES]
        for j, one in enumerate(modes):
            for delay in (_DELAYS * control.period).tolist():
                grows = one._replace(delay=delay).growth_rate()
                delays.append((i, j, delay, _clipped(grows)))
        for gain in _FORCE_INTEGRALS.tolist():
            changed = replace(loop, controller=replace(control, force_integral=gain))
            grows = linear_loop(changed, "contact", CONTACT, loop.touching).growth_rate()
            integrals.append((i, gain, _clipped(grows)))
    return {
        "delays": _table(("gains", "mode", "delay", "growth"), delays),
        "force_integrals": _table(("gains", "force_integral", "growth"), integrals),
    }


def _table(names: tuple[str, ...], rows: Sequence[tuple[float, ...]]) -> Table:
    return {name: column(values) for name, values in zip(names, np.transpose(rows), strict=True)}


def _clipped(growth: float) -> float:
    """Return 0 for a growth that is a neutral pole in floating point."""
    return growth if growth > NEUTRAL else 0.0


def poles(loop: PlanarLoop) -> tuple[Table, Metric]:
    """Return poles in contact, of the linear loop and of its diagram, and their distance.

    The table has ``model``, 1 for those of the linear loop and 0 for those of the diagram,
    ``real`` and ``imaginary``.
    """
    note = "of the linear loop's from the diagram's, without dry friction"
    still = smooth(loop)
    if max(one.growth_rate() for one in linear_loops(still)) > NEUTRAL:
        return _no_poles("unstable")
    diagram, period = make_hybrid_diagram(still), still.controller.period
    context = settled(diagram, still.distance / still.task.speed + _SETTLED)
    if diagram.GetOutputPort("mode").Eval(context)[0] != CONTACT:
        return _no_poles("no contact")
    found = to_control(diagram, at=context, period=period, whole=True).poles()
    q = diagram.GetOutputPort("encoders").Eval(context)[: still.ARM.num_joints]
    model = linear_loop(still, "contact", CONTACT, still.ARM.endpoint(q))
    expected = np.linalg.eigvals(model.period_map())
    apart = max(float(np.abs(found - pole).min()) for pole in expected)
    both = np.concatenate([expected, found])
    table = {
        "model": np.repeat([1.0, 0.0], [len(expected), len(found)]),
        "real": both.real,
        "imaginary": both.imag,
    }
    return table, Metric(value=apart, unit="", note=note)


def _no_poles(note: str) -> tuple[Table, Metric]:
    none = {name: np.zeros(0) for name in ("model", "real", "imaginary")}
    return none, Metric(value=None, unit="", note=note)


CASES: Final[tuple[tuple[Elbow, LawKind], ...]] = (
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
    """Parameters of the planar loop's stability, and the grid over its workspace.

    The laws are compared with the same gains.
    """

    controller: HybridGains = HybridGains(**_gains(_PLANAR.controller))  # type: ignore[arg-type]
    late: HybridGains = HybridGains(**_gains(LATE_GAINS))  # type: ignore[arg-type]
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
        """The compared gains."""
        elbow, law = CASES[0]
        return {"chapter 2": self.loop(elbow, law), "late": self.loop(elbow, law, self.late)}

    def loop(
        self, elbow: Elbow, law: LawKind, controller: HybridGains | None = None
    ) -> PlanarLoop:
        """Return the planar loop with an elbow, a law and gains, or its own; all filled in."""
        friction = replace(_PLANAR.arm.joint_friction, viscous=self.viscous)
        gains = _gains(controller or self.controller)
        loop = replace(
            _PLANAR,
            arm=replace(_PLANAR.arm, elbow=elbow, joint_friction=friction),
            controller=replace(_PLANAR.controller, law=law, **gains),  # type: ignore[arg-type]
            task=replace(_PLANAR.task, start=self.start, direction=self.direction),
        )
        return fill(loop)


HYBRID_STABILITY: Final = HybridStabilityScenario()


def run_stability(scenario: HybridStabilityScenario, seed: int, progress: Progress) -> Outcome:
    """Map the least eigenvalue of ``M^-1 J^-1 P J`` (and its kin) and the loop's growth."""
    grid = np.linspace(-scenario.reach, scenario.reach, scenario.points)
    rows: list[tuple[float, ...]] = []
    metrics: dict[str, Metric] = {}
    for i, (elbow, law) in enumerate(CASES):
        loop = scenario.loop(elbow, law)
        crucible, period = loop.make_surface(), loop.controller.period
        measured = _Loop(loop)
        unstable: list[bool] = []  # of the points in reach
        inside: list[bool] = []  # of the crucible
        for j, y in enumerate(grid.tolist()):
            progress((i + j / len(grid)) / len(CASES), f"{law}, {elbow} elbow")
            for x in grid.tolist():
                least, growth = measured.stability((x, y))
                rows.append((i, x, y, least, growth))
                if math.isfinite(least):
                    unstable.append(least < 0)
                    inside.append(locate(crucible, np.array([x, y, 0.0])).gap >= 0)
        nominal = tuple(loop.touching.tolist())
        least, growth = measured.stability(nominal)
        _, sampled = measured.stability(nominal, period)
        share = 100 * sum(unstable) / max(1, len(unstable))
        share_inside = (
            100 * sum(map(all, zip(unstable, inside, strict=True))) / max(1, sum(inside))
        )
        in_time, held = "in continuous time", f"with the torque held over {period:g} s"
        for what, value, unit, note in (
            ("unstable_share", share, "%", "of the reachable grid"),
            ("unstable_share_in_crucible", share_inside, "%", "of the grid in the crucible"),
            ("eigenvalue", least, "1/(kg m^2)", f"the least one at {nominal}, per unit of gain"),
            ("growth", _clipped(growth), "1/s", f"of the loop at {nominal}, {in_time}"),
            ("sampled_growth", _clipped(sampled), "1/s", f"the same {held}"),
        ):
            metrics[f"{elbow}.{law}.{what}"] = Metric(value=value, unit=unit, note=note)
        metrics |= margin_metrics(f"{elbow}.{law}", loop)
    sets = scenario.gain_sets
    metrics |= margin_metrics("late", sets["late"])
    drawn, metrics["pole_difference"] = poles(sets["chapter 2"])
    return Outcome(
        metrics=metrics,
        traces=_table(("case", "x", "y", "least", "growth"), rows),
        simulated_seconds=0.0,
        tables={**margin_tables(sets), "poles": drawn},
    )


class _Loop:
    """A loop with all quantities that do not depend on the pose."""

    def __init__(self, loop: PlanarLoop) -> None:
        self._loop = loop
        self._dynamics = loop.dynamics()
        self._selection = position_selection(loop.direction)
        self._viscous = np.array(loop.arm.joint_friction.viscous)

    def stability(
        self, endpoint: tuple[float, ...], period: float = _CONTINUOUS
    ) -> tuple[float, float]:
        """Return the least eigenvalue, to rounding, and the growth with a period, s, 1/s.

        Both are NaN out of reach.
        """
        loop = self._loop
        try:
            q = loop.joint_positions(np.array(endpoint))
        except ParameterError:
            return math.nan, math.nan
        mass = self._dynamics.evaluate(q, np.zeros(len(q))).mass
        J = loop.ARM.jacobian(q)
        values = stiffness_eigenvalues(mass, J, self._selection, loop.controller.law).real
        least = float(values.min())
        if abs(least) < _ROUNDING * float(np.abs(values).max()):
            least = 0.0
        control = replace(loop.controller, period=period)
        return least, free_growth_rate(mass, J, self._selection, control, self._viscous)


def resolve_hybrid_stability(scenario: HybridStabilityScenario) -> HybridStabilityScenario:
    """Return the scenario with its open fields filled in, and checked."""
    with within("late"):
        scenario.late.for_joints(_PLANAR.ARM.num_joints)
    try:
        for case in CASES:
            linear_loops(scenario.loop(*case))  # checks that start and contact are reached
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


_STABLE = "#dfe7f2"
_SETS = ("#1b4f9c", "#e07b00")


def plot_stability(loop: PlanarLoop, cases: Sequence[tuple[str, str]], outcome: Outcome) -> Figure:
    """Draw a map for each elbow and law: blue where stable, shaded by growth where not."""
    traces = outcome.traces
    size = round(np.sqrt(len(traces["x"]) / len(cases)))
    shares = (outcome.metrics[f"{'.'.join(one)}.unstable_share"].value or 0.0 for one in cases)
    figure = new_figure(
        height=7.0,
        caption=f"{sum(share > 0 for share in shares)} of {len(cases)} cases have unstable places "
        "in the workspace (dark: fast growth; light blue: stable). Circle: the crucible; dot: "
        "where the arm touches it.",
    )
    figure.set_layout_engine("compressed")  # for panels of equal scale
    panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    growth = traces["growth"]
    unstable = growth[np.isfinite(growth) & (growth > NEUTRAL)]
    norm = LogNorm(max(1.0, float(unstable.min(initial=1.0))), float(unstable.max(initial=100.0)))
    drawn = None
    for i, (axes, (elbow, law)) in enumerate(zip(panels, cases, strict=True)):
        of = traces["case"] == i
        x, y = traces["x"][of].reshape(size, size), traces["y"][of].reshape(size, size)
        rate = growth[of].reshape(size, size)
        reached = np.where(np.isfinite(rate), 1.0, np.nan)
        stable = ListedColormap([_STABLE])
        axes.pcolormesh(x, y, reached, cmap=stable, shading="nearest", rasterized=True)
        shown = np.where(rate > NEUTRAL, rate, np.nan)
        drawn = axes.pcolormesh(
            x, y, shown, cmap="inferno_r", norm=norm, shading="nearest", rasterized=True
        )
        axes.add_patch(Circle((1.0, -0.75), 0.75, fill=False, **DESIRED))
        axes.plot(*loop.touching, "o", mfc="white", mec="black", ms=7)
        share = outcome.metrics[f"{elbow}.{law}.unstable_share"].value
        title = f"{law}, {elbow} elbow: {share:.3g} % unstable"
        dress(axes, title=title, x="x / m" if i > 1 else "", y="" if i % 2 else "y / m")
        axes.set_aspect("equal")
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=panels.tolist(), shrink=0.6)
        bar.set_label("growth out of contact (blue: stable) / (1/s)", fontsize=9)
        bar.ax.tick_params(labelsize=8)
    return figure


def plot_margins(sets: Mapping[str, PlanarLoop], outcome: Outcome) -> Figure:
    """Draw growth by the torque's delay and by the force integral, and poles in contact."""
    table, late = outcome.tables["delays"], "growth_one_sample_late"
    found = {
        name.removesuffix(f".{late}"): one.value
        for name, one in outcome.metrics.items()
        if name.endswith(late)
    }
    unstable = sum((one or 0.0) > 0 for one in found.values())
    figure = new_figure(
        height=8.5,
        caption=f"{unstable} of {len(found)} loops are unstable with the torque one sample late. "
        "Growth over the delay (a) and the gain of the force integral (b); poles in contact (c).",
    )
    panels = figure.subplot_mosaic("dd;ip", height_ratios=(1, 1.3))
    delay, integral, plane = (panels[name] for name in "dip")
    for i, (name, loop) in enumerate(sets.items()):
        control = loop.controller
        gains = f"Kp {control.stiffness:g}, Ki {control.integral:g}, Kd {control.damping:g}"
        for j, mode in enumerate(MODES.values()):
            of = (table["gains"] == i) & (table["mode"] == j)
            style: Style = {"color": _SETS[i], "linestyle": ("-", "--", ":")[j], "linewidth": 1.6}
            delay.plot(
                1e3 * table["delay"][of], table["growth"][of], label=f"{name}, {mode}", **style
            )
        of = outcome.tables["force_integrals"]["gains"] == i
        integral.plot(
            outcome.tables["force_integrals"]["force_integral"][of],
            outcome.tables["force_integrals"]["growth"][of],
            label=f"{name}: {gains}",
            color=_SETS[i],
        )
        integral.axvline(control.force_integral, color=_SETS[i], linestyle=":", linewidth=1.0)
    period = next(iter(sets.values())).controller.period
    delay.axvline(1e3 * period, **LIMIT)
    delay.annotate(
        "one sample", (1.02e3 * period, 0.93), xycoords=("data", "axes fraction"), **NOTE
    )
    dress(delay, title="(a) Growth with a delayed torque", x="delay / ms", y="growth / (1/s)")
    delay.set_ylim(top=1.1 * max(1.0, float(table["growth"].max())))
    legend(delay, ncols=3)
    dress(
        integral,
        title="(b) Growth in contact by force integral (dotted: the gain used)",
        x="force integral / (1/s)",
        y="growth / (1/s)",
    )
    legend(integral)
    drawn = outcome.tables["poles"]
    for model, label, marker, size in (
        (0, "differences of the diagram", "o", 8),
        (1, "model", "x", 6),
    ):
        of = drawn["model"] == model
        look: Style = {"ms": size, "mfc": "none", "color": _SETS[model], "label": label}
        plane.plot(drawn["real"][of], drawn["imaginary"][of], marker, **look)
    plane.add_patch(Circle((0.0, 0.0), 1.0, fill=False, **DESIRED))
    plane.set_aspect("equal")
    dress(plane, title="(c) Poles in contact, chapter 2", x="real part", y="imaginary part")
    legend(plane)
    return figure
