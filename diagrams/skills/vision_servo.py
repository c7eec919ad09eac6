"""A carriage under one vision primitive: cameras, detection, primitive, velocity (section 3.1)."""

import math
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Integrator

from chamfer.models.arms.wrist import tip_pose
from chamfer.models.cameras.camera import LARGEST_PIXEL, Camera, CameraPlacement, View
from chamfer.models.peg.peg_and_hole import BLUE, RED, Colour
from chamfer.models.validation import (
    require_finite,
    require_numbers,
    require_one_of,
    require_positive,
)
from chamfer.systems.cameras.camera_image import FrameGrabberParams, Image, add_frame_grabber
from chamfer.systems.cameras.solids_camera import Solid, SolidsCamera, render_solids
from chamfer.systems.pose import pose_vector
from chamfer.systems.primitives.carriage import CarriedPoses
from chamfer.systems.primitives.primitive import TICK, Primitive
from chamfer.systems.primitives.skill import DONE, Outcome, Retry, Skill, SkillState
from chamfer.systems.primitives.skill_machine import SkillMachine
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.primitives.vision_primitives import (
    FixedPointRotation,
    VisGrasp,
    VisRotation,
    VisTranslation,
)
from chamfer.systems.primitives.visual_servoing import ServoingParams, StaticCameras
from chamfer.systems.vision.cross_section import CrossSectionDetector
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.part_detector import PartsDetector

Array = NDArray[np.float64]
VisionPrimitive = Literal["translation", "rotation", "fixed_point", "grasp"]
Triple = tuple[float, float, float]

NAMES: Final[tuple[VisionPrimitive, ...]] = get_args(VisionPrimitive)
STATIC: Final[tuple[View, ...]] = ("xz", "yz")

GREEN: Final[Colour] = (40, 170, 40)
# In the order of the detections. All dimensions are assumed.
PARTS: Final = (Appearance(hue=0, front=1), Appearance(hue=161, front=-1))
_QUARTER: Final = math.pi / 2  # rad, roll of the static cameras: down is to the right
_ENDLESS: Final = 1e6  # s


def block(size: Triple, *, below: float) -> Array:
    """Return the corners of an upright block, m, shape (8, 3), in part ``below`` its origin."""
    x, y, z = size
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (0.0, 1.0)])
    moved: Array = corners * (x, y, z) - np.array([0.0, 0.0, below])
    return moved


PLUG: Final = Solid(name="plug", vertices=block((0.02, 0.014, 0.03), below=0.0), colour=RED)
GRIPPER: Final = Solid(
    name="gripper", vertices=block((0.012, 0.02, 0.02), below=-0.03), colour=GREEN
)
SOCKET: Final = Solid(name="socket", vertices=block((0.024, 0.018, 0.03), below=0.03), colour=BLUE)
HELD_OVER: Final = (SOCKET, PLUG, GRIPPER)
LOOSE: Final = Solid(name="part", vertices=block((0.03, 0.014, 0.02), below=0.02), colour=RED)


@dataclass(frozen=True, kw_only=True)
class CameraBelief:
    """Errors of a camera's believed parameters."""

    focal_factor: float = 1.0  # believed focal length over the true one
    turn: Triple = (0.0, 0.0, 0.0)  # rad, from the true to the believed orientation, camera frame

    def __post_init__(self) -> None:
        require_positive(self, "focal_factor")
        require_numbers(self, 3, "turn")

    def of(self, camera: Camera) -> Camera:
        """Return the believed camera."""
        return camera.miscalibrated(focal_factor=self.focal_factor, turn=self.turn)


