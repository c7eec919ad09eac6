import math
import re
from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.campaign.trial_metrics import bootstrap_interval
from chamfer.analysis.cell.alignment_runs import (
    AlignmentTrialsScenario,
    RepeatabilityScenario,
    Spread,
    drawn,
    margins,
    resolve_repeatability,
    statistics,
)
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.work_cell import resolve_arms, wedging_support
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import OpenSupport, Support
from chamfer.models.peg_theory.wedging import box_margin, least_margin, rotation_margin, wedges
from chamfer.models.validation import ParameterError

SCENARIO = resolve_arms(AlignmentScenario(initial_error=(0.0,) * 6))
NONE = Spread(lateral=0.0, rotational=0.0, payload=0.0, link_mass=0.0, joint_friction=0.0)
PARTS, SUPPORT = PegHoleGeometry(), Support()
seeds = st.integers(0, 2**63 - 1)


def finished(**measured: Any) -> Trials[int]:
    """Trials with these values, one list a metric."""
    rows = [dict(zip(measured, row, strict=True)) for row in zip(*measured.values(), strict=True)]
    return Trials(tasks=tuple(range(len(rows))), rows=tuple(rows))


@given(seed=seeds, trial=st.integers(0, 10_000_000))
def test_a_trial_is_its_seed_and_its_number(seed: int, trial: int) -> None:
    first = drawn(SCENARIO, Spread(), seed, trial)
    assert drawn(SCENARIO, Spread(), seed, trial) == first
    for other in (
        drawn(SCENARIO, Spread(), seed, trial + 1),
        drawn(SCENARIO, Spread(), seed + 1, trial),
    ):
        assert other.initial_error != first.initial_error
        assert other.peg.payload_error != first.peg.payload_error
        assert other.hole.joint_friction != first.hole.joint_friction
    # The two arms are not wrong in the same way.
    assert first.peg.mass_scale != first.hole.mass_scale


@given(
    seed=seeds,
    lateral=st.floats(0.0, 0.02),
    rotational=st.floats(0.0, 0.2),
    payload=st.floats(0.0, 0.9),
    link_mass=st.floats(0.0, 0.9),
    joint_friction=st.floats(0.0, 0.9),
)
def test_within_the_ranges(seed: int, **ranges: float) -> None:
    spread = Spread(**ranges)
    found = drawn(SCENARIO, spread, seed, 3)
    x, y, z, roll, pitch, yaw = found.initial_error
    assert x == roll == 0.0
    assert max(abs(y), abs(z)) <= spread.lateral
    assert max(abs(pitch), abs(yaw)) <= spread.rotational
    for name in ("peg", "hole"):
        was, now = getattr(SCENARIO, name), getattr(found, name)
        assert abs(now.payload_error / was.payload_error - 1) <= spread.payload * (1 + 1e-12)
        assert abs(now.mass_scale - 1) <= spread.link_mass * (1 + 1e-12)
        ratios = np.array(now.joint_friction) / np.array(was.joint_friction)
        assert np.ptp(ratios) < 1e-12  # one factor for all joints
        assert abs(ratios[0] - 1) <= spread.joint_friction * (1 + 1e-12)
        rest = {"payload_error", "mass_scale", "joint_friction"}
        for field in fields(was):
            if field.name not in rest:
                assert getattr(now, field.name) is getattr(was, field.name)


