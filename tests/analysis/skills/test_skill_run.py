"""Any skill, run in a scenario."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.skills.insertion_metrics import insertion_metrics
from chamfer.analysis.skills.skill_run import AXES, run_skill, true_motion
from chamfer.diagrams.skills.connector_scenario import (
    D_CONNECTOR,
    BncConnectorScenario,
    DConnectorScenario,
    resolve,
)
from chamfer.models.arms.wrist import tip_pose
from chamfer.systems.primitives.force_primitives import GuardedMove
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE, Retry, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.sensing.force_sensor import WrenchSensorParams

D: Final = resolve(replace(D_CONNECTOR, sight=None, step=0.002, duration=3.0))
angles = st.floats(-0.4, 0.4)
ways = st.floats(-0.05, 0.05)


def touching(limit: float = 0.03) -> Skill:
    """Touches twice."""
    touch = SkillState(
        name="touch", run=[GuardedMove(limit=limit)], on={"contact": "leave"}, timeout=5.0
    )
    up = MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, 0.002), duration=0.2)
    leave = SkillState(
        name="leave", run=[up], on={"done": Retry("touch", 1, Retry("rest", 1))}, timeout=1.0
    )
    rest = SkillState(name="rest", run=[MoveDx(duration=0.1)], on={"done": DONE}, timeout=1.0)
    return Skill(name="touching", states=[touch, leave, rest], retract=[up], held=True)


def test_a_skill_of_ones_own_says_what_it_did() -> None:
    found = run_skill(touching(), D)
    assert (found.outcome, found.state, found.reason) == ("done", DONE, "")
    assert [(one.source, one.outcome) for one in found.path] == [
        ("touch", "contact"),
        ("leave", "done"),
        ("touch", "contact"),
        ("leave", "done"),
        ("rest", "done"),
    ]
    times = [one.time for one in found.path]
    assert times == sorted(times)
    assert found.traces["time"][-1] == pytest.approx(times[-1], abs=0.1)
    assert found.traces["retries"][-1] == 2
    # Down to the face, which gives way by the threshold over the wrist's stiffness.
    assert found.traces["depth"].max() == pytest.approx(0.0, abs=3e-4)
    # Steps of the plant are between the ticks, and are seen too.
    ticks = [float(np.abs(found.traces[f"true_wrench_{axis}"]).max()) for axis in AXES]
    assert np.all(found.peaks >= ticks)
    assert found.peaks[5] == pytest.approx(ticks[5], rel=0.1)


def test_a_skill_that_fails_says_why_and_one_that_is_cut_off_does_not_end() -> None:
    found = run_skill(touching(limit=0.002), D)
    assert (found.outcome, found.state, found.reason) == ("failed", "failed", "touch: lost")
    assert [one.target for one in found.path] == ["retract", "failed"]
    cut = run_skill(touching(), replace(D, duration=0.2))
    assert (cut.outcome, cut.state, cut.reason, cut.path) == ("running", "touch", "", ())


@given(displacement=st.tuples(angles, angles, angles, ways, ways, ways))
def test_true_motion_of_a_plug_that_is_held_straight(displacement: tuple[float, ...]) -> None:
    X = tip_pose(np.array(displacement))
    found = true_motion(np.array([displacement]), np.zeros(3))
    x, y, z = X.translation()
    assert found["depth"][0] == -z
    assert (found["lateral_x"][0], found["lateral_y"][0]) == (x, y)
    axis = X.rotation().matrix()[:, 2]
    assert np.cos(found["tilt"][0]) == pytest.approx(axis[2], abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "within"),
    # Contact-rich searches may be chaotic: these begin near the socket's middle, where the search
    # has nothing to find, or, with the BNC connector, only the slots.
    [
        # What lays a D at the bottom is the push's last command, a window more or less.
        (DConnectorScenario(initial_error=(0.01, 0.0, 0.005, 1e-4, 5e-5, 0.0)), Seat().growth - 1),
        (BncConnectorScenario(initial_error=(0.0, 0.0, -0.12, 0.0, 0.0, 0.0)), 0.02),
    ],
)
def test_a_finer_step_changes_neither_depth_nor_peak_force(scenario: Any, within: float) -> None:
    still = resolve(replace(scenario, height=0.001, sensor=WrenchSensorParams()))
    coarse, fine = (
        insertion_metrics(
            run_skill(still.make_skill(), replace(still, step=step)), still.connector
        )
        for step in (0.001, 0.0005)
    )
    values: list[dict[str, Any]] = [dict(coarse), dict(fine)]
    assert [one["success"] for one in values] == [1.0, 1.0]
    assert values[1]["force.peak"] == pytest.approx(values[0]["force.peak"], rel=within)
    assert values[1]["depth"] == pytest.approx(values[0]["depth"], abs=2e-5)
