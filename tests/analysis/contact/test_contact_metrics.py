import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.contact.contact_metrics import (
    contact_metrics,
    longest,
    settling_time,
)

Array = NDArray[np.float64]
STEP = 0.1  # s


def traces(rows: int = 101, **columns: Array) -> dict[str, Array]:
    """Traces at 10 Hz of a run without contact, some columns replaced."""
    names = ("mode", "force", "measured_force", "peak_force", "impact_speed", "position_error")
    table = {name: np.zeros(rows) for name in names} | columns
    return {"time": STEP * np.arange(rows), **table}


def contact(rows: int = 101) -> dict[str, Array]:
    """Contact from 2 s on, 10 N wanted: 30 N at first, then 12 N, within 5 % from 4 s on."""
    time = STEP * np.arange(rows)
    force = np.select([time < 1.95, time < 2.05, time < 3.95], [0.0, 30.0, 12.0], 10.4)
    impact = np.zeros(rows)
    impact[20] = 0.3
    return traces(
        rows,
        mode=np.where(time < 1.95, 0.0, 1.0),
        force=force,
        measured_force=force.copy(),
        peak_force=1.1 * force,
        impact_speed=impact,
    )


def measured(table: dict[str, Array], **options: Any) -> dict[str, float | None]:
    given = {
        "force": 10.0,
        "after": 5.0,
        "period": None,
        "kick": None,
        "impact_limit": 0.4,
    } | options
    return contact_metrics(table, **given)  # type: ignore[arg-type]


def test_a_run_in_contact() -> None:
    values = measured(contact())
    assert values["contact_time"] == pytest.approx(2.0)
    assert values["force.peak"] == pytest.approx(33.0)
    assert values["force.settling_time"] == pytest.approx(2.0)  # 4 s less the contact's 2 s
    assert values["force.final"] == pytest.approx(10.4)
    assert values["force.above"] == values["force.below"] == pytest.approx(0.4)
    assert values["force.deviation"] == pytest.approx(0.4)
    assert values["impact.speed"] == 0.3
    assert values["recontact.speed"] is None
    assert (values["contact.losses"], values["contact.share"]) == (0, 100)
    assert values["damage.impact_share"] == pytest.approx(75.0)  # of 0.4 m/s
    assert values["damage.safe_speed_share"] == pytest.approx(150.0)  # of 0.2 m/s
    assert values["damage.scratch_time"] == pytest.approx(8.0)  # 2 s to 10 s, above 5 N


def test_deviations_count_in_their_window_only() -> None:
    table = contact()
    time, push = table["time"], table["measured_force"]
    push[np.isclose(time, 4.9)] = 99.0  # before the window
    push[np.isclose(time, 5.0)] = 12.5  # its first sample
    push[np.isclose(time, 7.0)] = 4.0
    table["position_error"][np.isclose(time, 4.9)] = 1.0
    table["position_error"][np.isclose(time, 6.0)] = -0.03
    table["position_error"][np.isclose(time, 8.0)] = 0.02
    values = measured(table)
    assert values["force.above"] == pytest.approx(2.5)
    assert values["force.below"] == pytest.approx(-6.0)
    assert values["force.deviation"] == pytest.approx(6.0)
    assert values["force.min"] == pytest.approx(4.0)
    assert values["position.lag_error"] == pytest.approx(0.03)
    earlier = measured(table, after=4.9)
    assert earlier["force.above"] == pytest.approx(89.0)
    assert earlier["position.lag_error"] == 1.0


def test_deviations_are_measured_and_settling_is_true() -> None:
    table = contact()
    table["measured_force"] += 1.0  # a sensor that reads too much
    values = measured(table)
    assert values["force.deviation"] == pytest.approx(1.4)
    assert values["force.true_deviation"] == pytest.approx(0.4)
    assert values["force.final"] == pytest.approx(11.4)
    assert values["force.settling_time"] == pytest.approx(2.0)
    assert values["damage.scratch_time"] == pytest.approx(8.0)


def test_the_final_force_is_the_mean_over_the_last_second_or_period() -> None:
    table = contact()
    time = table["time"]
    table["measured_force"] = 10.0 + np.sin(2 * math.pi * time / 2.0)
    # Over a whole period the sinusoid is gone, over half of one it is not.
    assert measured(table, period=2.0)["force.final"] == pytest.approx(10.0, abs=1e-12)
    last_second = 10.0 + np.sin(2 * math.pi * time[91:] / 2.0).mean()
    assert measured(table)["force.final"] == pytest.approx(last_second)
    assert last_second < 9.5


