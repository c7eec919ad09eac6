"""An iiwa behind Drake's messages, which drake-iiwa-driver uses."""

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

    Its readings have the names of the status, shape (7,) each; torques have the sign of actuators.
    It accepts ``joint_position``, ``joint_torque``, which is added to the arm's own gravity
    compensation, or both, as the application on its cabinet requires.
    """

    def __init__(self, lcm: DrakeLcmInterface, *, period: float = 0.005) -> None:
        self.period, self._lcm = period, lcm
        self._status = Subscriber(lcm, "IIWA_STATUS", lcmt_iiwa_status)
        self._sent = lcmt_iiwa_command()

    @property
    def ready(self) -> bool:
        """Whether the arm has sent its state with a time: the driver sends -1 before it knows it.

        The driver takes commands only from 0.25 s after its first message on.
        """
        self._lcm.HandleSubscriptions(0)
        return bool(self._status.count > 0 and self._status.message.utime >= 0)

    def read(self) -> Reading:
        """Return the content of the last message.

        Raises:
            ParameterError: If there was none yet, or it is of another number of joints.
        """
        self._lcm.HandleSubscriptions(0)
        message = self._status.message
        if message.num_joints != JOINTS:
            raise ParameterError("num_joints", message.num_joints, f"{JOINTS}, of a status")
        values = {name: sign * np.array(getattr(message, name)) for name, sign in _READ.items()}
        return Reading(message.utime * 1e-6, values)

    def write(self, command: Mapping[str, Array]) -> None:
        """Send positions, rad, torques, N m, or both."""
        message = self._sent = lcmt_iiwa_command()
        if "joint_position" in command:
            message.num_joints = JOINTS
            message.joint_position = command["joint_position"].tolist()
        if "joint_torque" in command:
            message.num_torques = JOINTS
            message.joint_torque = command["joint_torque"].tolist()
        self._publish()

    def stop(self) -> None:
        """Stay at the last commanded position, and remove the torque."""
        self._sent.joint_torque = [0.0] * self._sent.num_torques
        if self._sent.num_joints or self._sent.num_torques:
            self._publish()

    def _publish(self) -> None:
        self._sent.utime = self._status.message.utime
        self._lcm.Publish("IIWA_COMMAND", self._sent.encode())
