"""The block that runs one primitive, and what all primitives show and refuse."""

import importlib
import inspect
import math
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

import chamfer.systems.primitives
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import (
    DIRECTIONS,
    GuardedMove,
    Hold,
    Level,
    Obstructed,
    Stick,
)
from chamfer.systems.primitives.position_primitives import Centre, Held, Place, Way
from chamfer.systems.primitives.primitive import (
    EVENTS,
    STILL,
    Event,
    Observation,
    Primitive,
    PrimitiveRunner,
    Stepped,
)
from chamfer.systems.primitives.seating import Press, Seat
from chamfer.systems.primitives.skill import PRIMITIVES
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx, Spiral, lissajous
from chamfer.systems.primitives.vision_primitives import (
    FixedPointRotation,
    VisGrasp,
    VisRotation,
    VisTranslation,
)
from chamfer.systems.primitives.visual_servoing import Servoing, StaticCameras

UP = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Counting:
    """Goes up, says what it was shown, ends after some ticks."""

    ticks: int = 5
    event: Event = "contact"
    velocity: tuple[float, ...] = UP
    shown: list[tuple[Observation, float]] = field(default_factory=list)
    label: str = "count"
    events: ClassVar[Mapping[Event, float]] = dict.fromkeys(EVENTS, 0.0)

    def begin(self, sensed: Observation) -> object:
        self.shown.append((sensed, -1.0))
        return 0

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        assert isinstance(memory, int)
        self.shown.append((sensed, time))
        event = self.event if memory + 1 == self.ticks else None
        return Stepped(memory + 1, self.velocity, event)


def loop(primitive: Any, connected: dict[str, Any], **settings: Any) -> tuple[Any, Any, Any]:
    builder = DiagramBuilder()
    block = builder.AddSystem(PrimitiveRunner(primitive, **settings))
    for name, value in connected.items():
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    return simulator, block, block.GetMyMutableContextFromRoot(simulator.get_mutable_context())


HERE = {"carriage": np.arange(6.0)}


def test_it_runs_the_primitive_until_its_event_and_then_stands_still() -> None:
    primitive = Counting()
    simulator, block, context = loop(primitive, HERE, period=0.1)
    velocity, event = (block.GetOutputPort(name) for name in ("velocity", "event"))
    simulator.Initialize()
    assert velocity.Eval(context).tolist() == list(STILL)
    for time in (0.05, 0.35):
        simulator.AdvanceTo(time)
        assert velocity.Eval(context).tolist() == list(UP)
        assert event.Eval(context).tolist() == [0.0]
        assert block.event(context) is None
    for time in (0.45, 0.95):
        simulator.AdvanceTo(time)
        assert velocity.Eval(context).tolist() == list(STILL)
        assert event.Eval(context).tolist() == [1.0 + EVENTS.index("contact")]
        assert block.event(context) == "contact"
    assert [time for _, time in primitive.shown] == pytest.approx([-1, 0, 0.1, 0.2, 0.3, 0.4])


def test_what_a_primitive_is_shown() -> None:
    primitive = Counting(ticks=100)
    simulator, _, _ = loop(primitive, HERE)
    simulator.AdvanceTo(0.015)
    (begun, _), (first, _), (second, _) = primitive.shown
    assert begun == first
    assert first == Observation(tuple(range(6)), STILL, STILL)
    assert second == Observation(tuple(range(6)), UP, STILL)  # nothing perturbs the command

    primitive = Counting(ticks=100)
    everything = {
        **HERE,
        "motion": np.full(6, 1.0),
        "wrench": np.full(6, 2.0),
        "xz_detections": np.full(18, 3.0),
        "yz_detections": np.full(18, 4.0),
        "cross_section": np.full(8, 5.0),
    }
    simulator, _, _ = loop(primitive, everything, parts=3)
    simulator.AdvanceTo(0.005)
    expected = {name: tuple(value.tolist()) for name, value in everything.items()}
    assert primitive.shown[0][0] == Observation(**expected)


def test_nan_does_not_leave_the_block() -> None:
    simulator, _, _ = loop(Counting(velocity=(math.nan,) * 6), HERE)
    with pytest.raises(ParameterError, match=r"^velocity of count is .*, allowed: finite numbers"):
        simulator.AdvanceTo(0.02)


def test_outputs_do_not_follow_the_inputs_at_once() -> None:
    block = PrimitiveRunner(Counting())
    assert not block.HasAnyDirectFeedthrough()


def test_no_primitive_is_forgotten() -> None:
    found = set()
    for module in pkgutil.iter_modules(chamfer.systems.primitives.__path__):
        for name, one in vars(
            importlib.import_module(f"chamfer.systems.primitives.{module.name}")
        ).items():
            if inspect.isclass(one) and issubclass(one, Primitive) and name[0] != "_":
                found.add(name)
    assert found - {"Primitive", "Directed"} == set(PRIMITIVES)


