"""Runs of insertions, measured against the truth that no skill sees."""

import math
from typing import Any, Final

from chamfer.analysis.campaign.trial_metrics import Quantity, Trial
from chamfer.analysis.scenario.experiment import Progress
from chamfer.analysis.skills.connector_truth import is_mated
from chamfer.analysis.skills.skill_run import SkillResult, run_skill
from chamfer.diagrams.skills.connector_insertion import PartScenario
from chamfer.systems.primitives.skill_chart import make_skill_chart
from chamfer.systems.statechart.chart import Chart

# What :func:`insertion_metrics` measures.
INSERTION: Final = {
    "success": Quantity(""),
    "duration": Quantity("s"),
    "depth": Quantity("m"),
    "force.peak": Quantity("N"),
    "force.peak_share": Quantity(""),
    "torque.peak": Quantity("N m"),
    "retries": Quantity(""),
    "real_time_factor": Quantity(""),
}


def run_insertion(
    scenario: PartScenario, seed: int, progress: Progress | None = None
) -> SkillResult:
    """Simulate a resolved scenario with its own skill until that has ended."""
    return run_skill(scenario.make_skill(), scenario, seed=seed, progress=progress)


def insertion_metrics(done: SkillResult, scenario: PartScenario) -> Trial:
    """Return what a run measured.

    ``success`` is 1 if the skill says so and the plug is in, by the truth; ``force.peak`` is the
    largest true push or pull along the insertion at any step of the plant, its share that of the
    true mating force, and ``torque.peak`` the largest true torque about an axis, likewise.
    """
    traces = done.traces
    connector = scenario.connector
    depth = float(traces["depth"][-1])
    peak = float(done.peaks[-1])
    return {
        "success": float(not failure(done, scenario)),
        "duration": float(traces["time"][-1]),
        "depth": depth,
        "force.peak": peak,
        "force.peak_share": peak / connector.mating_force,
        "torque.peak": float(done.peaks[:3].max()),
        "retries": float(traces["retries"][-1]),
        "real_time_factor": round(float(traces["time"][-1]) / done.wall_seconds, 2),
    }


def failure(done: SkillResult, scenario: PartScenario) -> str:
    """Return why a run is no success; empty if it is one."""
    if done.outcome == "failed":
        return done.reason
    if done.outcome == "running":
        return f"{done.state}: still running after {done.traces['time'][-1]:g} s"
    depth, turn = (float(done.traces[name][-1]) for name in ("depth", "turn"))
    connector = scenario.connector
    if is_mated(connector, depth, turn):
        return ""
    mated = f"mated is {1e3 * connector.mated_depth:.2f} mm"
    if connector.mated_turn is not None:
        turned = math.remainder(turn - connector.mated_turn, math.pi)
        mated += f", it is turned {math.degrees(turned):.0f} degrees from there"
    return f"said to be done {1e3 * depth:.2f} mm deep, {mated}"


def skill_charts(scenario: PartScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the chart of the scenario's skill."""
    return (make_skill_chart(scenario.make_skill()),)
