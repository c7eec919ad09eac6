"""What is passed over as the contacts of a step are looked for."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.insertion.peg_insertion import (
    PEG_INSERTION,
    make_peg_insertion_diagram,
    resolve_peg_insertion,
)
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.contact.near_walls import wall_gaps


@pytest.mark.parametrize("preset", ["paper", "nist-12.675mm", "factory-8mm"])
def test_walls_that_touch_are_near_however_the_peg_stands(preset: str) -> None:
    """Against all the pairs that Drake finds, in poses drawn around the wall and the mouth."""
    parts = PegAndHole(**PegAndHole.PRESETS[preset])  # type: ignore[arg-type]
    scenario = resolve_peg_insertion(replace(PEG_INSERTION, parts=parts, speed=0.001))
    diagram = make_peg_insertion_diagram(scenario)
    context = diagram.CreateDefaultContext()
    plant = diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    of_plant = plant.GetMyContextFromRoot(context)
    sizes = parts.hole_radius, parts.peg_radius, parts.peg_length, scenario.contact.facets
    inspector = diagram.GetSubsystemByName("geometry").model_inspector()  # type: ignore[attr-defined]
    rng = np.random.default_rng(4)
    touching = 0
    for _ in range(150):
        depth, off = rng.uniform(-0.002, 0.03), rng.uniform(-2, 2, 4) * parts.clearance
        across, tilt = off[:2], off[2:] / 0.01
        X_WT = RigidTransform(RollPitchYaw([0.0, *tilt]), [depth, *across])
        centre = X_WT @ np.array([-scenario.support.centre_distance, 0.0, 0.0])
        plant.SetPositions(of_plant, np.array([*centre, tilt[1], tilt[0]]))
        gaps = wall_gaps(X_WT.GetAsMatrix34(), *sizes)
        query = plant.get_geometry_query_input_port().Eval(of_plant)
        names = [inspector.GetName(one.id_B) for one in query.ComputePointPairPenetration()]
        walls = {int(name.split()[-1]) for name in names}
        assert walls <= set(np.flatnonzero(gaps < 0.0).tolist())
        touching += 0 < len(walls) < 0.5 * len(gaps) and np.mean(gaps < 0.0) < 0.5
    assert touching > 50


@pytest.mark.parametrize("tilt", [0.045, 0.08])  # slides, is held
def test_a_run_is_to_the_last_digit_what_it_is_with_all_walls(tilt: float) -> None:
    scenario = replace(PEG_INSERTION, lateral=0.001, tilt=tilt, speed=0.04, gap=0.001, depth=0.01)
    scenario = resolve_peg_insertion(scenario)
    quick, slow = (make_peg_insertion_diagram(scenario) for _ in range(2))
    slow.GetSubsystemByName("contact").after_steps = None  # type: ignore[attr-defined]
    lasting = {"duration": scenario.released, "step": scenario.step}
    expected = simulate(slow, **lasting).outputs
    for name, values in simulate(quick, **lasting).outputs.items():
        np.testing.assert_array_equal(values, expected[name], name)
    assert expected["normal_forces"].max() > 1.0