XZ, YZ = (CameraPlacement(view=view, roll=math.pi / 2).camera for view in ("xz", "yz"))
CAMERAS = StaticCameras(xz=XZ, yz=YZ)


@pytest.mark.parametrize(
    ("primitive", "label", "events"),
    [
        (GuardedMove(direction="-rx"), "gmove -rx", {"contact": 0.0, "lost": 3.0}),
        (Stick(), "stick -z", {"lost": 0.0}),
        (Stick(threshold=math.inf), "stick -z", {}),
        (Obstructed(), "corr x, y", {"hindered": 0.0}),
        (Hold(), "hold rx, ry, rz", {}),
        (Level(), "level rx, ry", {"done": 0.2, "lost": 0.0}),
        (Place(), "place", {"done": 0.0}),
        (Centre(dither=Dither(axis="y")), "centre y", {}),
        (Way(direction="+z", wait=0.25, time=0.5), "way +z", {"done": 0.75, "jammed": 0.75}),
        (Held(wait=0.25, time=0.5), "held", {"done": 0.75, "lost": 0.25}),
        (Held(time=math.inf), "held", {"lost": 0.0}),
        (Seat(window=0.1), "seat -z", {"done": 0.2, "jammed": 0.2}),
        (Press(), "press -z", {}),
        (MoveDx(displacement=(0.0, 0.0, 0.1, -0.1, 0.0, 0.0)), "movedx +rz -x", {"done": 1.0}),
        (MoveDx(duration=0.25), "wait 0.25 s", {"done": 0.25}),
        (Dither(kind="linear", axis="y"), "ldither y", {"done": 10.0}),
        (Dither(kind="rotary", axis="z"), "rdither z", {"done": 10.0}),
        (
            VisTranslation(axes=("x", "z"), cameras=CAMERAS),
            "vis_xz",
            {"done": 1 / 6, "lost": 1 / 3},
        ),
        (VisRotation(cameras=CAMERAS), "vis_rxy", {"done": 1 / 6, "lost": 1 / 3}),
        (FixedPointRotation(cameras=CAMERAS), "vis_fixed_ry", {"done": 1 / 6, "lost": 1 / 3}),
    ],
)
def test_what_a_chart_shows_and_may_expect(primitive: Any, label: str, events: Any) -> None:
    assert primitive.label == label
    assert dict(primitive.events) == pytest.approx(events)


