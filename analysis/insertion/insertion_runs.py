"""One insertion of a sprung peg: simulated, measured, and predicted."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, EventStatus
from scipy.ndimage import median_filter

from chamfer.analysis.campaign.trial_metrics import metrics_of, prefixed
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Progress, Table
from chamfer.diagrams.insertion.peg_insertion import (
    JOINTS,
    PegInsertionScenario,
    make_peg_insertion_diagram,
)
from chamfer.models.peg.peg_and_hole import SEATED, PegAndHole
from chamfer.models.peg_theory import insertion_statics as simple
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.wedging import sits_on_edge, sliding_bounds, two_point_onset, wedges
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES, ContactState

Array = NDArray[np.float64]

WINDOW: Final = 0.01  # s, of the medians of forces
_MOVED: Final = 1e-4  # m, by which a peg that is held has not come out
_PULL: Final = 0.01  # of the cap, the least pull that says that a peg is held
_TOUCHING: Final = 0.01  # N
_DEPTHS: Final = 1001  # at which forces are predicted
_MOUTH, _TIP, _BOTTOM = (FEATURES.index(name) for name in ("mouth", "tip", "bottom"))


class Insertion(NamedTuple):
    """A finished run; one row per step."""

    time: Array  # s, shape (n,)
    depth: Array  # m, of the tip below the mouth
    push: Array  # N, of the feed on the peg
    wrench: Array  # N m above N, of the hole on the peg about the mouth's middle, shape (n, 6)
    normal: Array  # N, by feature, shape (n, 5)
    sides: Array  # rad, of mouth, tip and chamfer, shape (n, 3)
    state: Array  # of ContactState
    joints: Array  # positions above velocities, shape (n, 10)
    power: Array  # W, of feed and springs on the peg
    loss: Array  # W, that the contacts take

    @property
    def axial(self) -> Array:
        """Force of the hole against the insertion, N."""
        return -self.wrench[:, 3]

    @property
    def lateral(self) -> Array:
        """Force of the hole across, N, shape (n, 2)."""
        return self.wrench[:, 4:]

    @property
    def two_point(self) -> NDArray[np.bool_]:
        """When mouth and tip touch on opposite sides."""
        touch = (self.normal[:, _MOUTH] > _TOUCHING) & (self.normal[:, _TIP] > _TOUCHING)
        opposite: NDArray[np.bool_] = np.cos(self.sides[:, 0] - self.sides[:, 1]) < 0
        return touch & opposite

    @property
    def tilt(self) -> Array:
        """Of the peg in the plane of its errors, rad."""
        return -self.joints[:, JOINTS.index("rz")]


def insert(
    scenario: PegInsertionScenario, progress: Progress | None = None, *, withdraw: bool = True
) -> Insertion:
    """Feed the peg until it is as deep as commanded, or else take the push away again.

    Without ``withdraw`` the run ends where the push would be taken away.
    """
    diagram = make_peg_insertion_diagram(scenario)
    depth, normal = (diagram.GetOutputPort(name) for name in ("depth", "normal_forces"))

    def ended(root: Context) -> bool:
        context = diagram.GetMyContextFromRoot(root)
        if float(depth.Eval(context)[0]) >= scenario.depth:
            return True
        return float(normal.Eval(context)[_BOTTOM]) > SEATED * scenario.force_cap

    end = scenario.duration if withdraw else scenario.released
    run = simulate(diagram, duration=end, step=scenario.step, progress=progress, ended=ended)
    return _insertion(run.time, run.outputs)


def insert_by_cenic(scenario: PegInsertionScenario, accuracy: float) -> Insertion:
    """Feed the peg with steps that CENIC chooses for an accuracy.

    Drake computes the contact forces that it then reports once more, by the law of its other
    integrators: they are close to those that CENIC applies, not the same.
    """
    diagram = make_peg_insertion_diagram(scenario, continuous=True)
    ports = [diagram.get_output_port(i) for i in range(diagram.num_output_ports())]
    time: list[float] = []
    rows: list[list[Array]] = []

    def record(context: Context) -> EventStatus:
        time.append(context.get_time())
        rows.append([port.Eval(context).copy() for port in ports])
        return EventStatus.DidNothing()

    simulator = Simulator(diagram)
    config = SimulatorConfig(
        integration_scheme="cenic",
        max_step_size=scenario.step,
        accuracy=accuracy,
        use_error_control=True,
    )
    ApplySimulatorConfig(config, simulator)
    simulator.set_monitor(record)
    simulator.Initialize()
    depth = [port.get_name() for port in ports].index("depth")
    slices = math.ceil(scenario.released / WINDOW)
    for k in range(slices):
        simulator.AdvanceTo(scenario.released * (k + 1) / slices)
        if rows[-1][depth][0] >= scenario.depth:
            break
    outputs = {}
    for i, port in enumerate(ports):
        values = np.array([row[i] for row in rows])
        outputs[port.get_name()] = values[:, 0] if port.size() == 1 else values
    return _insertion(np.array(time), outputs)


def _insertion(time: Array, outputs: Mapping[str, Array]) -> Insertion:
    rates = outputs["joints"][:, len(JOINTS) :]
    return Insertion(
        time=time,
        depth=outputs["depth"],
        push=outputs["drives"][:, 0],
        wrench=outputs["wrench"],
        normal=outputs["normal_forces"],
        sides=outputs["sides"],
        state=outputs["state"],
        joints=outputs["joints"],
        power=np.sum(outputs["drives"] * rates, axis=1),
        loss=outputs["loss"],
    )


def median(values: Array, step: float) -> Array:
    """Return medians over 10 ms around each value, shape (n,)."""
    size = max(1, round(WINDOW / step))
    filtered: Array = median_filter(values, size, mode="nearest")
    return filtered


def onset_of(parts: PegAndHole, depth: Array, two_point: NDArray[np.bool_]) -> float:
    """Return l, m, where two points touch first; NaN if they never do."""
    first = np.flatnonzero(two_point)
    return float(depth[first[0]]) - parts.chamfer_height if first.size else math.nan


def measure(scenario: PegInsertionScenario, run: Insertion) -> dict[str, Metric]:
    """Return the results of the run, and those of the statics."""
    fed = run.time <= scenario.released + scenario.step / 2
    pushed = fed & np.logical_and.accumulate(run.normal[:, _BOTTOM] <= _TOUCHING)
    axial = median(run.axial, scenario.step)
    across = np.hypot(*(median(one, scenario.step) for one in run.lateral.T))
    onset = onset_of(scenario.parts, run.depth, run.two_point & fed)
    until_bottom = "" if pushed[fed].all() else ", before the bottom"
    cap = f"at a cap of {scenario.force_cap:g} N"
    seated = is_seated(scenario, run)
    enough = f"1: at least {100 * SEATED:g} % of the commanded depth, or on the bottom"
    pulled, left = "that pulls it out", "of the forces at mouth and tip, left without the push"
    if seated:
        pulled = left = "it is in"
    held, pull, kept = (False, math.nan, math.nan) if seated else _taken_away(scenario, run)
    stopped = not seated and run.state[fed][-1] not in (ContactState.NONE, ContactState.FACE)
    work, lost = (float(np.sum(one[fed]) * scenario.step) for one in (run.power, run.loss))
    median_of, never = "largest median of 10 ms", "two points never touch"
    measured = metrics_of(
        {
            "seated": (float(seated), "", enough),
            "depth": (float(run.depth[fed].max()), "m", "of the tip"),
            "force.axial": (float(axial[pushed].max()), "N", median_of + until_bottom),
            "force.lateral": (float(across[pushed].max()), "N", median_of),
            "force.raw_peak": (float(run.axial[pushed].max()), "N", "along the axis, of one step"),
            "two_point.onset": (onset, "m", "l" if math.isfinite(onset) else never),
            "wedged": (
                float(stopped and held),
                "",
                f"1: stopped {cap}, and held when the push is removed",
            ),
            "jammed": (float(stopped and not held), "", f"1: stopped {cap}, free without it"),
            "missed": (float(not seated and not stopped), "", "1: beside the mouth"),
            "pull_out.force": (pull, "N", pulled),
            "squeeze.kept": (kept, "%", left),
            "energy.work": (work, "J", "of feed and springs on the peg"),
            "energy.dissipated": (lost, "J", "in the contacts"),
        }
    )
    return measured | predict(scenario)


def is_seated(scenario: PegInsertionScenario, run: Insertion) -> bool:
    """Whether the peg got deep enough, or to the bottom, while it was fed."""
    fed = run.time <= scenario.released + scenario.step / 2
    return bool((run.state[fed] == ContactState.SEATED).any())


def _taken_away(scenario: PegInsertionScenario, run: Insertion) -> tuple[bool, float, float]:
    """Return what a stopped peg does as the push is taken away, if the run goes on so long.

    Whether it is held, N that pull it out, and % of the normal forces at mouth and tip that are
    left without the push.
    """
    after = np.flatnonzero(run.time > scenario.released)
    free = after[run.push[after] <= 0]
    if not free.size:
        return False, math.nan, math.nan
    come_out = run.depth[after[0]] - run.depth[free[0]]
    pull = float(-median(run.push, scenario.step)[after].min())
    squeeze = run.normal[:, [_MOUTH, _TIP]].sum(axis=1)
    kept = 100 * float(squeeze[free[0]] / squeeze[after[0]]) if squeeze[after[0]] > 0 else 0.0
    held = come_out < _MOVED and pull > _PULL * scenario.force_cap
    return bool(held), max(pull, 0.0), kept


def path(scenario: PegInsertionScenario) -> Table:
    """Return the statics over the depth l, exact and in the simple form.

    Forces are NaN where no push slides the peg, and the simple one above the bore.
    """
    parts, support, errors = scenario.parts, scenario.support, _errors(scenario)
    end = scenario.depth - parts.chamfer_height
    above = float(simple.chamfer_depth(parts, scenario.lateral)) + 2 * parts.clearance
    depth = np.linspace(-above, max(end, 0.0), _DEPTHS)
    found = equilibrium(parts, support, *errors, depth)
    in_bore = simple.bore_contact(parts, support, *errors, np.maximum(depth, 0.0))
    return {
        "depth": depth,
        "axial": np.where(np.isinf(found.insertion_force), np.nan, found.insertion_force),
        "lateral": found.lateral_force,
        "tilt": found.tilt,
        "tip": found.tip,
        "contact": found.contact.astype(np.float64),
        "simple": np.where(depth >= 0, in_bore.insertion_force, np.nan),
    }


def predict(scenario: PegInsertionScenario) -> dict[str, Metric]:
    """Return the predictions of the exact statics and of Whitney's simple forms."""
    parts, support, errors = scenario.parts, scenario.support, _errors(scenario)
    of = path(scenario)
    onset = float(two_point_onset(parts, support, *errors))
    lower, upper = sliding_bounds(parts, support, scenario.lateral)
    slides = bool(lower < scenario.tilt < upper) or not onset < of["depth"][-1]
    on_chamfer = abs(scenario.lateral) < parts.chamfer_limit
    enters = on_chamfer and not np.isnan(of["axial"]).any()
    peak = float(np.nanmax(of["axial"])) if slides and enters else math.inf
    never = "two points never touch"
    simple_onset = float(simple.two_point_onset(parts, support, *errors))
    reason = "" if slides else "no push slides it past the onset"
    if not on_chamfer or (slides and not enters):
        reason = "it does not enter"
    across = None if reason else float(np.nanmax(np.abs(of["lateral"])))
    holds = "1: two points that touch can hold the peg against any force"
    tilted = "1: a tilted rim may sit on the bore's edge, off the plane of the errors"
    l_of, simple_l = ("l" if math.isfinite(one) else never for one in (onset, simple_onset))
    said = {
        "seated": (float(peak <= scenario.force_cap), "", reason or "peak below the cap"),
        "force.axial": (None if reason else peak, "N", reason or "exact statics"),
        "force.lateral": (across, "N", reason or "exact statics"),
        "two_point.onset": (onset, "m", l_of),
        "may_wedge": (float(wedges(parts, support, *errors)), "", holds),
        "may_sit_on_edge": (float(sits_on_edge(parts, *errors)), "", tilted),
        "slides": (float(slides), "", "1: a push slides it at any depth"),
        "simple.force.axial": (float(np.nanmax(of["simple"])), "N", "Whitney's form, in the bore"),
        "simple.two_point.onset": (simple_onset, "m", simple_l),
    }
    return prefixed("predicted", metrics_of(said))


def _errors(scenario: PegInsertionScenario) -> tuple[float, float]:
    return scenario.lateral, scenario.tilt


def jamming_loads(
    parts: PegAndHole, run: Mapping[str, Array], step: float
) -> tuple[Array, Array, Array, Array]:
    """Return l, the push, F_x / F_z and M / (r F_z) of the peg's support, at every step.

    It is what the hole does to the peg, reversed, as 10 ms medians; the moment is about the middle
    between the tip's corners. A run has, in the plane of the errors, ``depth``, ``lateral`` and
    ``tilt`` of the tip, and ``force_x``, ``across`` and ``turning`` of the hole about the mouth.
    """
    height, tilt = parts.peg_chamfer.height, run["tilt"]
    down, across, turning = (-median(run[name], step) for name in ("force_x", "across", "turning"))
    x, y = run["depth"] - height * np.cos(tilt), run["lateral"] + height * np.sin(tilt)
    moment = turning - (x * across - y * down)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = across / down, moment / (parts.peg_radius * down)
    return run["depth"] - parts.chamfer_height, down, *ratios
