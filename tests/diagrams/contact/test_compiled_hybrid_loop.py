"""The compiled hybrid loop beside the diagram, and what is left to the diagram."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.contact.contact_runs import run_contact
from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.contact.compiled_hybrid_loop import run_compiled
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_MOTION,
    PLANAR_SLIDE,
    PUMA_ROLLER_MOTION,
    PlanarLoop,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_scenario import fill
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK, endpoint
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.force.hybrid_law import LAWS
from chamfer.systems.recording import Recorder, recording
from chamfer.systems.sensing.encoders import EncoderParams


def changed(scenario: Any, part: str, **values: Any) -> Any:
    """The scenario with other values in one of its parts."""
    return replace(scenario, **{part: replace(getattr(scenario, part), **values)})


NEAR = (
    changed(PLANAR_SLIDE, "task", start=(1.0, -1.45)),
    changed(PUMA_ROLLER_MOTION, "task", distance=0.004),
    changed(ADEPT_NUGGET_MOTION, "task", distance=0.002),
)
FEED = FrictionCompensationParams(bandwidth=10.0, joints=(0,))
COUNTED = EncoderParams(counts=1e5, velocity="exact", bandwidth=0.0)
TRACKED = EncoderParams(counts=0.0, velocity="tracked", bandwidth=20.0)
COARSE = replace(COUNTED, counts=0.4)  # the planar arm's elbow seems straight


def drawn(index: int) -> Any:
    """A loop near its surface: arm and law in turn, all else by lot."""
    lot = np.random.default_rng(index)

    def one(*values: Any) -> Any:
        return values[lot.integers(len(values))]

    scenario, law = NEAR[index % 3], LAWS[index // 3 % 3]
    if index % 3 == 1 and law != "transpose":  # the Puma's gains are in N/m
        scenario = changed(scenario, "controller", stiffness=100.0, integral=200.0, damping=6.0)
    on_way = {"amplitude": 0.02, "blend": one(0.1, 0.3), "frequency": lot.uniform(3.0, 8.0)}
    controller = {
        "law": law,
        "full_dynamics": law != "transpose" and one(True, False),
        "held_integrators": one((), (1,)),
        "force_damping": one(0.0, 5.0),
        **{name: one(True, False) for name in ("loss_mode", "bumpless")},
    }
    scenario = changed(scenario, "task", kick_time=one(None, 0.6), **on_way)
    scenario = changed(scenario, "controller", **controller)
    scenario = changed(scenario, "surface", friction=SurfaceFriction(coefficient=one(0.0, 0.3)))
    others = {
        "friction_compensation": one(None, FEED),
        "gripper": one(None, GripperCompliance(stiffness=2e3, damping=20.0)),
        "encoders": one(EncoderParams(), COUNTED, TRACKED),
        "sensing": one("ideal", "realistic"),
    }
    return fill(replace(scenario, duration=lot.uniform(0.9, 1.1), **others))


def test_drawn_loops_do_what_their_diagrams_do() -> None:
    modes: set[float] = set()
    for index in range(12):
        scenario = drawn(index)
        diagram, period = make_hybrid_diagram(scenario), scenario.controller.period
        run = simulate(diagram, duration=scenario.duration, step=period, seed=index)
        found = run_compiled(scenario, index)
        assert found is not None
        assert list(found) == list(run.outputs)
        for name, values in run.outputs.items():
            where = f"{name} of loop {index}"
            np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-9, err_msg=where)
        assert CONTACT in found["mode"]
        modes |= set(found["mode"])
    assert modes == {APPROACH, CONTACT, LOST}


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        (changed(NEAR[0], "controller", stiffness=1e9), r"velocity at t = 0\.\d+ s is \["),
        (replace(NEAR[0], encoders=COARSE), r"the pose of the planar two-link arm is \[.*"),
    ],
)
def test_a_run_that_ends_early_is_the_diagrams_to_refuse(scenario: Any, message: str) -> None:
    scenario = fill(replace(scenario, duration=2.0))
    assert run_compiled(scenario, 0) is None
    with pytest.raises(ParameterError, match=message):
        run_contact(scenario, 0)


class OwnArm(PlanarLoop):
    """The planar arm with kinematics of a user's own."""

    ARM = replace(PLANAR_TWO_LINK, endpoint=lambda q: endpoint(q))


def test_own_arms_and_recorded_laws_run_in_the_diagram() -> None:
    scenario = fill(replace(NEAR[0], duration=0.1))
    own = fill(OwnArm(task=scenario.task, duration=0.1))
    assert run_compiled(own, 0) is None
    np.testing.assert_array_equal(run_contact(own, 0)["x"], run_contact(scenario, 0)["x"])
    with recording(Recorder()):
        assert run_compiled(scenario, 0) is None
