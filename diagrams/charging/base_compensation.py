"""Friction compensation by a sensor under the base: its parameters, and the wiring."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from pydrake.systems.framework import DiagramBuilder, OutputPort

from chamfer.diagrams.contact.sensing import Sensing, add_base_sensor, ideal, missing
from chamfer.models.validation import require_not_negative
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.friction_compensation import (
    BaseWrenchTorque,
    FrictionCompensation,
    FrictionCompensationParams,
    JointsToMove,
)
from chamfer.systems.sensing.force_sensor import BaseSensorParams

# A plate that bears the arm, 1000 N and 200 N m, with noise and resolution that are the wrist
# sensor's parts of the full scale; bias and drift likewise. All of it is assumed.
_SENSORS: Final[Mapping[Sensing, BaseSensorParams]] = {
    "ideal": ideal(BaseSensorParams()),
    "realistic": BaseSensorParams(
        noise=1.0,
        bias=2.0,
        drift=0.01,
        bandwidth=200.0,
        delay=1.7e-3,
        resolution=0.25,
        full_scale=1000.0,
        tare=0.0,
    ),
}


@dataclass(frozen=True, kw_only=True)
class BaseCompensationParams(FrictionCompensationParams):
    """Friction compensation with the torques that a sensor under the base shows."""

    bandwidth: float = 10.0  # Hz, of the estimate's first-order lag; assumed
    joints: tuple[int, ...] | None = (0, 1, 2)
    # indices of those compensated; None: all. Friction of the wrist is below the sensor's noise
    rest_speed: float = 1e-3
    # rad/s, m/s of the quill: of a joint that the command moves less the estimate is kept; 0: it
    # follows also where a joint is to stand, which then hunts
    sensor: BaseSensorParams = BaseSensorParams()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "rest_speed")

    def filled(self, sensing: Sensing) -> "BaseCompensationParams":
        """Return the parameters with the sensor that ``sensing`` says."""
        left_open = missing(self.sensor, _SENSORS[sensing])
        return replace(self, sensor=replace(self.sensor, **left_open))  # type: ignore[arg-type]


def add_base_compensation(
    builder: DiagramBuilder,
    params: BaseCompensationParams,
    dynamics: ArmDynamics,
    command: OutputPort,
    base_wrench: OutputPort,
    encoders: OutputPort,
    desired_velocity: OutputPort,
    *,
    step: float,
    period: float,
) -> OutputPort:
    """Add a base sensor and what compensates by it; return the torque, (n,).

    Args:
        builder: Of the loop.
        params: Resolved.
        dynamics: What is known of the arm.
        command: (n,), the controller's torque.
        base_wrench: (6,), of the base on the arm.
        encoders: (2n,).
        desired_velocity: (n,), of the endpoint's coordinates.
        step: s, at which the wrench changes.
        period: s, of the computer.
    """
    add, connect = builder.AddNamedSystem, builder.Connect
    reading = add_base_sensor(builder, params.sensor, base_wrench, step=step, period=period)
    torque = add("base wrench to torque", BaseWrenchTorque(dynamics))
    compensation = add(
        "friction compensation",
        FrictionCompensation(params, joints=command.size(), period=period),
    )
    moved = add("joints to move", JointsToMove(dynamics.arm, rest_speed=params.rest_speed))
    connect(encoders, moved.GetInputPort("encoders"))
    connect(desired_velocity, moved.GetInputPort("desired_velocity"))
    connect(moved.GetOutputPort("moving"), compensation.GetInputPort("moving"))
    connect(reading, torque.GetInputPort("base_wrench"))
    connect(encoders, torque.GetInputPort("encoders"))
    connect(torque.GetOutputPort("base_torque"), compensation.GetInputPort("base_torque"))
    connect(command, compensation.GetInputPort("command"))
    return compensation.GetOutputPort("torque")
