"""Where the centre of an RCC should be, and pegs that are fed on one."""

import re
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.drawing.figure_kit import metric_value as value
from chamfer.analysis.insertion.insertion_runs import insert, median, path
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Outcome, load, quiet, select
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.peg_insertion import (
    FeedSupport,
    PegInsertionScenario,
    resolve_peg_insertion,
)
from chamfer.models.peg.peg_and_hole import PRESETS, PegAndHole
from chamfer.models.peg.support import RCC
from chamfer.models.validation import ParameterError

(CENTRE,) = map(load, select(CATALOGUE.entries, ["compliance-centre"]))
_NIST_16MM: dict[str, Any] = dict(PRESETS["nist-16mm"])


def run(**given: Any) -> Outcome:
    return CENTRE.run(CENTRE.resolve(make_scenario(CENTRE.default, given=given)), 0, quiet)


def test_the_best_centre_is_between_where_friction_meets_the_mouth_and_the_tip() -> None:
    """Both slopes of the limits are nil at 3 mu r and mu r, and equal at 2 mu r above the tip."""
    parts = PegAndHole(**_NIST_16MM)
    corner = parts.peg_chamfer.height
    outcome = run(points=10, depths=41, nearest=0.001, farthest=0.01)
    best = value(outcome.metrics, "most_margin.centre_distance")
    assert best == pytest.approx(corner + parts.wedging_depth, abs=0.001)
    assert value(outcome.metrics, "most_margin.margin") > value(outcome.metrics, "own.margin")
    assert value(outcome.metrics, "compliance.deflection") == pytest.approx(42, abs=1)


def test_an_arm_that_gives_way_takes_the_deflection_and_the_push() -> None:
    few = {"points": 2, "depths": 41}
    stiff, soft = (run(arm=arm, **few) for arm in (None, {"lateral_stiffness": 700.0}))
    for name in ("own.push", "compliance.deflection"):
        assert value(soft.metrics, name) < 0.4 * value(stiff.metrics, name)
    far = run(start={"rotation": 0.1}, compliance={"centre_distance": 0.14}, **few)
    assert far.metrics["own.push"].value is None
    assert far.metrics["own.push"].note == "none slides it"
    assert "compliance.deflection" not in run(compliance={"kind": "arm"}, **few).metrics


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"farthest": -0.03}, "farthest is -0.03, allowed: more than nearest, 1 m at most"),
        ({"start": {"lateral": 0.002}}, "start.lateral is 0.002, allowed: less than the chamfers"),
        ({"compliance": {"angular": 0.05}}, "compliance.angular is 0.05, allowed: > 0.09072 = "),
    ],
)
def test_refusals(given: dict[str, Any], message: str) -> None:
    with pytest.raises((ParameterError, UserError), match=re.escape(message)):
        run(**given)


@pytest.mark.parametrize("centre", [0.0, 0.004, 0.1])
def test_a_peg_that_is_fed_on_an_rcc_needs_the_push_of_the_statics(centre: float) -> None:
    """In the bore; the facets of the bore leave it up to a tenth more clearance."""
    support = FeedSupport(**{**RCC, "centre_distance": centre}, damping_ratio=0.7)
    start = {"lateral": 0.0005, "tilt": 0.008, "speed": 0.03, "depth": 0.017, "gap": 0.001}
    given = PegInsertionScenario(parts=PegAndHole(**_NIST_16MM), support=support, **start)
    scenario = resolve_peg_insertion(given)
    fed, statics = insert(scenario, withdraw=False), path(scenario)
    depth = fed.depth - scenario.parts.chamfer_height
    in_bore = depth > 0.001
    push = median(fed.axial, scenario.step)[in_bore]
    predicted = np.interp(depth[in_bore], statics["depth"], statics["axial"])
    assert push.max() == pytest.approx(predicted.max(), rel=0.08)
