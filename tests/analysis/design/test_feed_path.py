from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.design.design import assess
from chamfer.analysis.design.design_scenario import (
    DesignScenario,
    ResolvedDesignScenario,
    resolve_design,
)
from chamfer.analysis.design.feed_path import feed_path, path_links, wound_up
from chamfer.analysis.design.link import Link
from chamfer.diagrams.cell.work_cell import HOLE_ARM
from chamfer.systems.force.arm_model import Placement

USUAL = DesignScenario(draws=72, pictures=1, hole=replace(HOLE_ARM, kind="fixture"))


def at(distance: float) -> ResolvedDesignScenario:
    base = Placement(position=(-distance, 0.0, 0.0))
    return resolve_design(replace(USUAL, peg=replace(USUAL.peg, base=base)))


def links(cell: ResolvedDesignScenario) -> dict[str, Link]:
    return {link.name: link for link in path_links(cell)}


def test_an_elbow_that_gets_straight_stops_the_feed() -> None:
    near, edge, far = (links(at(distance)) for distance in (0.8, 0.95, 0.98))
    assert near["posture"].bound > 3 * edge["posture"].bound > 0
    assert "joint_4 is at 0.569 rad" in edge["posture"].source
    assert far["posture"].bound == 0
    assert "22.5 mm below the mouth" in far["posture"].source
    assert "out of reach" in far["posture"].source


def test_what_the_arm_can_t_do_is_named_and_nothing_goes_in() -> None:
    found = assess(at(0.98))
    assert (found.verdict, found.share) == ("no", 0.0)
    assert found.limiting_link == "posture"


def test_torques_are_those_of_weight_payload_and_push() -> None:
    cell = at(0.8)
    place = feed_path(cell)[0]
    model = cell.peg.known_arm()
    state = model.evaluate(cell.rest_posture("peg"))
    more = cell.peg.payload_error * (1 + cell.spread.payload)
    # The payload is behind the tip, about which its weight has a moment.
    held = np.array([0.0, 0.0, 9.81 * more])
    at_payload = state.X_WT.rotation().matrix() @ cell.peg.payload_position
    wrench = np.concatenate([np.cross(at_payload, held), held])
    expected = state.gravity + state.J_V_WT.T @ wrench
    np.testing.assert_allclose(place.weight, expected, atol=1e-9)
    heavy = replace(cell, insert=replace(cell.insert, push=14.0))
    assert links(heavy)["torque"].bound > links(cell)["torque"].bound


def test_friction_winds_up_more_where_the_arm_is_nearly_straight() -> None:
    along = [place.wound[0] for place in feed_path(at(0.95))]
    assert along == sorted(along)
    assert along[-1] > 2 * along[0]
    assert wound_up(at(0.95))[0] == along[-1]
    smooth = replace(at(0.8), peg=replace(at(0.8).peg, joint_friction=(0.0,) * 7))
    assert wound_up(smooth) == pytest.approx(np.zeros(6))