@dataclass(frozen=True, kw_only=True)
class VisionServoSetup:
    """Cameras, goals and control law of the primitives. All of it is assumed.

    In translation, rotation and turn about a fixed point the carriage holds a plug over a socket;
    for the grasp the camera looks down at a loose part.
    """

    lever: Triple = (0.01, 0.0, -0.04)
    # m, from the reference point to the plug's tip, which the fixed point's primitive holds
    gap: float = 0.01  # m, goal of the translation, above the socket
    angle: float = 0.15  # rad, goal of the turn about a fixed point
    distance: float = 0.5  # m, of the static cameras
    height: float = 0.2  # m, of the camera on the gripper over the part
    pixel_size: float = 0.0005  # m, of every camera, at its distance
    # Exposed between ticks, so that rounding cannot change their order.
    frames: FrameGrabberParams = FrameGrabberParams(period=1 / 30, offset=TICK / 2)
    servoing: ServoingParams = ServoingParams()

    def __post_init__(self) -> None:
        require_positive(self, "distance", "height", "gap")
        require_positive(self, "pixel_size", most=LARGEST_PIXEL, unit="m")
        require_finite(self, "angle")
        require_numbers(self, 3, "lever")

    def camera(self, view: View) -> Camera:
        """Return the true static camera; down is to the right in its image."""
        return CameraPlacement(
            view=view, distance=self.distance, pixel_size=self.pixel_size, roll=_QUARTER
        ).camera

    @property
    def hand_camera(self) -> Camera:
        """The true camera on the gripper, with the carriage at 0."""
        return CameraPlacement(
            view="xy", distance=self.height, pixel_size=self.pixel_size, roll=0.0
        ).camera

    @property
    def camera_at(self) -> RigidTransform:
        """X_EC, of the camera on the gripper."""
        return RigidTransform(RotationMatrix(self.hand_camera.R_WC), [0.0, 0.0, self.height])


@dataclass(frozen=True, kw_only=True)
class VisionServoScenario(VisionServoSetup):
    """One primitive, its start and its target, and the errors of its believed cameras."""

    primitive: VisionPrimitive = "translation"
    start: tuple[float, ...] = (0.0, 0.0, 0.0, 0.02, -0.015, 0.02)  # rad above m, of the carriage
    target: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, -0.015)  # rad above m, socket or part
    believed_lever: float = 1.0  # of the believed lever to the true one
    xz: CameraBelief = CameraBelief()
    yz: CameraBelief = CameraBelief()
    hand: CameraBelief = CameraBelief()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "primitive", NAMES)
        require_positive(self, "believed_lever")
        require_numbers(self, 6, "start", "target")

    @property
    def held_at(self) -> RigidTransform:
        """X_ET, of the plug's tip in the carriage's frame."""
        return RigidTransform(self.lever if self.primitive == "fixed_point" else (0.0, 0.0, 0.0))

    @property
    def parameters(self) -> Primitive:
        """The primitive with its parameters and believed cameras."""
        servoing = self.servoing.with_frames(self.frames.period)
        if self.primitive == "grasp":
            return VisGrasp(
                camera=self.hand.of(self.hand_camera), depth=self.height, servoing=servoing
            )
        cameras = StaticCameras(
            xz=self.xz.of(self.camera("xz")), yz=self.yz.of(self.camera("yz")), depth=self.distance
        )
        if self.primitive == "rotation":
            return VisRotation(cameras=cameras, servoing=servoing)
        if self.primitive == "fixed_point":
            turned = tip_pose(np.array(self.start)).rotation().matrix() @ self.lever
            x, y, z = (self.believed_lever * turned).tolist()
            return FixedPointRotation(
                cameras=cameras, angle=self.angle, lever=(x, y, z), servoing=servoing
            )
        return VisTranslation(cameras=cameras, offset=(0.0, 0.0, self.gap), servoing=servoing)


def view_of(scenario: VisionServoScenario, view: View | Literal["hand"], at: Array) -> Image:
    """Return the image of a camera without noise, shape (height, width, 3), at a displacement."""
    X_WE, target = tip_pose(at), tip_pose(np.array(scenario.target))
    if view == "hand":
        X_WC = X_WE @ scenario.camera_at
        camera = scenario.hand_camera.placed(X_WC.rotation().matrix(), X_WC.translation())
        return render_solids(camera, [LOOSE], {"part": target})
    X_WT = X_WE @ scenario.held_at
    poses = {"socket": target, "plug": X_WT, "gripper": X_WT}
    return render_solids(scenario.camera(view), HELD_OVER, poses)


def _skill_of(primitive: Primitive) -> Skill:
    """Return the skill that runs a primitive until it has an event."""
    ends: dict[Outcome, str | Retry] = dict.fromkeys(primitive.events, DONE)
    run = SkillState(name="run", run=[primitive], on=ends, timeout=_ENDLESS)
    return Skill(name=primitive.label, states=[run], retract=[MoveDx()])