def test_impacts_and_losses_are_counted() -> None:
    table = contact()
    mode, impact = table["mode"], table["impact_speed"]
    mode[30:33] = 2.0  # lost at 3.0 s, found at 3.3 s
    mode[50:52] = 2.0
    impact[33], impact[52] = 0.05, 0.5
    values = measured(table)
    assert values["contact.losses_seen"] == 2
    assert values["impact.speed"] == 0.3
    assert values["recontact.speed"] == 0.5
    assert values["damage.impact_share"] == pytest.approx(125.0)  # the worst of all
    assert values["damage.safe_speed_share"] == pytest.approx(250.0)


@pytest.mark.parametrize(
    ("off", "hits", "kick", "losses", "share", "settled"),
    [
        ((), (), None, 0, 100, 100),
        ((30, 33), (33,), None, 1, 100 * 78 / 81, 100),  # before 5 s, as a bounce of the impact
        ((60, 63), (63,), None, 1, 100 * 78 / 81, 100 * 48 / 51),
        ((60, 63), (63,), 6.0, 0, 100, 100),  # by a blow it is planned
        ((60, 63), (63,), 5.0, 1, 100 * 78 / 81, 100 * 48 / 51),  # long after it is not
        ((60, 63), (63, 70), 6.0, 1, 100, 100),  # within a row: a bounce after the return
        ((60, 101), (), 6.0, 1, 50 - 100 / 162, 100 * 10 / 51),  # that never returns
        ((20, 21), (), None, 1, 100 * 80 / 81, 100),  # off again in the row of the first touch
    ],
)
def test_contact_is_kept_from_the_first_touch_on(
    off: tuple[int, ...],
    hits: tuple[int, ...],
    kick: float | None,
    losses: int,
    share: float,
    settled: float,
) -> None:
    table = contact()
    table["force"][slice(*off) if off else []] = 0.0
    table["impact_speed"][list(hits)] = 0.1
    values = measured(table, kick=kick)
    assert values["contact.losses"] == losses
    assert values["contact.share"] == pytest.approx(share)
    assert values["contact.settled_share"] == pytest.approx(settled)


def test_a_run_that_never_touches_is_undefined_but_for_what_is_zero() -> None:
    known = {name: value for name, value in measured(traces()).items() if value is not None}
    assert known == {"force.peak": 0.0, "contact.losses_seen": 0.0, "damage.scratch_time": 0.0}


TIME = np.arange(11.0)  # s


@pytest.mark.parametrize(
    ("values", "settled"),
    [
        (np.full(11, 5.0), 0.0),
        (np.full(11, 5.1), 0.0),  # the band's edge is in it
        (np.full(11, 5.2), None),
        (np.full(11, np.nan), None),
        # After the last sample outside, above or below.
        (np.where(np.isin(TIME, [0, 4]), 9.0, 5.0), 5.0),
        (np.where(np.isin(TIME, [0, 4]), 1.0, 5.0), 5.0),
        # In the last tenth it is not believed.
        (np.where(TIME < 9, 9.0, 5.0), 9.0),
        (np.where(TIME < 10, 9.0, 5.0), None),
    ],
)
def test_settling(values: Array, settled: float | None) -> None:
    assert settling_time(TIME, values, 5.0, 0.1) == settled


def test_settling_after_a_contact_and_for_as_long_as_asked_for() -> None:
    values = np.where(TIME < 9, 9.0, 5.0)
    assert settling_time(TIME - 4.0, values, 5.0, 0.1) == 5.0
    assert settling_time(TIME, values, 5.0, 0.1, lasting=1.0) == 9.0
    assert settling_time(TIME, values, 5.0, 0.1, lasting=1.0 + 1e-6) is None


def test_longest() -> None:
    time = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 9.0])
    never = np.zeros(6, dtype=bool)
    assert longest(time, never) == 0.0
    assert longest(time, ~never) == 9.0
    # From the first sample that holds to the first that does not.
    assert longest(time, np.array([False, True, True, False, True, False])) == 3.0
    assert longest(time, np.array([True, False, True, False, False, False])) == 2.0
    # To the end of the run, if it holds until then.
    assert longest(time, np.array([True, False, False, False, True, True])) == 1.0
    assert longest(time, np.array([False, False, False, True, False, False])) == 4.0
