"""By how much the worlds of a campaign's trials differ, and what a skill believes of each."""

import math
from dataclasses import dataclass, fields, replace
from operator import mul
from typing import Any, Final, TypeVar

import numpy as np

from chamfer.diagrams.skills.connector_insertion import AnyConnectorScenario
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.models.validation import ParameterError, require_not_negative

S = TypeVar("S", bound=AnyConnectorScenario)

_LEAST: Final = 0.0003  # m, depth of an obstacle that is in a socket, not before it


@dataclass(frozen=True, kw_only=True)
class WorldSpread:
    """By how much the true worlds of trials differ from what is believed; all is assumed.

    Draws are uniform within plus and minus a range unless it is said otherwise.
    """

    lateral: float = 0.002  # m, of the plug over the socket along x and y
    rotational: float = math.radians(3)  # rad, of the plug in the gripper about x, y and z
    force_bias: float = 1.0  # N, of the sensor along each axis
    torque_bias: float = 0.03  # N m, of the sensor about each axis
    friction: float = 0.5  # share, of what is believed of the connector's
    wrist_stiffness: float = 0.3  # share, of what is believed of all of the wrist's
    mating_force: float = 2.0  # factor of the connector's own, either way, log-uniform
    tight: float = 0.5  # share of trials whose connector has the tightest fit allowed
    focal: float = 0.1  # share, of each camera's focal length, with sight
    camera_turn: float = math.radians(5)  # rad, of each camera about each of its axes, with sight
    obstacles: float = 0.1  # share of trials in which something is in the socket
    obstacle_short: float = 0.0005  # m, by which an obstacle is short of the mated depth at least

    def __post_init__(self) -> None:
        names = [one.name for one in fields(self) if one.name != "mating_force"]
        require_not_negative(self, *names)
        for name in ("friction", "wrist_stiffness", "focal"):
            if not (value := getattr(self, name)) < 1:
                raise ParameterError(name, value, "0 <= share < 1")
        for name in ("tight", "obstacles"):
            if not (value := getattr(self, name)) <= 1:
                raise ParameterError(name, value, "0 to 1")
        if not 1 <= self.mating_force < math.inf:
            raise ParameterError("mating_force", self.mating_force, "a finite factor >= 1")


def drawn_world(scenario: S, spread: WorldSpread, seed: int, trial: int) -> S:
    """Return the scenario with the world of one of a seed's trials.

    What is believed is the scenario itself. Every trial takes the same draws in the same order, so
    that one spread does not change another's.

    Raises:
        ParameterError: If an obstacle would have no room in the socket.
    """
    random = np.random.default_rng([seed, trial])

    def off(*ranges: float) -> list[float]:
        return list(map(mul, ranges, random.uniform(-1.0, 1.0, len(ranges)).tolist()))

    error = off(*[spread.rotational] * 3, *[spread.lateral] * 2, 0.0)
    bias = off(*[spread.force_bias] * 3, *[spread.torque_bias] * 3)
    friction, stiffness, force = off(
        spread.friction, spread.wrist_stiffness, math.log(spread.mating_force)
    )
    focal, turns = off(*[spread.focal] * 2), [off(*[spread.camera_turn] * 3) for _ in range(2)]
    tight, blocked, place = random.uniform(size=3).tolist()
    believed = scenario.connector
    material = replace(believed.material, friction=(1 + friction) * believed.material.friction)
    tolerance = "worst" if tight < spread.tight else believed.tolerance
    connector = replace(believed, material=material, tolerance=tolerance).with_mating_force(
        math.exp(force) * believed.mating_force
    )
    deepest = connector.mated_depth - spread.obstacle_short
    if not deepest > _LEAST:
        allowed = f"less than {connector.mated_depth - _LEAST:.3g} m"
        raise ParameterError("spread.obstacle_short", spread.obstacle_short, allowed)
    wrist = replace(
        scenario.wrist, stiffness=tuple((1 + stiffness) * k for k in scenario.wrist.stiffness)
    )
    changes: dict[str, Any] = {
        "initial_error": tuple(np.add(scenario.initial_error, error).tolist()),
        "sensor": replace(scenario.sensor, bias=tuple(bias)),
        "connector": connector,
        "believed_connector": scenario.believed_connector or believed,
        "wrist": wrist,
        "believed_wrist": scenario.believed,
    }
    if scenario.sight is not None:
        changes["sight"] = _miscalibrated(scenario.sight, focal, turns)
    if blocked < spread.obstacles:
        changes["obstacle"] = _LEAST + place * (deepest - _LEAST)
    return replace(scenario, **changes)


def _miscalibrated(
    sight: SightSettings, focal: list[float], turns: list[list[float]]
) -> SightSettings:
    """Return the cameras, believed to be as they are but for errors."""
    cameras = {
        name: replace(
            getattr(sight, name),
            focal_factor=getattr(sight, name).focal_factor * (1 + factor),
            turn=tuple(np.add(getattr(sight, name).turn, turn).tolist()),
        )
        for name, factor, turn in zip(("xz", "yz"), focal, turns, strict=True)
    }
    return replace(sight, **cameras)
