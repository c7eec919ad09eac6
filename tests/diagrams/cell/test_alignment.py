"""The cell aligned by sight: it converges, and nothing but images reaches the controller."""

import math
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.systems.sensors import ImageRgba8U
from scipy.spatial.transform import Rotation

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell import cell_vision
from chamfer.diagrams.cell.alignment import make_alignment_diagram, resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, ControllerChoice
from chamfer.diagrams.cell.cell_vision import CameraSettings, ViewSettings
from chamfer.diagrams.cell.work_cell import HOLE_ARM, PEG_ARM
from chamfer.diagrams.insertion.insertion import InsertionScenario, make_insertion_diagram
from chamfer.diagrams.insertion.insertion import resolve as resolve_insertion
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import (
    FrameGrabber,
    FrameGrabberParams,
    SensorParams,
    write_image,
)
from chamfer.systems.cameras.software_camera import PosePorts, render
from chamfer.systems.cameras.vtk_camera import missing_graphics
from chamfer.systems.force.impedance_controller import ImpedanceController

Array = np.ndarray
Outputs = dict[str, Array]

PERIOD = 1 / 80


def run(scenario: AlignmentScenario, seed: int = 0) -> Outputs:
    diagram = make_alignment_diagram(resolve(scenario))
    return simulate(diagram, duration=scenario.duration, step=PERIOD, seed=seed).outputs


# Arms that are known, without friction: it would hold small errors.
KNOWN = {"payload_error": 0.0, "joint_friction": (0.0,) * 7}
SMALL = AlignmentScenario(
    peg=replace(PEG_ARM, **KNOWN),
    hole=replace(HOLE_ARM, **KNOWN),
    controller=ControllerChoice(kind="pid"),  # the quicker one
    initial_error=(0.0, 0.002, -0.002, 0.0, 0.02, -0.02),
    begin=0.5,
    compensation_time=0.7,
)
SHARES = {"peg": (1.0, 0.0), "hole": (0.0, -1.0), "both": (0.5, -0.5), "none": (0.0, 0.0)}


@lru_cache
def shared(compensated: Any) -> Outputs:
    return run(replace(SMALL, compensated=compensated))


# The hole's arm alone is the second share of both.
WAYS = ["peg", pytest.param("hole", marks=pytest.mark.slow), "both"]


@pytest.mark.parametrize("compensated", [*WAYS, "none"])
def test_every_arm_takes_its_share(compensated: Any) -> None:
    outputs = shared(compensated)
    assert np.abs(outputs["compensation"][-1, 1:3]).min() > 1e-3
    assert np.abs(outputs["compensation"][-1, 4:]).max() > 0.01
    for arm, share in zip(("peg", "hole"), SHARES[compensated], strict=True):
        command = outputs[f"{arm}.command"]
        total = share * outputs["compensation"]
        moved = command[:, 4:] - command[0, 4:]
        np.testing.assert_allclose(moved, total[:, :3], rtol=0, atol=1e-12)
        turns = Rotation.from_quat(command[:, :4], scalar_first=True)
        turned = (turns * turns[0].inv()).as_rotvec()
        np.testing.assert_allclose(turned, total[:, 3:], rtol=0, atol=1e-12)


def test_the_peg_is_commanded_off_by_the_initial_error_and_the_hole_is_not() -> None:
    outputs = shared("peg")
    X_WT = outputs["peg.command"][0]
    np.testing.assert_allclose(X_WT[4:], [-0.03, 0.002, 0.156], rtol=0, atol=1e-12)
    turned = Rotation.from_quat(X_WT[:4], scalar_first=True).as_rotvec()
    np.testing.assert_allclose(turned, [0.0, 0.02, -0.02], rtol=0, atol=1e-12)
    for desired in (outputs["peg.desired_pose"], outputs["hole.desired_pose"]):
        assert (desired == desired[0]).all()
    np.testing.assert_allclose(outputs["peg.desired_pose"][0], [1, 0, 0, 0, -0.03, 0, 0.158])
    np.testing.assert_allclose(outputs["hole.command"][0], outputs["hole.desired_pose"][0])


CONTROLLERS = {"fsm": "trajectory compensator", "pid": "PID"}
PLANT = {"arms", "geometry", "peg true pose", "hole true pose"}
CAMERAS = {"xz camera", "xy camera"}
SIGHT = {
    "image error",
    "divergence watch",
    *("xz detection", "xy detection", "xz frames", "xy frames"),
}
IN_IMAGES = {"both image planes"}
IN_SPACE = {"two-plane stereo", "metres to pixels"}
DESIRED = {
    "expected error",
    "expected, 0 periods old",
    "expected, 1 periods old",
    "peg desired motion",
    "hole desired pose",
}


