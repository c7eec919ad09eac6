"""An arm's equations of motion, from Drake's MultibodyPlant."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from models.arms.arm import Arm
from models.validation import ParameterError

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2


class ArmState(NamedTuple):
    """What the equations of motion need at one state of n joints."""

    mass: Array  # (n, n), reflected rotor inertias included
    bias: Array  # (n,), Coriolis and centripetal less gravity torque: M v' + bias = torque
    R_WE: Array  # (3, 3), rotation of the endpoint's frame
    p_WC: Array  # (3,), m, the contact point
    J_v_WC: Array  # (3, n), its translational Jacobian


class ArmDynamics:
    """Evaluates an arm's mass matrix, bias and contact point (2-1, without friction).

    It owns a plant and a context; the contact point is fixed in the arm's endpoint frame.

    Args:
        arm: The arm; its base is welded to the world.
        gravity: Whether gravity acts, along -z.
        contact_offset: m, shape (3,), the contact point in the endpoint's frame.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        gravity: bool = True,
        contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        if not all(math.isfinite(value) for value in contact_offset):
            raise ParameterError("contact_offset", contact_offset, "three finite numbers")
        plant = MultibodyPlant(0.0)
        Parser(plant).AddModels(str(arm.urdf))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY * gravity])
        plant.Finalize()
        self.arm = arm
        self._plant = plant
        self._context = plant.CreateDefaultContext()
        self._world = plant.world_frame()
        self._endpoint = plant.GetFrameByName("endpoint")
        self._offset = np.array(contact_offset)
        self._gravity = gravity

    def evaluate(self, q: Array, v: Array) -> ArmState:
        """Return the equations of motion at joint positions q and velocities v, shape (n,)."""
        plant, context = self._plant, self._context
        plant.SetPositionsAndVelocities(context, np.concatenate([q, v]))
        mass = plant.CalcMassMatrix(context)
        bias = plant.CalcBiasTerm(context)
        if self._gravity:
            bias = bias - plant.CalcGravityGeneralizedForces(context)
        pose = self._endpoint.CalcPoseInWorld(context)
        jacobian = plant.CalcJacobianTranslationalVelocity(
            context,
            JacobianWrtVariable.kV,
            self._endpoint,
            self._offset,
            self._world,
            self._world,
        )
        rotation = pose.rotation().matrix()
        point = pose.translation() + rotation @ self._offset
        return ArmState(mass, bias, rotation, point, jacobian)

    def orientation(self, q: Array) -> Array:
        """Return the rotation of the endpoint's frame at joint positions q, shape (3, 3)."""
        self._plant.SetPositions(self._context, q)
        rotation: Array = self._endpoint.CalcPoseInWorld(self._context).rotation().matrix()
        return rotation

    def gravity_torque(self, q: Array) -> Array:
        """Return the torque that holds the arm at rest at q, shape (n,)."""
        return self.evaluate(q, np.zeros(len(q))).bias
