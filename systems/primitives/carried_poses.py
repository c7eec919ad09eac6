"""What a carriage carries, as poses for the cameras that see it."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.arms.wrist import SIZE, tip_displacement, tip_pose
from chamfer.models.validation import ParameterError
from chamfer.systems.pose import POSE_SIZE, pose_from_vector, pose_vector


class CarriedPoses(LeafSystem):
    """Gives the poses of what is fixed to a carriage.

    .. pydrake_system::

        name: CarriedPoses
        input_ports:
        - displacement
        output_ports:
        - (<name>_pose of each thing)

    ``displacement``, shape (6,), rad above m, is that of
    :func:`chamfer.models.arms.wrist.tip_pose`: the integral of a velocity while the carriage turns
    about one axis, and nearly so for small turns. The poses are in the world, shape (7,):
    quaternion w, x, y, z and position in m.

    Args:
        carried: X_EB of each thing in the carriage's frame, by its name.

    Raises:
        ParameterError: If nothing is carried.
    """

    def __init__(self, carried: Mapping[str, RigidTransform]) -> None:
        super().__init__()
        if not carried:
            raise ParameterError("carried", dict(carried), "one thing or more")
        displacement = self.DeclareVectorInputPort("displacement", 6)

        def reader(X_EB: RigidTransform) -> Callable[[Context, BasicVector], None]:
            def calc(context: Context, vector: Any) -> None:
                X_WE = tip_pose(displacement.Eval(context))
                vector.SetFromVector(pose_vector(X_WE @ X_EB))

            return calc

        for name, X_EB in carried.items():
            self.DeclareVectorOutputPort(
                f"{name}_pose", POSE_SIZE, reader(X_EB), {displacement.ticket()}
            )


class PoseDisplacement(LeafSystem):
    """Gives the displacement of a pose, :class:`CarriedPoses` undone.

    .. pydrake_system::

        name: PoseDisplacement
        input_ports:
        - pose
        output_ports:
        - displacement

    ``pose``, shape (7,), quaternion and position, m; ``displacement``, shape (6,), rad above m,
    its turn about z between -pi and pi.
    """

    def __init__(self) -> None:
        super().__init__()
        pose = self.DeclareVectorInputPort("pose", POSE_SIZE)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(tip_displacement(pose_from_vector(pose.Eval(context))))

        self.DeclareVectorOutputPort("displacement", SIZE, calc, {pose.ticket()})


class TrueMotion(LeafSystem):
    """Picks a body's true displacement and velocity out of a plant's; not for controllers.

    .. pydrake_system::

        name: TrueMotion
        input_ports:
        - body_poses
        - body_velocities
        output_ports:
        - motion

    The inputs are the plant's ports of these names. ``motion``, shape (12,), is the displacement,
    rad above m, and the velocity, rad/s above m/s in the world's axes.
    """

    def __init__(self, body: BodyIndex) -> None:
        super().__init__()
        index = int(body)
        poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        velocities = self.DeclareAbstractInputPort(
            "body_velocities", Value[list[SpatialVelocity]]()
        )

        def calc(context: Context, vector: BasicVector) -> None:
            X, V = poses.Eval(context)[index], velocities.Eval(context)[index]
            vector.SetFromVector(
                np.concatenate([tip_displacement(X), V.rotational(), V.translational()])
            )

        self.DeclareVectorOutputPort(
            "motion", 2 * SIZE, calc, {poses.ticket(), velocities.ticket()}
        )
