import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import load, select
from chamfer.analysis.servo.plant_identification import (
    IdentificationScenario,
    PlantFamily,
    identify,
    pid_step,
)
from chamfer.diagrams.servo.servo_scenario import PlantParams
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.pid import PidParams

PLANT_IDENTIFICATION = load(select(CATALOGUE.entries, ["plant-identification"])[0])


def test_the_plant_behind_fig_8() -> None:
    plant = identify(rise_time=0.00888, overshoot=10.5, stiffness=700.0, pid=PidParams())
    assert plant.mass == pytest.approx(PlantParams().mass, abs=1e-5)
    assert plant.damping == pytest.approx(PlantParams().damping, abs=1e-3)


def test_a_known_plant_is_found_again() -> None:
    known = PlantParams(mass=1.7, damping=40.0, stiffness=500.0)
    measured = pid_step(known, PidParams(), 0.008)
    assert measured.rise_time is not None
    assert measured.overshoot is not None
    found = identify(
        rise_time=measured.rise_time,
        overshoot=measured.overshoot,
        stiffness=500.0,
        pid=PidParams(),
    )
    assert found.mass == pytest.approx(1.7, rel=1e-3)
    assert found.damping == pytest.approx(40.0, rel=1e-3)


def test_a_response_that_no_plant_has_is_refused() -> None:
    with pytest.raises(
        ParameterError, match=r"plant\.stiffness is 700\.0, allowed: one for which"
    ):
        identify(rise_time=0.00888, overshoot=400.0, stiffness=700.0, pid=PidParams())


def test_the_steady_state_error_is_predicted_by_the_integral_gain() -> None:
    outcome = PLANT_IDENTIFICATION.run(
        IdentificationScenario(plant=PlantFamily(stiffness=(550.0,))),
        0,
        lambda fraction, doing="": None,
    )
    final = outcome.metrics["stiffness_550.final_value"].value
    assert final == pytest.approx(21903 / (21903 + 550), rel=1e-6)
