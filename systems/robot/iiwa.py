"""An iiwa that is reached by Drake's messages, which drake-iiwa-driver speaks."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from drake import lcmt_iiwa_command, lcmt_iiwa_status
from numpy.typing import NDArray
from pydrake.lcm import DrakeLcmInterface, Subscriber

from chamfer.models.validation import ParameterError
from chamfer.systems.robot.command_guard import Reading

Array = NDArray[np.float64]

JOINTS: Final = 7
POSITION, TORQUE = "joint_position", "joint_torque"  # commands: rad, N m
_READ: Final = {  # by the name in the message; torques there have the sign against the actuators'
    "joint_position_measured": 1.0,  # rad
    "joint_velocity_estimated": 1.0,  # rad/s, filtered by the driver
    "joint_position_commanded": 1.0,  # rad
    "joint_torque_measured": -1.0,  # N m, as actuators push
    "joint_torque_commanded": -1.0,  # N m
    "joint_torque_external": 1.0,  # N m, of what touches the arm
}


class Iiwa:
    """An iiwa behind ``IIWA_STATUS`` and ``IIWA_COMMAND``.

    What it reads has the names of the status, shape (7,) each, torques with the sign of
    actuators. It takes ``joint_position``, ``joint_torque``, which is added to the weight that the
    arm carries itself, or both, as the application on its cabinet has it.
    """

    def __init__(self, lcm: DrakeLcmInterface, *, period: float = 0.005, prefix: str = "IIWA"):
        self.period = period
        self._lcm, self._channel = lcm, f"{prefix}_COMMAND"
        self._status = Subscriber(lcm, f"{prefix}_STATUS", lcmt_iiwa_status)
        self._sent: Mapping[str, Array] = {}

    @property
    def ready(self) -> bool:
        """Whether the arm has said how it is, with a time: the driver says -1 before it knows it.

        The driver takes commands only from 0.25 s after its first message on.
        """
        self._lcm.HandleSubscriptions(0)
        return bool(self._status.count > 0 and self._status.message.utime >= 0)

    def read(self) -> Reading:
        """Return what the last message says.

        Raises:
            ParameterError: If there was none yet, or it is of another number of joints.
        """
        self._lcm.HandleSubscriptions(0)
        message = self._status.message
        if message.num_joints != JOINTS:
            raise ParameterError(
                "num_joints", message.num_joints, f"{JOINTS}, of an iiwa's status"
            )
        values = {name: sign * np.array(getattr(message, name)) for name, sign in _READ.items()}
        return Reading(message.utime * 1e-6, values)

    def write(self, command: Mapping[str, Array]) -> None:
        """Send positions, torques, or both."""
        message = lcmt_iiwa_command()
        message.utime = self._status.message.utime
        if POSITION in command:
            message.num_joints = JOINTS
            message.joint_position = command[POSITION].tolist()
        if TORQUE in command:
            message.num_torques = JOINTS
            message.joint_torque = command[TORQUE].tolist()
        self._lcm.Publish(self._channel, message.encode())
        self._sent = command

    def stop(self) -> None:
        """Stay where it was sent last, and take the torque away."""
        if self._sent:
            still = np.zeros(JOINTS)
            self.write({name: still if name == TORQUE else q for name, q in self._sent.items()})
