from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.contact.contact_runs import run_contact
from chamfer.analysis.contact.wrist_contention import run_contention
from chamfer.analysis.scenario.experiment import quiet
from chamfer.diagrams.contact.contact_scenarios import WRIST_CONTENTION, AdeptScenario
from chamfer.diagrams.contact.hybrid_loop_stability import resolve


def near(**values: float) -> AdeptScenario:
    """The nugget 2 mm from the wall."""
    scenario = replace(WRIST_CONTENTION, **values)  # type: ignore[arg-type]
    task = replace(scenario.task, start=(0.498, -0.3, 0.3, 0.0), distance=0.002)
    return resolve(replace(scenario, task=task))


SCENARIO = near(duration=3.0, measure_after=1.5, trials=1)


def test_the_wrists_integrator_is_the_one_that_is_off() -> None:
    outcome = run_contention(SCENARIO, 0, quiet)
    held = replace(SCENARIO, controller=replace(SCENARIO.controller, held_integrators=(3,)))
    for scenario, found in (
        (SCENARIO, outcome.traces),
        (held, outcome.tables["wrist_integrator_off"]),
    ):
        expected = run_contact(scenario, trial_seed(0, 0))["joint_4.torque"]
        np.testing.assert_array_equal(found["joint_4.torque"], expected)


@pytest.mark.slow
def test_the_integrator_disturbs_the_force() -> None:
    outcome = run_contention(near(duration=20.0, measure_after=5.0, trials=1), 0, quiet)
    ratio = outcome.metrics["force.deviation_ratio"].value
    assert ratio is not None
    assert ratio > 1.1


def test_a_run_that_ends_before_it_is_measured_has_no_wrist_error() -> None:
    outcome = run_contention(near(duration=0.5, measure_after=1.5, trials=1), 0, quiet)
    metric = outcome.metrics["wrist_error"]
    assert (metric.value, metric.note) == (None, "the run ends before measure_after")
    assert outcome.metrics["force.deviation_ratio"].value is None
