from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.contact.wrist_contention import run_contention
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.contact_scenarios import WRIST_CONTENTION, AdeptScenario
from chamfer.diagrams.contact.hybrid_loop_stability import resolve


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def near(**values: float) -> AdeptScenario:
    """The nugget 2 mm from the wall."""
    scenario = replace(WRIST_CONTENTION, **values)  # type: ignore[arg-type]
    task = replace(scenario.task, start=(0.498, -0.3, 0.3, 0.0), distance=0.002)
    return resolve(replace(scenario, task=task))


SCENARIO = near(duration=3.0, measure_after=1.5, trials=1)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run_contention(SCENARIO, 0, quiet)


def test_the_wrists_integrator_is_the_one_that_is_off(outcome: Outcome) -> None:
    off = outcome.tables["wrist_integrator_off"]
    contact = outcome.metrics["contact_time"].value
    assert contact is not None
    # tau = Kp e + I + tau_off - Kd w, the force has no part in joint 4: Kp e is all that moves.
    late = off["time"] > contact + 0.2
    gains = SCENARIO.controller
    q = np.stack([off[f"joint_{i}.position"] for i in range(1, 5)], axis=1)
    v = np.stack([off[f"joint_{i}.velocity"] for i in range(1, 5)], axis=1)
    errors = np.stack([off[f"desired_{c}"] - off[c] for c in ["x", "y", "z", "phi"]], axis=1)
    P = np.diag([0.0, 1.0, 1.0, 1.0])  # the push is along x
    arm = SCENARIO.ARM
    rest = []
    for k in np.flatnonzero(late)[:-1]:
        J = arm.jacobian(q[k])
        e = np.linalg.solve(J, P @ errors[k])
        rate = np.linalg.solve(J, P @ J @ v[k])
        torque = off["joint_4.torque"][k + 1]  # computed at k
        rest.append(torque - gains.stiffness[3] * e[3] + gains.damping[3] * rate[3])
    assert np.ptp(rest) < 1e-9


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
