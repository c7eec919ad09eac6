"""Assesses the arms' postures along the feed: singularities, joint limits, torques, friction.

The peg's arm is computed from the gap to the depth, the hole's arm at rest.
"""

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.analysis.design.design_scenario import ResolvedDesignScenario, target_of
from chamfer.analysis.design.link import Link, at_least, at_most
from chamfer.diagrams.cell.work_cell import ArmName, CellArmSettings, WorkCellScenario
from chamfer.diagrams.insertion.compiled_alignment import arms_alone
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ArmModel, tool_friction

Array = NDArray[np.float64]

_PLACES: Final = 9
_TURN: Final = 1e-4  # rad, of a finite difference
GRAVITY: Final = 9.81  # m/s^2


class Place(NamedTuple):
    """An arm on the way; forces are along and about the hole's axes, in AXES' order."""

    arm: ArmName
    fed: float  # m, from the gap on
    joint: str  # that a singularity is one of
    angle: float  # rad, of it
    singular_value: float  # the smallest of the Jacobian, rad and m; 0: out of reach
    to_limit: float  # rad, of the joint that is closest to the end of its range
    closest: str  # which it is
    wound: Array  # N and N m, shape (6,), that dry friction takes of a motion
    weight: Array  # N m, that holds arm and payload, and friction's bias, shape (n,)
    lever: Array  # m, of a push along the hole's axis, shape (n,)


def feed_path(scenario: ResolvedDesignScenario) -> tuple[Place, ...]:
    """Return the arms' places on the way, with the largest random friction and payload."""
    spread = scenario.spread
    length = scenario.gap + target_of(scenario)
    more = 1 + spread.joint_friction, 1 + spread.payload
    return _path(arms_alone(scenario), length, *more)


@lru_cache(maxsize=64)
def _path(
    scenario: WorkCellScenario, length: float, more_friction: float, more_payload: float
) -> tuple[Place, ...]:
    found = []
    R_WH = scenario.hole_axes.matrix()
    axes = np.kron(np.eye(2), R_WH.T)
    for arm in scenario.arms:
        settings: CellArmSettings = getattr(scenario, arm)
        model, own = settings.known_arm(), settings.arm
        q, start = scenario.rest_posture(arm), scenario.nominal_pose(arm)
        lower, upper = np.array(own.lower_limits), np.array(own.upper_limits)
        ways = np.linspace(0.0, length, _PLACES) if arm == "peg" else np.zeros(1)
        for fed in ways.tolist():
            reached = True
            pose = RigidTransform(start.rotation(), start.translation() + fed * R_WH[:, 0])
            try:
                q = model.joint_positions(pose, q)
            except ParameterError:
                reached = False
            state = model.evaluate(q)
            J = axes @ state.J_V_WT
            _, wound = tool_friction(J, more_friction * np.array(own.dry_friction))
            near = np.minimum(q - lower, upper - q)
            joint, closest = _straight(model, q), int(np.argmin(near))
            p_WP = state.X_WT.rotation().matrix() @ settings.payload_position
            J_P = state.J_V_WT[3:] + np.cross(state.J_V_WT[:3], p_WP, axis=0)
            payload = more_payload * settings.payload_error
            held = state.gravity + more_friction * own.friction_bias
            found.append(
                Place(
                    arm=arm,
                    fed=fed,
                    joint=own.joint_names[joint],
                    angle=float(q[joint]),
                    singular_value=_smallest(model, q) if reached else 0.0,
                    to_limit=float(near[closest]) if reached else 0.0,
                    closest=own.joint_names[closest],
                    wound=np.roll(wound, 3),
                    weight=held + J_P[2] * GRAVITY * payload,
                    lever=J[3],
                )
            )
    return tuple(found)


def _smallest(model: ArmModel, q: Array) -> float:
    return float(np.linalg.svd(model.evaluate(q).J_V_WT, compute_uv=False)[-1])


def _straight(model: ArmModel, q: Array) -> int:
    """Return the joint with which the Jacobian's smallest singular value changes most."""
    turns = _TURN * np.eye(len(q))
    return int(np.argmax([abs(_smallest(model, q + t) - _smallest(model, q - t)) for t in turns]))


def path_links(scenario: ResolvedDesignScenario) -> list[Link]:
    """Return whether the arms' postures allow the feed and the push."""
    path, impedance = feed_path(scenario), scenario.impedance

    def where(one: Place) -> str:
        depth = 1e3 * (one.fed - scenario.gap)
        side = "below" if depth >= 0 else "before"
        return f"{one.arm}'s arm with the tip {abs(depth):.3g} mm {side} the mouth"

    straight = min(path, key=lambda one: one.singular_value)
    reached = straight.singular_value > 0
    said = f"{straight.joint} is at {straight.angle:.3g} rad{'' if reached else ', out of reach'}"
    least = impedance.smallest_singular_value
    source = f"smallest singular value of the Jacobian along the feed: {where(straight)}, {said}"
    ends = min(path, key=lambda one: one.to_limit)
    says = f"to the end of a joint's range along the feed: {ends.closest} of the {where(ends)}"
    links = [
        at_least("posture", straight.singular_value, least, "", source),
        at_least("posture.limits", ends.to_limit, 0.0, "rad", says),
    ]
    held = []
    for one in path:
        settings: CellArmSettings = getattr(scenario, one.arm)
        push = scenario.insert.push * one.lever
        shares = (np.abs(one.weight) + np.abs(push)) / impedance.limits(settings.arm.torque_limits)
        worst = int(np.argmax(shares))
        held.append((float(shares[worst]), settings.arm.joint_names[worst], where(one)))
    share, joint, place = max(held)
    source = f"of {joint}'s torque, for weight and push along the feed: {place}"
    return [*links, at_most("torque", share, 1.0, "", source)]


def wound_up(scenario: ResolvedDesignScenario) -> Array:
    """Return the most that dry friction takes of a motion, along and about the axes, (6,)."""
    found: Array = np.max([one.wound for one in feed_path(scenario)], axis=0)
    return found
