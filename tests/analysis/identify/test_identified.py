"""Logs whose truth is known, and recordings: what identify says of them, and how surely."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.identified import Quantity, identify
from chamfer.analysis.identify.log import Log, read_log
from chamfer.analysis.scenario.errors import UserError
from chamfer.models.recordings.recordings import slide_path

Array = NDArray[np.float64]
Simulate = Callable[..., list[Log]]
Found = Mapping[str, Quantity]

SLIDE: Mapping[str, float] = {
    "friction": 0.22, "contact.stiffness": 4e4, "delay": 0.03, "sensor.noise": 0.06,
    "stiffness.x": 600.0, "stiffness.y": 700.0, "stiffness.z": 650.0,
    "damping.x": 60.0, "damping.y": 75.0, "damping.z": 90.0,
    "sensor.rotation.x": 0.02, "sensor.rotation.y": -0.01, "sensor.rotation.z": 0.0,
    "sensor.rotation": np.hypot(0.02, 0.01),
    "sensor.offset.x": 0.0, "sensor.offset.y": 0.8, "sensor.offset.z": -0.8,
}  # fmt: skip
WEIGHT = {
    "touches": np.inf, "tool_mass": 1.2, "tool_axes": True, "turning": 0.8,
    "tool_centre": (0.01, -0.005, 0.06), "rotation": (0.03, 0.0, -1.57),
    "drift": (0.03, 0.0, -0.04), "offset": (-0.24, 0.8, -0.48), "duration": 16.0,
}  # fmt: skip
WEIGHED: Mapping[str, float] = {
    "tool.mass": 1.2, "sensor.rotation.x": 0.03, "sensor.rotation.y": 0.0,
    "sensor.rotation.z": -1.57, "tool.centre_of_mass.x": 0.01, "tool.centre_of_mass.y": -0.005,
    "tool.centre_of_mass.z": 0.06, "sensor.offset.x": 0.0, "sensor.offset.y": 0.8,
    "sensor.offset.z": -0.8, "sensor.drift": 0.05,
}  # fmt: skip
FRICTION: Mapping[str, float] = {
    "joint_friction.coulomb_plus.1": 0.5, "joint_friction.coulomb_minus.1": 0.2,
    "joint_friction.viscous_plus.1": 0.3, "joint_friction.viscous_minus.1": 0.1,
}  # fmt: skip


def covered(found: Sequence[Found], truth: Mapping[str, float]) -> dict[str, float]:
    """Return in which share of the logs the interval holds the truth."""
    return {
        name: float(np.mean([one[name].low <= value <= one[name].high for one in found]))
        for name, value in truth.items()
    }


def joint_log(seed: int) -> Log:
    """Return a joint that swings forth and back under gravity, and one that stands still."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 30.0, 0.01)
    speed = 0.5 * np.sign(np.sin(0.8 * time)) * (1 + 0.5 * np.sin(1.7 * time + 6.0 * rng.random()))
    speed = np.convolve(speed, np.ones(20) / 20, mode="same")
    q = np.cumsum(speed) * 0.01
    torque = np.where(speed > 0, 0.5 + 0.3 * speed, -0.2 + 0.1 * speed)
    torque += 3.0 * np.cos(q) + 1.0 * np.sin(q) + 0.2 * np.gradient(speed, time)
    torque += 0.1 * np.convolve(rng.standard_normal(len(time)), np.ones(30) / 30, mode="same")
    return Log(time=time, joint_position=np.c_[q, 0 * q], joint_torque=np.c_[torque, 0 * q])


def value(found: Found, name: str) -> float:
    told = found[name].value
    assert told is not None, found[name].note
    return told


def recorded(name: str) -> Log:
    return read_log(slide_path(name))


def turned(log: Log, turn: Callable[[Array], Array]) -> Log:
    """Return a log whose forces and moments were recorded in other axes."""
    assert log.force is not None
    assert log.moment is not None
    return replace(log, force=turn(log.force), moment=turn(log.moment))


def test_intervals_hold_the_truth(simulated: Simulate) -> None:
    found = [identify(log).quantities for log in simulated(8, first=7)]
    shares = covered(found, SLIDE)
    assert min(shares.values()) >= 0.75
    assert np.mean(list(shares.values())) >= 0.92
    assert all(value(one, "contacts") == 1.0 for one in found)


@pytest.mark.slow
def test_intervals_of_95_percent_cover_95_percent(simulated: Simulate) -> None:
    slides = [replace(log, wrench_axes="base") for log in simulated(200, duration=20.0)]
    weighed = [replace(log, wrench_axes="tool") for log in simulated(200, **WEIGHT)]
    joints = [joint_log(seed) for seed in range(200)]
    for logs, truth in ((slides, SLIDE), (weighed, WEIGHED), (joints, FRICTION)):
        shares = covered([identify(log).quantities for log in logs], truth)
        assert min(shares.values()) >= 0.90, shares
        assert np.mean(list(shares.values())) <= 0.99, shares


