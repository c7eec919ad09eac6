"""Insertions: the paper's D connector (Fig. 5) and BNC connector (Fig. 6), a peg, an RJ45 plug."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.diagrams.skills.connector_loop import ConnectorScenario, add_skill_loop
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.connectors.connector import Connector
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.connectors.mesh_connector import MeshConnector
from chamfer.models.connectors.rj45_connector import Rj45Connector
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import GRAVITY
from chamfer.systems.force.accommodation import AccommodationParams
from chamfer.systems.primitives.skill import Skill, SkillState
from chamfer.systems.strategies.bnc_strategy import (
    BncConnectorSkillParams,
    make_bnc_connector_skill,
)
from chamfer.systems.strategies.d_strategy import DConnectorSkillParams, make_d_connector_skill
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams, make_peg_in_hole_skill
from chamfer.systems.strategies.rj45_strategy import (
    Rj45ConnectorSkillParams,
    make_rj45_connector_skill,
)

Array = NDArray[np.float64]


def compliant() -> AccommodationParams:
    """Return accommodation that turns readily; assumed."""
    return AccommodationParams(damping=(1.2, 1.2, 1.2, 800.0, 800.0, 800.0))


@dataclass(frozen=True, kw_only=True)
class PartScenario(ConnectorScenario):
    """The insertion of a part."""

    connector: Connector  # plug and socket
    accommodation: AccommodationParams = field(default_factory=compliant)

    def make_skill(self) -> Skill:
        """Return the part's own strategy.

        Raises:
            ParameterError: If it has none.
        """
        raise ParameterError("skill", None, f"a skill, {self.connector.name} has no strategy")


@dataclass(frozen=True, kw_only=True)
class StrategyScenario(PartScenario):
    """The insertion of a part that has a strategy of its own."""

    believed_connector: Connector | None = None  # as the skill takes it to be; None: as it is

    LIKE: ClassVar[Mapping[str, str]] = {"believed_connector": "connector"}

    def make_grasp(self) -> tuple[SkillState, ...]:
        """Return the states that grasp and transport the plug by sight; none without sight."""
        if self.sight is None:
            return super().make_grasp()
        motion, believed = self.sight.motion, self.believed_connector or self.connector
        if motion.top is not None and motion.weight is not None:
            return super().make_grasp()
        if motion.top is None:
            motion = replace(motion, top=float(self.connector.plug_outline[:, 2].max()))
        if motion.weight is None:
            weight = 0.0 if self.gripper.senses else GRAVITY * believed.mass
            motion = replace(motion, weight=weight)
        return replace(self, sight=replace(self.sight, motion=motion)).make_grasp()


@dataclass(frozen=True, kw_only=True)
class DConnectorScenario(StrategyScenario):
    """The insertion of a D connector."""

    connector: DConnector = field(default_factory=DConnector)
    believed_connector: DConnector | None = None  # as the skill takes it to be; None: as it is
    skill: DConnectorSkillParams = field(default_factory=DConnectorSkillParams)
    initial_error: tuple[float, ...] = (0.02, -0.015, 0.03, 0.0012, -0.0015, 0.0)

    def make_skill(self) -> Skill:
        """Return the strategy."""
        return make_d_connector_skill(
            self.skill,
            self.believed_connector or self.connector,
            period=self.accommodation.period,
            before=self.make_grasp(),
        )


@dataclass(frozen=True, kw_only=True)
class BncConnectorScenario(StrategyScenario):
    """The insertion of a BNC connector."""

    connector: BncConnector = field(default_factory=BncConnector)
    believed_connector: BncConnector | None = None  # as the skill takes it to be; None: as it is
    skill: BncConnectorSkillParams = field(default_factory=BncConnectorSkillParams)
    initial_error: tuple[float, ...] = (0.02, -0.015, 0.6, 0.0012, -0.0015, 0.0)

    def make_skill(self) -> Skill:
        """Return the strategy."""
        return make_bnc_connector_skill(
            self.skill,
            self.believed_connector or self.connector,
            period=self.accommodation.period,
            before=self.make_grasp(),
        )


@dataclass(frozen=True, kw_only=True)
class PegScenario(StrategyScenario):
    """The insertion of a round peg."""

    connector: RoundPeg = field(default_factory=RoundPeg)
    believed_connector: RoundPeg | None = None  # as the skill takes it to be; None: as it is
    skill: PegInHoleSkillParams = field(default_factory=PegInHoleSkillParams)
    initial_error: tuple[float, ...] = (0.02, -0.015, 0.03, 0.0012, -0.0015, 0.0)

    def make_skill(self) -> Skill:
        """Return the strategy."""
        return make_peg_in_hole_skill(
            self.skill, self.believed_connector or self.connector, before=self.make_grasp()
        )


@dataclass(frozen=True, kw_only=True)
class Rj45ConnectorScenario(StrategyScenario):
    """The insertion of an RJ45 plug."""

    connector: Rj45Connector = field(default_factory=Rj45Connector)
    believed_connector: Rj45Connector | None = None  # as the skill takes it to be; None: as it is
    skill: Rj45ConnectorSkillParams = field(default_factory=Rj45ConnectorSkillParams)
    initial_error: tuple[float, ...] = (0.02, -0.015, 0.03, 0.0012, -0.0015, 0.0)

    def make_skill(self) -> Skill:
        """Return the strategy."""
        return make_rj45_connector_skill(
            self.skill, self.believed_connector or self.connector, before=self.make_grasp()
        )


@dataclass(frozen=True, kw_only=True)
class OwnPartScenario(PartScenario):
    """A part of one's own, held above its socket from the begin."""

    connector: MeshConnector
    sight: SightSettings | None = None


AnyConnectorScenario = (
    DConnectorScenario | BncConnectorScenario | PegScenario | Rj45ConnectorScenario
)


def make_connector_diagram(scenario: PartScenario, skill: Skill | None = None) -> Diagram:
    """Return the loop of a skill that inserts a connector; its outputs are those of the loop.

    Args:
        scenario: Parameters.
        skill: What is run; None: the scenario's own.
    """
    builder = DiagramBuilder()
    add_skill_loop(builder, scenario, scenario.connector, skill or scenario.make_skill())
    diagram = builder.Build()
    diagram.set_name(f"Insertion of a {scenario.connector.name}")
    return diagram
