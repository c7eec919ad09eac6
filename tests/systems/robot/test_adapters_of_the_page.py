"""The adapters that docs/robot.md shows, against stand-ins for the libraries that they call."""

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

PAGE = Path(__file__).parents[3] / "docs/robot.md"
VELOCITY = np.array([0.1, 0.2, 0.3, 0.01, 0.02, 0.03])  # rad/s above m/s
THEIRS = [0.01, 0.02, 0.03, 0.1, 0.2, 0.3]


@pytest.mark.parametrize("name", ["UniversalRobot", "Franka"])
def test_an_adapter_reads_and_writes_in_their_order(name: str) -> None:
    scripts = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), flags=re.DOTALL)
    (script,) = (one for one in scripts if f"class {name}" in one)
    assert len(script.partition("class")[2].splitlines()) <= 36
    library: Any = mock.MagicMock()
    receive, state = library.RTDEReceiveInterface(), mock.MagicMock()
    receive.getActualTCPPose.return_value = [1.0, 2, 3, 0, 0, 0]
    receive.getActualTCPForce.return_value = [1.0, 2, 3, 4, 5, 6]
    receive.getTimestamp.return_value = state.time.to_sec.return_value = 7.0
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec([0, 0, 1]).as_matrix(), [1, 2, 3]
    state.O_T_EE, state.O_F_ext_hat_K = pose.ravel(order="F"), [-1.0, -2, -3, -4, -5, -6]
    control = library.Robot().start_cartesian_velocity_control()
    control.readOnce.return_value = state, None
    names: dict[str, Any] = {}
    modules: dict[str, ModuleType] = dict.fromkeys(
        ("rtde_control", "rtde_receive", "pylibfranka"), library
    )
    with mock.patch.dict(sys.modules, modules):
        exec(compile(script, "page", "exec"), names)
    robot = names[name]("10.0.0.2", **({"acceleration": 1.0} if name == "UniversalRobot" else {}))
    if name == "Franka":
        assert robot.clock() == 7.0
    reading = robot.read()
    assert reading.time == 7.0
    assert reading.values["position"].tolist() == [1, 2, 3]
    assert reading.values["wrench"].tolist() == [4, 5, 6, 1, 2, 3]
    robot.write({"velocity": VELOCITY})
    told = library.RTDEControlInterface().speedL
    told = library.CartesianVelocities if name == "Franka" else told
    assert told.call_args.args[0] == THEIRS
    robot.stop()
    robot.stop()
