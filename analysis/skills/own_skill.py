"""A skill of one's own, out of a YAML file, run with any part (Fig. 4)."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Final, Literal, get_args

from matplotlib.figure import Figure
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.analysis.scenario.scenario_yaml import parse_value
from chamfer.analysis.skills.connector_insertion import (
    insertion_figures,
    insertion_outcome,
    replay_insertion,
    run_to_end,
)
from chamfer.analysis.skills.skill_file import read_skill, skill_of, skill_text
from chamfer.diagrams.skills.connector_loop import make_connector_diagram
from chamfer.diagrams.skills.connector_scenario import (
    BNC_CONNECTOR,
    D_CONNECTOR,
    RJ45_CONNECTOR,
    ROUND_PEG,
    ConnectorScenario,
    OwnPartScenario,
    ResolvedConnectorScenario,
    StrategyScenario,
    resolve,
    resolve_own_part,
    resolved_fields,
)
from chamfer.diagrams.skills.connector_sight import ResolvedSightSettings
from chamfer.models.arms.wrist import WristParams
from chamfer.models.connectors.mesh_connector import MeshConnector
from chamfer.models.validation import ParameterError, require_one_of
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_law import check_forces, check_timing
from chamfer.systems.sensing.force_sensor import WrenchSensorParams
from chamfer.systems.statechart.chart import ChartError

PartName = Literal["d-connector", "bnc-connector", "peg", "rj45-connector", "own"]

_PARTS: Final[Mapping[PartName, StrategyScenario]] = {
    "d-connector": D_CONNECTOR,
    "bnc-connector": BNC_CONNECTOR,
    "peg": ROUND_PEG,
    "rj45-connector": RJ45_CONNECTOR,
}


@dataclass(frozen=True, kw_only=True)
class OwnSkillScenario(ConnectorScenario):
    """A skill, a part, and all that both are run in."""

    skill: str | None = None
    # path of a YAML file, of which a run keeps the text; None: the part's own strategy
    part: PartName = "d-connector"  # what is inserted; own: what the files of ``own`` hold
    own: MeshConnector | None = None  # plug and socket of one's own; None: another part

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "part", get_args(PartName))
        if (self.part == "own") != (self.own is not None):
            allowed = "the files of a part" if self.own is None else f"null with {self.part}"
            raise ParameterError("own", self.own, allowed)


OWN_SKILL: Final = OwnSkillScenario()


@dataclass(frozen=True, kw_only=True)
class ResolvedOwnSkillScenario(OwnSkillScenario):
    """A skill, a part, and all that both are run in; nothing is open but the strategy."""

    believed_wrist: WristParams
    believed_sensor: WrenchSensorParams
    sight: ResolvedSightSettings | None

    @property
    def insertion(self) -> ResolvedConnectorScenario:
        """The part with all that it is run in."""
        common = {one.name: getattr(self, one.name) for one in fields(ConnectorScenario)}
        if self.own is not None:
            return resolve_own_part(OwnPartScenario(connector=self.own, **common))
        return resolve(replace(_PARTS[self.part], **common))

    def make_skill(self) -> Skill:
        """Return the skill, out of its text or the part's own strategy."""
        if self.skill is None:
            return self.insertion.make_skill()
        try:
            plain = parse_value(self.skill)
        except ValueError as error:
            raise UserError(f"skill: {error}") from error
        if not isinstance(plain, Mapping):
            raise UserError("skill has several lines, allowed: a path, or the text of a skill")
        return skill_of(plain)


def resolve_own_skill(scenario: OwnSkillScenario) -> ResolvedOwnSkillScenario:
    """Put the text of a skill in the place of its file, check the skill, and leave nothing open.

    Raises:
        UserError: If there is no such file, or it holds no skill that can be run.
    """
    connector = scenario.own or _PARTS[scenario.part].connector
    found = resolved_fields(scenario, connector=connector)
    del found["connector"]
    if scenario.skill is not None and "\n" not in scenario.skill:
        found["skill"] = skill_text(read_skill(Path(scenario.skill)))
    resolved = ResolvedOwnSkillScenario(**found)
    try:
        skill = resolved.make_skill()
        check_timing(skill, scenario.accommodation.period)
        check_forces(skill, scenario.accommodation.damping, connector)
    except ChartError as error:
        raise UserError(str(error)) from error
    return resolved


def run(scenario: ResolvedOwnSkillScenario, seed: int, progress: Progress) -> Outcome:
    """Run the skill once."""
    insertion = scenario.insertion
    done = run_to_end(scenario.make_skill(), insertion, seed, progress)
    outcome = insertion_outcome(done, insertion.connector)
    ended = Metric(value=float(done.outcome == "done"), unit="", note=done.reason)
    return replace(outcome, metrics={"done": ended, **outcome.metrics})


def make_diagram(scenario: ResolvedOwnSkillScenario) -> Diagram:
    """Return the wiring, for the block diagram."""
    return make_connector_diagram(scenario.insertion, scenario.make_skill())


def show_replay(scenario: ResolvedOwnSkillScenario, outcome: Outcome, meshcat: Meshcat) -> None:
    """Show the run in three dimensions."""
    replay_insertion(scenario.insertion, outcome, meshcat)


def figures(scenario: ResolvedOwnSkillScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    done = outcome.metrics["done"]
    ended = "done" if done.value else f"not done: {done.note or 'out of time'}"
    return insertion_figures(scenario.make_skill(), scenario.insertion.connector, outcome, ended)