def event_of(diagram: Diagram, root: Context) -> str | None:
    """Return the event with which the primitive ended; None: it goes on."""
    machine: SkillMachine = diagram.GetSubsystemByName("primitive")
    context = machine.GetMyContextFromRoot(root)
    taken = machine.transitions(context)
    return taken[0].label if taken else machine.snapshot(context).memory.event


def make_vision_servo_diagram(scenario: VisionServoScenario) -> Diagram:
    """Build the loop of one primitive; the carriage is an integrator of its velocity.

    It exports ``displacement``, rad above m, ``velocity``, rad/s above m/s, shape (6,), and
    ``state``. From a tick after the primitive's event on, the state is
    :data:`chamfer.systems.primitives.skill.DONE`.
    """
    builder = DiagramBuilder()
    carriage = builder.AddNamedSystem("carriage", Integrator(np.array(scenario.start)))
    machine = SkillMachine(_skill_of(scenario.parameters), parts=len(PARTS), period=TICK)
    builder.AddNamedSystem("primitive", machine)
    untouched = builder.AddNamedSystem("no contact", ConstantVectorSource(np.zeros(6)))
    target = tip_pose(np.array(scenario.target))
    source = builder.AddNamedSystem("target", ConstantVectorSource(pose_vector(target)))
    carried = {"plug": scenario.held_at, "gripper": scenario.held_at}
    if scenario.primitive == "grasp":
        carried = {"camera": scenario.camera_at}
    poses = builder.AddNamedSystem("poses", CarriedPoses(carried))
    velocity = machine.GetOutputPort("velocity")
    builder.Connect(velocity, carriage.get_input_port())
    for name in ("motion", "perturbed"):  # nothing perturbs the command
        builder.Connect(velocity, machine.GetInputPort(name))
    builder.Connect(untouched.get_output_port(), machine.GetInputPort("wrench"))
    builder.Connect(carriage.get_output_port(), machine.GetInputPort("carriage"))
    builder.Connect(carriage.get_output_port(), poses.get_input_port())

    if scenario.primitive == "grasp":
        camera = SolidsCamera(scenario.hand_camera, [LOOSE])
        detector: LeafSystem = CrossSectionDetector()
        add_camera(builder, scenario.frames, "hand", camera, detector)
        builder.Connect(source.get_output_port(), camera.GetInputPort("part_pose"))
        builder.Connect(poses.GetOutputPort("camera_pose"), camera.GetInputPort("camera_pose"))
        builder.Connect(detector.get_output_port(), machine.GetInputPort("cross_section"))
    else:
        views = STATIC[:1] if scenario.primitive == "fixed_point" else STATIC
        for view in views:
            camera = SolidsCamera(scenario.camera(view), HELD_OVER)
            detector = PartsDetector(PARTS)
            add_camera(builder, scenario.frames, view, camera, detector)
            builder.Connect(source.get_output_port(), camera.GetInputPort("socket_pose"))
            for name in carried:
                port = f"{name}_pose"
                builder.Connect(poses.GetOutputPort(port), camera.GetInputPort(port))
            builder.Connect(detector.get_output_port(), machine.GetInputPort(f"{view}_detections"))

    builder.ExportOutput(carriage.get_output_port(), "displacement")
    builder.ExportOutput(velocity, "velocity")
    builder.ExportOutput(machine.GetOutputPort("state"), "state")
    diagram = builder.Build()
    diagram.set_name(f"Vision primitive: {scenario.primitive.replace('_', ' ')}")
    return diagram


def add_camera(
    builder: DiagramBuilder,
    params: FrameGrabberParams,
    name: str,
    camera: SolidsCamera,
    detector: LeafSystem,
) -> LeafSystem:
    """Add a camera and the detection of parts in its frames; return its frame grabber."""
    builder.AddNamedSystem(f"{name} camera", camera)
    grabber = add_frame_grabber(builder, params, f"{name} frames")
    builder.AddNamedSystem(f"{name} detection", detector)
    builder.Connect(camera.GetOutputPort("image"), grabber.GetInputPort("image"))
    builder.Connect(grabber.get_output_port(), detector.get_input_port())
    return grabber
