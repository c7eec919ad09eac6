"""Vision primitives on ideal detections: pinhole points, sampled, one frame late."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.primitive import STILL, Observation
from chamfer.systems.primitives.vision_primitives import (
    FixedPointRotation,
    VisRotation,
    VisTranslation,
)
from chamfer.systems.primitives.visual_servoing import Servoing, StaticCameras
from chamfer.systems.vision.detections import Detection, Status, pack_detections

Array = np.ndarray
FRAME = 0.03  # s, three ticks
TICK = 0.01


@lru_cache
def true(view: Any) -> Camera:
    return CameraPlacement(view=view, roll=math.pi / 2).camera


TRUE = StaticCameras(xz=true("xz"), yz=true("yz"))
DOWN = np.array([0.0, 0.0, -1.0])


def seen(camera: Camera, tip: Array, direction: Array) -> Detection:
    """A part as a pinhole sees it; the frame's x axis is along ``direction``."""
    pixel, ahead = camera.project(np.array([tip, tip + 1e-4 * direction]))
    u, v = pixel.tolist()
    angle = math.atan2(*(ahead - pixel)[::-1])
    return Detection(status=Status.VALID, tip=(u, v), angle=angle, point=(u, v))


class Loop:
    """A carriage that obeys at once, and frames that arrive one period after their exposure."""

    def __init__(self, start: Any, target: Any, *, arm: Any = (0.0, 0.0, 0.0)) -> None:
        self.carriage = np.array(start, dtype=float)
        self.target = np.array(target, dtype=float)
        self.arm = np.array(arm)
        self.blind: Callable[[float], bool] = lambda time: False
        self.path: list[Array] = []
        self.event: Any = None

    def tip(self, carriage: Array) -> Array:
        return carriage[3:] + Rotation.from_rotvec(carriage[:3]).apply(self.arm)

    def detections(self) -> dict[str, tuple[float, ...]]:
        found = {}
        for view in ("xz", "yz"):
            camera = true(view)
            poses = [(self.tip(self.carriage), self.carriage), (self.target[3:], self.target)]
            parts = [
                seen(camera, tip, Rotation.from_rotvec(pose[:3]).apply(DOWN))
                for tip, pose in poses
            ]
            found[f"{view}_detections"] = tuple(pack_detections(*parts).tolist())
        return found

    def run(self, primitive: Any, duration: float) -> "Loop":
        memory: Any = None
        blank = tuple(pack_detections(*[Detection(status=Status.NO_IMAGE)] * 2).tolist())
        nothing = {f"{view}_detections": blank for view in ("xz", "yz")}
        underway, arrived = nothing, nothing
        for k in range(round(duration / TICK)):
            if k % 3 == 0:
                arrived, underway = underway, self.detections()
                if self.blind(k * TICK):
                    underway = nothing
                self.path.append(self.carriage.copy())
            carriage = tuple(self.carriage.tolist())
            sensed = Observation(carriage, STILL, STILL, **arrived)
            if k == 0:
                memory = primitive.begin(sensed)
            memory, velocity, self.event = primitive.step(sensed, memory, k * TICK)
            if self.event is not None:
                break
            self.carriage += TICK * np.array(velocity)
        return self

    @property
    def way(self) -> Array:
        """From the target's tip, at the frames, m, shape (n, 3)."""
        return np.array([self.tip(one) for one in self.path]) - self.target[3:]


FAST = {"speed": 10.0, "tolerance": 1e-3}
ENDLESS = Servoing(period=FRAME, ends=False)
TARGET = (0.0, 0.0, 0.0, 0.003, -0.002, -0.01)


def servoing(gain: float) -> Servoing:
    return Servoing(period=FRAME, gain=gain, ends=False)


def test_translation_follows_the_recursion_of_one_frame_of_delay() -> None:
    gain = 0.4
    primitive = VisTranslation(axes=("x",), cameras=TRUE, servoing=servoing(gain), **FAST)
    start, target = (0, 0, 0, 0.02, 0, -0.01), (0, 0, 0, 0.003, 0, -0.01)
    way = Loop(start, target).run(primitive, 1.0).way[:, 0]
    expected = [way[0], way[0]]
    while len(expected) < len(way):
        expected.append(expected[-1] - gain * expected[-2])
    np.testing.assert_allclose(way, expected, atol=1e-8)
    assert way.min() < -1e-3  # beyond a quarter it overshoots


@pytest.mark.parametrize("axes", [("x",), ("y",), ("z",), ("x", "z"), ("y", "z"), ("x", "y")])
def test_only_the_chosen_axes_move_and_reach_their_goal(axes: Any) -> None:
    primitive = VisTranslation(axes=axes, cameras=TRUE, servoing=Servoing(period=FRAME))
    assert primitive.label == "vis_" + "".join(axes)
    start = np.array([0.01, -0.008, 0.012])
    loop = Loop((0, 0, 0, *start), (0, 0, 0, 0, 0, 0)).run(primitive, 4.0)
    assert loop.event == "done"
    for k, axis in enumerate("xyz"):
        if axis in axes:
            # What is not corrected is at another depth: 2 % of some pixels.
            assert loop.way[-1, k] == pytest.approx(0, abs=6e-4)
        else:
            assert loop.way[-1, k] == start[k]


