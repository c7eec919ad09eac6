"""Runs of the hybrid loop: approach, contact and its loss, and convergence with the step."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.contact.contact_runs import Traces, measure, run_contact
from chamfer.diagrams.contact.contact_scenarios import (
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    AdeptRollerMotionScenario,
    PlanarScenario,
    PlanarSlideScenario,
    PumaNuggetMotionScenario,
    PumaRollerHoldScenario,
    PumaRollerMotionScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import CONTACT, LOST
from chamfer.systems.force.friction_compensation import FrictionCompensationParams

PLANAR, PUMA, ADEPT = PlanarScenario(), PumaRollerHoldScenario(), AdeptNuggetHoldScenario()


def changed(scenario: HybridScenario, part: str, **values: Any) -> HybridScenario:
    """The scenario with other values in one of its parts."""
    return replace(scenario, **{part: replace(getattr(scenario, part), **values)})  # type: ignore[arg-type]


def torques(scenario: HybridScenario, traces: Traces) -> NDArray[np.float64]:
    return np.stack([traces[f"{name}.torque"] for name in scenario.ARM.joint_names], axis=1)


def positions(scenario: HybridScenario, traces: Traces) -> NDArray[np.float64]:
    return np.stack([traces[f"{name}.position"] for name in scenario.ARM.joint_names], axis=1)


def velocities(scenario: HybridScenario, traces: Traces) -> NDArray[np.float64]:
    return np.stack([traces[f"{name}.velocity"] for name in scenario.ARM.joint_names], axis=1)


# The adept's wall and the puma's table are near, so that the force settles in a short run.
NEAR_WALL = changed(
    replace(ADEPT, duration=0.6),
    "task",
    start=(0.4985, -0.3, 0.3, 0.0),
    distance=0.0015,
)
NEAR_TABLE = changed(
    replace(PUMA, duration=0.6), "task", start=(0.176, -0.011, 0.1075), distance=0.003
)
NEAR = changed(replace(PLANAR, duration=3.5), "task", start=(1.0, -1.4))


@pytest.mark.parametrize("scenario", [NEAR_WALL, NEAR_TABLE])
def test_the_same_seed_gives_the_same_bytes(scenario: HybridScenario) -> None:
    runs = [run_contact(resolve(scenario), seed) for seed in (3, 3, 4)]
    same, other = (
        [one[name].tobytes() == runs[0][name].tobytes() for name in runs[0]] for one in runs[1:]
    )
    assert all(same)
    assert runs[0]["mode"].max() == CONTACT  # so that the noise comes back through the force
    unlike = {name for name, equal in zip(runs[0], other, strict=True) if not equal}
    assert {"measured_force", "force", "gap", "joint_2.torque", "joint_2.velocity"} <= unlike


def test_without_noise_the_seed_does_not_matter() -> None:
    scenario = replace(NEAR, duration=0.7)
    one, other = (run_contact(resolve(scenario), seed) for seed in (0, 1))
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize(
    ("scenario", "near"),
    [
        (replace(PLANAR, duration=2.0), 0.05),
        (replace(PUMA, duration=1.0), 0.008),
        (replace(ADEPT, duration=0.8), 0.003),
    ],
)
def test_free_motion_follows_the_approach(scenario: HybridScenario, near: float) -> None:
    traces = run_contact(resolve(scenario), 0)
    assert not np.any(traces["mode"])
    assert not np.any(traces["force"])
    arm, task = scenario.ARM, scenario.task
    covered = np.array([task.approached(t) for t in traces["time"]])
    wanted = np.array(task.start) + covered[:, np.newaxis] * scenario.direction
    for i, name in enumerate(arm.coordinates):
        # The last row of what the controller puts out is of the tick before.
        np.testing.assert_allclose(traces[f"desired_{name}"][:-1], wanted[:-1, i], atol=1e-12)
        np.testing.assert_allclose(traces[name], wanted[:, i], atol=near)
    half = len(covered) // 2
    travelled = np.diff(traces["height"][[half, -1]])[0] / np.diff(traces["time"][[half, -1]])[0]
    assert travelled == pytest.approx(-task.speed, rel=0.1)


def test_the_measured_force_is_the_one_of_its_time() -> None:
    traces = run_contact(resolve(replace(NEAR, duration=1.0)), 0)
    assert traces["force"].max() > 15
    # But for what the arm turned since.
    np.testing.assert_allclose(
        traces["measured_force"][:-1], traces["force"][:-1], rtol=1e-5, atol=1e-12
    )
    noisy = run_contact(resolve(NEAR_WALL), 0)
    across = 0.1 * 3 * np.abs(noisy["force"][:-1])  # cross-talk
    off = np.abs(noisy["measured_force"] - noisy["force"])[:-1]
    assert np.all(off <= 0.5 + across)
    assert off.max() > 0.4


def test_noise_in_the_air_is_taken_for_contact_only_by_who_does_not_know_of_it() -> None:
    noisy = changed(replace(ADEPT, duration=0.5), "sensor", noise=1.5)
    assert not np.any(run_contact(resolve(noisy), 0)["mode"])
    hasty = changed(noisy, "detection", detect=0.8, release=0.2, samples=1)
    touched = run_contact(resolve(hasty), 0)
    assert touched["time"][np.argmax(touched["mode"])] < 0.1
    patient = changed(noisy, "detection", detect=0.8, release=0.2)
    assert not np.any(run_contact(resolve(patient), 0)["mode"])


def test_a_torque_that_comes_late_is_late_in_the_loop() -> None:
    scenario = replace(PLANAR, duration=0.3)
    late = changed(scenario, "controller", computation_delay=0.005, allow_unstable=True)
    on_time, behind = (run_contact(resolve(one), 0) for one in (scenario, late))
    # The first torque acts in the second period, so the arm begins to move a row later.
    moves = [np.abs(velocities(scenario, one)).max(axis=1) > 0 for one in (on_time, behind)]
    assert np.argmax(moves[1]) == np.argmax(moves[0]) + 1


@pytest.fixture(scope="module")
def hold() -> Traces:
    return run_contact(resolve(replace(PLANAR, duration=9.0)), 0)


@pytest.mark.slow
def test_the_planar_arm_converges_to_the_desired_force(hold: Traces) -> None:
    late = hold["time"] > 8.0
    np.testing.assert_allclose(hold["force"][late], 15.0, atol=1e-2)
    assert hold["mode"][-1] == CONTACT
    # What holds 15 N is the spring that the tip has pressed in, once it is at rest.
    assert hold["gap"][-1] == pytest.approx(-15.0 / 1e4, rel=1e-2)
    assert hold["time"][np.argmax(hold["mode"] > 0)] == pytest.approx(4.55, abs=0.05)


def test_dissipated_energy_never_comes_back(hold: Traces) -> None:
    assert np.diff(hold["dissipated"]).min() >= 0
    q, v = positions(PLANAR, hold), velocities(PLANAR, hold)
    # A row's torque is that of the period before it.
    work = np.sum(torques(PLANAR, hold)[1:] * np.diff(q, axis=0))
    kinetic = 0.5 * v[-1] @ PLANAR.dynamics().evaluate(q[-1], v[-1]).mass @ v[-1]
    stored = 0.5 * PLANAR.surface.stiffness * hold["gap"][-1] ** 2
    assert hold["dissipated"][-1] + kinetic + stored == pytest.approx(work, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["projected", "transpose"])
@pytest.mark.parametrize("elbow", ["negative", "positive"])
def test_laws_that_settle_with_both_elbows(law: str, elbow: str) -> None:
    scenario = resolve(changed(changed(NEAR, "arm", elbow=elbow), "controller", law=law))
    traces = run_contact(scenario, 0)
    late = traces["time"] > 3.0
    np.testing.assert_allclose(traces["force"][late], 15.0, atol=0.3)
    assert np.sign(traces["joint_2.position"][-1]) == (1 if elbow == "positive" else -1)
    assert np.abs(velocities(scenario, traces)).max() < 2.0
    assert np.abs(traces["position_error"]).max() < 0.1
    assert np.all(traces["mode"][late] == CONTACT)
    assert np.diff(traces["dissipated"]).min() >= 0


def test_the_inverse_law_diverges_with_the_other_elbow() -> None:
    scenario = changed(changed(NEAR, "arm", elbow="positive"), "controller", allow_unstable=True)
    with pytest.raises(ParameterError, match=r"finite numbers|regular") as caught:
        run_contact(scenario, 0)
    assert "\n" not in str(caught.value)


def test_the_inverse_law_does_not_diverge_with_its_own_elbow() -> None:
    traces = run_contact(resolve(NEAR), 0)
    assert np.abs(velocities(NEAR, traces)).max() < 2.0
    assert traces["force"][-1] == pytest.approx(15.0, abs=0.3)


@pytest.fixture(scope="module")
def switching() -> dict[bool, Traces]:
    """The first contacts, by whether the controller switches without bumps."""
    return {
        bumpless: run_contact(
            resolve(changed(replace(NEAR, duration=0.9), "controller", bumpless=bumpless)), 0
        )
        for bumpless in (True, False)
    }


def test_the_torque_does_not_jump_at_the_first_contact(switching: dict[bool, Traces]) -> None:
    jumps = {}
    for bumpless, traces in switching.items():
        first = int(np.argmax(traces["mode"] == CONTACT))
        steps = np.abs(np.diff(torques(NEAR, traces), axis=0)).max(axis=1)
        jumps[bumpless] = steps[first - 2 : first + 4].max()
    assert jumps[True] < 7.0  # N m in a period, in which the blow of 45 N slows the tip
    assert jumps[False] > 15.0


def test_losing_contact_keeps_what_acts_along_the_surface(switching: dict[bool, Traces]) -> None:
    traces = switching[True]
    lost = int(np.argmax(traces["mode"] == LOST))  # seen by the controller at this row's time
    q, v = positions(NEAR, traces)[lost], velocities(NEAR, traces)[lost]
    J = NEAR.ARM.jacobian(q)
    before, after = np.linalg.solve(J.T, torques(NEAR, traces)[lost : lost + 2].T).T
    assert after @ NEAR.along == pytest.approx(before @ NEAR.along, abs=1e-9)
    # The push starts at 0: what is left is the damping of the creep.
    assert after @ NEAR.direction == pytest.approx(-60 * (J @ v) @ NEAR.direction, rel=1e-9)


@pytest.fixture(scope="module")
def blow() -> dict[bool, Traces]:
    """A blow that breaks the contact at 4 s, by whether there is a loss mode."""
    kicked = changed(replace(NEAR, duration=5.5, measure_after=3.5), "task", kick_time=4.0)
    return {
        mode: run_contact(resolve(changed(kicked, "controller", loss_mode=mode)), 0)
        for mode in (True, False)
    }


@pytest.mark.slow
def test_the_blow_takes_the_tip_off_the_surface(blow: dict[bool, Traces]) -> None:
    for traces in blow.values():
        time = traces["time"]
        assert np.all(traces["mode"][(time > 3.8) & (time < 4.0)] == CONTACT)
        struck = (time > 4.001) & (time < 4.006)
        # 0.2 m/s less what push and joint friction take in the meantime
        np.testing.assert_allclose(-traces["approach_speed"][struck], 0.2, atol=0.025)
        assert traces["gap"][(time > 4.0) & (time < 4.2)].max() > 1e-3
        assert np.any(traces["mode"][(time > 4.0) & (time < 4.2)] == LOST)


def test_the_loss_mode_brings_the_tip_back_gently(blow: dict[bool, Traces]) -> None:
    speed, force = {}, {}
    for mode, traces in blow.items():
        time = traces["time"]
        after = time > time[np.argmax((time > 4.0) & (traces["gap"] > 0))]
        speed[mode] = traces["impact_speed"][after].max()
        force[mode] = traces["peak_force"][after].max()
    assert speed[True] < 0.1
    assert force[True] < 20.0
    assert speed[False] > 0.1
    assert force[False] > 30.0


def test_first_contact_bounces_gently_with_the_loss_mode(blow: dict[bool, Traces]) -> None:
    early = blow[True]["time"] < 3.5
    impacts = [traces["impact_speed"][early] for traces in (blow[True], blow[False])]
    gentle, hard = (one[one > 0] for one in impacts)
    assert gentle[0] == hard[0] == pytest.approx(0.33, rel=0.1)
    assert gentle[1:].max() < 0.1
    assert hard[1:].max() > gentle[0]


def test_friction_compensation_lets_the_sticking_quill_follow() -> None:
    slow = changed(
        replace(ADEPT, duration=2.0), "task", start=(0.45, -0.3, 0.3, 0.0), distance=0.05
    )
    plain, helped = (
        run_contact(resolve(replace(slow, friction_compensation=compensation)), 0)
        for compensation in (None, FrictionCompensationParams(bandwidth=20.0))
    )
    error = [np.abs(one["desired_x"] - one["x"])[100:].max() for one in (plain, helped)]
    assert error[1] < 0.8 * error[0]


@pytest.mark.slow
@pytest.mark.parametrize("scenario", [NEAR_TABLE, NEAR_WALL])
def test_held_contact_comes_to_the_desired_force(scenario: HybridScenario) -> None:
    traces = run_contact(resolve(replace(scenario, duration=5.0)), 0)
    late = traces["time"] > 4.0
    assert traces["force"][late].mean() == pytest.approx(scenario.task.force, rel=0.2)
    assert np.all(traces["mode"][late] == CONTACT)
    assert np.diff(traces["dissipated"]).min() >= 0


# Step-size convergence.

STICK_SLIP = {
    "force.below": 0.05,
    "force.min": 0.1,
    "scratch_time": 0.05,
    **dict.fromkeys(("force.peak", "deviation", "force.above"), 0.07),
}
SHORT_ADEPT = AdeptRollerMotionScenario(duration=12.0)
# A contact that is found a sample earlier meets other samples of the noise.
QUIET_ADEPT = changed(SHORT_ADEPT, "sensor", noise=0.0)
# With sensors and a computer as they are, but for what rounds and what is random.
LATE_ADEPT = changed(
    changed(
        changed(replace(SHORT_ADEPT, sensing="realistic"), "encoders", counts=0.0),
        "sensor",
        noise=0.0,
        drift=0.0,
        resolution=0.0,
    ),
    "controller",
    computation_jitter=0.0,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "seed", "tolerance", "wider"),
    [
        # A bounce that ends a sample earlier changes times by a sample.
        (replace(PLANAR, duration=9.0), 0, 5e-3, {"settling_time": 0.02, "scratch_time": 0.03}),
        (replace(PlanarSlideScenario(), duration=14.0), 0, 3e-3, {}),
        # Joints that stick and slip take small differences to other places.
        (PumaRollerMotionScenario(), 0, 2e-2, STICK_SLIP),
        (PumaRollerMotionScenario(), 1, 2e-2, STICK_SLIP),
        (PumaNuggetMotionScenario(), 0, 2e-2, STICK_SLIP),
        (QUIET_ADEPT, 0, 1e-3, {"contact_time": 0.004, "scratch_time": 0.01}),
        (LATE_ADEPT, 0, 1e-2, {}),
        (AdeptNuggetMotionScenario(duration=17.0), 1, 1e-2, {"scratch_time": 0.1}),
    ],
)
def test_half_the_step_gives_the_same_results(
    scenario: HybridScenario, seed: int, tolerance: float, wider: dict[str, float]
) -> None:
    coarse, fine = (
        measure(scenario, run_contact(resolve(replace(scenario, step=step)), seed))
        for step in (scenario.step, scenario.step / 2)
    )
    for name, value in coarse.items():
        if value is None:
            assert fine[name] is None, name
            continue
        wide = next((one for part, one in wider.items() if name.endswith(part)), tolerance)
        assert value == pytest.approx(fine[name], rel=wide, abs=1e-9), name


@pytest.mark.slow
def test_the_first_impacts_peak_converges() -> None:
    scenario = replace(NEAR, duration=0.55)
    peaks = [
        run_contact(resolve(replace(scenario, step=step)), 0)["peak_force"].max()
        for step in (2e-4, 1e-4, 5e-5, 2.5e-5)
    ]
    assert peaks[0] == pytest.approx(peaks[-1], rel=1e-4)
    assert peaks[1] == pytest.approx(peaks[-1], rel=1e-5)  # the default step
