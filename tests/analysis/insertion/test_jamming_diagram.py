"""Loads of insertions in the jamming diagram."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.insertion.insertion_runs import insert
from chamfer.analysis.insertion.jamming_diagram import (
    JammingScenario,
    load_ratios,
    loads,
    resolve,
)
from chamfer.analysis.scenario.experiment import Outcome, load, select

JAMMING_DIAGRAM = load(select(CATALOGUE.entries, ["jamming-diagram"])[0])

SCENARIO = resolve(JammingScenario())
FEED = replace(SCENARIO.insertion, speed=0.1, step=0.002, depth=0.025)
FAST = replace(SCENARIO, insertion=FEED, laterals=(0.0,), tilts=(0.03,)).starts()[0]


def test_loads_of_a_sliding_peg_are_on_the_sides() -> None:
    found = loads(replace(FAST, tilt=0.03))
    assert found.seated
    assert found.moving.all()
    assert len(found.depth) > 10
    np.testing.assert_allclose(found.level, 1.0, atol=0.08)


def test_loads_of_a_jammed_peg_are_outside() -> None:
    found = loads(replace(FAST, tilt=0.06))
    assert not found.seated
    stopped = ~found.moving
    assert stopped.any()
    assert found.level[stopped].min() > 1.0
    assert found.level[stopped][-1] > 1.15


def test_mirrored_insertions_have_mirrored_loads() -> None:
    right, left = (loads(replace(FAST, tilt=tilt)) for tilt in (0.06, -0.06))
    assert right.level[-1] == pytest.approx(left.level[-1], rel=0.02)
    assert right.moment_ratio[-1] == pytest.approx(-left.moment_ratio[-1], rel=0.02)


def test_the_load_is_what_the_springs_and_the_push_put_on_the_peg() -> None:
    scenario = replace(FAST, tilt=0.06)
    run = insert(scenario, withdraw=False)
    _, force_ratio, moment_ratio = load_ratios(scenario, run)
    support, parts = scenario.support, scenario.parts
    x, y, _, rz, _ = run.joints[-1, :5]
    arm = support.centre_distance - parts.peg_chamfer.height  # to the middle of the corners
    tip = np.array([x + arm * math.cos(rz), y + arm * math.sin(rz)])
    start = scenario.lateral + support.centre_distance * math.sin(scenario.tilt)
    across = support.lateral_stiffness * (start - y)
    turning = support.angular_stiffness * (-scenario.tilt - rz)
    down = run.push[-1]
    moment = turning + (x - tip[0]) * across - (y - tip[1]) * down
    assert force_ratio[-1] == pytest.approx(across / down, abs=5e-3)
    assert moment_ratio[-1] == pytest.approx(moment / (parts.peg_radius * down), rel=0.02)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    scenario = replace(SCENARIO, insertion=FEED, tilts=(0.03, 0.06), laterals=(0.0,))
    return JAMMING_DIAGRAM.run(scenario, 0, lambda fraction, doing="": None)


def test_agreement_is_of_loads_off_the_sides(outcome: Outcome) -> None:
    assert outcome.metrics["agreement"].value == pytest.approx(100.0, abs=3.0)
    assert outcome.metrics["moving.on_sides"].value == pytest.approx(100.0, abs=5.0)
    assert outcome.metrics["stopped.outside"].value == 100.0
    assert outcome.metrics["seated"].value == 1.0
