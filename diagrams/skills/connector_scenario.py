"""Insertions: the paper's D connector (Fig. 5) and BNC connector (Fig. 6), a peg, an RJ45 plug.

A scenario may leave open the beliefs of the skill and the controller, the properties of the
sensor, and the data of the plug for the grasp; :func:`resolve` fills them in.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Final, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.diagrams.cell.work_cell import CellArmSettings
from chamfer.diagrams.contact.sensing import Sensing, ideal, missing
from chamfer.diagrams.skills.connector_sight import ResolvedSightSettings, SightSettings
from chamfer.diagrams.skills.robots import ARM, RobotName
from chamfer.models.arms.wrist import SIZE, WristParams, tip_pose
from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.connectors.connector import Connector
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.connectors.mesh_connector import MeshConnector
from chamfer.models.connectors.rj45_connector import Rj45Connector
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import (
    ParameterError,
    require_numbers,
    require_one_of,
    require_positive,
)
from chamfer.systems.contact.arm_dynamics import GRAVITY
from chamfer.systems.contact.contact_approximation import Approximation
from chamfer.systems.force.admittance_law import AdmittanceParams
from chamfer.systems.force.impedance_law import ImpedanceControllerParams
from chamfer.systems.primitives.carriage import PartGripperParams
from chamfer.systems.primitives.skill import Skill, SkillState
from chamfer.systems.sensing.force_sensor import WrenchSensorParams
from chamfer.systems.strategies.bnc_strategy import BncConnectorSkillParams
from chamfer.systems.strategies.d_strategy import DConnectorSkillParams
from chamfer.systems.strategies.grasp_and_transport import make_grasp_and_transport
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams
from chamfer.systems.strategies.rj45_strategy import Rj45ConnectorSkillParams

Array = NDArray[np.float64]
StandardConnector = DConnector | BncConnector | RoundPeg | Rj45Connector
StrategyParams = (
    DConnectorSkillParams
    | BncConnectorSkillParams
    | PegInHoleSkillParams
    | Rj45ConnectorSkillParams
)

_BELIEVED: Final = ("origin", "cross_talk", "decoupling")  # of a sensor
_NO_CROSS_TALK: Final = tuple(map(tuple, np.eye(6).tolist()))
# A calibrated six-axis sensor of 200 N: noise with a standard deviation of 0.5 N and 0.01 N m,
# forces leak into each other by 1 %; the numbers are those at the tool's tip. All is assumed.
SENSING: Final[Mapping[Sensing, WrenchSensorParams]] = {
    "ideal": ideal(WrenchSensorParams(cross_talk=_NO_CROSS_TALK)),
    "realistic": WrenchSensorParams(
        noise=0.87,
        bias=1.0,
        drift=0.02,
        bandwidth=500.0,
        delay=1.7e-3,
        resolution=0.05,
        full_scale=200.0,
        tare=0.0,
        cross_talk=(
            (1.0, 0.01, 0.01, 0.1, 0.1, 0.1),
            (0.01, 1.0, 0.01, 0.1, 0.1, 0.1),
            (0.01, 0.01, 1.0, 0.1, 0.1, 0.1),
            (2e-4, 2e-4, 2e-4, 1.0, 0.01, 0.01),
            (2e-4, 2e-4, 2e-4, 0.01, 1.0, 0.01),
            (2e-4, 2e-4, 2e-4, 0.01, 0.01, 1.0),
        ),
        origin=(0.0, 0.0, 0.0),
    ),
}


@dataclass(frozen=True, kw_only=True)
class ConnectorScenario:
    """The fields that all insertions have in common."""

    robot: RobotName = "carriage"  # moves the gripper: a carriage with six axes, or a WAM
    arm: CellArmSettings = ARM  # of the WAM
    impedance: ImpedanceControllerParams = ImpedanceControllerParams(
        stiffness=(4000.0, 4000.0, 4000.0), rotational_stiffness=(20.0, 20.0, 20.0)
    )  # of the WAM; assumed
    wrist: WristParams = WristParams()
    accommodation: AdmittanceParams = AdmittanceParams(
        damping=(1.2, 1.2, 1.2, 800.0, 800.0, 800.0)
    )  # compliant in rotation; assumed. Raised where the wrist, seen from the tip, requires it
    believed_wrist: WristParams | None = None
    # as the skill and accommodation assume it; None: the true one
    sensing: Sensing = "ideal"  # sets the sensor's open fields: ideal, or realistic
    sensor: WrenchSensorParams = WrenchSensorParams(noise=0.17)
    # at the wrist; ``sensing`` sets the fields that are None
    believed_sensor: WrenchSensorParams | None = None
    # as the skill assumes its origin, cross_talk and decoupling; None: the true ones
    gripper: PartGripperParams = PartGripperParams()
    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    # rad above m, true pose of the plug in the gripper relative to the believed one
    sight: SightSettings | None = None
    # cameras and scene of the grasp; None: the gripper holds the plug above the socket from the
    # start
    height: float = 0.008  # m, of the plug above the socket after the transport
    obstacle: float | None = None
    # m, depth in the socket of an obstacle; None: the socket is free
    approximation: Approximation = "tamsi"  # of contact, by Drake
    step: float = 0.001  # s, of the plant
    duration: float = 120.0  # s, after which a run ends at the latest

    LIKE: ClassVar[Mapping[str, str]] = {"believed_wrist": "wrist"}

    def __post_init__(self) -> None:
        require_one_of(self, "robot", get_args(RobotName))
        require_one_of(self, "sensing", get_args(Sensing))
        require_one_of(self, "approximation", get_args(Approximation))
        require_positive(self, "height", "step", "duration")
        require_numbers(self, SIZE, "initial_error")
        if self.obstacle is not None and not 0 < self.obstacle < math.inf:
            raise ParameterError("obstacle", self.obstacle, "a finite number > 0, or none")
        if any(self.accommodation.spring):
            allowed = "six times 0: only the damping limits the push of a skill"
            raise ParameterError("accommodation.spring", self.accommodation.spring, allowed)
        for one in fields(WrenchSensorParams) if self.believed_sensor else ():
            value = getattr(self.believed_sensor, one.name)
            if one.name not in _BELIEVED and value != one.default:
                allowed = f"left open: only {', '.join(_BELIEVED)} can be believed"
                raise ParameterError(f"believed_sensor.{one.name}", value, allowed)
        stated, believed = self.accommodation.stiffness, self.believed_wrist or self.wrist
        pairs = zip(believed.stiffness, stated, strict=True)
        if not self.accommodation.allow_unstable and any(k > most for k, most in pairs):
            raise ParameterError(
                "wrist.stiffness" if self.believed_wrist is None else "believed_wrist.stiffness",
                believed.stiffness,
                f"at most accommodation.stiffness, {stated}",
            )


@dataclass(frozen=True, kw_only=True)
class StrategyScenario(ConnectorScenario):
    """The insertion of a part by its built-in strategy."""

    connector: StandardConnector  # plug and socket
    believed_connector: StandardConnector | None = None
    # as the skill assumes it; None: the true one
    skill: StrategyParams

    LIKE: ClassVar[Mapping[str, str]] = {
        **ConnectorScenario.LIKE,
        "believed_connector": "connector",
    }


@dataclass(frozen=True, kw_only=True)
class DConnectorScenario(StrategyScenario):
    """The insertion of a D connector."""

    connector: DConnector = DConnector()
    believed_connector: DConnector | None = None
    skill: DConnectorSkillParams = DConnectorSkillParams()


@dataclass(frozen=True, kw_only=True)
class BncConnectorScenario(StrategyScenario):
    """The insertion of a BNC connector."""

    connector: BncConnector = BncConnector()
    believed_connector: BncConnector | None = None
    skill: BncConnectorSkillParams = BncConnectorSkillParams()


@dataclass(frozen=True, kw_only=True)
class PegScenario(StrategyScenario):
    """The insertion of a round peg."""

    connector: RoundPeg = RoundPeg()
    believed_connector: RoundPeg | None = None
    skill: PegInHoleSkillParams = PegInHoleSkillParams()


@dataclass(frozen=True, kw_only=True)
class Rj45ConnectorScenario(StrategyScenario):
    """The insertion of an RJ45 plug."""

    connector: Rj45Connector = Rj45Connector()
    believed_connector: Rj45Connector | None = None
    skill: Rj45ConnectorSkillParams = Rj45ConnectorSkillParams()


@dataclass(frozen=True, kw_only=True)
class OwnPartScenario(ConnectorScenario):
    """Your own part, for your own skill."""

    connector: MeshConnector


ERROR: Final = (0.02, -0.015, 0.03, 0.0012, -0.0015, 0.0)  # rad above m, of the grasp; assumed
D_CONNECTOR: Final = DConnectorScenario(initial_error=ERROR, sight=SightSettings())
BNC_CONNECTOR: Final = BncConnectorScenario(
    # The slots are far from the studs.
    initial_error=(*ERROR[:2], 0.6, *ERROR[3:]),
    sight=SightSettings(),
)
ROUND_PEG: Final = PegScenario(initial_error=ERROR, sight=SightSettings())
RJ45_CONNECTOR: Final = Rj45ConnectorScenario(initial_error=ERROR, sight=SightSettings())


@dataclass(frozen=True, kw_only=True)
class ResolvedConnectorScenario(ConnectorScenario):
    """A part, and the setup of its insertion; nothing is open."""

    connector: Connector
    believed_wrist: WristParams
    believed_sensor: WrenchSensorParams
    sight: ResolvedSightSettings | None

    @property
    def above(self) -> tuple[float, float, float]:
        """Height of the plug's tip over the socket's face after the transport, m."""
        x, y, z = self.initial_error[3:]
        return x, y, self.height + z

    @property
    def plug_in_tool(self) -> RigidTransform:
        """X_TP, the pose of the plug in the tool's frame: the error of the grasp."""
        return tip_pose(np.array([*self.initial_error[:3], 0.0, 0.0, 0.0]))

    @property
    def start(self) -> Array:
        """Initial displacement of the carriage, rad above m, shape (6,)."""
        return self.sight.start if self.sight else np.array([0.0, 0.0, 0.0, *self.above])

    @property
    def resting(self) -> Array:
        """Initial displacement of the plug, likewise."""
        return self.sight.resting if self.sight else self.start

    def make_grasp(self) -> tuple[SkillState, ...]:
        """Return the states that grasp and transport the plug with cameras, if there are any."""
        if self.sight is None:
            return ()
        return make_grasp_and_transport(
            self.sight.motion,
            self.sight.believed,
            self.sight.servoing.with_frames(self.sight.frames.period),
            above=self.above,
            then="tare",
        )

    def make_skill(self) -> Skill:
        """Return the part's own strategy; this one has none."""
        raise ParameterError("skill", None, f"a skill, {self.connector.name} has no strategy")


