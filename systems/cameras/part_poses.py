"""The poses of the peg and the hole part as ports of the cameras that draw them."""

from typing import Any

from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem

from chamfer.systems.pose import POSE_SIZE, pose_from_vector


class PosePorts:
    """The inputs ``peg_pose`` and ``hole_pose`` of a system; one not connected: not in view.

    Args:
        system: Whose inputs.
        when: What is added to the names.
    """

    def __init__(self, system: LeafSystem, when: str = "") -> None:
        self._ports: list[Any] = [
            system.DeclareVectorInputPort(f"{name}{when}", POSE_SIZE)
            for name in ("peg_pose", "hole_pose")
        ]

    def read(self, context: Context) -> tuple[RigidTransform | None, RigidTransform | None]:
        """Return X_WT of the peg and X_WM of the hole part.

        None where a port is not connected, or the zeros of a hold that has not sampled yet.
        """
        peg, hole = (_read(port, context) for port in self._ports)
        return peg, hole

    def tickets(self) -> set[Any]:
        """Return what an output that reads the poses depends on."""
        return {port.ticket() for port in self._ports}


def _read(port: Any, context: Context) -> RigidTransform | None:
    if not port.HasValue(context):
        return None
    pose = port.Eval(context)
    return pose_from_vector(pose) if pose.any() else None
