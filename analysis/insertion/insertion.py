"""From pixels to a seated peg: the cameras align, a chart decides and inserts (section 5)."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.cell.alignment_figures import plot_moments
from chamfer.analysis.cell.alignment_pictures import pictures_at
from chamfer.analysis.cell.alignment_runs import row_before, settling_metrics
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.insertion.cell_prediction import predict
from chamfer.analysis.insertion.cell_runs import (
    INSERTION,
    CellInsertion,
    ending,
    insertion_charts,
    insertion_metrics,
    path_table,
    run_cell_insertion,
    touch_row,
)
from chamfer.analysis.insertion.insertion_figures import plot_course, plot_loads
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.diagrams.cell.in_view import require_fine_enough
from chamfer.diagrams.insertion.insertion_scenario import InsertionScenario, resolve
from chamfer.systems.contact.peg_hole_contact_monitor import SEATED

# Close, nearly aligned, fast, not deep.
REDUCED = (
    "begin=0.2",
    "gap=0.01",
    "initial_error=[0, 0.001, -0.001, 0, 0.01, -0.01]",
    "insert.depth=0.015",
    "insert.speed=0.06",
    "insert.rest=0.05",
    "duration=2",
)
_MOMENTS = ("before", "touch", "end")
_NOTES = {
    "seated": f"1: {100 * SEATED:g} % of the commanded depth, or on the bottom, at the end",
    "seated.said": "1: so says the chart, which sees cameras and encoders alone",
    "seated.first": "1: with the first attempt",
    "depth": "of the tip below the mouth, deepest of the last attempt",
    "force.axial": "against the insertion, largest median of 10 ms",
    "force.lateral": "across, largest median of 10 ms",
    "force.contact": "likewise of both",
    "force.raw_peak": "against the insertion, of one step",
    "force.sensed_error": "of what the arm's springs say, while the peg is fed, at most",
    "time_to_seated": "from when the cameras count to 90 % of the depth",
    "decision.time": "likewise, of the last decision",
    "touch.lateral_error": "where it touches first, or the tip is at the mouth",
    "touch.rotational_error": "likewise",
    "two_point.onset": "l",
    "pull_out.force": "that pulls out what was stopped in the hole",
}


def run(scenario: InsertionScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the peg once."""

    def told(fraction: float, doing: str = "") -> None:
        # The task ends long before its time is up: the time is what tells.
        progress(fraction, doing or f"{fraction * scenario.duration:.0f} s of the task")

    done = run_cell_insertion(scenario, seed, told)
    return Outcome(
        metrics=_metrics(scenario, done),
        traces=done.traces,
        simulated_seconds=float(done.traces["time"][-1]),
        tables={
            "path": path_table(done.path),
            "pictures": pictures_at(scenario.there, done.traces, _moments(scenario, done), seed),
        },
    )


def _metrics(scenario: InsertionScenario, done: CellInsertion) -> dict[str, Metric]:
    metrics = over_trials([insertion_metrics(done, scenario)], INSERTION)
    insert = scenario.insert
    cap = f"at a cap of {insert.push:g} N"
    notes = _NOTES | {
        "wedged": f"1: stopped {cap}, held without it by more than {insert.held_force:g} N",
        "jammed": f"1: stopped {cap}, held by no more without it",
    }
    for name, note in notes.items():
        if metrics[name].value is not None:
            metrics[name] = Metric(value=metrics[name].value, unit=metrics[name].unit, note=note)
    metrics["seated.said"] = Metric(
        value=metrics["seated.said"].value, unit="", note=ending(done, scenario)
    )
    metrics["real_time_factor"] = Metric(
        value=round(float(done.traces["time"][-1]) / done.cpu_seconds, 2),
        unit="",
        note="simulated over processor time, one core, the machine's own",
    )
    return metrics | settling_metrics(scenario) | predict(scenario, done)


def _moments(scenario: InsertionScenario, done: CellInsertion) -> dict[str, int]:
    """Return the rows of the traces of which there are pictures."""
    before = row_before(done.traces["time"], scenario.begin)
    touch = touch_row(done)
    last = len(done.traces["time"]) - 1
    return dict(zip(_MOMENTS, (before, last if touch is None else touch, last), strict=True))


def figures(scenario: InsertionScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    (chart,) = insertion_charts(scenario)
    result = outcome.metrics["seated.said"].note
    time = outcome.traces["time"]
    return {
        "insertion": plot_course(scenario, outcome, chart.state_names),
        "path": plot_chart_path(chart, outcome.tables["path"], result=result),
        "loads": plot_loads(scenario, outcome),
        "pictures": plot_moments(
            scenario,
            outcome.tables["pictures"],
            {"before": "before", "touch": "at the touch", "end": f"after {time[-1]:.1f} s"},
        ),
    }


def resolve_insertion(scenario: InsertionScenario) -> InsertionScenario:
    """Return the scenario with what it leaves open filled in, and checked."""
    resolved = resolve(scenario)
    require_fine_enough(resolved)
    return resolved
