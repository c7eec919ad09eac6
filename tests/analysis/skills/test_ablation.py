"""Skills without one of their primitives."""

from dataclasses import replace
from typing import Any

import pytest

from chamfer.analysis.skills.ablation import CHANGES
from chamfer.analysis.skills.connector_ablation import (
    BNC_ABLATION,
    D_ABLATION,
    BncConnectorAblationScenario,
    DConnectorAblationScenario,
    skills,
)
from chamfer.systems.primitives.force_primitives import Level, Obstructed
from chamfer.systems.primitives.position_primitives import Centre, Held
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_machine import make_skill_chart
from chamfer.systems.primitives.skill_machine import check_timing

D, BNC = DConnectorAblationScenario(), BncConnectorAblationScenario()
PERIOD = 0.01  # s


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def counted(skill: Skill, kind: Any) -> int:
    return sum(isinstance(one, kind) for state in skill.states for one in state.run)


@pytest.mark.parametrize("scenario", [D, BNC])
@pytest.mark.parametrize("name", CHANGES)
def test_what_is_left_is_a_skill(name: str, scenario: Any) -> None:
    skill = CHANGES[name](scenario.make_skill())
    check_timing(skill, PERIOD)
    make_skill_chart(skill)


@pytest.mark.parametrize("scenario", [D, BNC])
def test_each_skill_lacks_what_it_says(scenario: Any) -> None:
    own = scenario.make_skill()
    for name, kind in (
        ("without_correlation", Obstructed),
        ("without_level", Level),
        ("without_centring", Centre),
        ("without_grip_check", Held),
    ):
        found = CHANGES[name](own)
        assert counted(found, kind) == 0
        for other in {Obstructed, Level, Centre, Held} - {kind}:
            assert counted(found, other) == counted(own, other)
    assert any(state.tares for state in own.states)
    assert not any(state.tares for state in CHANGES["without_tare"](own).states)
    assert CHANGES["whole"](own) == own


def test_without_the_rotary_search_the_plug_comes_out_where_the_dithers_end() -> None:
    own = D.make_skill()
    states = {state.name: state for state in own.states}
    found = {state.name: state for state in CHANGES["without_rotary_search"](own).states}
    assert set(states) - set(found) == {"rotary search"}
    assert found["search"].on["done"] == states["rotary search"].on["done"]


def test_a_primitive_that_a_skill_does_not_have_is_no_ablation() -> None:
    assert set(skills(D)) == {*CHANGES, "without_sight"}
    assert set(skills(D)) - set(skills(BNC)) == {"without_level", "without_rotary_search"}
    assert "without_sight" not in skills(replace(D, sight=None))


@pytest.mark.slow
@pytest.mark.parametrize("experiment", [D_ABLATION, BNC_ABLATION])
def test_every_skill_meets_the_same_worlds(experiment: Any) -> None:
    scenario = experiment.scenario(trials=2, duration=0.02, sight=None)
    outcome = experiment.run(scenario, 0, quiet)
    names = skills(scenario)
    assert outcome.traces["skill"].tolist() == [name for name in names for _ in range(2)]
    assert outcome.traces["trial"].tolist() == [0.0, 1.0] * len(names)
    for name in names:
        assert outcome.metrics[f"{name}.success_rate"].value == 0.0
        assert outcome.metrics[f"{name}.duration"].value == pytest.approx(0.02, abs=0.1)
    figure = experiment.plot(scenario, outcome)["ablation"]
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert labels == [name.replace("_", " ") for name in names]