@dataclass(frozen=True, kw_only=True)
class ResolvedStrategyScenario(ResolvedConnectorScenario):
    """The insertion of a part by its built-in strategy; nothing is open."""

    connector: StandardConnector
    believed_connector: StandardConnector
    skill: StrategyParams

    def make_skill(self) -> Skill:
        """Return the strategy."""
        return self.skill.make_skill(
            self.believed_connector, period=self.accommodation.period, before=self.make_grasp()
        )


def resolve(scenario: StrategyScenario) -> ResolvedStrategyScenario:
    """Return the scenario with its beliefs, its sensor, and the data of the plug for the grasp."""
    return ResolvedStrategyScenario(**resolved_fields(scenario))


def resolve_own_part(scenario: OwnPartScenario) -> ResolvedConnectorScenario:
    """Return the scenario with its beliefs, its sensor, and the data of the plug for the grasp."""
    return ResolvedConnectorScenario(**resolved_fields(scenario))


def resolved_fields(scenario: ConnectorScenario, **given: Any) -> dict[str, Any]:
    """Return the fields of a scenario, and the given ones, with nothing in them open."""
    found = {one.name: getattr(scenario, one.name) for one in fields(scenario)} | given
    connector: Connector = found["connector"]
    believed: Connector = found.get("believed_connector") or connector
    if scenario.obstacle is not None and not scenario.obstacle < connector.mated_depth:
        allowed = f"less than the mated depth, {connector.mated_depth:g} m, or none"
        raise ParameterError("obstacle", scenario.obstacle, allowed)
    if "believed_connector" in found:
        found["believed_connector"] = believed
    if (sight := scenario.sight) is not None:
        weight = 0.0 if scenario.gripper.senses else GRAVITY * believed.mass
        top = float(connector.plug_outline[:, 2].max())
        found["sight"] = sight.resolved(top=top, weight=weight)
    left_open = missing(scenario.sensor, SENSING[scenario.sensing])
    sensor = replace(scenario.sensor, **left_open)  # type: ignore[arg-type]
    believes = scenario.believed_sensor or sensor
    wrist = scenario.believed_wrist or scenario.wrist
    return found | {
        "accommodation": scenario.accommodation.against(wrist.tip_stiffness),
        "believed_wrist": wrist,
        "sensor": sensor,
        "believed_sensor": WrenchSensorParams(
            **{
                name: getattr(sensor if getattr(believes, name) is None else believes, name)
                for name in _BELIEVED
            }
        ),
    }
