"""What an insertion does when cameras, motors, arms or parts fail it: it stops, and says why."""

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
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve
from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import FrameGrabberParams, write_image
from chamfer.systems.cameras.part_poses import PosePorts
from chamfer.systems.cameras.picture_formation import SensorParams
from chamfer.systems.cameras.software_camera import render
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


# Arms


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
