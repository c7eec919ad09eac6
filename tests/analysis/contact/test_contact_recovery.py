from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.contact import contact_recovery
from chamfer.analysis.contact.contact_recovery import run_recovery
from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.diagrams.contact.contact_scenarios import CONTACT_RECOVERY, PlanarLoop
from chamfer.diagrams.contact.hybrid_loop_stability import resolve

GAINS = (1.0, 2.0, 3.0, 4.0, 5.0)
ASKED = [value for value in PUBLISHED if value.experiment == "contact-recovery"]


def near(kick_time: float | None, duration: float) -> PlanarLoop:
    """The arm 10 cm above the crucible's bottom."""
    scenario = CONTACT_RECOVERY
    task = replace(scenario.task, start=(1.0, -1.4), kick_time=kick_time)
    return resolve(replace(scenario, task=task, duration=duration, measure_after=1.5))


SCENARIO = near(2.0, 3.0)


@pytest.fixture(scope="module")
def outcome() -> Iterator[Outcome]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contact_recovery, "_BOUNCING", 2.5)
        yield run_recovery(SCENARIO, 0, quiet)


@pytest.mark.slow
def test_bounces_grow_above_the_threshold_and_decay_below(outcome: Outcome) -> None:
    growth = [outcome.metrics[f"without_loss_mode.growth_at_{gain:g}"].value for gain in GAINS]
    assert None not in growth
    assert growth == sorted(growth, key=float)  # type: ignore[arg-type]
    low, high = growth[:2], growth[-1]
    assert all(one is not None and one < 0.8 for one in low)
    assert high is not None
    assert high > 2
    threshold = outcome.metrics["growth_threshold"]
    # reference: between 3.0 and 3.5 1/s
    assert threshold.value == pytest.approx(3.25, abs=0.4)
    assert threshold.unit == "1/s"


@pytest.mark.slow
def test_growth_and_threshold_follow_from_the_bounces(outcome: Outcome) -> None:
    table = outcome.tables["bounces"]
    for gain in GAINS:
        speeds = table["speed"][table["force_integral"] == gain]
        assert len(speeds) == 6
        np.testing.assert_array_equal(
            table["bounce"][table["force_integral"] == gain], np.arange(6)
        )
        assert speeds[0] == pytest.approx(0.33, rel=0.1)
        assert outcome.metrics[f"without_loss_mode.growth_at_{gain:g}"].value == pytest.approx(
            speeds[5] / speeds[1]
        )


@pytest.mark.slow
def test_the_loss_mode_is_gentle_after_the_blow(outcome: Outcome) -> None:
    value = {name: metric.value for name, metric in outcome.metrics.items()}
    for name in ("recontact.force", "recontact.blow_speed", "recontact.speed"):
        assert value[name] is not None
    assert value["recontact.blow_speed"] == pytest.approx(0.05, abs=0.02)  # the creep speed
    assert (value["recontact.force"] or np.inf) < 20
    assert (value["recontact.speed"] or np.inf) < 0.1
    assert (value["without_loss_mode.force"] or 0) > 30
    assert (value["without_loss_mode.speed"] or 0) > 0.1


@pytest.mark.slow
def test_checks_that_fail_are_the_ones_that_a_note_explains(outcome: Outcome) -> None:
    failed = {c.published.metric for c in check(ASKED, outcome.metrics) if not c.ok}
    broken = {"contact.losses", "damage.scratch_time", "damage.safe_speed_share"}
    assert failed == {"without_loss_mode.growth_at_2", *broken}
    assert all(value.note for value in ASKED if value.metric in failed)


def test_the_threshold_is_interpolated_between_gains() -> None:
    threshold = contact_recovery._threshold
    assert threshold([0.2, 0.4, 0.8, 1.2, 3.0]).value == pytest.approx(3.5)
    assert threshold([0.2, 0.4, 0.5, 0.75, 1.75]).value == pytest.approx(4.25)
    assert threshold([0.5, 1.0, 2.0, 3.0, 4.0]).value == pytest.approx(2.0)
    for growth in ([0.1, 0.2, 0.3, 0.4, 0.5], [2.0, 3.0, 4.0, 5.0, 6.0]):
        none = threshold(growth)
        assert none.value is None
        assert none.note.startswith("not among")


def test_what_follows_a_blow_begins_when_the_tip_has_left() -> None:
    traces = {
        "time": np.arange(8.0),
        "gap": np.array([-1.0, 2.0, -1.0, -1.0, -1.0, 0.5, 0.5, -1.0]),
        "peak_force": np.array([90.0, 0.0, 90.0, 15.0, 40.0, 30.0, 0.0, 12.0]),
    }
    scenario = near(3.5, 5.5)  # the tip leaves at 5 s; 30 N are still of the blow's period
    assert contact_recovery._after_blow(scenario, traces, "peak_force", "N").value == 12.0
    traces["gap"] = np.full(8, -1.0)
    metric = contact_recovery._after_blow(scenario, traces, "peak_force", "N")
    assert metric.value is None
    assert metric.note == "the blow does not break the contact"
