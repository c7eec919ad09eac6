"""A skill of one's own, out of a YAML file, run with any part (Fig. 4)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final, Literal, get_args

from matplotlib.figure import Figure
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from chamfer.analysis.campaign.trial_metrics import Quantity, over_trials
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Outcome, Progress
from chamfer.analysis.scenario.scenario_yaml import parse_value
from chamfer.analysis.skills.connector_insertion import SPEED
from chamfer.analysis.skills.connector_insertion_figures import plot_insertion
from chamfer.analysis.skills.connector_replay import replay_insertion
from chamfer.analysis.skills.connector_runs import INSERTION, failure, insertion_metrics
from chamfer.analysis.skills.skill_file import read_skill, skill_of, skill_text
from chamfer.analysis.skills.skill_run import path_table, run_skill
from chamfer.diagrams.skills.connector_insertion import (
    BncConnectorScenario,
    DConnectorScenario,
    OwnPartScenario,
    PartScenario,
    PegScenario,
    Rj45ConnectorScenario,
    compliant,
    make_connector_diagram,
)
from chamfer.diagrams.skills.connector_loop import ConnectorScenario
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.models.connectors.mesh_connector import MeshConnector
from chamfer.models.validation import ParameterError, require_one_of
from chamfer.systems.force.accommodation import AccommodationParams
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_chart import make_skill_chart
from chamfer.systems.primitives.skill_check import check_forces, check_timing
from chamfer.systems.statechart.chart import Chart, ChartError

Part = Literal["d-connector", "bnc-connector", "peg", "rj45-connector", "own"]

_WORLDS: Final[Mapping[Part, Callable[..., PartScenario]]] = {
    "d-connector": DConnectorScenario,
    "bnc-connector": BncConnectorScenario,
    "peg": PegScenario,
    "rj45-connector": Rj45ConnectorScenario,
}
_MEASURED: Final = {"done": Quantity(""), **INSERTION}


@dataclass(frozen=True, kw_only=True)
class OwnSkillScenario(ConnectorScenario):
    """A skill, a part, and the world of both."""

    skill: str | None = None
    # path of a YAML file, of which a run keeps the text; None: the part's own strategy
    part: Part = "d-connector"  # what is inserted; own: what the files of ``own`` hold
    own: MeshConnector | None = None  # plug and socket of one's own; None: another part
    accommodation: AccommodationParams = field(default_factory=compliant)
    sight: SightSettings | None = None
    # None: the plug is in the gripper above the socket from the begin

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "part", get_args(Part))
        if (self.part == "own") != (self.own is not None):
            allowed = "the files of a part" if self.own is None else f"null with {self.part}"
            raise ParameterError("own", self.own, allowed)

    @property
    def world(self) -> PartScenario:
        """The part with all that it is run in."""
        common = {one.name: getattr(self, one.name) for one in fields(ConnectorScenario)}
        if self.own is not None:
            return OwnPartScenario(connector=self.own, **common)
        return _WORLDS[self.part](**common)

    def make_skill(self) -> Skill:
        """Return the skill, of a resolved scenario.

        Raises:
            UserError: If its text is not that of a skill.
        """
        if self.skill is None:
            return self.world.make_skill()
        try:
            plain = parse_value(self.skill)
        except ValueError as error:
            raise UserError(f"skill: {error}") from error
        if not isinstance(plain, Mapping):
            raise UserError("skill has several lines, allowed: a path, or the text of a skill")
        return skill_of(plain)


def resolve(scenario: OwnSkillScenario) -> OwnSkillScenario:
    """Put the text of a skill in the place of its file, and check the skill.

    Raises:
        UserError: If there is no such file, or it holds no skill that can be run.
        ParameterError: If there is neither a file nor a strategy.
    """
    if scenario.skill is not None and "\n" not in scenario.skill:
        scenario = replace(scenario, skill=skill_text(read_skill(Path(scenario.skill))))
    try:
        skill = scenario.make_skill()
        check_timing(skill, scenario.accommodation.period)
        check_forces(skill, scenario.accommodation.damping, scenario.world.connector)
    except ChartError as error:
        raise UserError(str(error)) from error
    return scenario


def run(scenario: OwnSkillScenario, seed: int, progress: Progress) -> Outcome:
    """Run the skill once."""
    world = scenario.world

    def told(fraction: float, doing: str = "") -> None:
        progress(fraction, doing or f"{fraction * scenario.duration:.0f} s of the skill")

    done = run_skill(scenario.make_skill(), world, seed=seed, progress=told)
    values = {"done": float(done.outcome == "done"), **insertion_metrics(done, world)}
    metrics = over_trials([values], _MEASURED)
    metrics["done"] = replace(metrics["done"], note=done.reason)
    metrics["success"] = replace(metrics["success"], note=failure(done, world))
    metrics["real_time_factor"] = replace(metrics["real_time_factor"], note=SPEED)
    return Outcome(
        metrics=metrics,
        traces=done.traces,
        simulated_seconds=float(done.traces["time"][-1]),
        tables={"path": path_table(done.path)},
    )


def make_charts(scenario: OwnSkillScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the state charts."""
    return (make_skill_chart(scenario.make_skill()),)


def make_diagram(scenario: OwnSkillScenario) -> Diagram:
    """Return the wiring, for the block diagram."""
    return make_connector_diagram(scenario.world, scenario.make_skill())


def show_replay(scenario: OwnSkillScenario, outcome: Outcome, meshcat: Meshcat) -> None:
    """Show the run in three dimensions."""
    replay_insertion(scenario.world, outcome, meshcat)


def figures(scenario: OwnSkillScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    (chart,) = make_charts(scenario)
    connector = scenario.world.connector
    done, path = outcome.metrics["done"], outcome.tables["path"]
    ended = "done" if done.value else f"not done: {done.note or 'out of time'}"
    result = f"{ended}, after {outcome.metrics['duration'].value:.2f} s"
    return {
        "path": plot_chart_path(chart, path, result=result),
        "signals": plot_insertion(
            outcome.traces,
            path,
            states=[state.name for state in chart.states],
            mated=connector.mated_depth,
            mating_force=connector.mating_force,
        ),
    }