@pytest.mark.parametrize(
    ("controller", "measured", "moves", "renderer"),
    [
        *product(CONTROLLERS, ("image", "metric"), (False, True), ("software",)),
        ("fsm", "image", True, "vtk"),
        ("pid", "metric", False, "vtk"),
    ],
)
def test_only_images_reach_the_controller(
    controller: Any, measured: Any, moves: bool, renderer: Any, wires: Any, known_to: Any
) -> None:
    if renderer == "vtk" and (reason := missing_graphics()):
        pytest.skip(reason)
    scenario = AlignmentScenario(
        controller=ControllerChoice(kind=controller),
        cameras=CameraSettings(measured=measured, renderer=renderer),
        start_offset=(0.0, 0.0, -0.01 if moves else 0.0),
    )
    diagram = make_alignment_diagram(resolve(scenario))
    wiring, control = wires(diagram), CONTROLLERS[controller]
    grabbers = {
        system.get_name() for system in diagram.GetSystems() if isinstance(system, FrameGrabber)
    }
    assert grabbers == {"xz frames", "xy frames"}
    assert known_to(wiring, control) >= PLANT | CAMERAS  # the loop is closed
    for cut in (grabbers, CAMERAS):
        assert not PLANT & known_to(wiring, control, cut)
    known = SIGHT | (IN_IMAGES if measured == "image" else IN_SPACE)
    assert known_to(wiring, control, grabbers) == known | (DESIRED if moves else set())
    # Nobody but the cameras sees where the tools are.
    for arm in ("peg", "hole"):
        assert {wire[2] for wire in wiring if wire[0] == f"{arm} true pose"} == CAMERAS
    assert {wire[2] for wire in wiring if wire[0] == "arms"} == {
        "geometry",
        "peg true pose",
        "hole true pose",
        "peg impedance control",  # the encoders
        "hole impedance control",
    }


SHORT = resolve(AlignmentScenario(begin=0.2, compensation_time=1.0))


class Integrator(LeafSystem):
    """Integrates the measured error wherever it is measured."""

    def __init__(self, size: int = 6) -> None:
        super().__init__()
        self._error = self.DeclareVectorInputPort("error", 6)
        self._valid = self.DeclareVectorInputPort("valid", 1)
        state = self.DeclareDiscreteState(size)
        self.DeclareStateOutputPort("compensation", state)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._tick)

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        gain = 0.06 * np.array([5e-4] * 3 + [1.0] * 3) * self._valid.Eval(context)[0]
        total = context.get_discrete_state_vector().value()
        values.set_value(total + gain * np.nan_to_num(self._error.Eval(context)))


def test_an_own_controller_aligns_the_parts() -> None:
    diagram = make_alignment_diagram(SHORT, controller=Integrator())
    found = simulate(diagram, duration=SHORT.duration, step=PERIOD, seed=0).outputs
    off = np.hypot(found["error"][:, 1], found["error"][:, 2])
    assert not found["compensation"][10].any()
    assert off[-1] < 0.2 * off[20]


def test_an_own_law_drives_an_arm() -> None:
    arm, posture = SHORT.peg.known_arm(), SHORT.rest_posture("peg")
    own = ImpedanceController(arm, posture, SHORT.impedance)
    runs = [
        simulate(
            make_alignment_diagram(SHORT, arm_controllers=given), duration=0.1, step=PERIOD, seed=0
        ).outputs["peg.true_pose"]
        for given in (None, {"peg": own})
    ]
    np.testing.assert_array_equal(*runs)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"controller": Integrator(5)},
            r"output port compensation of size 6; .*compensation \(5\)",
        ),
        ({"controller": ConstantVectorSource([0.0] * 6)}, "input port error of size 6; .* none"),
        (
            {"arm_controllers": {"hole": Integrator()}},
            r"^hole controller is .*input port encoders of size 14; .*error \(6\), valid \(1\)",
        ),
    ],
)
def test_other_ports_are_refused_in_a_line(given: dict[str, Any], told: str) -> None:
    for make, scenario in (
        (make_alignment_diagram, SHORT),
        (make_insertion_diagram, resolve_insertion(InsertionScenario())),
    ):
        with pytest.raises(ParameterError, match=told):
            make(scenario, **given)  # type: ignore[operator]


BRIEF = resolve(AlignmentScenario(begin=0.3, compensation_time=0.5))
BRIEF_BEGIN = 24  # the tick from which on the compensation may change; the log has what it reads
LATERAL, ROTATIONAL = BRIEF.compensator.axes[0], BRIEF.compensator.axes[3]
BOTH = ["fsm", "pid"]
FSM_FIRST = ["fsm", pytest.param("pid", marks=pytest.mark.slow)]  # what is the plant's to decide


def changes(outputs: Outputs) -> Array:
    """Of the compensation, by the tick at which they were made, shape (n - 1, 6)."""
    return np.diff(outputs["compensation"], axis=0)


