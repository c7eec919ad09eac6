"""Skills without one of their primitives."""

from dataclasses import replace
from typing import Any

import pytest

from chamfer.analysis.skills.ablation import CHANGES
from chamfer.analysis.skills.connector_campaign import (
    BNC_ABLATION,
    D_ABLATION,
    ablated_skills,
    resolve_campaign,
)
from chamfer.systems.primitives.force_primitives import Level, Obstructed
from chamfer.systems.primitives.position_primitives import Centre, Held
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_law import check_timing, make_skill_chart

D, BNC = resolve_campaign(D_ABLATION), resolve_campaign(BNC_ABLATION)
PERIOD = 0.01  # s


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
    assert set(ablated_skills(D)) == {*CHANGES, "without_sight"}
    assert set(ablated_skills(D)) - set(ablated_skills(BNC)) == {
        "without_level",
        "without_rotary_search",
    }
    assert "without_sight" not in ablated_skills(replace(D, sight=None))
