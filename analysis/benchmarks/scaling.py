"""Costs of a simulated second over joints, trials, points of contact and pixels.

Costs are of this process, the least of several rounds, and so metrics. The traces, which a seed
fixes, have the sizes alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from pydrake.systems.analysis import Simulator
from scipy.stats import linregress, t

from chamfer.analysis.drawing.figure_kit import Curve, draw_lines, metric_value
from chamfer.analysis.drawing.figure_style import FORCE, POSITION, legend, new_figure
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.diagrams.cell import alignment
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.diagrams.contact import contact_scenarios
from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_scenario import STEP, fsm_axis, resolve
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.validation import require_positive
from chamfer.systems.contact import arm_in_contact
from chamfer.systems.contact.arm_dynamics import make_chain, pose

Simulation = Callable[[float], object]  # for a time, s


@dataclass(frozen=True, kw_only=True)
class ScalingScenario:
    """The simulated time and the number of rounds of each size."""

    duration: float = 0.5  # s, simulated each time
    rounds: int = 3  # of each size, of which the least time counts

    def __post_init__(self) -> None:
        require_positive(self, "duration", "rounds")


SCALING: Final = ScalingScenario()


def _arm(arm: Arm, points: int) -> Simulation:
    """Return an arm without torque: it falls freely, or with points of its tip on a plane."""
    n = arm.num_joints
    q, still = np.full(n, 0.3), (0.0,) * n
    height = float(pose(make_chain(arm), q).p_WE[2]) if points else -100.0
    plane, contact = RippledPlane(point=(0.0, 0.0, height)), arm_in_contact.ContactParams()
    places = [(1e-4 * i, 0.0, 0.0) for i in range(max(1, points))]
    tip = tuple(arm_in_contact.ContactPoint(place, plane, contact) for place in places)
    friction = JointFrictionParams(coulomb=still, viscous=still)
    params = arm_in_contact.ArmInContactParams(joint_friction=friction)
    block = arm_in_contact.ArmInContact(arm, (arm_in_contact.Scene(tip),), params, q)
    simulator = Simulator(block)
    block.GetInputPort("torque").FixValue(simulator.get_mutable_context(), np.zeros(n))
    return lambda time: simulator.AdvanceTo(time)


def _servo(trials: int) -> Simulation:
    loop = resolve(STEP)
    axes, step = [fsm_axis(loop, "position")] * trials, loop.fsm.period
    return lambda time: run_fsm_trials(loop, "position", duration=time, step=step, axes=axes)


def _cameras(pixels: int) -> Simulation:
    """Return the cell's loop with two cameras that have the same view in so many pixels."""
    width, paper = round((4 * pixels / 3) ** 0.5), CameraSettings()
    size = paper.pixel_size * paper.width / width
    cameras = CameraSettings(width=width, height=3 * width // 4, pixel_size=size)
    scenario = AlignmentScenario(cameras=cameras, begin=cameras.frames.period)
    diagram = alignment.make_alignment_diagram(alignment.resolve(scenario))
    simulator = Simulator(diagram)
    return lambda time: simulator.AdvanceTo(time)


class _Panel(NamedTuple):
    title: str
    sizes: tuple[int, ...]
    make: Callable[[int], Simulation]


_LOOPS: Final = ("PLANAR_SLIDE", "PUMA_ROLLER_MOTION", "ADEPT_ROLLER_MOTION")
_ARMS: Final = (*(getattr(contact_scenarios, one).ARM for one in _LOOPS), ADEPT_WRIST)
_BY_JOINTS: Final[dict[int, Arm]] = {arm.num_joints: arm for arm in _ARMS}
_PANELS: Final = {
    "joints": _Panel("an arm that falls", (*_BY_JOINTS,), lambda n: _arm(_BY_JOINTS[n], 0)),
    "trials": _Panel("servo loops, compiled", (1000, 3000, 10_000, 30_000), _servo),
    "points of contact": _Panel(
        "the Puma on a plane", (1, 2, 4, 8, 16), lambda n: _arm(_ARMS[1], n)
    ),
    "pixels": _Panel("the cell's two cameras", (19_200, 76_800, 307_200, 1_228_800), _cameras),
}


def run(scenario: ScalingScenario, seed: int, progress: Progress) -> Outcome:
    """Time each size, and fit a power of the size to the costs."""
    metrics: dict[str, Metric] = {}
    for i, (over, panel) in enumerate(_PANELS.items()):
        name = over.partition(" ")[0]
        costs = [_cost(panel.make, size, scenario) for size in panel.sizes]
        fit = linregress(np.log(panel.sizes), np.log(costs))
        half = t.ppf(0.975, len(costs) - 2) * fit.stderr
        for what, cost in zip(panel.sizes, costs, strict=True):
            metrics[f"{name}.{what}.cost"] = Metric(value=cost, unit="s")
        note = f"+- {half:.2f}, the 95 % interval"
        metrics[f"{name}.cost_slope"] = Metric(value=float(fit.slope), unit="", note=note)
        progress((i + 1) / len(_PANELS), over)
    sizes = np.concatenate([panel.sizes for panel in _PANELS.values()])
    seconds = len(sizes) * (scenario.rounds + 1) * scenario.duration
    return Outcome(metrics=metrics, traces={"size": sizes}, simulated_seconds=seconds)


def _cost(make: Callable[[int], Simulation], size: int, scenario: ScalingScenario) -> float:
    """Return the time of a simulated second, s, after compilation."""
    spent = []
    for _ in range(scenario.rounds + 1):
        simulation, began = make(size), process_time()
        simulation(scenario.duration)
        spent.append(process_time() - began)
    return min(spent[1:]) / scenario.duration


def figures(scenario: ScalingScenario, outcome: Outcome) -> dict[str, Figure]:
    """Draw the costs and the fitted powers."""
    caption = (
        "Time of a simulated second over four sizes, on logarithmic axes. The line is the fitted "
        "power of the size."
    )
    figure = new_figure(8.0, 6.2, caption=caption)
    grid, metrics = figure.subplots(2, 2, sharey=True), outcome.metrics
    for axes, (over, (title, sizes, _)) in zip(grid.flat, _PANELS.items(), strict=True):
        name = over.partition(" ")[0]
        slope, note = (
            metric_value(metrics, f"{name}.cost_slope"),
            metrics[f"{name}.cost_slope"].note,
        )
        costs = [metric_value(metrics, f"{name}.{size}.cost") for size in sizes]
        x, y = np.log(sizes), np.log(costs)
        power = np.exp(y.mean() + slope * (x - x.mean()))
        measured = Curve(costs, "measured", {**POSITION, "marker": "o", "linestyle": ""})
        fit = Curve(power, f"slope {slope:.2f} {note.partition(',')[0]}", FORCE)
        y_label, lines = "time of a simulated second / s", [measured, fit]
        claim = f"{title[0].upper()}{title[1:]}: power {slope:.2f}"
        draw_lines(axes, sizes, lines, title=claim, y=y_label, over=over, log=True)
        legend(axes, ncols=2)
        axes.set_xticks(sizes, [f"{size:,}" for size in sizes])
        axes.set_xticks([], minor=True)
    return {"scaling": figure}
