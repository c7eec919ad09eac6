"""An arm in contact that is run for a while, and its energy."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.models.arms.arm import Arm
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.arm_in_contact import ArmInContact, ArmInContactParams
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS

NOWHERE = RippledPlane(point=(0.0, 0.0, -100.0))


class Run(NamedTuple):
    """What the ports said after each update; the first row is the initial state."""

    encoders: np.ndarray
    contact_force: np.ndarray
    tool_force: np.ndarray
    base_torque: np.ndarray
    contact: np.ndarray
    tip: np.ndarray
    energy: np.ndarray
    base_wrench: np.ndarray

    def drift(self) -> np.ndarray:
        """Return what is neither conserved nor accounted for, J, from the first update on."""
        kinetic, potential, elastic, dissipated, work = self.energy[1:].T
        balance = kinetic + potential + elastic + dissipated - work
        return balance - balance[0]

    def turned_over(self) -> float:
        """Return how much energy changes its kind, J."""
        return float(np.sum(np.ptp(self.energy[1:, :3], axis=0)))

    def signal(self, name: str) -> np.ndarray:
        return self.contact[:, CONTACT_SIGNALS.index(name)]

    @property
    def q(self) -> np.ndarray:
        return self.encoders[:, : self.encoders.shape[1] // 2]

    @property
    def v(self) -> np.ndarray:
        return self.encoders[:, self.encoders.shape[1] // 2 :]


def run_block(
    block: ArmInContact,
    duration: float,
    *,
    period: float,
    torque: object = 0.0,
    disturbance: object = None,
    velocity: np.ndarray | None = None,
) -> Run:
    builder = DiagramBuilder()
    builder.AddSystem(block)
    inputs = {"torque": torque} | ({} if disturbance is None else {"disturbance": disturbance})
    for name, value in inputs.items():
        port = block.GetInputPort(name)
        constant = np.broadcast_to(np.array(value, dtype=float), (port.size(),))
        source = builder.AddSystem(ConstantVectorSource(constant))
        builder.Connect(source.get_output_port(), port)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = block.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    if velocity is not None:
        start = context.get_discrete_state(0).value().copy()
        n = len(velocity)
        start[n : 2 * n] = velocity
        context.SetDiscreteState(0, start)
    simulator.Initialize()
    rows: list[list[np.ndarray]] = []
    for k in range(round(duration / period) + 1):
        if k > 0:  # else the first update would already be part of the first row
            simulator.AdvanceTo(k * period)
        rows.append([block.GetOutputPort(name).Eval(context).copy() for name in Run._fields])
    return Run(*(np.array(column) for column in zip(*rows, strict=True)))


def simulate_arm(
    arm: Arm,
    q: np.ndarray,
    settings: ArmInContactParams,
    duration: float,
    surface: Surface = NOWHERE,
    **inputs: object,
) -> Run:
    block = ArmInContact(arm, surface, settings, q)
    return run_block(block, duration, period=settings.period, **inputs)  # type: ignore[arg-type]


@pytest.fixture(scope="package")
def run() -> Callable[..., Run]:
    """Return a function that runs a block with constant inputs."""
    return run_block


@pytest.fixture(scope="package")
def simulate() -> Callable[..., Run]:
    """Return a function that runs an arm at a surface, by default one out of reach."""
    return simulate_arm
