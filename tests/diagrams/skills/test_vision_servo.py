"""The loop of one vision primitive, with images."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.diagrams.skills.vision_servo import (
    NAMES,
    PARTS,
    VisionServoScenario,
    event_of,
    make_vision_servo_diagram,
    view_of,
)
from chamfer.systems.cameras.camera_image import read_image
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_detection import detect


@pytest.mark.parametrize("name", ["translation", "grasp"])
def test_it_is_lost_without_frames(name: Any) -> None:
    frames = replace(VisionServoScenario().frames, miss=1.0)
    one = VisionServoScenario(primitive=name, frames=frames)
    diagram = make_vision_servo_diagram(one)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    context = simulator.get_context()
    assert event_of(diagram, context) == "lost"
    np.testing.assert_array_equal(diagram.GetOutputPort("displacement").Eval(context), one.start)


@pytest.mark.parametrize("name", NAMES)
def test_only_encoders_and_images_reach_the_primitive(name: Any, wires: Any) -> None:
    before: dict[str, set[str]] = {}
    for start, _, end, _ in wires(make_vision_servo_diagram(VisionServoScenario(primitive=name))):
        before.setdefault(end, set()).add(start)
    views = {"grasp": ["hand"], "fixed_point": ["xz"]}.get(name, ["xz", "yz"])
    own = {"primitive", "no contact"}  # what it commanded, and a constant
    assert before["primitive"] - own == {"carriage", *(f"{view} detection" for view in views)}
    for view in views:
        assert before[f"{view} detection"] == {f"{view} frames"}
        assert before[f"{view} frames"] == {f"{view} camera", f"{view} frames random"}
        assert before[f"{view} camera"] == {"poses", "target"}
    assert before["carriage"] == {"primitive"}


@pytest.mark.parametrize(("name", "view"), [("rotation", "yz"), ("fixed_point", "xz")])
def test_view_of_is_what_the_camera_draws(name: Any, view: Any) -> None:
    one = VisionServoScenario(primitive=name)
    diagram = make_vision_servo_diagram(one)
    camera, context = diagram.GetSubsystemByName(f"{view} camera"), diagram.CreateDefaultContext()
    image = read_image(camera.GetOutputPort("image").Eval(camera.GetMyContextFromRoot(context)))
    assert image is not None
    np.testing.assert_array_equal(view_of(one, view, np.array(one.start)), image)
    assert [detect(image, part).status for part in PARTS] == [Status.VALID] * 2
