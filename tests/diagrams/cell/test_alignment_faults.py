"""What the aligned cell does when the cameras or the motors fail it; short runs."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell import cell_vision
from chamfer.diagrams.cell.alignment import make_alignment_diagram, resolve
from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    ControllerChoice,
)
from chamfer.diagrams.cell.cell_vision import CameraSettings, ViewSettings
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import FrameGrabberParams, SensorParams, write_image
from chamfer.systems.cameras.software_camera import PosePorts, render

Array = np.ndarray
Outputs = dict[str, Array]

PERIOD = 1 / 80
SHORT = resolve(AlignmentScenario(begin=0.3, compensation_time=0.5))
BEGIN = 24  # the tick from which on the compensation may change; the log has what it reads
LATERAL, ROTATIONAL = SHORT.compensator.axes[0], SHORT.compensator.axes[3]
BOTH = ["fsm", "pid"]
FSM_FIRST = ["fsm", pytest.param("pid", marks=pytest.mark.slow)]  # what is the plant's to decide


def run(scenario: AlignmentScenario, seed: int = 0) -> Outputs:
    diagram = make_alignment_diagram(resolve(scenario))
    return simulate(diagram, duration=scenario.duration, step=PERIOD, seed=seed).outputs


def changes(outputs: Outputs) -> Array:
    """Of the compensation, by the tick at which they were made, shape (n - 1, 6)."""
    return np.diff(outputs["compensation"], axis=0)


@pytest.mark.parametrize("measured", ["image", "metric"])
@pytest.mark.parametrize("controller", BOTH)
def test_blank_images_stop_the_compensation(controller: Any, measured: Any) -> None:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=1.0), measured=measured)
    outputs = run(
        replace(
            SHORT,
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


@lru_cache
def with_dropped_frames(controller: Any) -> Outputs:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=0.3), most_misses=40)
    return run(replace(SHORT, controller=ControllerChoice(kind=controller), cameras=cameras))


@pytest.mark.parametrize("controller", FSM_FIRST)
def test_dropped_frames_change_nothing(controller: Any) -> None:
    outputs = with_dropped_frames(controller)
    valid = outputs["valid"] > 0
    assert 0.3 < valid[BEGIN:].mean() < 0.7  # both cameras have to have their frames: 0.49
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
        SHORT,
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
    assert (lost["valid"][BEGIN:FIRST_MISS] == 1).all()
    assert not lost["valid"][misses].any()
    assert not lost["error"][misses].any()
    assert not changes(lost)[misses].any()
    assert np.abs(lost["compensation"][FIRST_MISS, 1:3]).min() > 1e-4


def test_a_lost_part_makes_blind_and_stops_the_approach_for_good(lost: Outputs) -> None:
    np.testing.assert_array_equal(lost["blind"], np.arange(len(lost["blind"])) >= BLIND)
    desired = lost["peg.desired_pose"]
    assert (np.diff(desired[: BLIND + 1, 4]) > 0).all()  # until it is told
    assert (desired[BLIND:] == desired[BLIND]).all()
    assert desired[BLIND, 4] < SHORT.nominal_pose("peg").translation()[0] - 0.002
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
