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
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
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


def drawn(index: int) -> HybridScenario:
    """A loop near its surface: arm and law in turn, all else by lot."""
    lot = np.random.default_rng(index)
    yes = lambda: bool(lot.random() < 0.5)  # noqa: E731
    scenario, law = NEAR[index % 3], LAWS[index // 3 % 3]
    if index % 3 == 1 and law != "transpose":  # the Puma's gains are in N/m
        scenario = changed(scenario, "controller", stiffness=100.0, integral=200.0, damping=6.0)
    n, full = scenario.ARM.num_joints, law != "transpose" and yes()
    scenario = changed(
        scenario,
        "task",
        blend=lot.uniform(0.1, 0.3),
        amplitude=lot.uniform(0.005, 0.02),
        frequency=lot.uniform(3.0, 8.0),
        kick_time=lot.uniform(0.5, 0.7) if yes() else None,
    )
    scenario = changed(
        scenario,
        "controller",
        law=law,
        full_dynamics=full,
        loss_mode=yes(),
        bumpless=yes(),
        held_integrators=(n - 1,) if yes() else (),
        force_damping=lot.uniform(0.0, 5.0),
    )
    friction = SurfaceFriction(coefficient=lot.uniform(0.0, 0.3))
    scenario = changed(scenario, "surface", friction=friction)
    if yes():
        given = FrictionCompensationParams(bandwidth=lot.uniform(5.0, 20.0), joints=(0,))
        scenario = replace(scenario, friction_compensation=given)
    if yes():
        scenario = replace(scenario, gripper=GripperCompliance(stiffness=2e3, damping=20.0))
    if yes():
        velocity = ("exact", "tracked")[int(yes())]
        bandwidth = 20.0 if velocity == "tracked" else 0.0
        encoders = EncoderParams(counts=1e5, velocity=velocity, bandwidth=bandwidth)  # type: ignore[arg-type]
        scenario = replace(scenario, encoders=encoders)
    sensing = ("ideal", "realistic")[int(index % 2 == 0 or yes())]
    return fill(replace(scenario, duration=lot.uniform(0.9, 1.1), sensing=sensing))  # type: ignore[arg-type]


def of_diagram(scenario: HybridScenario, seed: int) -> Any:
    period = scenario.controller.period
    diagram = make_hybrid_diagram(scenario)
    return simulate(diagram, duration=scenario.duration, step=period, seed=seed).outputs


def test_drawn_loops_do_what_their_diagrams_do() -> None:
    modes: set[float] = set()
    for index in range(12):
        scenario = drawn(index)
        found, expected = run_compiled(scenario, index), of_diagram(scenario, index)
        assert found is not None
        assert list(found) == list(expected)
        for name, values in expected.items():
            where = f"{name} of loop {index}"
            np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-9, err_msg=where)
        assert CONTACT in expected["mode"]
        modes |= set(expected["mode"])
    assert modes == {APPROACH, CONTACT, LOST}


# Counts so coarse that the elbow seems straight.
COARSE = EncoderParams(counts=0.4, velocity="exact", bandwidth=0.0)


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        (changed(NEAR[0], "controller", stiffness=1e9), r"velocity at t = 0\.\d+ s is \["),
        (
            replace(NEAR[0], encoders=COARSE),
            r"the pose of the planar two-link arm is \[.*",
        ),
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
    own = OwnArm(task=scenario.task, duration=0.1)
    assert run_compiled(fill(own), 0) is None
    np.testing.assert_array_equal(run_contact(fill(own), 0)["x"], run_contact(scenario, 0)["x"])
    with recording(Recorder()):
        assert run_compiled(scenario, 0) is None
