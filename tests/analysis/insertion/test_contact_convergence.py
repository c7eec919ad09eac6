"""What is varied, and how a convergence is told."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.insertion.contact_convergence import (
    MEASURED,
    PARAMETERS,
    ConvergenceScenario,
    label,
    measure_variation,
    resolve,
    variations,
)
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import load, select
from chamfer.analysis.scenario.scenario_io import make_scenario

(ENTRY,) = select(CATALOGUE.entries, ["contact-convergence"])
CONTACT_CONVERGENCE = load(ENTRY)

SCENARIO = resolve(ConvergenceScenario())


def test_one_thing_is_varied_at_a_time_about_the_insertion() -> None:
    tasks = [one for one in variations(SCENARIO) if one.start == "sliding"]
    counts = {name: sum(one.parameter == name for one in tasks) for name in PARAMETERS}
    assert counts == {
        "steps": 4,
        "stiffnesses": 4,
        "facets": 3,
        "stictions": 3,
        "approximations": 3,
        "accuracies": 2,
    }
    base = SCENARIO.insertion
    for one in tasks:
        kept = one.scenario
        for name, back in (
            ("steps", {"step": base.step}),
            ("stictions", {"stiction": base.stiction}),
            ("approximations", {"approximation": base.approximation}),
            ("stiffnesses", {"contact": base.contact}),
            ("facets", {"contact": base.contact}),
        ):
            if one.parameter == name:
                kept = replace(kept, **back)
        assert kept == base
    assert [one.accuracy for one in tasks[-2:]] == [1e-2, 1e-5]


def test_the_stuck_start_is_beyond_the_last_tilt_that_slides() -> None:
    stuck = next(one for one in variations(SCENARIO) if one.start == "stuck")
    assert stuck.scenario.tilt == SCENARIO.stuck_tilt
    leaning_left = replace(SCENARIO, insertion=replace(SCENARIO.insertion, tilt=-0.045))
    stuck = next(one for one in variations(leaning_left) if one.start == "stuck")
    assert stuck.scenario.tilt == -SCENARIO.stuck_tilt


def test_a_variation_is_measured() -> None:
    task = next(one for one in variations(SCENARIO) if one.value == 2e-3)
    found = measure_variation(task)
    assert set(found) == set(MEASURED)
    assert found["seated"] == 1.0
    assert found["force"] == pytest.approx(8.46, rel=0.02)  # the exact statics
    assert found["onset"] == pytest.approx(0.01101, abs=2e-4)
    assert found["balance"] == pytest.approx(100.0, abs=2.0)
    assert found["depth"] == pytest.approx(SCENARIO.insertion.depth, abs=2e-4)


@pytest.mark.parametrize(
    ("parameter", "value", "expected"),
    [("steps", 2.5e-4, "0_00025"), ("stiffnesses", 1e8, "1e08"), ("approximations", 2, "sap")],
)
def test_values_in_names(parameter: str, value: float, expected: str) -> None:
    assert label(SCENARIO, parameter, value) == expected


def test_mistakes() -> None:
    with pytest.raises(
        UserError, match=r"^steps is \(0\.001, -1\.0\), allowed: finite numbers > 0"
    ):
        make_scenario(ConvergenceScenario(), settings=["steps=[0.001, -1]"])


@pytest.mark.slow
def test_a_run_says_how_far_values_are_apart() -> None:
    settings = [*ENTRY.reduced, "steps=[0.004, 0.002]"]
    settings = [one for one in settings if one != "steps=[0.002]"]
    scenario = resolve(make_scenario(ConvergenceScenario(), settings=settings))
    outcome = CONTACT_CONVERGENCE.run(scenario, 0, lambda fraction, doing="": None)
    traces = outcome.traces
    of = (traces["parameter"] == 0) & (traces["start"] == 0)
    coarse, fine = traces["force"][of]
    spread = outcome.metrics["sliding.steps.force.spread"].value
    assert spread == pytest.approx(100 * abs(coarse - fine) / fine)
    worst = outcome.metrics["energy.worst"].value
    assert worst is not None
    assert worst >= 0
    assert math.isnan(traces["balance"][traces["parameter"] == PARAMETERS.index("accuracies")][0])
    assert np.array_equal(
        traces["force"][(traces["parameter"] == 2) & (traces["start"] == 0)], [fine]
    )  # the same insertion is run once
