"""The path that a cycle took, a row of the chart for each mode."""

import numpy as np
import pytest

from chamfer.analysis.charging.charging_figures import plot_path
from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario, chart_of, resolve
from chamfer.models.charging.packing import PlanItem
from chamfer.systems.charging.charging_chart import ChargingChart


@pytest.fixture(scope="module")
def chart() -> ChargingChart:
    return chart_of(resolve(CrucibleChargingScenario(plan=(PlanItem(),))))


def outcome(*steps: tuple[str, str, str], why: str = "") -> Outcome:
    source, target, label = np.array(steps).T
    table = {"time": 0.5 * np.arange(len(steps)), "source": source, "target": target}
    metrics = {
        "cycle.laid": Metric(value=0, unit="", note=why),
        "cycle.time": Metric(value=5.5, unit="s"),
    }
    return Outcome(
        metrics=metrics,
        traces={},
        simulated_seconds=5.5,
        tables={"transitions": table | {"label": label}},
    )


HOMED = (
    ("home.out", "home.settle", "there"),
    ("home.settle", "acquire.above", "homed"),
)


def shown(chart: ChargingChart, result: Outcome) -> dict[str, tuple[float, float]]:
    """Return where each text stands, by its words without spaces."""
    texts = plot_path(chart, result).axes[0].texts
    return {
        "".join(text.get_text().replace("_", " ").split()): text.get_position() for text in texts
    }


def test_each_state_stands_in_its_modes_row(chart: ChargingChart) -> None:
    found = shown(chart, outcome(*HOMED, why="no part in the feeder"))
    assert "charging:0itemslaidin5.5s,thenstopped:nopartinthefeeder" in found
    boxes = {name.replace("_", "").replace(" ", ""): name for name in chart.state_names}
    missing = {name for words, name in boxes.items() if words not in found}
    # What a run seldom comes to is drawn only where it did.
    assert missing == {"halted", "back_off.brake", "back_off.away", "stopped"}
    heights = [found[one][1] for one in ("home.settle", "acquire.zero", "wall.lower", "done")]
    assert heights == sorted(heights)
    assert found["wall.lower"][1] < found["crown.lower"][1] < found["bulk.pour"][1]


def test_a_stop_and_a_halt_are_drawn_where_they_were_taken(chart: ChargingChart) -> None:
    steps = (
        ("acquire.descend", "back_off.brake", "nothing there"),
        ("back_off.brake", "stopped", "at rest, not to be moved"),
        ("scan.pass", "halted", "operator's halt"),
    )
    found = shown(chart, outcome(*HOMED, *steps))
    assert {"stopped", "halted", "backoff.brake"} <= set(found)
    assert "charging:0itemslaidin5.5s" in found
