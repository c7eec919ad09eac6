"""What the two cameras of an insertion see."""

import gc
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final

import numpy as np
import pytest
from pydrake.systems.framework import Diagram

from chamfer.analysis.report.replay import open_meshcat
from chamfer.diagrams.skills.connector_loop import make_connector_diagram
from chamfer.diagrams.skills.connector_scenario import BNC_CONNECTOR, D_CONNECTOR, resolve
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.diagrams.skills.connector_view import make_connector_view
from chamfer.diagrams.skills.vision_servo import CameraBelief
from chamfer.models.arms.wrist import tip_pose
from chamfer.systems.cameras.camera_image import read_image
from chamfer.systems.primitives.vision_primitives import VisTranslation
from chamfer.systems.primitives.visual_servoing import Servoing, ServoingParams
from chamfer.systems.strategies.grasp_and_transport import GRIPPER, PARTS, PLUG, PLUG_TOP, SOCKET
from chamfer.systems.vision.detections import Detection, Status, unpack_detections
from chamfer.systems.vision.part_detector import PartsDetector

SIGHT: Final = SightSettings()
ALIGNED: Final = (0.0,) * 6
VIEWS: Final[Any] = ("xz", "yz")


@lru_cache
def image_of(kind: Any, view: str, **changes: Any) -> Any:
    diagram = make_connector_diagram(resolve(replace(kind, **changes)))
    context = diagram.CreateDefaultContext()
    camera = diagram.GetSubsystemByName(f"{view} camera")
    return read_image(camera.GetOutputPort("image").Eval(camera.GetMyContextFromRoot(context)))


def detected(kind: Any, view: str, **changes: Any) -> tuple[Detection, ...]:
    detector: Any = detector_of(make_connector_diagram(resolve(replace(kind, **changes))), view)
    return tuple(unpack_detections(detector.measure(image_of(kind, view, **changes))))


def detector_of(diagram: Diagram, view: str) -> PartsDetector:
    found: PartsDetector = diagram.GetSubsystemByName(f"{view} detection")
    return found


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("kind", [D_CONNECTOR, BNC_CONNECTOR])
def test_both_cameras_find_all_parts_at_the_start(kind: Any, view: Any) -> None:
    parts = detected(kind, view, initial_error=ALIGNED)
    assert len(parts) == PARTS
    assert [part.status for part in parts] == [Status.VALID] * PARTS
    scenario = resolve(replace(kind, initial_error=ALIGNED))
    mark = scenario.start[3:] + np.array([0.0, 0.0, SIGHT.motion.mark])
    top = np.array(SIGHT.plug) + np.array([0.0, 0.0, kind.connector.plug_outline[:, 2].max()])
    places = {PLUG: SIGHT.plug, SOCKET: (0.0, 0.0, 0.0), GRIPPER: mark, PLUG_TOP: top}
    for part, p_WT in places.items():
        tip = SIGHT.camera(view).project(np.array(p_WT))
        # What is detected is the outline's end: the edge of the face that shows.
        np.testing.assert_allclose(parts[part].tip, tip, atol=4.0)


def test_cameras_are_believed_wrong_as_told() -> None:
    settings = SightSettings(
        distance=0.4,
        xz=CameraBelief(focal_factor=1.2, turn=(0.1, 0.0, -0.1)),
        yz=CameraBelief(focal_factor=0.8, turn=(0.0, 0.05, 0.0)),
    )
    believed = settings.believed
    assert believed.depth == 0.4
    for view, belief in (("xz", settings.xz), ("yz", settings.yz)):
        true, camera = settings.camera(view), getattr(believed, view)  # type: ignore[arg-type]
        expected = belief.of(true)
        np.testing.assert_allclose(camera.focal, np.multiply(true.focal, belief.focal_factor))
        np.testing.assert_array_equal(camera.R_WC, expected.R_WC)
        assert not np.allclose(camera.R_WC, true.R_WC, atol=0.01)


def test_servoing_is_that_of_the_frames() -> None:
    settings = SightSettings(servoing=ServoingParams(gain=0.15, settled_frames=3, lost_frames=7))
    scenario = resolve(replace(D_CONNECTOR, sight=settings))
    (reach, *_) = (state.run[0] for state in scenario.make_grasp())
    assert isinstance(reach, VisTranslation)
    assert reach.servoing == Servoing(
        gain=0.15, settled_frames=3, lost_frames=7, period=settings.frames.period
    )
    phases = (settings.frames.offset + settings.frames.period * np.arange(300)) % 0.01
    assert np.minimum(phases, 0.01 - phases).min() > 1e-3  # exposed between ticks


PLACES = np.array([[0.05, -0.02, 0.6, 0.001, 0.002, -0.004], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
CARRIAGE = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.1, 0.2, -1.5, 0.01, -0.02, 0.03]])


def test_plug_and_gripper_are_where_they_are_told_to_be() -> None:
    scenario = resolve(D_CONNECTOR)
    meshcat = open_meshcat(0)
    view = make_connector_view(scenario, meshcat)
    plant = view.plant
    context = plant.GetMyMutableContextFromRoot(view.diagram.CreateDefaultContext())
    positions = view.positions(PLACES, CARRIAGE)
    for q, plug, carriage in zip(positions, PLACES, CARRIAGE, strict=True):
        plant.SetPositions(context, q)
        for name, expected in (("tool", plug), ("gripper", carriage)):
            X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name))
            assert X.IsNearlyEqualTo(tip_pose(expected), 1e-12)
    view.diagram.ForcedPublish(view.diagram.CreateDefaultContext())
    for part in ("wrist/tool", "gripper/gripper"):
        assert meshcat.HasPath(f"insertion/{part}")
    del view, plant, context, meshcat
    gc.collect()
