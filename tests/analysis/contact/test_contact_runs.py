from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.contact.contact_metrics import contact_metrics
from chamfer.analysis.contact.contact_runs import (
    contact_charts,
    measure,
    run_contact,
    run_trials,
)
from chamfer.diagrams.contact.contact_scenarios import (
    AdeptNuggetHoldScenario,
    PlanarScenario,
    PumaNuggetMotionScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def near_wall(**values: float) -> HybridScenario:
    """The Adept a millimetre from its wall."""
    scenario = AdeptNuggetHoldScenario(duration=0.8, measure_after=0.4, trials=1)
    task = replace(scenario.task, start=(0.499, -0.3, 0.3, 0.0), distance=0.001)
    return resolve(replace(scenario, task=task, **values))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "make", [PlanarScenario, PumaNuggetMotionScenario, AdeptNuggetHoldScenario]
)
def test_traces_have_a_row_a_period(make: Callable[..., HybridScenario]) -> None:
    scenario = resolve(make(duration=0.2))
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


def test_the_push_is_positive_and_comes_with_contact() -> None:
    scenario = near_wall()
    traces = run_contact(scenario, 0)
    assert traces["force"].min() >= 0
    assert traces["force"].max() > 1
    pressed = traces["gap"] < -1e-6
    assert np.all(traces["force"][pressed] > 0)
    # A damper ahead of the spring: coming in at v, it acts from a gap of d v / k on.
    surface = scenario.surface
    ahead = surface.damping * np.maximum(traces["approach_speed"], 0) / surface.stiffness
    assert np.all(traces["force"][traces["gap"] > 1.1 * ahead + 1e-6] == 0)
    # The largest normal force of a period is not below the last one; friction on the tilted wall
    # adds mu times the tilt to the push.
    assert np.all(traces["force"] <= 1.005 * traces["peak_force"])


def test_measuring_a_run_is_measuring_its_traces() -> None:
    scenario = near_wall()
    traces = run_contact(scenario, 0)
    assert measure(scenario, traces) == contact_metrics(
        traces, force=5.0, after=0.4, period=None, impact_limit=0.44
    )
    sliding = replace(scenario, task=replace(scenario.task, amplitude=0.01, frequency=20.0))
    period = 2 * np.pi / 20.0
    assert measure(sliding, traces) == contact_metrics(
        traces, force=5.0, after=0.4, period=period, impact_limit=0.44
    )
    assert measure(sliding, traces)["force.final"] != measure(scenario, traces)["force.final"]


def test_light_nuggets_may_hit_harder() -> None:
    scenario = near_wall()
    light = replace(scenario, task=replace(scenario.task, nugget_mass=0.014))
    traces = run_contact(scenario, 0)
    shares = [measure(one, traces)["damage.impact_share"] or 0.0 for one in (scenario, light)]
    assert shares[0] / shares[1] == pytest.approx(0.99 / 0.44)  # appendix C


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


def test_the_loops_growth_is_a_metric() -> None:
    stable = PlanarScenario(duration=0.1)
    metric = run_trials(resolve(stable), 0, quiet).metrics["loop.growth_contact"]
    assert (metric.value, metric.unit, metric.note) == (0.0, "1/s", "")
    unstable = replace(
        stable,
        arm=replace(stable.arm, elbow="positive"),
        controller=replace(stable.controller, allow_unstable=True),
    )
    metric = run_trials(unstable, 0, quiet).metrics["loop.growth_contact"]
    assert metric.value == pytest.approx(31.2, abs=0.1)
    assert metric.note.startswith("unstable in contact")


def test_another_seed_gives_another_outcome() -> None:
    outcomes = [run_trials(near_wall(), seed, quiet) for seed in (0, 0, 1)]
    peaks = [outcome.metrics["force.peak"].value for outcome in outcomes]
    assert peaks[0] == peaks[1] != peaks[2]


def test_the_loops_chart_is_its_contact_detection() -> None:
    (chart,) = contact_charts(near_wall())
    assert chart.name == "contact detection"
    assert [state.name for state in chart.states] == ["approach", "contact", "lost"]
    assert any("0.8 N" in transition.label for transition in chart.transitions)
