"""What an insertion does when cameras, motors, arms or parts fail it: it stops, and says why."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from chamfer.analysis.insertion.cell_runs import (
    CellInsertion,
    ending,
    force_medians,
    insertion_metrics,
    run_cell_insertion,
)
from chamfer.diagrams.cell import cell_vision
from chamfer.diagrams.cell.alignment_scenario import SixAxisSettings
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.diagrams.cell.work_cell import PEG_ARM
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve
from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import FrameGrabberParams, write_image
from chamfer.systems.cameras.part_poses import PosePorts
from chamfer.systems.cameras.picture_formation import SensorParams
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.force.impedance_controller import ImpedanceControllerParams
from chamfer.systems.strategies.insertion_decision import DecisionParams

Run = tuple[CellInsertion, InsertionScenario]


def run(scenario: InsertionScenario) -> Run:
    resolved = resolve(scenario)
    return run_cell_insertion(resolved, seed=0), resolved


def hardest(done: CellInsertion, scenario: InsertionScenario) -> float:
    """The largest contact force, N, of 10 ms."""
    return float(np.hypot(*force_medians(done.traces, scenario.step)).max())


def assert_ended(found: Run, state: str, words: str) -> None:
    """It is not seated, does not say so, says why, stays below the limit, and stands still."""
    done, scenario = found
    values = insertion_metrics(done, scenario)
    assert done.state == state
    assert values["seated"] == values["seated.said"] == 0
    assert words in ending(done, scenario)
    assert hardest(done, scenario) < scenario.insert.force_limit
    assert done.traces["feed"][-1] == pytest.approx(done.traces["feed"][-20], abs=0.001)


# Cameras


class PegVanishes(LeafSystem):
    """A software camera that does not see the peg any more once it is in the hole."""

    def __init__(self, parts: ColouredParts, camera: Camera, *, sensor: SensorParams) -> None:
        super().__init__()
        poses = PosePorts(self)

        def calc(context: Context, output: Any) -> None:
            X_WT, X_WM = poses.read(context)
            assert X_WT is not None
            assert X_WM is not None
            gone = (X_WM.inverse() @ X_WT).translation()[0] > 0.008
            write_image(output, render(parts, camera, None if gone else X_WT, X_WM))

        model = Value(ImageRgba8U(camera.width, camera.height, 0))
        self.DeclareAbstractOutputPort("image", model.Clone, calc, poses.tickets())


@pytest.mark.slow
def test_a_part_that_is_lost_in_contact_stops_it(
    quick: InsertionScenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell_vision, "SoftwareCamera", PegVanishes)
    deep = replace(quick, insert=replace(quick.insert, depth=0.04))
    found = run(deep)
    assert_ended(found, "blind", "stopped: the cameras see no parts")
    assert found[0].traces["depth"][-1] > 0.008


def test_without_frames_nothing_moves(quick: InsertionScenario) -> None:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=1.0))
    done, scenario = run(replace(quick, cameras=cameras))
    assert_ended((done, scenario), "blind", "stopped: the cameras see no parts")
    assert not done.traces["feed"].any()


@pytest.mark.slow
def test_dropped_frames_cost_time_alone(quick: InsertionScenario) -> None:
    cameras = CameraSettings(frames=FrameGrabberParams(miss=0.1), most_misses=40)
    done, scenario = run(replace(quick, cameras=cameras))
    values = insertion_metrics(done, scenario)
    assert values["seated"] == values["seated.said"] == 1
    assert not done.traces["valid"][-100:].all() or not done.traces["valid"][200:].all()


@pytest.mark.slow
def test_errors_that_do_not_get_small_are_given_up(quick: InsertionScenario) -> None:
    # Nothing compensates, and the error is outside of the region.
    wrong = (0.0, 0.006, 0.0, 0.0, 0.0, 0.0)
    decide = DecisionParams(timeout=0.4)
    found = run(replace(quick, initial_error=wrong, compensated="none", decide=decide))
    assert_ended(found, "gave_up", "not aligned in time")


@pytest.mark.slow
def test_a_compensation_at_its_limit_stops_it(quick: InsertionScenario) -> None:
    axes = SixAxisSettings()
    tight = replace(axes, lateral=replace(axes.lateral, limit=0.0005))
    wrong = (0.0, 0.008, 0.0, 0.0, 0.0, 0.0)
    found = run(replace(quick, initial_error=wrong, compensator=tight))
    assert_ended(found, "limit_reached", "stopped: compensation at its limit")


@pytest.mark.slow
def test_cameras_that_are_turned_around_stop_it(quick: InsertionScenario) -> None:
    cameras = CameraSettings(roll=0.1 + math.pi)
    wrong = (0.0, 0.004, -0.003, 0.0, 0.0, 0.0)
    found = run(replace(quick, cameras=cameras, initial_error=wrong))
    assert_ended(found, "diverging", "stopped: compensated, the error grows")


# Arms


@pytest.mark.slow
def test_motors_that_are_too_weak_stop_it(quick: InsertionScenario) -> None:
    weak = ImpedanceControllerParams(torque_limits=(77.3, 24.0, 95.6, 8.0, 0.05, 0.5, 0.05))
    assert_ended(run(replace(quick, impedance=weak)), "saturated", "a joint at its torque limit")


@pytest.mark.slow
def test_an_arm_that_sticks_does_not_get_there(quick: InsertionScenario) -> None:
    stuck = replace(PEG_ARM, joint_friction=(3.0,) * 7)
    found = run(replace(quick, peg=stuck))
    assert_ended(found, "gave_up", "gave up after 1 attempt: the arm did not get to the mouth")
    assert not found[0].traces["contact_state"].any()


# Parts


@pytest.fixture(scope="module")
def thick(quick: InsertionScenario) -> Run:
    """A peg that is thicker than its hole, tried twice."""
    insert = replace(quick.insert, attempts=2)
    return run(replace(quick, peg_excess=0.0003, insert=insert))


@pytest.mark.slow
def test_a_peg_that_is_too_thick_does_not_enter(thick: Run) -> None:
    assert_ended(
        thick, "gave_up", "gave up after 2 attempts: stuck at the mouth, the peg does not"
    )
    done, scenario = thick
    assert done.traces["depth"].max() < scenario.parts.chamfer_height
    values = insertion_metrics(done, scenario)
    assert values["wedged"] == values["jammed"] == 0  # that is said of the bore


@pytest.mark.slow
def test_in_vain_nothing_winds_up(thick: Run) -> None:
    done, scenario = thick
    pushed = done.traces["sensed_x"] > scenario.insert.hold_force
    off = done.when("release", "back_off") | (done.when("insert") & pushed)
    for axis in ("y", "z", "pitch", "yaw"):
        total = done.traces[f"compensation_{axis}"]
        steps = np.abs(np.diff(total))
        # The tick in which the chart learns of the force is still compensated.
        calm = off[1:] & off[:-1] & np.roll(off, 8)[1:]
        assert not steps[calm].any()


@pytest.fixture(scope="module")
def wedge(quick: InsertionScenario) -> Run:
    """A peg that leans much further than the limit, inserted at once and frozen."""
    insert = replace(quick.insert, compensation="frozen")
    return run(
        replace(
            quick,
            initial_error=(0.0, 0.002, 0.0, 0.0, 0.0, -0.1),
            decide=DecisionParams(kind="at_once"),
            insert=insert,
        )
    )


@pytest.mark.slow
def test_a_wedge_is_told_and_pulled_out(wedge: Run) -> None:
    done, scenario = wedge
    assert_ended(wedge, "gave_up", "gave up after 1 attempt: wedged")
    values = insertion_metrics(done, scenario)
    assert (values["wedged"], values["jammed"]) == (1, 0)
    pull = values["pull_out.force"]
    assert pull is not None
    assert 3 < pull < scenario.insert.force_limit
    assert done.traces["depth"][-1] < 0  # it came out
    assert values["depth"] == done.traces["depth"].max()
    assert done.traces["depth"].max() == pytest.approx(0.010, abs=0.002)


@pytest.mark.slow
def test_the_wedge_is_one_of_the_theory(wedge: Run) -> None:
    done, scenario = wedge
    stopped = done.when("release")
    l_of = done.traces["depth"][stopped] - scenario.parts.chamfer_height
    assert (l_of < scenario.parts.wedging_depth).all()
    assert (done.traces["rotational_error"][stopped] > scenario.parts.rotation_limit).all()
