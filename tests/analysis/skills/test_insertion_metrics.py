"""What insertions measure, and what a skill says of itself against what was true."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.skills.insertion_metrics import (
    INSERTION,
    failure,
    failure_columns,
    insertion_metrics,
    is_mated,
    peak,
    verdict,
)
from chamfer.analysis.skills.skill_run import SkillResult, SkillStep
from chamfer.diagrams.skills.connector_scenario import D_CONNECTOR, resolve
from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.connectors.d_connector import DConnector
from chamfer.systems.primitives.carriage import PartGripperParams

D, BNC = DConnector(), BncConnector()
# With states that weigh the plug.
SKILL = resolve(replace(D_CONNECTOR, gripper=PartGripperParams(senses=False))).make_skill()
MATED = D.mated_depth
STILL = ("turn", "tilt", *(f"true_wrench_{axis}" for axis in "xyz"))
DONE = (("approach", "level", "contact"), ("verify", "done", "hindered"))


def inserted(*steps: tuple[str, str, str], depth: float = MATED, turn: float = 0.0) -> SkillResult:
    """A run of two seconds; it succeeds where its depth and its steps say so."""
    return ended(*(steps or DONE), depths=[0.0, 0.001, depth], turn=np.full(3, turn))


def ended(*steps: tuple[str, str, str], depths: list[float], **traces: Any) -> SkillResult:
    """A run with a row per second; a step a second, from 1 s on: source, target, outcome."""
    n = len(depths)
    rows: dict[str, Any] = {"holding": np.ones(n), **dict.fromkeys(STILL, np.zeros(n))}
    rows["true_wrench_z"] = 5.0 * (np.array(depths) >= 0)
    rows |= {name: np.array(values, dtype=float) for name, values in traces.items()}
    path = tuple(SkillStep(float(1 + i), *step, step[2]) for i, step in enumerate(steps))
    last, time = steps[-1][1], np.arange(n, dtype=float)
    failing = [f"{source}: {how}" for source, target, how in steps if target == "retract"]
    return SkillResult(
        outcome=last if last in ("done", "failed") else "running",  # type: ignore[arg-type]
        state=last,
        reason=failing[-1] if failing else "",
        expected="done: a stop" if failing else "",
        path=path,
        traces={"time": time, "depth": np.array(depths), "retries": time / 2, **rows},
        peaks=np.array([0.1, 0.2, 0.0, 99.0, 0.0, 23.0]),
        peak_time=1.502,
        wall_seconds=0.5,
    )


def test_metrics_of_a_run() -> None:
    found = insertion_metrics(inserted(), D)
    assert set(found) == set(INSERTION)
    share = found.pop("force.peak_share")  # type: ignore[attr-defined]
    assert share == pytest.approx(23.0 / D.mating_force)
    assert found == {
        "success": 1.0,
        "duration": 2.0,
        "depth": MATED,
        "force.peak": 23.0,  # a force across does not count
        "force.share": pytest.approx(100 * 99.0 / D.largest_force),  # here it does
        "torque.share": pytest.approx(100 * 0.2 / D.largest_torque),
        "torque.peak": 0.2,
        "retries": 1.0,
        "real_time_factor": 4.0,
    }


@pytest.mark.parametrize(
    ("done", "reason"),
    [
        (inserted(), ""),
        (inserted(depth=MATED + 0.0004), ""),
        (inserted(depth=0.0025), "verify: done but not mated"),
        (inserted(depth=MATED + 0.0006), "verify: done but not mated"),
        # A plug that is in by chance is no success of a skill that failed.
        (inserted(("push", "retract", "jammed"), ("retract", "failed", "over")), "push: jammed"),
        (inserted(DONE[0]), "level: still running"),
    ],
)
def test_why_a_run_is_no_success(done: SkillResult, reason: str) -> None:
    found = failure(done, D)
    assert (found.reason if found else "") == reason
    assert insertion_metrics(done, D)["success"] == float(not reason)


def test_a_bayonet_that_is_not_locked_is_no_success() -> None:
    said = failure(inserted(depth=BNC.mated_depth, turn=-0.6), BNC)
    assert said is not None
    assert said.expected == "within 0.5 mm, turned 56 degrees from the mated angle"


def test_a_failure_says_what_was_true_when_it_gave_up() -> None:
    true = {"tilt": [0.0, 0.068, 0.0], "true_wrench_z": [0.0, 12.3, 0.0]}
    done = gave_up("push", "jammed", 0.001, **true)
    said = failure(done, D)
    assert said == ("push", "jammed", 0.001, MATED, 12.3, 0.068, 1.0, "done: a stop")
    assert said is not None
    assert said.text == (
        "push: jammed at 1.0 of 5.6 mm, 12 N, 3.9 degrees, after 1.0 s; expected done: a stop"
    )
    assert failure_columns(said) == {
        "reason": "push: jammed",
        "reason.depth": 0.001,
        "reason.force": 12.3,
        "reason.tilt": 0.068,
        "reason.time": 1.0,
        "reason.text": said.text,
    }
    assert failure_columns(None) == {
        **dict.fromkeys(failure_columns(said)),
        "reason": "",
        "reason.text": "",
    }


def test_the_peak_is_of_the_state_that_was_left_after_it() -> None:
    # The second step, from retract, is at 2 s; the peak at 1.502 s.
    assert peak(gave_up("push", "jammed", 0.001, end=-0.02)) == {
        "state": "retract",
        "depth": -0.02,
        "tilt": 0.0,
    }
    early = replace(gave_up("push", "jammed", 0.001), peak_time=0.9)
    assert peak(early) == {"state": "push", "depth": 0.001, "tilt": 0.0}
    assert peak(replace(early, peak_time=3.0))["state"] == "failed"


OUT = -0.03  # m, depth of a plug that was retracted


def gave_up(
    state: str, outcome: str, depth: float, end: float = OUT, **traces: Any
) -> SkillResult:
    steps = ((state, "retract", outcome), ("retract", "failed", "over"))
    return ended(*steps, depths=[0.0, depth, end], **traces)


@pytest.mark.parametrize(
    ("connector", "off", "turn", "mated"),
    [
        (DConnector(), 0.0, 1.0, True),
        (DConnector(), -0.0004, 0.0, True),
        (DConnector(), -0.0006, 0.0, False),
        (DConnector(), 0.0006, 0.0, False),
        (BncConnector(), 0.0, -math.pi / 2, True),
        (BncConnector(), 0.0, math.pi / 2 + 0.1, True),  # by the other stud
        (BncConnector(), 0.0, 0.0, False),
        (BncConnector(), 0.0006, -math.pi / 2, False),
    ],
)
def test_mated_is_deep_enough_and_locked(
    connector: Any, off: float, turn: float, mated: bool
) -> None:
    assert is_mated(connector, connector.mated_depth + off, turn) == mated


@pytest.mark.parametrize("short", [0.0, 0.0005001, 0.002])
def test_done_is_false_if_the_plug_is_not_in(short: float) -> None:
    found = verdict(ended(("verify", "done", "hindered"), depths=[0.0, MATED - short]), D, SKILL)
    assert found.mated == (not short)
    assert found.false_done == bool(short)
    assert not found.false_reason


def test_hindered_is_false_of_a_plug_on_the_face() -> None:
    steps = (("search", "push", "hindered"), ("push", "search", "jammed"))
    steps += (("search", "push", "hindered"), ("verify", "done", "hindered"))
    done = ended(*steps, depths=[0.0, 0.0004, 0.0, 0.0006, MATED])
    assert D.lead_in == 0.0005
    found = verdict(done, D, SKILL)
    assert (found.hindered, found.false_hindered) == (3, 1)


@pytest.mark.parametrize(
    ("done", "false"),
    [
        (gave_up("push", "jammed", 0.003), False),
        (gave_up("push", "jammed", MATED), True),  # it was in
        (gave_up("push", "jammed", 0.003, true_wrench_z=[0, 0, 0]), True),  # nothing was touched
        (gave_up("push", "jammed", -0.001, true_wrench_x=[0, 5, 0]), False),  # a face that tilts
        (gave_up("touch", "lost", -0.001), False),  # no face was found
        (gave_up("reach", "timed out", 0.0, end=0.0, holding=[0, 0, 0]), False),
        (gave_up("weigh", "lost", -0.02), True),  # it was held
        (gave_up("weigh", "lost", -0.02, holding=[1, 0, 0]), False),
        (gave_up("push", "tilted", 0.003, tilt=[0, 0.014, 0]), True),  # it is in line
        (gave_up("push", "tilted", 0.003, tilt=[0, 0.016, 0]), False),
        (gave_up("push", "jammed", 0.003, end=0.003), True),  # it was left there
        (gave_up("search", "done", 0.0), False),
        (gave_up("search", "done", 0.0, holding=[1, 0, 0]), True),  # of what was searched with?
        # A plug that was never held rests on the table, as high as the socket's face.
        (gave_up("grasp", "lost", 0.0, end=0.0, holding=[0, 0, 0]), False),
        (gave_up("around 6", "timed out", 0.0, end=0.0, holding=[0, 0, 0]), False),
        (gave_up("grasp", "lost", 0.0), True),  # it was held
        (gave_up("transport", "lost", -0.02, holding=[1, 0, 0]), False),
        (gave_up("transport", "lost", -0.02), False),  # it was seen no more
        (gave_up("transport", "timed out", -0.02, holding=[1, 0, 0]), True),
        (ended(("push", "verify", "done"), depths=[0.0, 0.003]), False),  # it goes on
    ],
)
def test_a_reason_is_false_if_the_truth_contradicts_it(done: SkillResult, false: bool) -> None:
    assert verdict(done, D, SKILL).false_reason == false
