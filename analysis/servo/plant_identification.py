"""Identifies the spring-mass-damper of Fig. 8: the family of plants for its response."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import root

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import Curve, ReferenceLine, draw_lines
from chamfer.analysis.drawing.figure_style import PID, PUBLISHED, new_figure
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.published.fsm_visual_servoing import OVERSHOOT, RISE_TIME
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.analysis.servo.response_metrics import StepMetrics, step_metrics
from chamfer.diagrams.servo.servo_loops import make_pid_loop
from chamfer.diagrams.servo.servo_scenario import PlantParams, StepScenario
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.servo.pid import PidParams

_STEPS = 3000  # of a run
_PAPERS_STIFFNESS = 700.0  # N/m, K_p of section 5
_SHOWN = (
    ("mass", "(a) Mass", "mass / kg"),
    ("damping", "(b) Damping", "damping / (N s/m)"),
    ("damping_ratio", "(c) Damping ratio", "damping ratio"),
)
_PERIODS = 34.0  # rise times in a run, long after the response has settled


@dataclass(frozen=True, kw_only=True)
class PlantFamily:
    """The known properties of the plants to identify."""

    stiffness: tuple[float, ...] = (400.0, 500.0, 600.0, 700.0, 800.0, 900.0, 1000.0)
    # N/m, of the plant to identify from the response

    def __post_init__(self) -> None:
        if not self.stiffness or not all(0 < k < math.inf for k in self.stiffness):
            raise ParameterError("stiffness", self.stiffness, "finite numbers > 0, at least one")


@dataclass(frozen=True, kw_only=True)
class IdentificationScenario:
    """A response, and the stiffnesses for which its plant is identified."""

    rise_time: float = RISE_TIME  # s, of the response, 10 to 90 %; Fig. 8
    overshoot: float = OVERSHOOT  # %, Fig. 8, relative to the final value
    plant: PlantFamily = field(default_factory=PlantFamily)
    pid: PidParams = field(default_factory=PidParams)

    def __post_init__(self) -> None:
        require_positive(self, "rise_time", "overshoot")


IDENTIFICATION: Final = IdentificationScenario()


def identify(
    *, rise_time: float, overshoot: float, stiffness: float, pid: PidParams
) -> PlantParams:
    """Return the plant for which the PID loop of eq. (2) has that rise time and overshoot.

    Rise time, s, and overshoot, %, as of :func:`step_metrics`, leave a one-parameter family of
    plants, of which the stiffness, N/m, is one.

    Raises:
        ParameterError: If no plant of that stiffness is found.
    """

    def plant(logs: NDArray[np.float64]) -> PlantParams:
        mass, damping = np.exp(logs).tolist()
        return PlantParams(mass=mass, damping=damping, stiffness=stiffness, form="velocity")

    def residual(logs: NDArray[np.float64]) -> list[float]:
        measured = pid_step(plant(logs), pid, rise_time)
        if measured.rise_time is None or measured.overshoot is None:
            return [1.0, 1.0]
        return [measured.rise_time / rise_time - 1, (measured.overshoot - overshoot) / 100]

    start = np.log([PlantParams().mass, PlantParams().damping])
    found = root(residual, start, tol=1e-10)
    if not found.success or np.abs(residual(found.x)).max() > 1e-6:
        raise ParameterError(
            "plant.stiffness", stiffness, "one for which a plant with this response exists"
        )
    return plant(found.x)


def pid_step(plant: PlantParams, pid: PidParams, rise_time: float) -> StepMetrics:
    """Measure the PID loop's step response over many rise times."""
    step = _PERIODS * rise_time / _STEPS
    loop = make_pid_loop(StepScenario(plant=plant, pid=pid), "velocity")
    run = simulate(loop, duration=_STEPS * step, step=step)
    return step_metrics(run.time, run.outputs["actual_trajectory"], 1.0)


def run(scenario: IdentificationScenario, seed: int, progress: Progress) -> Outcome:
    """Identify a plant for each stiffness."""
    each = scenario.plant.stiffness
    finished = run_each(partial(_identify, scenario), each, progress)
    finished.split(each, lambda stiffness: stiffness)  # none may be without a plant
    units = {"mass": "kg", "damping": "N s/m", "damping_ratio": "", "final_value": "m"}
    rows = {"stiffness": column(each)} | {name: finished.column(name) for name in units}
    metrics = {
        f"stiffness_{stiffness:g}.{name}": Metric(value=float(rows[name][i]), unit=unit)
        for i, stiffness in enumerate(each)
        for name, unit in units.items()
    }
    return Outcome(metrics=metrics, traces=rows, simulated_seconds=_PERIODS * scenario.rise_time)


def _identify(scenario: IdentificationScenario, stiffness: float) -> Row:
    rise_time, pid = scenario.rise_time, scenario.pid
    plant = identify(
        rise_time=rise_time, overshoot=scenario.overshoot, stiffness=stiffness, pid=pid
    )
    return {
        "mass": plant.mass,
        "damping": plant.damping,
        "damping_ratio": plant.damping / 2 / math.sqrt(plant.mass * stiffness),
        "final_value": pid_step(plant, pid, rise_time).final,
    }


def figures(scenario: IdentificationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    table = outcome.traces
    figure = new_figure(
        height=3.2,
        caption="Mass and damping of the plant that follow from the published rise time and "
        "overshoot, over its stiffness, which the paper gives.",
    )
    paper = ReferenceLine(_PAPERS_STIFFNESS, "the paper's stiffness", PUBLISHED, upright=True)
    for axes, (name, title, y) in zip(figure.subplots(1, 3), _SHOWN, strict=True):
        draw_lines(
            axes,
            table["stiffness"],
            [Curve(table[name], "identified", PID | {"marker": "o", "ms": 4})],
            title=title,
            y=y,
            over="stiffness / (N/m)",
            levels=[paper],
            key="below" if name == "damping" else None,
            columns=2,
        )
    return {"plant-identification": figure}
