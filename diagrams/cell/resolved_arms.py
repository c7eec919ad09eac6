"""What the cell's arms leave open, and whether they can do what they have to."""

from dataclasses import replace
from typing import Any, Final, TypeVar

import numpy as np

from chamfer.diagrams.cell.work_cell import ArmSettings, WorkCellScenario
from chamfer.models.validation import ParameterError, within

ScenarioT = TypeVar("ScenarioT", bound=WorkCellScenario)

# Shares of the largest torques: what holds an arm up leaves the rest to move it.
_MOST_HELD: Final = 0.9


def resolve_arms(scenario: ScenarioT) -> ScenarioT:
    """Fill in posture, friction and rotors of the arms.

    Raises:
        ParameterError: If an arm doesn't reach its place or is too weak to be there, or the torque
            limits that are given are of another number of joints.
    """
    for arm in scenario.arms:
        settings: ArmSettings = getattr(scenario, arm)
        with within("impedance"):
            scenario.impedance.limits(settings.arm)
        posture = scenario.rest_posture(arm) if settings.near is None else settings.near
        filled: dict[str, Any] = {}
        filled[arm] = replace(
            settings,
            posture=tuple(posture.tolist()),
            joint_friction=settings.arm.dry_friction,
            rotor_inertia=settings.arm.rotor_inertia,
        )
        scenario = replace(scenario, **filled)
    require_strong(scenario, 0.0)
    return scenario


def require_strong(scenario: WorkCellScenario, push: float) -> None:
    """Refuse arms whose motors don't hold them where they are to be.

    Args:
        scenario: The cell; torque limits of its own are not looked at.
        push: N, along the hole's axis, that they have to make there.

    Raises:
        ParameterError: It names the arm's model, the joint, and what torque it lacks.
    """
    if scenario.impedance.torque_limits is not None:
        return
    wrench = np.concatenate([np.zeros(3), push * scenario.hole_axes.matrix()[:, 0]])
    for name in scenario.arms:
        settings: ArmSettings = getattr(scenario, name)
        arm = settings.arm
        state = settings.known_arm().evaluate(scenario.rest_posture(name))
        force = wrench if name == "peg" else -wrench
        torque = np.abs(state.gravity + state.J_V_WT.T @ force)
        limits = np.array(arm.torque_limits)
        worst = int(np.argmax(torque / limits))
        if torque[worst] > _MOST_HELD * limits[worst]:
            what = f"hold itself and push with {push:g} N" if push else "hold itself"
            raise ParameterError(
                f"{name}.model",
                settings.model,
                f"an arm strong enough to {what} at its place: {arm.joint_names[worst]} has "
                f"{limits[worst]:.3g} N m, and takes {torque[worst]:.3g} N m of it",
            )
