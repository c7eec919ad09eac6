"""A camera that lets Drake's VTK engine draw the peg and the hole part: needs OpenGL.

Without a display the engine goes through EGL, and in software if need be: on Debian the packages
``libegl1`` and ``libgl1-mesa-dri``. Where a part of them is missing it may end the process, so
that :func:`missing_graphics` tries in another one.
"""

import subprocess
import sys
from functools import lru_cache
from typing import Any, Final

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.part_surfaces import part_shape
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import PosePorts

_SIDES: Final = 128  # corners of a circle
_NEAR: Final = 0.01  # m, from which on the camera sees
_FAR: Final = 10.0  # m, up to which it sees

# Directions in the camera frame and brightness: with the lamp at the camera alone the outlines
# would be black.
_LIGHTS: Final = (
    ((0.0, 0.0, 1.0), 0.4),
    ((1.0, 0.0, 0.3), 0.6),
    ((-1.0, 0.0, 0.3), 0.6),
    ((0.0, 1.0, 0.3), 0.6),
    ((0.0, -1.0, 0.3), 0.6),
)

_TRIAL = """
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.vtk_camera import VtkCamera
camera = VtkCamera(ColouredParts(), CameraPlacement().camera)
image = camera.GetOutputPort("image").Eval(camera.CreateDefaultContext())
assert image.data[..., 3].min() == 255
"""


@lru_cache(maxsize=1)
def missing_graphics() -> str | None:
    """Return why :class:`VtkCamera` does not work on this machine; None if it does.

    Drawn in another process, once: without OpenGL the engine can end the process that asks.
    """
    trial = subprocess.run(
        [sys.executable, "-c", _TRIAL], capture_output=True, text=True, check=False, timeout=120
    )
    if trial.returncode == 0:
        return None
    lines = trial.stderr.strip().splitlines()
    reason = lines[-1] if lines else f"the process ended with {trial.returncode}"
    return f"VTK can't draw here ({reason}); on Debian: apt-get install libegl1 libgl1-mesa-dri"


class VtkCamera(Diagram):
    """Draws the image of the peg and the hole part with Drake's ``RgbdSensor`` and VTK.

    .. pydrake_system::

        name: VtkCamera
        input_ports:
        - peg_pose (optional)
        - hole_pose (optional)
        output_ports:
        - image

    The ports are those of :class:`~chamfer.systems.cameras.software_camera.SoftwareCamera`, and
    the images agree within half a pixel, except light and shade. There is no blur. Edges are
    sampled, not exact.

    Raises:
        RuntimeError: By Drake, if OpenGL is missing; call :func:`missing_graphics` first.
    """

    def __init__(self, parts: ColouredParts, camera: Camera) -> None:
        super().__init__()
        builder = DiagramBuilder()
        scene = builder.AddNamedSystem("scene", SceneGraph())
        scene.AddRenderer("vtk", MakeRenderEngineVtk(_engine()))
        source = scene.RegisterSource("parts")
        frames = []
        for name, profile, colour in (
            ("peg", parts.peg.closed_profile, parts.peg_colour),
            ("hole", parts.hole.closed_profile, parts.hole_colour),
        ):
            frame = scene.RegisterFrame(source, GeometryFrame(name))
            mesh = part_shape(profile, _SIDES, name, parts.section)
            part = GeometryInstance(RigidTransform(), mesh, name)
            look = PerceptionProperties()
            look.AddProperty("phong", "diffuse", Rgba(*(channel / 255 for channel in colour)))
            part.set_perception_properties(look)
            scene.RegisterGeometry(source, frame, part)
            frames.append(frame)
        X_WC = RigidTransform(RotationMatrix(camera.R_WC), camera.p_WC)
        poses = builder.AddNamedSystem("poses", _FramePoses(frames, X_WC))
        builder.Connect(poses.GetOutputPort("poses"), scene.get_source_pose_port(source))
        core = _core(camera)
        sensor = builder.AddNamedSystem(
            "sensor",
            RgbdSensor(
                scene.world_frame_id(),
                X_WC,
                ColorRenderCamera(core),
                DepthRenderCamera(core, DepthRange(_NEAR, _FAR)),
            ),
        )
        builder.Connect(scene.get_query_output_port(), sensor.query_object_input_port())
        for name in ("peg_pose", "hole_pose"):
            builder.ExportInput(poses.GetInputPort(name), name)
        builder.ExportOutput(sensor.color_image_output_port(), "image")
        builder.BuildInto(self)


class _FramePoses(LeafSystem):
    """Poses for the scene; a part without one is behind the camera."""

    def __init__(self, frames: list[Any], X_WC: RigidTransform) -> None:
        super().__init__()
        ports = PosePorts(self)
        away = X_WC @ RigidTransform([0.0, 0.0, -_FAR])

        def calc(context: Context, output: Any) -> None:
            vector = FramePoseVector()
            for frame, X_WP in zip(frames, ports.read(context), strict=True):
                vector.set_value(frame, away if X_WP is None else X_WP)
            output.set_value(vector)

        model = Value(FramePoseVector())
        self.DeclareAbstractOutputPort("poses", model.Clone, calc, ports.tickets())


def _engine() -> RenderEngineVtkParams:
    lights = [
        LightParameter(
            type="directional",
            frame="camera",
            direction=np.array(direction) / np.linalg.norm(direction),
            intensity=intensity,
        )
        for direction, intensity in _LIGHTS
    ]
    clear = [channel / 255 for channel in SceneStyle.background]
    return RenderEngineVtkParams(default_clear_color=clear, lights=lights, backend="EGL")


def _core(camera: Camera) -> RenderCameraCore:
    # Drake counts from the corner of the first pixel, not from its middle.
    intrinsics = CameraInfo(
        width=camera.width,
        height=camera.height,
        focal_x=camera.focal[0],
        focal_y=camera.focal[1],
        center_x=camera.centre[0] + 0.5,
        center_y=camera.centre[1] + 0.5,
    )
    return RenderCameraCore("vtk", intrinsics, ClippingRange(_NEAR, _FAR), RigidTransform())
