"""Fields of a scenario that are given by a preset's name."""

import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.insertion import InsertionScenario
from chamfer.diagrams.insertion.peg_insertion import PegInsertionScenario
from chamfer.diagrams.skills.connector_scenario import PegScenario
from chamfer.models.peg.peg_and_hole import PegAndHole

DEFAULT = InsertionScenario()
FACTORY = make_scenario(DEFAULT, settings=["parts=factory-8mm"]).parts


def test_a_preset_takes_the_place_of_all_fields() -> None:
    assert FACTORY.hole_radius == 0.00405
    assert FACTORY.peg_colour == DEFAULT.parts.peg_colour
    own = make_scenario(DEFAULT, settings=["parts.friction=0.2"])
    assert make_scenario(own, settings=["parts=factory-8mm"]).parts == FACTORY


def test_in_a_file_too_and_single_fields_may_follow() -> None:
    scenario = make_scenario(
        PegInsertionScenario(), given={"parts": "factory-8mm"}, settings=["parts.friction=0.2"]
    )
    assert type(scenario.parts) is PegAndHole
    assert (scenario.parts.friction, scenario.parts.peg_length) == (0.2, 0.05)
    assert make_scenario(DEFAULT, settings=["parts=paper", "parts.friction=0.2"]) == make_scenario(
        DEFAULT, settings=["parts.friction=0.2"]
    )


def test_a_skills_peg_has_the_same_names_and_keeps_its_lengths() -> None:
    one = make_scenario(PegScenario(), settings=["connector=factory-8mm", "connector.depth=0.02"])
    assert (one.connector.hole_radius, one.connector.depth) == (0.00405, 0.02)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["parts=nist"], "parts is 'nist', allowed: paper, nist-12.675mm, "),
        (["parts.friction=0.2", "parts=paper"], "parts.friction and parts are both set"),
        (["parts={friction: 0.2}", "parts.friction=0.1"], "parts and parts.friction are both"),
        (["contact=paper"], "contact is 'paper', allowed: a mapping of dissipation"),
        (["parts=paper", "parts=paper"], "parts is set twice"),
    ],
)
def test_what_is_no_preset_is_refused(settings: list[str], message: str) -> None:
    with pytest.raises(UserError, match=message):
        make_scenario(DEFAULT, settings=settings)
