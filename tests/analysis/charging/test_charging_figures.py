"""The figures of a charging cycle: the modes that the run came to, with what was measured."""

import numpy as np
import pytest

from analysis.charging.charging_figures import plot_charging
from analysis.charging.charging_metrics import LIMITS
from analysis.run.experiment import Metric, Outcome
from diagrams.charging.charging_cycle import chart_of
from diagrams.charging.charging_resolve import resolve
from diagrams.charging.charging_scenario import CrucibleChargingScenario
from models.charging.packing import PlanItem

PLAN = (PlanItem(kind="wall"), PlanItem(kind="crown"), PlanItem(kind="bulk"))
VISITS = (  # item and state, a row each
    *((0, name) for name in ("acquire.descend", "scan.pass", "slew.over", "wall.slide")),
    *((0, name) for name in ("wall.lost", "wall.slide", "release.open", "retreat.up")),
    *((1, name) for name in ("acquire.descend", "acquire.lift", "crown.land", "release.open")),
)
FREE = ("wall_peak_force", "layer_peak_force", "feeder_peak_force", "layer_shift", "z")


@pytest.fixture(scope="module")
def scenario() -> CrucibleChargingScenario:
    return resolve(CrucibleChargingScenario(plan=PLAN))


@pytest.fixture(scope="module")
def names(scenario: CrucibleChargingScenario) -> tuple[str, ...]:
    return chart_of(scenario).state_names


@pytest.fixture(scope="module")
def outcome(names: tuple[str, ...]) -> Outcome:
    rows = len(VISITS)
    ramp = np.linspace(0.0, 1.0, rows)
    spaces = {f"{one}_{axis}": ramp for one in ("nugget", "desired") for axis in "xyz"}
    traces = {
        "time": 0.5 * np.arange(rows),
        "state": np.array([float(names.index(name)) for _, name in VISITS]),
        "item": np.array([float(item) for item, _ in VISITS]),
        "mode": np.array([2.0 if name == "wall.lost" else 0.0 for _, name in VISITS]),
        "held": np.ones(rows),
        **spaces,
        **dict.fromkeys(FREE, ramp),
    }
    metrics = {name: Metric(value=0.0123, unit="") for name in LIMITS}
    metrics["bulk.position_error"] = Metric(value=None, unit="m", note="no item came to it")
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=5.5)


def test_one_figure_for_each_mode_that_the_run_came_to(
    scenario: CrucibleChargingScenario, outcome: Outcome, names: tuple[str, ...]
) -> None:
    figures = plot_charging(scenario, outcome, names)
    assert list(figures) == ["acquire", "scan", "slew", "wall", "crown"]
    titles = {name: [axes.get_title("left") for axes in f.axes] for name, f in figures.items()}
    assert titles["slew"][1] == "(b) It clears the crucible by 12.3 mm"
    assert titles["acquire"][1].startswith("(b) Gripped with at most 0.0123 N")
    # The limit and the contact that was lost are drawn.
    force = figures["wall"].axes[1]
    assert 2.0 in [np.asarray(line.get_ydata())[0] for line in force.lines]
    assert len(force.collections) == 1
