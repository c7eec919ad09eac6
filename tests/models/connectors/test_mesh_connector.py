"""Parts out of files: against a part whose pieces have closed forms, and what is refused."""

import math

import numpy as np
import pytest
from pydrake.math import RotationMatrix

from chamfer.analysis.skills.skill_run import run_skill
from chamfer.diagrams.skills.connector_insertion import OwnPartScenario, PegScenario
from chamfer.models.connectors.connector import Connector
from chamfer.models.connectors.mesh_connector import MeshConnector
from chamfer.models.connectors.obj_file import convex_hull, write_solids
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import ParameterError

PEG = RoundPeg(outer_radius=0.034)  # so that the mesh has a face to lie on beside the hole
SIDES = 16
MM = 1e3


def prism(radii, heights):
    """Corners of a prism whose sides are the radii away from the axis at each height, mm."""
    angles = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) / math.cos(math.pi / SIDES)
    return np.vstack(
        [MM * np.insert(r * ring, 2, z, axis=1) for r, z in zip(radii, heights, strict=True)]
    )


def wall(side):
    """Corners of what one side of the hole is cut from, with a chamfer, mm."""
    across = 2 * math.tan(math.pi / SIDES)
    bore, edge, outer = PEG.hole_radius, PEG.lead_in, PEG.outer_radius
    radii = (bore, bore, bore + edge, outer, outer)
    heights = (-PEG.depth, -edge, 0.0, 0.0, -PEG.depth)
    corners = [
        [r, sign * r * across / 2, z]
        for r, z in zip(radii, heights, strict=True)
        for sign in (-1, 1)
    ]
    turn = RotationMatrix.MakeZRotation(2 * math.pi * side / SIDES).matrix()
    return MM * np.array(corners) @ turn.T


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    """The round peg and its hole with 16 sides."""
    folder = tmp_path_factory.mktemp("meshes")
    r, edge = PEG.peg_radius, PEG.lead_in
    peg = convex_hull("peg", prism((r - edge, r, r), (0.0, edge, PEG.peg_length)))
    bottom = prism((PEG.outer_radius,) * 2, (-PEG.depth - 4e-3, -PEG.depth))
    walls = [convex_hull(f"wall {i}", wall(i)) for i in range(SIDES)]
    write_solids(folder / "peg.obj", [peg])
    write_solids(folder / "hole.obj", [*walls, convex_hull("bottom", bottom)])
    return MeshConnector(
        plug=str(folder / "peg.obj"),
        socket=str(folder / "hole.obj"),
        mated_depth=PEG.mated_depth,
        mating_force=PEG.mating_force,
        material=PEG.material,
    )


def test_it_is_a_connector_with_the_size_of_its_files(meshes):
    connector: Connector = meshes
    assert connector.name == "peg"
    assert connector.mated_depth == PEG.mated_depth
    assert connector.plug_outline[:, 2].max() == pytest.approx(PEG.peg_length)
    assert connector.socket_outline[:, 2].max() == pytest.approx(0.0, abs=1e-12)
    assert meshes.with_mating_force(7.0).mating_force == 7.0


def test_play_is_that_of_the_round_parts(geometry_of, meshes):
    mesh, round_ = (geometry_of(one) for one in (meshes, PEG))
    for direction in ((1.0, 0.0), (0.0, -1.0), (math.sqrt(0.5), math.sqrt(0.5))):
        free = mesh.free(RotationMatrix(), 5e-3, direction)
        assert free == pytest.approx(PEG.clearance, abs=2e-6)
        assert free <= round_.free(RotationMatrix(), 5e-3, direction) + 2e-6


def test_it_goes_in_as_far_and_as_hard_as_the_round_parts(insert, meshes):
    found, expected = (
        insert(one, [0, 0, 0, 0, 0, 1e-3], -PEG.depth - 0.3e-3, 0.4) for one in (meshes, PEG)
    )
    before = found.depth < PEG.depth - 0.1e-3
    assert np.abs(found.wrench[:5, before]).max() < 1e-6
    assert found.push[before][-1] < 2.0  # N, of the wrist's mass as it starts
    assert found.depth[-1] == pytest.approx(expected.depth[-1], abs=5e-6)
    assert found.push[-1] == pytest.approx(expected.push[-1], rel=0.02)


def test_beside_its_hole_it_stays_on_the_face(insert, meshes):
    beside = 0.2e-3 + PEG.clearance + 2 * PEG.lead_in
    for one in (meshes, PEG):
        run = insert(one, [0, 0, 0, beside, 0, 0.5e-3], -0.5e-3, 0.2)
        assert run.depth[-1] < 0.1e-3
        assert run.push[-1] == pytest.approx(2e4 * 0.5e-3, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("trial", range(6))
def test_a_skill_inserts_it_as_it_inserts_the_round_parts(meshes, trial):
    spread = np.array([0.05, 0.05, 0.0, 0.002, 0.002, 0.0])  # rad above m
    error = tuple((np.random.default_rng([5, trial]).uniform(-1, 1, 6) * spread).tolist())
    fields = {"initial_error": error, "step": 0.002}
    round_ = PegScenario(connector=PEG, sight=None, **fields)
    skill = round_.make_skill()
    expected = run_skill(skill, round_, seed=trial)
    found = run_skill(skill, OwnPartScenario(connector=meshes, **fields), seed=trial)
    assert [one.outcome for one in (expected, found)] == ["done", "done"]
    depths = [one.traces["depth"][-1] for one in (expected, found)]
    assert depths == pytest.approx([PEG.mated_depth] * 2, abs=1e-5)
    pushes = [np.abs(one.traces["true_wrench_z"]).max() for one in (expected, found)]
    assert pushes[1] == pytest.approx(pushes[0], rel=0.1)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("plug", "nowhere.obj", "(No such file or directory)"),
        ("socket", "ell.obj", "('ell' is not convex, divide it first)"),
        ("socket", "half.obj", "(line 1: 'v 1 2')"),
        ("unit", 1.0, "at most 1 m large"),
        ("unit", 0.0, "a finite number > 0"),
        ("mated_depth", -1.0, "a finite number > 0"),
        ("mating_force", math.nan, "a finite number > 0"),
    ],
)
def test_what_is_not_allowed_is_told_in_one_line(tmp_path, ell, meshes, name, value, told):
    (tmp_path / "ell.obj").write_text(ell)
    (tmp_path / "half.obj").write_text("v 1 2")
    if isinstance(value, str):
        value = str(tmp_path / value)
    fields = {"plug": meshes.plug, "socket": meshes.socket, "mated_depth": 0.02}
    with pytest.raises(ParameterError) as refused:
        MeshConnector(**{**fields, "mating_force": 20.0, name: value})
    assert refused.value.name == name
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)
