"""Kinematics of an arm by Drake."""

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from chamfer.models.arms.serial_arm import FlangeState

Array = NDArray[np.float64]


class PlantKinematics:
    """Where the flange of a URDF's arm is, in its base frame; called with joint positions.

    It owns a plant and a context.

    Raises:
        RuntimeError, ValueError: At construction if Drake does not take the URDF.
    """

    def __init__(self, urdf: str, base: str, flange: str) -> None:
        self.plant = arm_alone(urdf, base)
        self.context = self.plant.CreateDefaultContext()
        self.flange = self.plant.GetFrameByName(flange)
        self._origin = np.zeros(3)

    def __call__(self, q: Array) -> FlangeState:
        """Return where the flange is at joint positions q, rad, shape (n,)."""
        plant, context, base = self.plant, self.context, self.plant.world_frame()
        plant.SetPositions(context, q)
        X_BF = self.flange.CalcPoseInWorld(context)
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, self.flange, self._origin, base, base
        )
        return FlangeState(X_BF.rotation().matrix(), X_BF.translation(), J)


def arm_alone(urdf: str, base: str) -> MultibodyPlant:
    """Return a plant whose world is the arm's base.

    Raises:
        RuntimeError, ValueError: If Drake does not take the URDF.
    """
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(urdf, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base))
    plant.Finalize()
    return plant