def test_recordings_agree_with_what_is_known_of_them() -> None:
    for name, tilt in (("table_a", 1.0), ("table_b", 1.5), ("table_press", 1.0)):
        found = identify(recorded(name), told_stiffness=800.0).quantities
        assert 0.19 < value(found, "friction") < 0.24
        assert value(found, "sensor.rotation") < np.radians(tilt)
        assert 610.0 < value(found, "stiffness.z") < 690.0
        assert value(found, "sensor.unit") == pytest.approx(800 / value(found, "stiffness.z"))
        assert value(found, "contacts") == 1.0
        assert value(found, "sensor.offset.y") == pytest.approx(0.8, abs=0.05)
        assert ("too straight" in found["friction"].note) is (name == "table_press")
    free = identify(recorded("free")).quantities
    assert value(free, "contacts") == 0.0
    assert free["friction"] == (None, None, None, "", "no contact in the log")
    assert 0.1 < value(free, "tool.mass") < 0.2


def test_a_turned_sensor_is_found_in_whatever_axes_forces_are() -> None:
    log = recorded("table_a")
    assert log.rotation is not None
    tool = Rotation.from_rotvec(log.rotation)
    back = Rotation.from_euler("z", 90, degrees=True)
    as_is = identify(log).quantities
    readings = {
        "tool": turned(log, lambda f: tool.apply(back.apply(tool.inv().apply(f)))),
        "tool ": turned(log, lambda f: back.apply(tool.inv().apply(f)) / 4.4482),
        "fixed": turned(log, back.apply),
    }
    for axes, one in readings.items():
        found = identify(one).quantities
        assert axes.strip() in found["sensor.rotation.z"].note
        yaw = value(found, "sensor.rotation.z") - value(as_is, "sensor.rotation.z")
        assert np.degrees(yaw) == pytest.approx(-90.0, abs=2.0 if axes == "fixed" else 0.6)
        assert value(found, "friction") == pytest.approx(value(as_is, "friction"), abs=0.003)


@pytest.mark.parametrize(
    ("signs", "said"), [((1.0, -1.0, 1.0), "one of them points"), ((-1.0,) * 3, "turn their sign")]
)
def test_axes_that_no_rotation_mends_are_an_error(signs: tuple[float, ...], said: str) -> None:
    mirrored = turned(recorded("table_b"), lambda f: np.asarray(f * signs))
    with pytest.raises(UserError, match=f"no rotation corrects them; .*{said}"):
        identify(mirrored)


def test_other_recordings_tell_what_they_can(simulated: Simulate) -> None:
    log = recorded("table_a")
    arrays = dict(log.quantities())
    late = replace(log, **{name: values[2000:6000:2] for name, values in arrays.items()})
    found = identify(late).quantities  # begins in contact, 100 Hz
    assert found["sensor.offset.x"].note == "no part of the log is free of contact"
    assert found["friction"].note == "the sensor's offset still in"
    assert value(found, "friction") == pytest.approx(0.235, abs=0.02)
    less = identify(replace(log, reference_position=None, moment=None, rotation=None)).quantities
    assert less["delay"].note == "no reference position in the log"
    assert value(less, "friction") == pytest.approx(0.233, abs=0.005)
    (walled,) = simulated(wall=True)
    two = identify(walled).quantities
    assert value(two, "contacts") == 2.0
    assert "more than one contact" in two["friction"].note
    only_force = identify(Log(time=log.time, force=log.force))
    assert value(only_force.quantities, "sensor.noise") == pytest.approx(0.06, abs=0.01)
    assert identify(Log(time=log.time)).quantities == {}


def test_friction_of_joints_has_two_directions() -> None:
    found = identify(joint_log(5))
    assert covered([found.quantities], FRICTION) == dict.fromkeys(FRICTION, 1.0)
    one = found.quantities["joint_friction.coulomb_plus.1"]
    assert one.high - one.low < 0.1
    assert found.quantities["joint_friction.coulomb_plus.2"].note.startswith("the joint doesn't")
    assert list(found.figures()) == ["residuals"]


def test_residuals_are_drawn() -> None:
    figure = identify(recorded("table_b")).figures()["residuals"]
    titles = [axes.get_title(loc="left").split(":")[0] for axes in figure.axes]
    assert titles == [
        "Force without contact", "Height over the plane", "Force off the friction cone",
        "Impedance",
    ]  # fmt: skip
