"""The RJ45 plug: its clearance, what its insertion takes, its click and what it holds."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.connectors.rj45_connector import Rj45Connector

TOLERANCES = ("nominal", "worst")
SOFT = ("latch", "contacts", "stop")
ABOVE = 3.0e-3  # m, depth before latch and contacts touch


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_play_is_that_of_the_dimensions(geometry_of, tolerance):
    connector = Rj45Connector(tolerance=tolerance)
    geometry = geometry_of(connector, SOFT)
    for axis, direction in ((0, (1.0, 0.0)), (0, (-1.0, 0.0)), (1, (0.0, 1.0)), (1, (0.0, -1.0))):
        free = geometry.free(RotationMatrix(), 3e-3, direction)
        assert free == pytest.approx(connector.clearance[axis], abs=1e-7)
    assert (connector.clearance > 3e-5).all()


@pytest.mark.parametrize("place", [(0.015, 0.0), (-0.015, 0.0), (0.0, 0.015), (0.0, -0.015)])
def test_face_is_all_around_the_jack(geometry_of, place):
    geometry = geometry_of(Rj45Connector(), SOFT)
    heights = (1e-5, -1e-5)
    assert [geometry.meet(RigidTransform([*place, z])) for z in heights] == [False, True]


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_slow_insertion_takes_what_springs_and_friction_say(insert, tolerance):
    connector = Rj45Connector(tolerance=tolerance)
    assert 10.0 < connector.mating_force < 20.0  # N, what data sheets allow
    run = insert(connector, [0, 0, 0, 0, 0, -ABOVE], -9.4e-3, 1.0)
    assert run.push.max() == pytest.approx(connector.mating_force, rel=0.04)
    for low, high in ((5.9e-3, 6.4e-3), (6.8e-3, 7.6e-3)):  # before the ramps, and on them
        there = (run.depth > low) & (run.depth < high)
        force = connector.insertion_force(run.depth[there])
        np.testing.assert_allclose(run.push[there], force, rtol=0.08, atol=0.1)


def test_it_clicks_stops_and_is_held_when_pulled(insert):
    connector = Rj45Connector()
    run = insert(connector, [0, 0, 0, 0, 0, -ABOVE], -9.7e-3, 0.8, back=-8.5e-3)
    before, after = connector.click_depth - 0.3e-3, connector.click_depth + 1.1e-3
    push = run.push[: run.push.argmin()]
    depth = run.depth[: len(push)]
    on_ramp, past = push[depth < before].max(), push[(depth > after) & (depth < 9.45e-3)].min()
    assert past < on_ramp - 8.0
    assert depth.max() == pytest.approx(connector.mated_depth, abs=0.01e-3)
    # The carriage goes up by a millimetre and a fifth; the latch holds the plug.
    pull = -run.push.min()
    assert 8.0 < pull < 1.3 * connector.retention
    assert run.depth[-1] > connector.mated_depth - connector.latch_play - 0.4e-3


@pytest.mark.parametrize(("pulled", "held"), [(0.8, True), (1.6, False)])
def test_latch_gives_way_beyond_its_retention(insert, pulled, held):
    # Contacts so weak that the latch alone is felt.
    connector = Rj45Connector(contact_force=1e-3)
    up = pulled * connector.retention / 2e4  # m, of the carriage above the held plug
    run = insert(connector, [0, 0, 0, 0, 0, -ABOVE], -9.5e-3, 0.5, back=-9.1e-3 + up + 0.6e-3)
    assert (run.depth[-1] > connector.click_depth) == held


def test_other_mating_forces_scale_all_springs():
    connector = Rj45Connector()
    twice = connector.with_mating_force(2 * connector.mating_force)
    depth = np.linspace(0.0, connector.travel, 50)
    expected = 2 * connector.insertion_force(depth)
    np.testing.assert_allclose(twice.insertion_force(depth), expected)
    assert twice.retention == pytest.approx(2 * connector.retention)


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize(
    "error", [(0.01, 0.01, 0.01, 0.4e-3, 0.3e-3), (-0.01, -0.01, -0.01, -0.4e-3, -0.2e-3)]
)
def test_wrist_lets_a_plug_in_that_is_a_little_tilted_and_beside(insert, tolerance, error):
    connector = Rj45Connector(tolerance=tolerance)
    run = insert(connector, [*error, 0.5e-3], -10.2e-3, 1.0)
    assert run.depth[-1] == pytest.approx(connector.mated_depth, abs=0.15e-3)
