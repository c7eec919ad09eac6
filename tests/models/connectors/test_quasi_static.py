"""The force of a slow insertion out of the geometry, against closed forms."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.connectors.mesh_connector import MeshConnector, convex_hull, write_solids
from chamfer.models.connectors.quasi_static import insertion_force
from chamfer.models.connectors.rj45_connector import Rj45Connector
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import ParameterError


@pytest.mark.parametrize(
    "connector", [Rj45Connector(), DConnector(), Rj45Connector(tolerance="worst")]
)
def test_it_is_the_closed_form(connector):
    depth = np.linspace(0.0, connector.mated_depth, 100, endpoint=False)
    form = getattr(connector, "insertion_force", None) or connector.pin_force
    expected = form(depth)
    np.testing.assert_allclose(insertion_force(connector, depth), expected, rtol=0.01, atol=0.05)
    assert expected.max() == pytest.approx(connector.mating_force, rel=0.05)


def test_a_spring_takes_its_force_and_a_peg_in_line_nothing():
    bnc = BncConnector()
    (force,) = insertion_force(bnc, np.array([bnc.overlap]))
    assert force == pytest.approx(bnc.mating_force, rel=0.01)
    assert insertion_force(RoundPeg(), np.array([0.0, 5e-3, 0.0149])).max() == 0.0


RADIUS, BENT, HALF, HEIGHT, STIFFNESS = 1.0, 0.2, 3.0, -2.0, 5000.0  # mm and N/m


def box(name, *ends):
    return convex_hull(name, np.array(list(product(*ends)), float))


@pytest.fixture
def clip(tmp_path):
    """A block that goes between two balls, which bend by 0.2 mm each, in a shaft."""
    balls = []
    for i, side in enumerate((-1, 1)):
        x = side * (HALF + RADIUS - BENT)
        ends = [(m - RADIUS, m + RADIUS) for m in (x, 0.0, HEIGHT)]
        balls.append(box(f"spring {i}", *ends))
    walls = [box(f"wall {s}", (-8, 8), sorted((s * 2.1, s * 8)), (-6, 0)) for s in (-1, 1)]
    block = box("block", (-HALF, HALF), (-2, 2), (0, 20))
    write_solids(tmp_path / "block.obj", [block])
    write_solids(tmp_path / "clip.obj", [*balls, *walls])
    return {
        "plug": str(tmp_path / "block.obj"),
        "socket": str(tmp_path / "clip.obj"),
        "mated_depth": 5e-3,
        "springs": {"spring": STIFFNESS},
    }


def test_a_part_of_ones_own_takes_what_its_springs_and_friction_say(clip):
    part = MeshConnector(**clip)
    depth = np.linspace(0.0, part.mated_depth, 200, endpoint=False)
    mm = 1e-3
    height = np.clip(HEIGHT * mm + depth, None, 0.0)  # of the edge over the balls' middles
    distance = np.hypot(height, (RADIUS - BENT) * mm)
    press = STIFFNESS * np.clip(RADIUS * mm - distance, 0.0, None)
    mu = part.material.friction
    expected = 2 * press * (-height + mu * (RADIUS - BENT) * mm) / distance
    np.testing.assert_allclose(insertion_force(part, depth), expected, rtol=1e-3, atol=1e-3)
    assert part.mating_force == pytest.approx(expected.max(), rel=1e-3)
    assert part.with_mating_force(7.0).mating_force == pytest.approx(7.0, rel=1e-3)
    rubbing = replace(part, material=replace(part.material, friction=0.4))
    assert rubbing.mating_force > 1.2 * part.mating_force


def test_it_takes_so_much_in_the_simulation(clip, insert):
    part = MeshConnector(**clip)
    run = insert(part, [0, 0, 0, 0, 0, 1e-3], -4.5e-3, 1.0)
    assert run.push.max() == pytest.approx(part.mating_force, rel=0.05)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"mated_depth": 1e-3}, "take 0 N"),  # the springs are deeper
        ({"tolerance_width": 3e-4, "tolerance": "worst"}, "with at most 100 N"),  # walls overlap
    ],
)
def test_a_force_that_is_none_is_refused(clip, changes, told):
    with pytest.raises(ParameterError, match=f"^springs is .*{told}"):
        _ = MeshConnector(**{**clip, **changes}).mating_force


def test_the_tightest_fit_has_less_clearance_to_all_sides(clip, geometry_of):
    for tolerance, free in (("nominal", 1e-4), ("worst", 4e-5)):
        part = MeshConnector(**clip, tolerance_width=6e-5, tolerance=tolerance)
        geometry = geometry_of(part, ("spring",))
        for y in (-1.0, 1.0):
            found = geometry.free(RotationMatrix(), 2e-3, (0.0, y))
            assert found == pytest.approx(free, abs=1e-7)


PARTS = Path(__file__).parents[3] / "docs" / "parts"


@pytest.mark.parametrize("name", ["usb-a", "header", "key-peg"])
def test_the_parts_of_the_docs_go_in_one_way_only(geometry_of, name):
    files = {end: str(PARTS / f"{name}-{end}.obj") for end in ("plug", "socket")}
    part = MeshConnector(**files, mated_depth=6e-3, seating_force=1.0)
    geometry = geometry_of(part, ("grip", "contact", "tine"))
    for turn, most in ((0.0, 6e-3), (np.pi, 1.2e-3)):
        R = RotationMatrix.MakeZRotation(turn)
        assert geometry.meet(RigidTransform(R, [0, 0, -most])) == (turn > 0)
