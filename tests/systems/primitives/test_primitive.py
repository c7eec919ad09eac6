"""What all primitives show and refuse."""

import importlib
import inspect
import math
import pkgutil
from functools import partial
from typing import Any

import pytest

import chamfer.systems.primitives
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import GuardedMove, Level, Obstructed, Stick
from chamfer.systems.primitives.position_primitives import Centre, Held, Way
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import PRIMITIVES
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx, lissajous
from chamfer.systems.primitives.vision_primitives import VisGrasp, VisRotation, VisTranslation
from chamfer.systems.primitives.visual_servoing import StaticCameras


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
        (Stick(threshold=math.inf), "stick -z", {}),
        (Level(), "level rx, ry", {"done": 0.2, "lost": 0.0}),
        (Way(direction="+z", wait=0.25, time=0.5), "way +z", {"done": 0.75, "jammed": 0.75}),
        (Held(wait=0.25, time=0.5), "held", {"done": 0.75, "lost": 0.25}),
        (Held(time=math.inf), "held", {"lost": 0.0}),
        (Seat(window=0.1), "seat -z", {"done": 0.2, "jammed": 0.2}),
        (MoveDx(displacement=(0.0, 0.0, 0.1, -0.1, 0.0, 0.0)), "movedx +rz -x", {"done": 1.0}),
        (MoveDx(duration=0.25), "wait 0.25 s", {"done": 0.25}),
        (
            VisTranslation(axes=("x", "z"), cameras=CAMERAS),
            "vis_xz",
            {"done": 1 / 6, "lost": 1 / 3},
        ),
    ],
)
def test_what_a_chart_shows_and_may_expect(primitive: Any, label: str, events: Any) -> None:
    assert primitive.label == label
    assert dict(primitive.events) == pytest.approx(events)


translation, rotation = (partial(kind, cameras=CAMERAS) for kind in (VisTranslation, VisRotation))
grasp = partial(VisGrasp, camera=CameraPlacement(view="xy", roll=0.0).camera)
centre = partial(Centre, dither=Dither())
seat = partial(Seat, limit=115.0)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (Obstructed, {"axes": ("w",)}, "axes is ('w',), allowed: one or more of rx, ry, rz, x, y"),
        (Obstructed, {"cycle": (1.0, 0.0)}, "cycle is (1.0, 0.0), allowed: a finite number > 0 f"),
        (Level, {"axes": ("rz",)}, "axes is ('rz',), allowed: one or more of rx, ry"),
        (Way, {"least": 0.002, "most": 0.001}, "most is 0.001, allowed: a number > least, 0.002"),
        (Held, {"weight": 0.1, "time": math.inf}, "time is inf, allowed: a finite number, for a"),
        (seat, {"free": 116.0}, "free is 116.0, allowed: a number > 0, at most the limit, 115; o"),
        (seat, {"harder": 1.35}, "harder is 1.35, allowed: 0 to less than share, 1.35"),
        (seat, {"share": 1.1}, "rise is 1.12, allowed: less than share, 1.1: the end stop"),
        (seat, {"steep": (2.0, 1.0), "through": 115.0}, "steep is (2.0, 1.0), allowed: two numbe"),
        (seat, {"through": 20.0}, "through is 20.0, allowed: with steep"),
        (seat, {"steep": (1.0, 2.0), "through": 20.0, "free": 30.0}, "through is 20.0, allowed:"),
        (MoveDx, {"displacement": (0.0,) * 5}, "displacement is (0.0, 0.0, 0.0, 0.0, 0.0), allow"),
        (
            lissajous,
            {"first": Dither(), "axis": "x", "repeats": 4},
            "axis is 'x', allowed: an axis other",
        ),
        (lissajous, {"first": Dither(), "axis": "y", "repeats": 0}, "repeats is 0, allowed: a wh"),
        (translation, {"axes": ("z", "x")}, "axes is ('z', 'x'), allowed: some of x, y, z, in th"),
        (translation, {"target": 0}, "target is 0, allowed: another part than the moved"),
        (rotation, {"axes": ("z",)}, "axes is ('z',), allowed: some of x, y"),
        (grasp, {"camera": XZ}, "camera is "),
    ],
)
def test_refuses(kind: Any, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        kind(**values)
    assert str(refused.value).startswith(message)
