"""The loop of one vision primitive, with images."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from chamfer.diagrams.skills.vision_servo import (
    NAMES,
    PARTS,
    CameraBelief,
    VisionServoScenario,
    event_of,
    make_vision_servo_diagram,
    view_of,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import read_image
from chamfer.systems.vision.part_detection import Status, detect

WRONG = {
    "xz": CameraBelief(focal_factor=1.2, turn=(0.1, 0.1, 0.1)),
    "yz": CameraBelief(focal_factor=0.8, turn=(0.0, -0.1, 0.14)),
    "hand": CameraBelief(focal_factor=0.8, turn=(0.1, -0.1, 0.1)),
}
STARTS: dict[str, tuple[float, ...]] = {
    "translation": (0, 0, 0, 0.02, -0.015, 0.02),
    "rotation": (0.2, -0.15, 0, 0.01, 0, 0.01),
    "fixed_point": (0, 0, 0, -0.01, 0, 0.04),
    "grasp": (0, 0, 0.4, 0.02, -0.015, 0),
}


def scenario(name: Any, **changes: Any) -> VisionServoScenario:
    return VisionServoScenario(primitive=name, start=STARTS[name], **{**WRONG, **changes})


def run(one: VisionServoScenario, duration: float) -> tuple[Any, np.ndarray]:
    diagram = make_vision_servo_diagram(one)
    simulator = Simulator(diagram)
    context = simulator.get_context()
    while not (event := event_of(diagram, context)) and context.get_time() < duration:
        simulator.AdvanceTo(context.get_time() + 0.1)
    return event, diagram.GetOutputPort("displacement").Eval(context)


def test_fixed_point_is_done_with_the_tip_where_it_was() -> None:
    one = scenario("fixed_point", believed_lever=0.8)
    event, end = run(one, 3.0)
    assert event == "done"
    assert end[1] == pytest.approx(one.angle, abs=4e-3)
    x, _, z = one.lever
    cos, sin = np.cos(end[1]), np.sin(end[1])
    moved = end[[3, 5]] + [cos * x + sin * z, cos * z - sin * x]
    first = np.array(one.start)[[3, 5]] + [x, z]
    np.testing.assert_allclose(moved, first, atol=4e-4)


def test_grasp_is_done_over_the_part() -> None:
    target = (0.0, 0.0, -0.2, 0.004, -0.003, 0.0)
    event, end = run(scenario("grasp", target=target), 3.0)
    assert event == "done"
    np.testing.assert_allclose(end[3:], target[3:], atol=4e-4)
    assert end[2] == pytest.approx(-0.2, abs=0.01)


@pytest.mark.parametrize("name", ["translation", "grasp"])
def test_it_is_lost_without_frames(name: Any) -> None:
    frames = replace(VisionServoScenario().frames, miss=1.0)
    event, end = run(scenario(name, frames=frames), 1.0)
    assert event == "lost"
    np.testing.assert_array_equal(end, STARTS[name])


@pytest.mark.parametrize("name", NAMES)
def test_only_encoders_and_images_reach_the_primitive(name: Any) -> None:
    diagram = make_vision_servo_diagram(scenario(name))
    before: dict[str, set[str]] = {}
    for (end, _), (start, _) in diagram.connection_map().items():
        before.setdefault(end.get_name(), set()).add(start.get_name())
    views = {"grasp": ["hand"], "fixed_point": ["xz"]}.get(name, ["xz", "yz"])
    own = {"primitive", "no contact"}  # what it commanded, and a constant
    assert before["primitive"] - own == {"carriage", *(f"{view} detection" for view in views)}
    for view in views:
        assert before[f"{view} detection"] == {f"{view} frames"}
        assert before[f"{view} frames"] == {f"{view} camera", f"{view} frames random"}
        assert before[f"{view} camera"] == {"poses", "target"}
    assert before["carriage"] == {"primitive"}


def image_in(diagram: Diagram, view: str) -> np.ndarray:
    camera = diagram.GetSubsystemByName(f"{view} camera")
    context = diagram.CreateDefaultContext()
    image = camera.GetOutputPort("image").Eval(camera.GetMyContextFromRoot(context))
    found = read_image(image)
    assert found is not None
    return found


@pytest.mark.parametrize(("name", "view"), [("rotation", "yz"), ("fixed_point", "xz")])
def test_view_of_is_what_the_camera_draws(name: Any, view: Any) -> None:
    one = scenario(name)
    image = image_in(make_vision_servo_diagram(one), view)
    np.testing.assert_array_equal(view_of(one, view, np.array(one.start)), image)
    assert [detect(image, part).status for part in PARTS] == [Status.VALID] * 2


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"primitive": "zoom"}, "primitive is 'zoom', allowed: translation, rotation"),
        ({"start": (0.0,) * 5}, "start is (0.0, 0.0, 0.0, 0.0, 0.0), allowed: 6 finite numbers"),
        ({"distance": 0.0}, "distance is 0.0, allowed: a finite number > 0"),
        ({"lever": (0.0, 0.0)}, "lever is (0.0, 0.0), allowed: 3 finite numbers"),
    ],
)
def test_errors(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(text)}"):
        VisionServoScenario(**changes)
