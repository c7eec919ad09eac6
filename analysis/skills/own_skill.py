"""Your own skill from a YAML file, run with any part (Fig. 4)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column, measured
from chamfer.analysis.scenario.plain_data import plain_data, structured
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.analysis.scenario.scenario_yaml import parse_value, read_mapping
from chamfer.analysis.skills.connector_campaign import (
    CampaignScenario,
    ResolvedCampaignScenario,
    ResolvedSkillScenario,
    ResolvedTrialsScenario,
    ScenarioSpread,
    ablated_skills,
    ablation_figures,
    run_ablation,
    run_success,
    success_figures,
)
from chamfer.analysis.skills.connector_insertion import (
    insertion_figures,
    insertion_outcome,
    replay_insertion,
    run_to_end,
)
from chamfer.analysis.skills.insertion_metrics import MATED
from chamfer.analysis.skills.skill_file import read_skill, skill_of, skill_text
from chamfer.analysis.skills.skill_run import AXES
from chamfer.diagrams.skills.connector_loop import make_connector_diagram
from chamfer.diagrams.skills.connector_scenario import (
    BNC_CONNECTOR,
    D_CONNECTOR,
    RJ45_CONNECTOR,
    ROUND_PEG,
    ConnectorScenario,
    StrategyScenario,
    resolved_fields,
)
from chamfer.diagrams.skills.connector_sight import ResolvedSightSettings
from chamfer.models.arms.wrist import WristParams
from chamfer.models.connectors.connector import Connector
from chamfer.models.connectors.mesh_connector import MeshConnector
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_law import check_forces, check_timing
from chamfer.systems.sensing.force_sensor import WrenchSensorParams
from chamfer.systems.statechart.chart import ChartError

_PARTS: Final[Mapping[str, StrategyScenario]] = {
    "d-connector": D_CONNECTOR,
    "bnc-connector": BNC_CONNECTOR,
    "peg": ROUND_PEG,
    "rj45-connector": RJ45_CONNECTOR,
}
_OWN: Final = "own"  # a part whose fields are all given
_FILE: Final = ".yaml"  # of a part


@dataclass(frozen=True, kw_only=True)
class OwnSkillScenario(CampaignScenario):
    """A skill, a part, and the setup of both."""

    skill: str | None = None
    # path of a YAML file, of which a run keeps the text; None: the part's own strategy
    part: str = "d-connector"
    # part to insert: d-connector, bnc-connector, peg, rj45-connector; own: the mesh files of
    # ``connector``; or the path of a YAML file, .yaml, with the fields of a part of mesh files
    connector: Mapping[str, Any] | None = None
    # fields of the part that differ from its defaults; None: no field
    trials: int = 1  # insertions; 1: in the scenario itself, more: each in a randomised one
    compared: tuple[str, ...] = ()
    # skills to compare with the whole one, in the same randomised scenarios: without_tare and so
    # on

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.part not in (*_PARTS, _OWN) and not self.part.endswith(_FILE):
            allowed = f"{', '.join(_PARTS)}, {_OWN}, or a path that ends in {_FILE}"
            raise ParameterError("part", self.part, allowed)
        usual = {"spread": ScenarioSpread(), "compared": ()}
        varied = [name for name, value in usual.items() if getattr(self, name) != value]
        if self.trials == 1 and varied:
            allowed = f"2 or more with {varied[0]}"
            raise ParameterError("trials", self.trials, allowed)


OWN_SKILL: Final = OwnSkillScenario()


@dataclass(frozen=True, kw_only=True)
class ResolvedOwnSkillScenario(OwnSkillScenario):
    """A skill, a part, and the setup of both; nothing is open but the strategy."""

    connector: Mapping[str, Any]
    believed_wrist: WristParams
    believed_sensor: WrenchSensorParams
    sight: ResolvedSightSettings | None

    @cached_property
    def insertion(self) -> ResolvedTrialsScenario:
        """The part with its skill and setup."""
        common = {one.name: getattr(self, one.name) for one in fields(ConnectorScenario)}
        trials: dict[str, Any] = {"spread": self.spread, "trials": self.trials}
        connector = _connector(self.part, self.connector)
        if self.skill is not None:
            skill = _skill(self.skill)
            return ResolvedSkillScenario(connector=connector, skill=skill, **common, **trials)
        if self.part == _OWN:
            return ResolvedTrialsScenario(connector=connector, **common, **trials)
        own = replace(_PARTS[self.part], connector=connector, **common)
        return ResolvedCampaignScenario(**resolved_fields(own), **trials)

    def make_skill(self) -> Skill:
        """Return the skill, from its text or the part's own strategy."""
        return self.insertion.make_skill()


def _skill(text: str) -> Skill:
    try:
        plain = parse_value(text)
    except ValueError as error:
        raise UserError(f"skill: {error}") from error
    if not isinstance(plain, Mapping):
        raise UserError("skill has several lines, allowed: a path, or the text of a skill")
    return skill_of(plain)