def differences(spread: Spread) -> set[str]:
    base = SCENARIO
    found = drawn(base, spread, 1, 1)
    changed = {
        f"{name}.{field}"
        for name in ("peg", "hole")
        for field, value in asdict(getattr(found, name)).items()
        if value != asdict(getattr(base, name))[field]
    }
    return changed | {f"initial_error.{i}" for i, one in enumerate(found.initial_error) if one}


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("lateral", {"initial_error.1", "initial_error.2"}),
        ("rotational", {"initial_error.4", "initial_error.5"}),
        ("payload", {"peg.payload_error", "hole.payload_error"}),
        ("link_mass", {"peg.mass_scale", "hole.mass_scale"}),
        ("joint_friction", {"peg.joint_friction", "hole.joint_friction"}),
    ],
)
def test_each_range_changes_its_own_field(name: str, changes: set[str]) -> None:
    assert differences(replace(NONE, **{name: 0.3})) == changes


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"lateral": -0.1}, "lateral is -0.1, allowed: a finite number >= 0"),
        ({"rotational": math.nan}, "rotational is nan, allowed: a finite number >= 0"),
        ({"payload": 1.0}, "payload is 1.0, allowed: from 0 to less than 1"),
        ({"joint_friction": -0.5}, "joint_friction is -0.5, allowed: from 0 to less than 1"),
        ({"link_mass": 1.5}, "link_mass is 1.5, allowed: from 0 to less than 1"),
        ({"payload": math.nan}, "payload is nan, allowed: from 0 to less than 1"),
    ],
)
def test_spreads_that_are_none(values: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        Spread(**values)


@pytest.mark.parametrize("trials", [0, -1, 10_001])
def test_numbers_of_trials_that_are_none(trials: int) -> None:
    with pytest.raises(ParameterError, match=f"^trials is {trials}, allowed: 1 to 10000$"):
        AlignmentTrialsScenario(trials=trials)


@given(values=st.lists(st.integers(0, 100).map(lambda one: one / 1000), min_size=2, max_size=9))
def test_the_interval_is_of_what_the_trials_measured(values: list[float]) -> None:
    found = statistics(finished(lateral_error=values), "lateral_error", "m")
    assert list(found) == [
        f"lateral_error.{of}" for of in ("mean", "mean_low", "mean_high", "max")
    ]
    assert {one.unit for one in found.values()} == {"m"}
    assert found["lateral_error.mean"].value == pytest.approx(np.mean(values))
    assert found["lateral_error.max"].value == max(values)
    got = tuple(found[f"lateral_error.mean_{end}"].value for end in ("low", "high"))
    assert got == bootstrap_interval(np.array(values))
    assert found["lateral_error.mean"].note == f"{len(values)} trials"


def test_margins_are_the_worst_run_s() -> None:
    lateral, rotational = [0.001, 0.003, 0.0002], [0.04, 0.005, 0.07]
    found = margins(finished(lateral_error=lateral, rotational_error=rotational), PARTS, SUPPORT)
    assert {one.unit for one in found.values()} == {"%"}
    both = list(zip(lateral, rotational, strict=True))
    assert found["box_margin.lateral"].value == pytest.approx(100 * (1 - 0.003 / 0.019814))
    assert found["box_margin.rotation"].value == pytest.approx(
        100 * float(box_margin(PARTS, 0.0, 0.07).rotation)
    )
    guided = PARTS.chamfer_width + PARTS.hole_radius - PARTS.peg_radius
    assert found["chamfer_margin"].value == pytest.approx(100 * (1 - 0.003 / guided))
    assert found["parallelogram_margin"].value == pytest.approx(
        100 * min(least_margin(PARTS, SUPPORT, *one)[0] for one in both)
    )
    here = [rotation_margin(PARTS, SUPPORT, x, s * angle) for x, angle in both for s in (1, -1)]
    assert found["margin"].value == pytest.approx(100 * min(here))
    assert found["margin"].value > found["parallelogram_margin"].value
    wedged = [bool(wedges(PARTS, SUPPORT, *one)) for one in both]
    assert wedged == [False, False, True]
    assert found["wedging"].value == pytest.approx(100 / 3)


def test_of_the_signs_the_worse_one_counts() -> None:
    runs = finished(lateral_error=[0.003], rotational_error=[0.056])
    below = replace(SUPPORT, centre_distance=-0.05)  # errors of opposite signs add
    worse = float(rotation_margin(PARTS, below, 0.003, -0.056))
    assert worse < rotation_margin(PARTS, below, 0.003, 0.056)
    found = margins(runs, PARTS, below)
    assert found["margin"].value == pytest.approx(100 * worse)
    assert found["wedging"].value == 100.0


def test_the_support_is_that_of_the_arms_unless_it_is_said() -> None:
    found = resolve_repeatability(RepeatabilityScenario())
    assert found.held() == wedging_support(found)
    assert found.support == OpenSupport(**vars(wedging_support(found)))
    assert resolve_repeatability(found) == found
    said = RepeatabilityScenario(support=OpenSupport(centre_distance=0.1))
    assert resolve_repeatability(said).held() == replace(found.held(), centre_distance=0.1)
    soft = RepeatabilityScenario(support=OpenSupport(angular_stiffness=0.005))
    with pytest.raises(ParameterError, match=r"^support\.angular_stiffness is 0\.005, allowed: >"):
        resolve_repeatability(soft)
