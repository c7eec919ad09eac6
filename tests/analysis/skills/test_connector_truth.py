"""What a skill says of itself, against what was true."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.skills.connector_truth import is_mated, verdict
from chamfer.analysis.skills.skill_run import SkillResult, Step
from chamfer.diagrams.skills.connector_insertion import BncConnectorScenario, DConnectorScenario
from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.connectors.d_connector import DConnector
from chamfer.systems.strategies.grasp_and_transport import GRASPING, TRANSPORT

D, BNC = DConnectorScenario(), BncConnectorScenario()
DEEP = D.connector.mated_depth
OUT = -0.03  # m, depth of a plug that was retracted


def ended(*steps: tuple[str, str, str], depths: list[float], **traces: Any) -> SkillResult:
    """A run with a row per second; a step a second, from 1 s on: source, target, outcome."""
    n = len(depths)
    rows: dict[str, Any] = {"holding": np.ones(n), "turn": np.zeros(n)}
    rows |= {name: np.array(values, dtype=float) for name, values in traces.items()}
    path = tuple(Step(float(1 + i), *step, step[2]) for i, step in enumerate(steps))
    last = steps[-1][1]
    failing = [f"{source}: {how}" for source, target, how in steps if target == "retract"]
    return SkillResult(
        outcome=last if last in ("done", "failed") else "running",  # type: ignore[arg-type]
        state=last,
        reason=failing[-1] if failing else "",
        path=path,
        traces={"time": np.arange(n, dtype=float), "depth": np.array(depths), **rows},
        peaks=np.zeros(6),
        wall_seconds=1.0,
    )


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
    found = verdict(ended(("verify", "done", "hindered"), depths=[0.0, DEEP - short]), D)
    assert found.mated == (not short)
    assert found.false_done == bool(short)
    assert not found.false_reason


def test_done_is_false_if_the_plug_is_not_locked() -> None:
    deep = BNC.connector.mated_depth
    done = ended(("pull", "done", "contact"), depths=[0.0, deep], turn=[0.0, 0.0])
    assert verdict(done, BNC).false_done
    locked = ended(("pull", "done", "contact"), depths=[0.0, deep], turn=[0.0, -1.5])
    assert not verdict(locked, BNC).false_done


def test_hindered_is_false_of_a_plug_on_the_face() -> None:
    steps = (("search", "push", "hindered"), ("push", "search", "jammed"))
    steps += (("search", "push", "hindered"), ("verify", "done", "hindered"))
    done = ended(*steps, depths=[0.0, 0.0004, 0.0, 0.0006, DEEP])
    assert D.connector.lead_in == 0.0005
    found = verdict(done, D)
    assert (found.hindered, found.false_hindered) == (3, 1)


def test_all_that_comes_before_the_transport_is_known() -> None:
    unfelt = replace(D, gripper=replace(D.gripper, senses=False))
    names = [state.name for state in unfelt.make_grasp()]
    assert [*GRASPING, TRANSPORT] == names


@pytest.mark.parametrize(
    ("done", "false"),
    [
        (gave_up("push", "jammed", 0.003), False),
        (gave_up("push", "jammed", DEEP), True),  # it was in
        (gave_up("push", "jammed", -0.001), True),  # nothing was touched
        (gave_up("push", "jammed", 0.003, end=0.003), True),  # it was left there
        (gave_up("search", "done", 0.0), False),
        (gave_up("search", "done", 0.0, holding=[1, 0, 0]), True),  # of what was searched with?
        # A plug that was never held rests on the table, as high as the socket's face.
        (gave_up("grasp", "lost", 0.0, end=0.0, holding=[0, 0, 0]), False),
        (gave_up("around 6", "timed out", 0.0, end=0.0, holding=[0, 0, 0]), False),
        (gave_up("reach", "lost", 0.0, end=0.0, holding=[0, 0, 0]), False),
        (gave_up("grasp", "lost", 0.0), True),  # it was held
        (gave_up("lift", "lost", 0.0), True),  # likewise
        (gave_up("transport", "lost", -0.02, holding=[1, 0, 0]), False),
        (gave_up("transport", "lost", -0.02), False),  # it was seen no more
        (gave_up("transport", "timed out", -0.02, holding=[1, 0, 0]), True),
        (ended(("push", "verify", "done"), depths=[0.0, 0.003]), False),  # it goes on
    ],
)
def test_a_reason_is_false_if_the_truth_contradicts_it(done: SkillResult, false: bool) -> None:
    assert verdict(done, D).false_reason == false
