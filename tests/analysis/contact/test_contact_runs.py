"""Runs of the hybrid loop, and the planar arm's against the thesis."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.contact.contact_metrics import contact_metrics
from chamfer.analysis.contact.contact_runs import (
    measure,
    run_contact,
    run_trials,
)
from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import quiet
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    PLANAR_HOLD,
    PLANAR_SLIDE,
    PUMA_NUGGET_MOTION,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS


def near_wall(**values: float) -> HybridScenario:
    """The Adept a millimetre from its wall."""
    scenario = replace(ADEPT_NUGGET_HOLD, duration=0.8, measure_after=0.4, trials=1)
    task = replace(scenario.task, start=(0.499, -0.3, 0.3, 0.0), distance=0.001)
    return resolve(replace(scenario, task=task, **values))  # type: ignore[arg-type]


@pytest.mark.parametrize("scenario", [PLANAR_HOLD, PUMA_NUGGET_MOTION, ADEPT_NUGGET_HOLD])
def test_traces_have_a_row_a_period(scenario: HybridScenario) -> None:
    scenario = resolve(replace(scenario, duration=0.2))
    traces = run_contact(scenario, 0)
    np.testing.assert_allclose(traces["time"], 0.005 * np.arange(41), atol=1e-12)
    assert {len(values) for values in traces.values()} == {41}
    arm = scenario.ARM
    names = {"force", "measured_force", "position_error", "position", "height", "mode"}
    names |= {"time", *CONTACT_SIGNALS}
    names |= {f"{part}{name}" for name in arm.coordinates for part in ("", "desired_")}
    names |= {
        f"{name}.{what}" for name in arm.joint_names for what in ("position", "velocity", "torque")
    }
    assert set(traces) == names
    assert all(np.all(np.isfinite(values)) for values in traces.values())


def test_traces_agree_with_the_kinematics() -> None:
    scenario = near_wall()
    traces = run_contact(scenario, 0)
    q = np.stack([traces[f"{name}.position"] for name in scenario.ARM.joint_names], axis=1)
    endpoint = np.array([scenario.ARM.endpoint(one) for one in q])
    for i, name in enumerate(scenario.ARM.coordinates):
        np.testing.assert_array_equal(traces[name], endpoint[:, i])
    # The wall is in x, at 0.5 m; the motion would be along z.
    np.testing.assert_allclose(traces["height"], 0.5 - traces["x"], atol=1e-12)
    np.testing.assert_allclose(traces["position"], traces["z"], atol=1e-12)
    np.testing.assert_allclose(
        traces["position_error"], traces["desired_z"] - traces["z"], atol=1e-12
    )
    assert traces["height"][0] == pytest.approx(0.001, abs=1e-12)


def test_measuring_a_run_is_measuring_its_traces() -> None:
    scenario = near_wall()
    traces = run_contact(scenario, 0)
    assert measure(scenario, traces) == contact_metrics(
        traces, force=5.0, after=0.4, period=None, kick=None, impact_limit=0.44
    )
    sliding = replace(scenario, task=replace(scenario.task, amplitude=0.01, frequency=20.0))
    period = 2 * np.pi / 20.0
    assert measure(sliding, traces) == contact_metrics(
        traces, force=5.0, after=0.4, period=period, kick=None, impact_limit=0.44
    )
    assert measure(sliding, traces)["force.final"] != measure(scenario, traces)["force.final"]


@pytest.mark.slow
def test_trials_differ_and_the_traces_are_of_the_first() -> None:
    scenario = near_wall(trials=3)
    told: list[float] = []

    def progress(fraction: float, doing: str = "") -> None:
        told.append(fraction)

    outcome = run_trials(scenario, 7, progress)
    assert outcome.simulated_seconds == pytest.approx(3 * 0.8)
    assert told == sorted(told)
    assert told[0] == pytest.approx(1 / 3)
    assert told[-1] == pytest.approx(1.0)
    runs = [run_contact(scenario, trial_seed(7, trial)) for trial in range(3)]
    for name, values in outcome.traces.items():
        np.testing.assert_array_equal(values, runs[0][name])
    peaks = [measure(scenario, run)["force.peak"] or np.nan for run in runs]
    assert len(set(peaks)) == 3
    assert outcome.metrics["force.peak"].value == pytest.approx(np.mean(peaks))
    assert outcome.metrics["force.peak"].note.startswith("mean of 3 seeds")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "scenario"), [("planar-hold", PLANAR_HOLD), ("planar-slide", PLANAR_SLIDE)]
)
def test_fig_2_5_and_2_6_are_reproduced(name: str, scenario: HybridScenario) -> None:
    values = [value for value in PUBLISHED if value.experiment == name]
    assert values
    checks = check(values, run_trials(resolve(scenario), 0, quiet).metrics)
    # Its own 15 N and 0.33 m/s are beyond what glass bears.
    assert {one.published.kind for one in checks if not one.ok} == {"specification"}
    assert sum(one.verdict == "does_not_hold" for one in checks) == 2


def test_the_lag_is_damping_over_stiffness() -> None:
    task = replace(PLANAR_SLIDE.task, start=(1.0, -1.4))  # 10 cm above the crucible's bottom
    scenario = replace(PLANAR_SLIDE, task=task, duration=10.0, measure_after=3.5)
    slide = run_trials(resolve(scenario), 0, quiet)
    # A w Kd / Kp, plus friction
    lag = 0.02 * 1.0 * 60 / 400
    assert slide.metrics["position.lag_error"].value == pytest.approx(lag, rel=0.1)
