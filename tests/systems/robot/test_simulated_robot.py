"""A simulated robot's end of its connection, and who may talk to it."""

import time
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.systems.law import HeldLaw, Signal
from chamfer.systems.robot.link import LinkError, process
from chamfer.systems.robot.remote_controller import RemoteController
from chamfer.systems.robot.simulated_robot import SimulatedRobot

START = np.array([1.0, 0, 0, 0, 0, 0, 0])
FORWARD = np.array([0.0, 0, 0, 1, 0, 0])


class Command(NamedTuple):
    arm_pose: Any
    arm_velocity: Any


class Still(HeldLaw[None, Any, Command]):
    period = 0.01

    def __init__(self) -> None:
        self.inputs = {"force": Signal(unit="N")}
        self.outputs = {"arm_pose": Signal(7), "arm_velocity": Signal(6)}

    def start(self) -> None: ...

    def observe(self, values: Any) -> Any: ...

    def update(self, state: None, observation: Any, time: float) -> None: ...

    def command(self, state: None) -> Command:
        return Command(START, np.zeros(6))


class Wire:
    """Answers the measurements with what it has, None for none."""

    def __init__(self, *answers: Any) -> None:
        self.answers, self.heard = list(answers), list[Any]()

    def send(self, message: Any) -> None:
        self.heard.append(message)

    def receive(self, timeout: float | None) -> Any:
        return self.answers.pop(0) if self.answers else None


def at(time: float, x: float) -> dict[str, Any]:
    return {"time": [time], "arm_pose": [*START[:4], x, 0, 0], "arm_velocity": FORWARD.tolist()}


def places(*answers: Any, times: tuple[float, ...]) -> list[tuple[float, float]]:
    """Return where the robot is told to be, and its velocity, after some answers."""
    wire: Any = Wire(*answers)
    robot = RemoteController(Still(), wire, waits=0.0, timeout=0.02)
    simulator = Simulator(robot)
    context = simulator.get_mutable_context()
    robot.GetInputPort("force").FixValue(context, [3.0])
    found = []
    for moment in times:
        simulator.AdvanceTo(moment)
        one = [robot.GetOutputPort(f"arm_{name}").Eval(context) for name in ("pose", "velocity")]
        found.append((round(float(one[0][4]), 9), float(one[1][3])))
    assert (
        wire.heard[0].items()
        >= {"time": [0.0], "force": [3.0], "arm_pose": START.tolist()}.items()
    )
    return found


@pytest.mark.parametrize(
    ("answers", "times", "expected"),
    [
        # It goes on until nothing was heard for too long.
        ([at(0.0, 0.5)], (0.005, 0.015, 0.025), [(0.505, 1.0), (0.515, 1.0), (0.52, 0.0)]),
        # What comes late counts from the next period on, as of its time.
        ([None, at(0.0, 0.5), at(0.01, 0.7)], (0.005, 0.015), [(0.0, 0.0), (0.705, 1.0)]),
        # Told to stop it stays where it is, whatever comes after.
        ([at(0.0, 0.5), {"stop": []}, at(0.01, 0.7)], (0.005, 0.015), [(0.505, 1.0), (0.51, 0.0)]),
    ],
)
def test_a_robot_does_what_it_heard_last(answers: Any, times: Any, expected: Any) -> None:
    assert places(*answers, times=times) == expected


@pytest.fixture
def serve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Make a module of some lines, with ``order`` and ``link``, for a process to run."""

    def make(lines: str) -> str:
        text = "from chamfer.systems.robot.link import served\norder, link = served()\n"
        (tmp_path / "other_side.py").write_text(text + lines)
        return "other_side"

    root = Path(__file__).parents[3]
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{root / 'src'}")
    return make


def test_nobody_without_the_key_is_listened_to(serve: Any, monkeypatch: Any) -> None:
    refused = []

    def after_a_stranger(address: Any, authkey: bytes) -> Any:
        assert address[0] == "127.0.0.1"
        with pytest.raises((AuthenticationError, EOFError, OSError)):
            Client(address, authkey=b"guessed")
        refused.append(address)
        return Client(address, authkey=authkey)

    monkeypatch.setattr("chamfer.systems.robot.link.Client", after_a_stranger)
    with process(serve("link.send({'x': order['x']})"), {"x": [1.5, float("inf")]}) as link:
        assert link.receive(10.0) == {"x": [1.5, float("inf")]}
    assert refused


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("link.fail('no arm')", "has failed: no arm"),
        ("import time; time.sleep(60)", "does not answer for 0.1 s"),
    ],
)
def test_a_robot_that_is_not_there_is_told(
    serve: Any, lines: str, said: str, monkeypatch: Any
) -> None:
    monkeypatch.setattr(
        "chamfer.systems.robot.simulated_robot._STARTING", 0.1 if "0.1" in said else 10
    )
    monkeypatch.setattr("chamfer.systems.robot.link._ENDING", 0.1)
    began = time.monotonic()
    with pytest.raises(LinkError, match=said), process(serve(lines), {}) as link:
        SimulatedRobot(link, period=0.01).clock()
    assert time.monotonic() - began < 10