def _connector(part: str, given: Mapping[str, Any] | None) -> Any:
    """Return a part with the given fields."""
    if part == _OWN:
        return structured(given or {}, MeshConnector, path="connector")
    own = _from_file(Path(part)) if part.endswith(_FILE) else _PARTS[part].connector
    try:
        return make_scenario(own, given=given)
    except UserError as error:
        raise UserError(f"connector.{error}") from error


def _from_file(path: Path) -> MeshConnector:
    """Return the part that a file holds, its mesh files beside it."""
    found = read_mapping(path, "fields of a part")
    for name in ("plug", "socket"):
        if isinstance(found.get(name), str):
            found[name] = str(path.parent / found[name])
    part: MeshConnector = structured(found, MeshConnector, path="connector")
    return part


def resolve_own_skill(scenario: OwnSkillScenario) -> ResolvedOwnSkillScenario:
    """Replace files by their texts, check the skill, and leave nothing open.

    Raises:
        UserError: If there is no such file, it holds no skill that can be run or no part, or a
            field of the part doesn't exist; ParameterError if a value is not allowed.
    """
    connector = _connector(scenario.part, scenario.connector)
    if isinstance(connector, MeshConnector):
        connector = replace(connector, digest=connector.files_digest)
    part = _OWN if scenario.part.endswith(_FILE) else scenario.part
    found = resolved_fields(scenario, connector=connector)
    found |= {"part": part, "connector": plain_data(connector)}
    if scenario.skill is not None and "\n" not in scenario.skill:
        found["skill"] = skill_text(read_skill(Path(scenario.skill)))
    resolved = ResolvedOwnSkillScenario(**found)
    try:
        skill = resolved.make_skill()
        check_timing(skill, scenario.accommodation.period)
        check_forces(skill, scenario.accommodation.damping, connector)
    except ChartError as error:
        raise UserError(str(error)) from error
    lacks = list(ablated_skills(resolved.insertion)[1:]) if scenario.compared else []
    for name in scenario.compared:
        if name not in lacks:
            allowed = (
                f"primitives that this skill can lack, each once: {', '.join(lacks) or 'nothing'}"
            )
            raise ParameterError("compared", name, allowed)
        lacks.remove(name)
    return resolved


def run(scenario: ResolvedOwnSkillScenario, seed: int, progress: Progress) -> Outcome:
    """Run the skill once, or in as many randomised scenarios as there are trials."""
    insertion = scenario.insertion
    if scenario.compared:
        return run_ablation(insertion, seed, progress, ("whole", *scenario.compared))
    if scenario.trials > 1:
        return run_success(insertion, seed, progress)
    done = run_to_end(scenario.make_skill(), insertion, seed, progress)
    outcome = insertion_outcome(done, insertion.connector)
    ended = Metric(value=float(done.outcome == "done"), unit="", note=done.reason)
    forces = _mating_force(outcome.traces, insertion.connector)
    return replace(outcome, metrics={"done": ended, **outcome.metrics, **forces})


def _mating_force(traces: Table, connector: Connector) -> dict[str, Metric]:
    """Return the force of a plug in line, and that of this one on the same way."""
    depth = traces["depth"]
    on_its_way = (depth > connector.lead_in) & (depth < connector.mated_depth - MATED)
    most = float(traces["true_wrench_z"][on_its_way].max(initial=-math.inf))
    return {
        "mating_force.computed": Metric(
            value=connector.mating_force, unit="N", note="of a slow plug in line"
        ),
        "mating_force.measured": measured(
            most,
            "N",
            note="largest push between the lead-in and the mated depth",
            missing="the plug never reached this depth",
        ),
    }


def make_diagram(scenario: ResolvedOwnSkillScenario) -> Diagram:
    """Return the wiring, for the block diagram."""
    return make_connector_diagram(scenario.insertion, scenario.make_skill())


def show_replay(scenario: ResolvedOwnSkillScenario, outcome: Outcome, meshcat: Meshcat) -> None:
    """Show the run in three dimensions; of many trials where the plug begins."""
    if scenario.trials > 1:
        begin = {"time": column([0.0, 1.0])}
        for name in ("plug", "carriage"):
            start = scenario.insertion.start if name == "carriage" else scenario.insertion.resting
            begin |= {f"{name}_{axis}": np.full(2, x) for axis, x in zip(AXES, start, strict=True)}
        outcome = replace(outcome, traces=begin)
    replay_insertion(scenario.insertion, outcome, meshcat)


def figures(scenario: ResolvedOwnSkillScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    if scenario.compared:
        return ablation_figures(scenario.insertion, outcome)
    if scenario.trials > 1:
        return success_figures(scenario.insertion, outcome)
    done = outcome.metrics["done"]
    ended = "done" if done.value else f"not done: {done.note or 'out of time'}"
    return insertion_figures(scenario.make_skill(), scenario.insertion.connector, outcome, ended)