translation, rotation, fixed_point = (
    partial(kind, cameras=CAMERAS) for kind in (VisTranslation, VisRotation, FixedPointRotation)
)
grasp = partial(VisGrasp, camera=CameraPlacement(view="xy", roll=0.0).camera)
centre = partial(Centre, dither=Dither())
seat = partial(Seat, limit=115.0)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (PrimitiveRunner, {"primitive": Counting(), "period": 0.0}, "period is 0.0, allowed: "),
        (PrimitiveRunner, {"primitive": Counting(), "offset": -1.0}, "offset is -1.0, allowed: "),
        (PrimitiveRunner, {"primitive": Counting(), "parts": 0}, "parts is 0, allowed: "),
        (GuardedMove, {"direction": "down"}, f"direction is 'down', allowed: {DIRECTIONS[0]}"),
        (Stick, {"direction": "down"}, "direction is 'down', allowed: -rx"),
        (GuardedMove, {"speed": 0.0}, "speed is 0.0, allowed: a finite number > 0"),
        (GuardedMove, {"limit": math.inf}, "limit is inf, allowed: a finite number > 0"),
        (GuardedMove, {"sure": -1.0}, "sure is -1.0, allowed: a finite number >= 0"),
        (Stick, {"threshold": 0.0}, "threshold is 0.0, allowed: a number > 0, infinity for none"),
        (Obstructed, {"axes": ("w",)}, "axes is ('w',), allowed: one or more of rx, ry, rz, x, y"),
        (Obstructed, {"samples": (100, 3)}, "samples is (100, 3), allowed: a whole number >= 4 f"),
        (Obstructed, {"threshold": -0.1}, "threshold is -0.1, allowed: a finite number >= 0"),
        (Obstructed, {"windows": 0}, "windows is 0, allowed: a whole number >= 1"),
        (Hold, {"axes": ()}, "axes is (), allowed: one or more of rx, ry, rz, x, y, z"),
        (Hold, {"gain": 0.0}, "gain is 0.0, allowed: a finite number > 0"),
        (Level, {"axes": ("rz",)}, "axes is ('rz',), allowed: one or more of rx, ry"),
        (Level, {"limit": math.nan}, "limit is nan, allowed: a finite number > 0"),
        (Level, {"time": -1.0}, "time is -1.0, allowed: a finite number >= 0"),
        (Place, {"offset": (0.0, 0.0)}, "offset is (0.0, 0.0), allowed: 3 finite numbers"),
        (Place, {"tolerance": math.nan}, "tolerance is nan, allowed: a finite number > 0"),
        (centre, {"gain": -1.0}, "gain is -1.0, allowed: a finite number > 0"),
        (centre, {"offset": math.inf}, "offset is inf, allowed: a finite number"),
        (Way, {"least": 0.002, "most": 0.001}, "most is 0.001, allowed: a number > least, 0.002"),
        (Way, {"wait": 0.0}, "wait is 0.0, allowed: a finite number > 0"),
        (Way, {"beside": (0.0, math.nan)}, "beside is (0.0, nan), allowed: 2 finite numbers"),
        (Held, {"weight": -1.0}, "weight is -1.0, allowed: a finite number >= 0"),
        (Held, {"weight": 0.1, "time": math.inf}, "time is inf, allowed: a finite number, for a"),
        (Held, {"time": 0.0}, "time is 0.0, allowed: a number > 0, infinity to watch"),
        (Press, {"direction": "in"}, "direction is 'in', allowed: -rx"),
        (seat, {"speed": 0.0}, "speed is 0.0, allowed: a finite number > 0"),
        (seat, {"free": 116.0}, "free is 116.0, allowed: a number > 0, at most the limit, 115; o"),
        (seat, {"harder": 1.35}, "harder is 1.35, allowed: 0 to less than share, 1.35"),
        (seat, {"share": 1.1}, "rise is 1.12, allowed: less than share, 1.1: the end stop"),
        (seat, {"steep": (2.0, 1.0), "through": 115.0}, "steep is (2.0, 1.0), allowed: two numbe"),
        (seat, {"through": 20.0}, "through is 20.0, allowed: with steep"),
        (seat, {"steep": (1.0, 2.0), "through": 20.0, "free": 30.0}, "through is 20.0, allowed:"),
        (seat, {"growth": 1.0}, "growth is 1.0, allowed: a finite number > 1"),
        (seat, {"distance": math.inf}, "distance is inf, allowed: a finite number"),
        (MoveDx, {"duration": 0.0}, "duration is 0.0, allowed: a finite number > 0"),
        (MoveDx, {"displacement": (0.0,) * 5}, "displacement is (0.0, 0.0, 0.0, 0.0, 0.0), allow"),
        (Dither, {"kind": "circular"}, "kind is 'circular', allowed: linear, rotary"),
        (Dither, {"axis": "w"}, "axis is 'w', allowed: x, y, z"),
        (Dither, {"amplitude": math.inf}, "amplitude is inf, allowed: a finite number"),
        (Dither, {"cycles": -1.0}, "cycles is -1.0, allowed: a finite number > 0"),
        (Spiral, {"pitch": 0.0}, "pitch is 0.0, allowed: a finite number > 0"),
        (lissajous, {"first": Dither(), "axis": "x", "repeats": 4}, "axis is 'x', allowed: anoth"),
        (lissajous, {"first": Dither(), "axis": "y", "repeats": 0}, "repeats is 0, allowed: a wh"),
        (translation, {"axes": ("z", "x")}, "axes is ('z', 'x'), allowed: some of x, y, z, in th"),
        (translation, {"moved": -1}, "moved is -1, allowed: a whole number >= 0"),
        (translation, {"target": 0}, "target is 0, allowed: another part than the moved"),
        (translation, {"offset": (0.0, math.nan, 0.0)}, "offset is (0.0, nan, 0.0), allowed: 3 f"),
        (rotation, {"axes": ("z",)}, "axes is ('z',), allowed: some of x, y"),
        (rotation, {"tolerance": -1.0}, "tolerance is -1.0, allowed: a finite number > 0"),
        (fixed_point, {"view": "xy"}, "view is 'xy', allowed: xz, yz"),
        (fixed_point, {"angle": 2.0}, "angle is 2.0, allowed: less than a quarter turn"),
        (fixed_point, {"lever": (0.0,)}, "lever is (0.0,), allowed: 3 finite numbers"),
        (grasp, {"depth": 0.0}, "depth is 0.0, allowed: a finite number > 0"),
        (grasp, {"centre": "hole"}, "centre is 'hole', allowed: centroid, edges"),
        (grasp, {"goal": (0.0, math.nan)}, "goal is (0.0, nan), allowed: 2 finite numbers"),
        (grasp, {"camera": XZ}, "camera is "),
        (Servoing, {"gain": 1.0}, "gain is 1.0, allowed: a number between 0 and 1"),
        (Servoing, {"period": math.nan}, "period is nan, allowed: a finite number > 0"),
        (Servoing, {"lost_frames": 0}, "lost_frames is 0, allowed: a whole number >= 1"),
    ],
)
def test_refuses(kind: Any, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        kind(**values)
    assert str(refused.value).startswith(message)
