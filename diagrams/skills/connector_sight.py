"""The two cameras that watch an insertion, and the detection in their images."""

import math
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer

from chamfer.diagrams.skills.vision_servo import GREEN, STATIC, CameraBelief, add_camera, block
from chamfer.models.arms.wrist import SIZE
from chamfer.models.cameras.camera import LARGEST_PIXEL, Camera, CameraPlacement, View
from chamfer.models.connectors.connector import Array, Connector
from chamfer.models.peg.peg_and_hole import BLUE, RED
from chamfer.models.validation import require_numbers, require_positive
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.cameras.solids_camera import Solid, SolidsCamera
from chamfer.systems.pose import pose_vector
from chamfer.systems.primitives.carriage import CarriedPoses
from chamfer.systems.primitives.primitive import TICK
from chamfer.systems.primitives.visual_servoing import ServoingParams, StaticCameras
from chamfer.systems.strategies.grasp_and_transport import (
    GraspAndTransportParams,
    ResolvedGraspAndTransportParams,
)
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.part_detector import PartsDetector

_QUARTER: Final = math.pi / 2  # rad, roll of the cameras: down is to the right
# Plug, socket, the gripper's mark and the plug's other end, in the order of grasp_and_transport.
_APPEARANCES: Final = (
    Appearance(hue=0, front=1),
    Appearance(hue=161, front=-1),
    Appearance(hue=85, front=1, area=200),
    Appearance(hue=0, front=-1),
)
_MARK: Final = (0.012, 0.012, 0.022)  # m, of the mark on the gripper; assumed


@dataclass(frozen=True, kw_only=True)
class SightSettings:
    """Cameras, and the scene in which the plug is grasped; all of it is assumed."""

    distance: float = 0.5  # m, of the cameras from the scene's middle
    pixel_size: float = 0.0005  # m, at the scene's middle
    middle: tuple[float, float, float] = (-0.022, 0.035, 0.035)  # m, of the scene
    xz: CameraBelief = CameraBelief(focal_factor=1.05, turn=(0.03, -0.03, 0.03))
    yz: CameraBelief = CameraBelief(focal_factor=0.95, turn=(-0.03, 0.03, 0.03))
    # Exposed between ticks, so that rounding cannot change their order.
    frames: FrameGrabberParams = FrameGrabberParams(period=1 / 30, offset=TICK / 2)
    servoing: ServoingParams = ServoingParams()
    plug: tuple[float, float, float] = (-0.045, 0.035, 0.0)  # m, place of the plug's resting tip
    plug_present: bool = True  # False: there is nothing to be grasped
    standby: tuple[float, float, float] = (0.006, 0.03, 0.008)
    # m, of the gripper from the plug before the grasp
    motion: GraspAndTransportParams = GraspAndTransportParams()

    def __post_init__(self) -> None:
        require_positive(self, "distance")
        require_positive(self, "pixel_size", most=LARGEST_PIXEL, unit="m")
        require_numbers(self, 3, "middle", "plug", "standby")

    def resolved(self, *, top: float, weight: float) -> "ResolvedSightSettings":
        """Return the settings with the plug's upper end above its tip, m, and its weight, N."""
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        motion = self.motion.resolved(top=top, weight=weight)
        return ResolvedSightSettings(**own | {"motion": motion})

    def camera(self, view: View) -> Camera:
        """Return the true camera."""
        return CameraPlacement(
            view=view,
            target=self.middle,
            distance=self.distance,
            pixel_size=self.pixel_size,
            roll=_QUARTER,
        ).camera

    @property
    def believed(self) -> StaticCameras:
        """Both cameras as the skill believes them to be."""
        return StaticCameras(
            xz=self.xz.of(self.camera("xz")), yz=self.yz.of(self.camera("yz")), depth=self.distance
        )

    @property
    def resting(self) -> Array:
        """Displacement of the plug before it is grasped, rad above m, shape (6,)."""
        return np.array([0.0, 0.0, 0.0, *self.plug])

    @property
    def start(self) -> Array:
        """Initial displacement of the carriage, rad above m, shape (6,)."""
        start: Array = self.resting + np.array([0.0, 0.0, 0.0, *self.standby])
        return start


@dataclass(frozen=True, kw_only=True)
class ResolvedSightSettings(SightSettings):
    """Cameras, and the scene in which the plug is grasped; nothing is open."""

    motion: ResolvedGraspAndTransportParams


def add_sight(
    builder: DiagramBuilder,
    settings: SightSettings,
    connector: Connector,
    *,
    X_TP: RigidTransform,
    motion: OutputPort,
    tool_pose: OutputPort,
    trigger: OutputPort,
    detections: dict[View, InputPort],
) -> None:
    """Add cameras and detection; the detections of each camera go to ``detections``.

    X_TP is the pose of the plug in the tool's frame, ``motion``, shape (12,), the robot's true
    displacement and its rate, ``tool_pose``, shape (7,), the true pose of the tool's frame, which
    only the cameras see; ``trigger`` is 1 while images are needed.
    """
    corners = X_TP.multiply(connector.plug_outline.T).T
    mark = block(_MARK, below=-settings.motion.mark)
    solids = (
        Solid(name="socket", vertices=connector.socket_outline, colour=BLUE),
        Solid(name="plug", vertices=corners, colour=RED),
        Solid(name="gripper", vertices=mark, colour=GREEN),
    )
    gripper = builder.AddNamedSystem("gripper's mark", CarriedPoses({"gripper": RigidTransform()}))
    socket = builder.AddNamedSystem(
        "socket's place", ConstantVectorSource(pose_vector(RigidTransform()))
    )
    place = builder.AddNamedSystem("gripper's place", Demultiplexer(2 * SIZE, SIZE))
    builder.Connect(motion, place.get_input_port())
    builder.Connect(place.get_output_port(0), gripper.get_input_port())
    for view in STATIC:
        camera, detector = SolidsCamera(settings.camera(view), solids), PartsDetector(_APPEARANCES)
        frames = add_camera(builder, settings.frames, view, camera, detector)
        builder.Connect(socket.get_output_port(), camera.GetInputPort("socket_pose"))
        builder.Connect(gripper.GetOutputPort("gripper_pose"), camera.GetInputPort("gripper_pose"))
        if settings.plug_present:
            builder.Connect(tool_pose, camera.GetInputPort("plug_pose"))
        builder.Connect(trigger, frames.GetInputPort("trigger"))
        builder.Connect(detector.get_output_port(), detections[view])
