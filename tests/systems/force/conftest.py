"""Blocks that are run tick by tick, and the contact the hybrid controller is mostly run in."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.arm import Arm
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.force.hybrid_law import HybridControllerParams, LawKind

Array = np.ndarray


class Driven:
    """A block that is fed one set of inputs a tick; what is not given stays."""

    def __init__(self, block: Any, period: float, output: str, **inputs: Any) -> None:
        self.block, self.period, self.output = block, period, output
        self.simulator = Simulator(block)
        self.context: Any = self.simulator.get_mutable_context()
        self.ticks = 0
        self.feed(**inputs)

    def feed(self, **inputs: Any) -> None:
        for name, value in inputs.items():
            port = self.block.GetInputPort(name)
            port.FixValue(self.context, np.atleast_1d(np.asarray(value, dtype=float).ravel()))

    def tick(self, **inputs: Any) -> Array:
        """Feed the next tick, run it and return the output."""
        self.feed(**inputs)
        self.simulator.AdvanceTo(self.ticks * self.period)
        self.simulator.AdvancePendingEvents()
        self.ticks += 1
        return self.read(self.output)

    def read(self, name: str) -> Array:
        found: Array = self.block.GetOutputPort(name).Eval(self.context).copy()
        return found


def hybrid(
    params: HybridControllerParams, arm: Arm, q: Array, dynamics: ArmDynamics | None
) -> Driven:
    """Return a driven hybrid controller of an arm at rest."""
    n = arm.num_joints
    return Driven(
        HybridController(arm, params, dynamics=dynamics),
        params.period,
        "torque",
        encoders=np.concatenate([q, np.zeros(n)]),
        desired_position=arm.endpoint(q),
        desired_force=np.zeros(n),
        measured_force=np.zeros(n),
        selection=np.eye(n),
        mode=0,
    )


class Contact:
    """The planar arm where it meets the crucible: (1, -1.5), pushing along -y.

    Called, it returns inputs in contact at rest, with errors of position and force.
    """

    def __init__(self) -> None:
        self.x = np.array([1.0, -1.5])
        self.q = PLANAR_TWO_LINK.joint_positions(self.x, "negative")
        self.rest = np.concatenate([self.q, np.zeros(2)])
        self.J = np.array(  # written out for this pose
            [[1.5, -math.sin(self.q.sum())], [1.0, math.cos(self.q.sum())]]
        )

    def __call__(self, **changes: Any) -> dict[str, Any]:
        inputs = {
            "encoders": self.rest,
            "desired_position": self.x + np.array([0.02, -0.1]),
            "desired_force": np.array([0.0, -15.0]),
            "measured_force": np.array([4.0, -11.0]),
            "selection": np.diag([1.0, 0.0]),
            "mode": 1,
        }
        return {**inputs, **changes}

    def tip_force(self, torque: Array) -> Array:
        """Return the force on the environment that a torque at this pose stands for."""
        found: Array = np.linalg.solve(self.J.T, torque)
        return found


# The scope lets tests with hypothesis use them; none of them keeps anything.


@pytest.fixture(scope="package")
def driven() -> type[Driven]:
    """Return what drives a block."""
    return Driven


@pytest.fixture(scope="package")
def contact() -> Contact:
    return Contact()


@pytest.fixture(scope="package")
def make_params() -> Callable[..., HybridControllerParams]:
    """Return a function that makes the parameters of a controller of the planar arm."""

    def make(law: LawKind = "inverse", **changes: Any) -> HybridControllerParams:
        fields: dict[str, Any] = {
            "law": law,
            "stiffness": (400.0, 300.0),
            "integral": (200.0, 100.0),
            "damping": (60.0, 40.0),
            "force_integral": 3.0,
            "feedforward_torque": (),
            "period": 0.25,  # binary, so that the ticks' times are exact
        }
        return HybridControllerParams(**{**fields, **changes})

    return make


@pytest.fixture(scope="package")
def drive(
    make_params: Callable[..., HybridControllerParams], contact: Contact
) -> Callable[..., Driven]:
    """Return a function that drives the planar arm's controller, given changes of parameters."""

    def start(law: LawKind = "inverse", **changes: Any) -> Driven:
        return hybrid(make_params(law, **changes), PLANAR_TWO_LINK, contact.q, None)

    return start


@pytest.fixture(scope="package")
def drive_arm() -> Callable[..., Driven]:
    """Return a function that drives the controller of any arm, all joints at 0.5."""

    def start(
        arm: Arm, params: HybridControllerParams, dynamics: ArmDynamics | None = None
    ) -> Driven:
        return hybrid(params, arm, np.full(arm.num_joints, 0.5), dynamics)

    return start
