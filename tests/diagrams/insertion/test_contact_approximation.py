"""How a plant solves its contacts is said by its scenario, and refused where it has no effect."""

from dataclasses import replace
from typing import Any

import pytest
from pydrake.multibody.plant import MultibodyPlant

from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion import blind_feed, insertion, peg_insertion
from chamfer.diagrams.skills import connector_loop, connector_scenario
from chamfer.models.validation import ParameterError

PEG = peg_insertion.PEG_INSERTION, peg_insertion.resolve_peg_insertion
FED = blind_feed.BlindFeedScenario(), blind_feed.resolve_fed_cell
CELL = insertion.INSERTION_BY_SIGHT, insertion.resolve
POSITION = make_scenario(CELL[0], settings=["cell=ur5e-fixture"]), insertion.resolve
CONNECTOR = connector_scenario.D_CONNECTOR, connector_scenario.resolve


@pytest.mark.parametrize(
    ("scenario", "resolve", "make", "by_default"),
    [
        (*PEG, peg_insertion.make_peg_insertion_diagram, "kLagged"),
        (*FED, blind_feed.make_blind_feed_diagram, "kLagged"),
        (*CELL, insertion.make_insertion_diagram, "kLagged"),
        (*POSITION, insertion.make_insertion_diagram, "kLagged"),
        (*CONNECTOR, connector_loop.make_connector_diagram, "kTamsi"),
    ],
)
def test_a_plant_follows_its_scenario(
    scenario: Any, resolve: Any, make: Any, by_default: str
) -> None:
    changed = replace(scenario, approximation="sap")
    for one, expected in ((scenario, by_default), (changed, "kSap")):
        (plant,) = (s for s in make(resolve(one)).GetSystems() if isinstance(s, MultibodyPlant))
        assert plant.get_discrete_contact_approximation().name == expected


@pytest.mark.parametrize("scenario", [PEG[0], FED[0], CELL[0]])
def test_tamsi_is_refused_where_it_passes_over_gains(scenario: Any) -> None:
    with pytest.raises(ParameterError, match="approximation is 'tamsi', allowed: lagged, similar"):
        replace(scenario, approximation="tamsi")
    assert replace(POSITION[0], approximation="tamsi").servo is not None