@pytest.mark.parametrize("measured", ["image", "metric"])
@pytest.mark.parametrize("controller", BOTH)
def test_blank_images_stop_the_compensation(controller: Any, measured: Any) -> None:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=1.0), measured=measured)
    outputs = run(
        replace(
            BRIEF,
            controller=ControllerChoice(kind=controller),
            cameras=cameras,
            begin=0.1,
            compensation_time=0.2,
        )
    )
    assert not outputs["compensation"].any()
    assert not outputs["valid"].any()
    assert not outputs["error"].any()
    # Misses count from the begin: the fifth makes it blind.
    np.testing.assert_allclose(outputs["age"], PERIOD * np.maximum(np.arange(25) - 8, 0))
    np.testing.assert_array_equal(outputs["blind"], np.arange(25) >= 8 + 5)


@pytest.mark.parametrize("controller", FSM_FIRST)
def test_dropped_frames_change_nothing(controller: Any) -> None:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=0.3), most_misses=40)
    outputs = run(replace(BRIEF, controller=ControllerChoice(kind=controller), cameras=cameras))
    valid = outputs["valid"] > 0
    assert 0.3 < valid[BRIEF_BEGIN:].mean() < 0.7  # both cameras have to have their frames: 0.49
    assert not changes(outputs)[~valid[:-1]].any()
    assert not outputs["error"][~valid].any()
    made = np.abs(changes(outputs)[valid[:-1]])
    assert (made.max(axis=1) > 0).all()
    assert not outputs["blind"].any()
    if controller == "fsm":
        steps = [LATERAL.increment] * 3 + [ROTATIONAL.increment] * 3
        assert (made <= np.array(steps) * (1 + 1e-9)).all()


LOST, FOUND = 0.5, 0.65  # s, between which the peg is not in view


class PegVanishes(LeafSystem):
    """A software camera that for a while does not see the peg."""

    def __init__(self, parts: ColouredParts, camera: Camera, *, sensor: SensorParams) -> None:
        super().__init__()
        poses = PosePorts(self)

        def calc(context: Context, output: Any) -> None:
            X_WT, X_WM = poses.read(context)
            gone = LOST <= context.get_time() < FOUND
            write_image(output, render(parts, camera, None if gone else X_WT, X_WM))

        model = Value(ImageRgba8U(camera.width, camera.height, 0))
        depends = poses.tickets() | {self.time_ticket()}
        self.DeclareAbstractOutputPort("image", model.Clone, calc, depends)


@pytest.fixture(scope="module", params=BOTH)
def lost(request: Any) -> Outputs:
    """A run with an approach in which the peg gets lost, and found again."""
    scenario = replace(
        BRIEF,
        controller=ControllerChoice(kind=request.param),
        start_offset=(-0.02, 0.0, -0.01),
        motion_time=1.0,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cell_vision, "SoftwareCamera", PegVanishes)
        return run(scenario)


# An exposure is read latency + 1 = 2 ticks later.
FIRST_MISS = round(LOST / PERIOD) + 2
BLIND = FIRST_MISS + 5  # more than most_misses = 4
FIRST_FOUND = round(FOUND / PERIOD) + 2


def test_a_lost_part_holds_the_compensation(lost: Outputs) -> None:
    misses = slice(FIRST_MISS, FIRST_FOUND)
    assert (lost["valid"][BRIEF_BEGIN:FIRST_MISS] == 1).all()
    assert not lost["valid"][misses].any()
    assert not lost["error"][misses].any()
    assert not changes(lost)[misses].any()
    assert np.abs(lost["compensation"][FIRST_MISS, 1:3]).min() > 1e-4


def test_a_lost_part_makes_blind_and_stops_the_approach_for_good(lost: Outputs) -> None:
    np.testing.assert_array_equal(lost["blind"], np.arange(len(lost["blind"])) >= BLIND)
    desired = lost["peg.desired_pose"]
    assert (np.diff(desired[: BLIND + 1, 4]) > 0).all()  # until it is told
    assert (desired[BLIND:] == desired[BLIND]).all()
    assert desired[BLIND, 4] < BRIEF.nominal_pose("peg").translation()[0] - 0.002
    assert (lost["hole.desired_pose"] == lost["hole.desired_pose"][0]).all()


def test_parts_that_are_driven_out_of_sight_are_not_driven_on_when_they_are_seen_again() -> None:
    true = CameraModel(roll=math.pi)
    cameras = CameraSettings(xz=ViewSettings(true=true))
    pid = ControllerChoice(kind="pid")
    usual = AlignmentScenario(cameras=cameras, controller=pid, compensation_time=0.5)
    outputs = run(resolve(usual))
    sizes = np.linalg.norm(outputs["error"][:, 1:3], axis=1)
    begin = int(np.flatnonzero(outputs["valid"])[0])
    blind = int(np.flatnonzero(outputs["blind"])[0])
    lost = int(np.flatnonzero(outputs["valid"][begin:] == 0)[0]) + begin
    assert np.sum(sizes[begin:lost] > 1.5 * sizes[begin]) < 5  # too few to tell, but for the loss
    assert outputs["valid"][blind:].any()  # they are seen again
    assert outputs["diverged"][blind + 1 :].all()
    assert not changes(outputs)[lost:].any()
    assert np.abs(outputs["compensation"][:, 1:3]).max() < 0.025  # of a limit of 0.03
