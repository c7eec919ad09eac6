"""The frame grabber: rate, hold, latency, noise and dropped frames, each alone."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import TrajectorySource
from pydrake.systems.sensors import ImageRgba8U
from pydrake.trajectories import PiecewisePolynomial

from chamfer.systems.cameras.camera_image import (
    FrameGrabber,
    FrameGrabberParams,
    add_frame_grabber,
    read_image,
    write_image,
)

PERIOD = 1 / 80
QUIET: Any = {"noise": 0.0, "latency": 0}


class Clock(LeafSystem):
    """An image whose red is the time in tenths of a period."""

    def __init__(self, width: int = 4, height: int = 3) -> None:
        super().__init__()
        self.drawn = 0

        def calc(context: Context, output: Any) -> None:
            self.drawn += 1
            rgb = np.full((height, width, 3), 100, np.uint8)
            rgb[..., 0] = round(context.get_time() / PERIOD * 10) % 256
            write_image(output, rgb)

        model = Value(ImageRgba8U(width, height))
        self.DeclareAbstractOutputPort("image", model.Clone, calc, {self.time_ticket()})


class Reader(LeafSystem):
    """Notes the red of the image at every tick, None where there is no image."""

    def __init__(self, offset: float = 0.0) -> None:
        super().__init__()
        self._port = self.DeclareAbstractInputPort("image", Value(ImageRgba8U(4, 3)))
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, offset, self._read)
        self.seen: list[int | None] = []

    def _read(self, context: Context, values: Any) -> None:
        rgb = read_image(self._port.Eval(context))
        self.seen.append(None if rgb is None else int(rgb[0, 0, 0]))


def run(
    params: FrameGrabberParams, periods: int, offset: float = 0.0
) -> tuple[list[int | None], Clock]:
    builder = DiagramBuilder()
    clock = builder.AddSystem(Clock())
    grabber = add_frame_grabber(builder, params, "grabber", 4, 3)
    reader = builder.AddSystem(Reader(offset))
    builder.Connect(clock.get_output_port(), grabber.GetInputPort("image"))
    builder.Connect(grabber.GetOutputPort("image"), reader.get_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(0))
    Simulator(diagram, context).AdvanceTo((periods - 0.5) * PERIOD)
    return reader.seen, clock


@pytest.mark.parametrize("latency", [0, 1, 3])
@pytest.mark.parametrize("late", [0.0, 0.3, 0.9])
def test_frame_arrives_whole_periods_after_its_exposure_and_is_held(
    latency: int, late: float
) -> None:
    params = FrameGrabberParams(noise=0.0, latency=latency)
    seen, clock = run(params, 8, offset=late * PERIOD)
    assert seen == [None] * latency + [10 * k for k in range(len(seen) - latency)]
    assert clock.drawn == 8  # one image for an exposure, none between


@pytest.mark.parametrize("latency", [0, 2])
def test_without_its_trigger_nothing_is_exposed_and_no_image_arrives(latency: int) -> None:
    builder = DiagramBuilder()
    clock, reader = builder.AddSystem(Clock()), builder.AddSystem(Reader(0.5 * PERIOD))
    params = FrameGrabberParams(noise=0.0, latency=latency, offset=0.4 * PERIOD)
    grabber = add_frame_grabber(builder, params, "grabber", 4, 3)
    builder.Connect(clock.get_output_port(), grabber.GetInputPort("image"))
    looks = PiecewisePolynomial.ZeroOrderHold(
        np.array([0, 2.25, 4.25, 6.25, 7.25, 20]) * PERIOD, [[0.0, 1.0, 0.0, 1.0, 0.0, 0.0]]
    )
    trigger = builder.AddSystem(TrajectorySource(looks))
    builder.Connect(trigger.get_output_port(), grabber.GetInputPort("trigger"))
    builder.Connect(grabber.GetOutputPort("image"), reader.get_input_port())
    Simulator(builder.Build()).AdvanceTo((8 + latency) * PERIOD)
    expected = [None, None, 24, 34, None, None, 64, None]
    assert reader.seen == [None] * latency + expected
    assert clock.drawn == 3  # what is not exposed is not drawn


def test_dropped_frame_is_no_image_for_its_whole_period() -> None:
    frames, _ = run(FrameGrabberParams(noise=0.0, latency=1, miss=0.3), 250)
    assert frames[0] is None
    dropped = 0
    for k, frame in enumerate(frames[1:]):
        assert frame in (None, (10 * k) % 256)
        dropped += frame is None
    # 249 frames: standard deviation 7.2.
    assert dropped == pytest.approx(0.3 * 249, abs=22)
    assert run(FrameGrabberParams(**QUIET, miss=1.0), 20)[0] == [None] * 20


def exposed(noise: float, random: list[float], level: int = 128) -> np.ndarray:
    """Return the frame that a grabber makes of an even grey image, shape (240, 320, 4)."""
    grabber = FrameGrabber(FrameGrabberParams(noise=noise, latency=0))
    simulator = Simulator(grabber)
    context = simulator.get_mutable_context()
    image = ImageRgba8U(320, 240)
    image.mutable_data[:] = level
    image.mutable_data[..., 3] = 255
    grabber.GetInputPort("image").FixValue(context, Value(image))
    grabber.GetInputPort("random").FixValue(context, random)
    simulator.AdvanceTo(0.1 * PERIOD)
    return grabber.GetOutputPort("image").Eval(context).data.copy()


def test_noise_is_normal_and_independent_between_pixels_channels_and_frames() -> None:
    frame = exposed(4.0, [0.123, 0.9])
    noise = frame[..., :3].astype(float) - 128
    n = noise.size
    assert noise.mean() == pytest.approx(0, abs=4 * 4 / math.sqrt(n))
    # Rounding adds 1/12.
    assert noise.var() == pytest.approx(16 + 1 / 12, rel=4 * math.sqrt(2 / n))
    assert (np.abs(noise) > 8).mean() == pytest.approx(0.0336, abs=0.002)  # > 8.5 of a normal one
    other = exposed(4.0, [0.1230000001, 0.9])[..., :3].astype(float) - 128
    neighbours = [
        noise[:, 1:] * noise[:, :-1],
        noise[1:] * noise[:-1],
        noise[..., 1:] * noise[..., :-1],
        noise * other,
    ]
    for product in neighbours:
        assert abs(product.mean()) / 16 < 5 / math.sqrt(product.size)
    assert (frame[..., 3] == 255).all()


def test_missing_random_is_an_error_only_where_it_is_needed() -> None:
    for params, needed in (
        (FrameGrabberParams(noise=1.0), True),
        (FrameGrabberParams(noise=0.0, miss=0.1), True),
        (FrameGrabberParams(noise=0.0), False),
    ):
        grabber = FrameGrabber(params, 4, 3)
        grabber.set_name("camera")
        simulator = Simulator(grabber)
        context = simulator.get_mutable_context()
        grabber.GetInputPort("image").FixValue(context, Value(ImageRgba8U(4, 3, 255)))
        if needed:
            message = "^camera: random is not connected, but noise or miss need it$"
            with pytest.raises(ValueError, match=message):
                simulator.AdvanceTo(0.001)
        else:
            simulator.AdvanceTo(0.001)


def test_camera_without_an_image_stays_without() -> None:
    grabber = FrameGrabber(FrameGrabberParams(**QUIET), 4, 3)
    simulator = Simulator(grabber)
    context = simulator.get_mutable_context()
    grabber.GetInputPort("image").FixValue(context, Value(ImageRgba8U(4, 3, 0)))
    simulator.AdvanceTo(0.001)
    assert read_image(grabber.GetOutputPort("image").Eval(context)) is None


def test_period_is_the_cameras() -> None:
    seen, _ = run(FrameGrabberParams(noise=0.0, latency=1, period=2 * PERIOD), 8)
    assert seen == [None, None, 0, 0, 20, 20, 40, 40]


def test_noise_saturates() -> None:
    assert exposed(4.0, [0.5, 0.9], level=255)[..., :3].max() == 255
    assert exposed(4.0, [0.5, 0.9], level=255)[..., :3].min() > 230
    assert exposed(4.0, [0.5, 0.9], level=0)[..., :3].max() < 25
