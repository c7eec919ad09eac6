"""What a simulated second costs, over joints, trials, points of contact and pixels.

Costs are of the process, the least of some rounds. They are of this machine, so the traces, which
a seed fixes, have the sizes alone.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from scipy.stats import linregress, t

from chamfer.analysis.drawing.figure_kit import Curve, draw_lines, metric_value
from chamfer.analysis.drawing.figure_style import FORCE, POSITION, new_figure
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.diagrams.cell.alignment import make_alignment_diagram
from chamfer.diagrams.cell.alignment import resolve as resolve_alignment
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_ROLLER_MOTION,
    PLANAR_SLIDE,
    PUMA_ROLLER_MOTION,
)
from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_scenario import STEP, fsm_axis
from chamfer.diagrams.servo.servo_scenario import resolve as resolve_servo
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.contact.arm_dynamics import make_chain, pose
from chamfer.systems.contact.arm_in_contact import (
    ArmInContact,
    ArmInContactParams,
    ContactParams,
    ContactPoint,
    Scene,
)

_ARMS: Final = {
    arm.num_joints: arm
    for arm in (PLANAR_SLIDE.ARM, PUMA_ROLLER_MOTION.ARM, ADEPT_ROLLER_MOTION.ARM, ADEPT_WRIST)
}
_TITLES: Final[Mapping[str, tuple[str, str]]] = {  # of the panels, and what is along them
    "joints": ("an arm that falls", "joints"),
    "trials": ("servo loops, compiled", "trials"),
    "points": ("the Puma on a plane", "points of contact"),
    "pixels": ("the cell with its two cameras", "pixels"),
}


@dataclass(frozen=True, kw_only=True)
class ScalingScenario:
    """How large simulations are made, and how long each of them runs."""

    joints: tuple[int, ...] = (2, 3, 4, 7)  # of arms: two links, Puma, Adept, Adept with its wrist
    trials: tuple[int, ...] = (1000, 3000, 10_000, 30_000)  # of the FSM loop, in one batch
    points: tuple[int, ...] = (1, 2, 4, 8, 16)  # of an arm's tip, that touch
    widths: tuple[int, ...] = (160, 320, 640, 1280)  # pixels, of images whose height is 3/4 of it
    duration: float = 0.5  # s, simulated each time
    rounds: int = 3  # of which the least counts

    def __post_init__(self) -> None:
        require_positive(self, "duration")
        for name in ("joints", "trials", "points", "widths"):
            value = getattr(self, name)
            if len(set(value)) < 3 or len(set(value)) < len(value) or min(value) < 1:
                raise ParameterError(name, value, "at least three numbers from 1, each once")
        if not set(self.joints) <= set(_ARMS):
            raise ParameterError("joints", self.joints, f"of {tuple(_ARMS)}")
        if self.rounds < 1:
            raise ParameterError("rounds", self.rounds, "at least 1")


SCALING: Final = ScalingScenario()


def run(scenario: ScalingScenario, seed: int, progress: Progress) -> Outcome:
    """Time each size, and fit a power of the size to the costs."""
    make: dict[str, tuple[tuple[int, ...], Callable[[int], Callable[[float], object]]]] = {
        "joints": (scenario.joints, lambda n: _arm(_ARMS[n], 0)),
        "trials": (scenario.trials, partial(_servo, seed=seed)),
        "points": (scenario.points, lambda n: _arm(PUMA_ROLLER_MOTION.ARM, n)),
        "pixels": (scenario.widths, _cameras),
    }
    metrics: dict[str, Metric] = {}
    rows: list[tuple[str, int]] = []
    for i, (panel, (numbers, made)) in enumerate(make.items()):
        sizes = [3 * n * n // 4 if panel == "pixels" else n for n in numbers]
        costs = []
        for number, size in zip(numbers, sizes, strict=True):
            costs.append(_cost(made, number, scenario))
            metrics[f"{panel}.{size}.cost"] = Metric(value=costs[-1], unit="s")
            progress((i + len(costs) / len(numbers)) / len(make), panel)
        fit = linregress(np.log(sizes), np.log(costs))
        half = float(t.ppf(0.975, len(sizes) - 2) * fit.stderr)
        metrics[f"{panel}.cost_slope"] = Metric(value=float(fit.slope), unit="")
        note = "half of the 95 % interval"
        metrics[f"{panel}.cost_slope_error"] = Metric(value=half, unit="", note=note)
        rows += [(panel, size) for size in sizes]
    traces = {
        "panel": np.array([panel for panel, _ in rows]),
        "size": np.array([size for _, size in rows]),
    }
    seconds = len(rows) * (scenario.rounds + 1) * scenario.duration
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=seconds)


def _cost(
    make: Callable[[int], Callable[[float], object]], number: int, scenario: ScalingScenario
) -> float:
    """Return the time of a simulated second, s; what compiles has then compiled."""
    spent = []
    for _ in range(scenario.rounds + 1):
        simulation = make(number)
        began = process_time()
        simulation(scenario.duration)
        spent.append(process_time() - began)
    return min(spent[1:]) / scenario.duration


def _arm(arm: Arm, points: int) -> Callable[[float], object]:
    """Return an arm without torque: it falls freely, or with points of its tip on a plane."""
    n = arm.num_joints
    q, still = np.full(n, 0.3), (0.0,) * n
    tip: NDArray[np.float64] = pose(make_chain(arm), q).p_WE
    plane = RippledPlane(point=(0.0, 0.0, float(tip[2]) if points else -100.0))
    touching = (
        ContactPoint((1e-4 * i, 0.0, 0.0), plane, ContactParams()) for i in range(max(1, points))
    )
    friction = JointFrictionParams(coulomb=still, viscous=still)
    builder = DiagramBuilder()
    params = ArmInContactParams(joint_friction=friction)
    block = builder.AddSystem(ArmInContact(arm, (Scene(tuple(touching)),), params, q))
    torque = builder.AddSystem(ConstantVectorSource(np.zeros(n)))
    builder.Connect(torque.get_output_port(), block.GetInputPort("torque"))
    builder.ExportOutput(block.GetOutputPort("encoders"), "encoders")
    diagram = builder.Build()
    return lambda time: simulate(diagram, duration=time, step=params.period)


def _servo(trials: int, *, seed: int) -> Callable[[float], object]:
    scenario = resolve_servo(STEP)
    axes, step = [fsm_axis(scenario, "position")] * trials, scenario.fsm.period
    return lambda time: run_fsm_trials(
        scenario, "position", duration=time, step=step, axes=axes, seed=seed
    )


def _cameras(width: int) -> Callable[[float], object]:
    """Return the cell's loop with two cameras that see the same in more pixels."""
    pixel = CameraSettings().pixel_size * CameraSettings().width / width
    cameras = CameraSettings(width=width, height=3 * width // 4, pixel_size=pixel)
    scenario = AlignmentScenario(cameras=cameras, begin=cameras.frames.period)
    diagram = make_alignment_diagram(resolve_alignment(scenario))
    return lambda time: simulate(diagram, duration=time, step=cameras.frames.period)


def figures(scenario: ScalingScenario, outcome: Outcome) -> dict[str, Figure]:
    """Draw the costs and the powers that fit them."""
    figure = new_figure(10, 7)
    grid = figure.subplots(2, 2, sharey=True)
    for axes, (panel, (title, over)) in zip(grid.flat, _TITLES.items(), strict=True):
        sizes = outcome.traces["size"][outcome.traces["panel"] == panel]
        costs = [metric_value(outcome.metrics, f"{panel}.{n}.cost") for n in sizes]
        slope = metric_value(outcome.metrics, f"{panel}.cost_slope")
        half = metric_value(outcome.metrics, f"{panel}.cost_slope_error")
        x, y = np.log(sizes), np.log(costs)
        power = np.exp(y.mean() + slope * (x - x.mean()))
        draw_lines(
            axes,
            sizes,
            [
                Curve(costs, "measured", {**POSITION, "marker": "o", "linestyle": ""}),
                Curve(power, f"slope {slope:.2f} +- {half:.2f}", FORCE),
            ],
            title=title,
            y="time of a simulated second / s",
            over=over,
            log=True,
            key="best",
        )
        axes.set_xticks(sizes, [f"{n:,}" for n in sizes])
        axes.set_xticks([], minor=True)
    return {"scaling": figure}