def test_offset_goes_to_the_image_by_the_believed_perspective() -> None:
    offset = (0.004, -0.003, 0.01)
    start = (0, 0, 0, 0.02, 0.015, 0.02)
    right = VisTranslation(cameras=TRUE, offset=offset, servoing=Servoing(period=FRAME))
    loop = Loop(start, TARGET).run(right, 4.0)
    np.testing.assert_allclose(loop.way[-1], offset, atol=3e-4)
    # A focal length that is believed too long makes the offset too long.
    long = {"focal_factor": 1.2, "turn": (0.0, 0.0, 0.0)}
    cameras = StaticCameras(**{view: true(view).miscalibrated(**long) for view in ("xz", "yz")})
    wrong = VisTranslation(cameras=cameras, offset=offset, servoing=Servoing(period=FRAME))
    loop = Loop(start, TARGET).run(wrong, 4.0)
    assert loop.event == "done"
    np.testing.assert_allclose(loop.way[-1], np.multiply(1.2, offset), atol=4e-4)


def test_the_speed_is_limited() -> None:
    primitive = VisTranslation(cameras=TRUE, speed=0.03, servoing=Servoing(period=FRAME))
    loop = Loop((0, 0, 0, 0.02, 0.02, 0.02), TARGET).run(primitive, 4.0)
    speeds = np.linalg.norm(np.diff(loop.way, axis=0), axis=1) / FRAME
    assert speeds.max() == pytest.approx(0.03, rel=1e-6)
    assert loop.event == "done"


def primitives() -> list[Any]:
    return [
        VisTranslation(cameras=TRUE, servoing=ENDLESS),
        VisRotation(cameras=TRUE, servoing=ENDLESS),
        FixedPointRotation(cameras=TRUE, servoing=ENDLESS),
    ]


@pytest.mark.parametrize("primitive", primitives(), ids=lambda one: one.label)
def test_blind_it_stands_still_and_is_lost(primitive: Any) -> None:
    loop = Loop((0.1, 0.1, 0, 0.02, 0, 0.02), TARGET)
    loop.blind = lambda time: 0.3 <= time < 0.5 or time >= 0.9
    loop.run(primitive, 3.0)
    assert loop.event == "lost"
    # The frame that fails at 0.9 s would arrive at 0.93 s; ten more, and a shorter gap is borne.
    moves = np.abs(np.diff(np.array(loop.path), axis=0)).max(axis=1) > 0
    last = 0.93 + 10 * FRAME
    assert len(loop.path) - 1 == pytest.approx(last / FRAME, abs=1)
    assert not moves[round(0.93 / FRAME) :].any()
    assert moves[round(0.6 / FRAME)]
    assert not moves[round(0.42 / FRAME)]


@pytest.mark.parametrize("axes", [("x", "y"), ("x",), ("y",)])
def test_rotation_aligns_the_axes_in_the_images(axes: Any) -> None:
    primitive = VisRotation(axes=axes, cameras=TRUE, servoing=Servoing(period=FRAME))
    assert primitive.label == "vis_r" + "".join(axes)
    loop = Loop((0.2, -0.15, 0, 0.01, 0, 0.02), (0.05, 0.08, 0, *TARGET[3:])).run(primitive, 4.0)
    assert loop.event == "done"
    end = loop.path[-1]
    for k, axis in enumerate("xy"):
        if axis in axes:
            assert end[k] == pytest.approx((0.05, 0.08)[k], abs=0.006)
        else:
            assert end[k] == (0.2, -0.15)[k]
    np.testing.assert_array_equal(end[2:], loop.path[0][2:])


ARM = (0.01, 0.002, -0.04)


@pytest.mark.parametrize("view", ["xz", "yz"])
@pytest.mark.parametrize(("angle", "leaning"), [(0.2, 0.0), (-0.15, 0.0), (0.15, 0.1)])
def test_fixed_point_turns_and_stays(view: Any, angle: float, leaning: float) -> None:
    index = 1 if view == "xz" else 0
    start = np.array([0, 0, 0, 0.005, 0, 0.04])
    start[index] = leaning
    lever = tuple(Rotation.from_rotvec(start[:3]).apply(ARM).tolist())
    primitive = FixedPointRotation(
        view=view, cameras=TRUE, angle=angle, lever=lever, servoing=Servoing(period=FRAME)
    )
    assert primitive.label == "vis_fixed_r" + "xy"[index]
    loop = Loop(tuple(start.tolist()), TARGET, arm=ARM).run(primitive, 4.0)
    assert loop.event == "done"
    assert loop.path[-1][index] - leaning == pytest.approx(angle, abs=0.004)
    camera = true(view)
    pixels = camera.project(loop.way + loop.target[3:])
    assert np.abs(pixels - pixels[0]).max() < 0.15
    # The turn alone would take the point 16 px away.
    assert 1000 * abs(angle) * 0.041 / 0.5 > 10


def test_cameras_that_are_believed_to_look_the_same_way_are_refused() -> None:
    cameras = StaticCameras(xz=true("xz"), yz=true("xz"))
    for kind in (VisTranslation, VisRotation):
        with pytest.raises(ParameterError, match=r"^least to largest sensitivity of the cameras"):
            kind(cameras=cameras)
