"""The worlds that a campaign draws, and what is believed of them."""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from chamfer.analysis.skills.connector_trials import (
    BncConnectorSuccessScenario,
    DConnectorSuccessScenario,
    SuccessScenario,
)
from chamfer.analysis.skills.randomised_scenario import WorldSpread, drawn_world
from chamfer.models.validation import ParameterError

D, BNC = DConnectorSuccessScenario(), BncConnectorSuccessScenario()
KNOWN = WorldSpread(
    **{one.name: 0.0 for one in fields(WorldSpread) if one.name != "mating_force"},
    mating_force=1.0,
)
seeds = st.integers(0, 2**63 - 1)


def worlds(scenario: Any, number: int, **changes: Any) -> list[Any]:
    spread = replace(scenario.spread, **changes)
    return [drawn_world(scenario, spread, 0, trial) for trial in range(number)]


def focal_factors(world: Any) -> list[float]:
    return [world.sight.xz.focal_factor, world.sight.yz.focal_factor]


@settings(max_examples=20)
@given(seed=seeds, trial=st.integers(0, 10_000_000))
def test_a_world_is_its_seed_and_its_trial(seed: int, trial: int) -> None:
    first = drawn_world(D, D.spread, seed, trial)
    assert drawn_world(D, D.spread, seed, trial) == first
    for other in (
        drawn_world(D, D.spread, seed, trial + 1),
        drawn_world(D, D.spread, seed + 1, trial),
    ):
        assert other.initial_error != first.initial_error
        assert other.connector != first.connector
        assert other.sensor != first.sensor


@pytest.mark.parametrize("scenario", [D, BNC])
def test_without_a_spread_the_world_is_what_is_believed(scenario: SuccessScenario) -> None:
    found = drawn_world(scenario, KNOWN, 3, 4)
    assert found.connector.mating_force == pytest.approx(scenario.connector.mating_force)
    assert (
        replace(
            found,
            connector=scenario.connector,
            believed_connector=None,
            believed_wrist=None,
            sensor=scenario.sensor,
        )
        == scenario
    )
    assert found.sensor.bias == (0.0,) * 6


@pytest.mark.parametrize("scenario", [D, BNC])
def test_draws_reach_both_ends_and_no_further(scenario: SuccessScenario) -> None:
    found = worlds(scenario, 300)
    off = np.array([world.initial_error for world in found]) - scenario.initial_error
    believed = scenario.connector
    columns = {
        "rotational": off[:, :3] / math.radians(3),
        "lateral": off[:, 3:5] / 0.002,
        "force bias": np.array([world.sensor.bias[:3] for world in found]),
        "torque bias": np.array([world.sensor.bias[3:] for world in found]) / 0.03,
        "friction": 2 * np.array([[w.connector.material.friction] for w in found]) / 0.2 - 2,
        "wrist": (np.array([[w.wrist.stiffness[3]] for w in found]) / 2e4 - 1) / 0.3,
        "mating force": np.log2(
            [[w.connector.mating_force / believed.mating_force] for w in found]
        ),
        "focal": np.array([focal_factors(world) for world in found]) / 0.1 - 10,
    }
    for values in columns.values():
        for column in values.T:
            assert stats.kstest(column, stats.uniform(-1, 2).cdf).pvalue > 1e-4
    np.testing.assert_array_equal(off[:, 5], 0.0)
    everything = np.hstack(list(columns.values()))
    between = np.corrcoef(everything.T) - np.eye(everything.shape[1])
    assert np.abs(between).max() < 0.25


def test_what_is_believed_is_the_scenario_s_own() -> None:
    for world in worlds(D, 20):
        assert world.believed_connector == D.connector
        assert world.believed == D.wrist
        assert world.accommodation == D.accommodation
        # One factor: the wrist is all stiffer or all softer.
        assert np.ptp(np.divide(world.wrist.stiffness, D.wrist.stiffness)) < 1e-12


def test_some_fits_are_tight_and_some_sockets_blocked() -> None:
    found = worlds(D, 400, tight=0.25, obstacles=0.5)
    tight = [world.connector.tolerance == "worst" for world in found]
    assert sum(tight) == pytest.approx(100, abs=40)
    depths = np.array([world.obstacle for world in found if world.obstacle is not None])
    assert len(depths) == pytest.approx(200, abs=40)
    assert depths.min() > 0
    assert depths.max() < D.connector.mated_depth - 0.0005
    assert np.ptp(depths) > 0.9 * (D.connector.mated_depth - 0.0008)


@pytest.mark.parametrize("name", [one.name for one in fields(WorldSpread)])
def test_a_spread_changes_no_other_s_draws(name: str) -> None:
    changed = {"mating_force": 1.5, "obstacle_short": 0.001}.get(name, 0.01)
    spread = replace(D.spread, obstacles=0.6)
    one, other = (
        drawn_world(D, each, 0, 5) for each in (spread, replace(spread, **{name: changed}))
    )
    # Of the fields of a scenario one at most differs.
    assert sum(getattr(one, f.name) != getattr(other, f.name) for f in fields(one)) <= 1


def test_without_sight_cameras_need_no_errors() -> None:
    blind = replace(D, sight=None)
    one, seeing = drawn_world(blind, D.spread, 1, 2), drawn_world(D, D.spread, 1, 2)
    assert one == replace(seeing, sight=None)


@pytest.mark.parametrize(
    ("fields_", "message"),
    [
        ({"lateral": -1.0}, "lateral is -1.0, allowed: a finite number >= 0"),
        ({"rotational": math.nan}, "rotational is nan, allowed: a finite number >= 0"),
        ({"friction": 1.0}, "friction is 1.0, allowed: 0 <= share < 1"),
        ({"mating_force": 0.5}, "mating_force is 0.5, allowed: a finite factor >= 1"),
        ({"obstacles": 1.5}, "obstacles is 1.5, allowed: 0 to 1"),
    ],
)
def test_refuses(fields_: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        WorldSpread(**fields_)
    assert str(refused.value) == message


def test_an_obstacle_has_room_in_the_socket() -> None:
    with pytest.raises(ParameterError, match=r"^spread\.obstacle_short is 0\.006, allowed: less"):
        drawn_world(D, WorldSpread(obstacle_short=0.006), 0, 0)
