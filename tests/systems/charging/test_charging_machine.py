"""The block: the chart's ports, with a path follower in a diagram, and what it may be told."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from chamfer.models.charging.packing import PlanItem, places
from chamfer.models.charging.station import Station
from chamfer.models.validation import ParameterError
from chamfer.systems.charging.charging_machine import ChargingMachine
from chamfer.systems.charging.charging_params import (
    ON_BOTH,
    ON_LAYER,
    ChargingBeliefs,
    ChargingParams,
    ChargingTrouble,
    ResolvedChargingParams,
    ResolvedTouchDetectionParams,
    TouchDetectionParams,
)
from chamfer.systems.force.contact_detection_law import CONTACT, LOST
from chamfer.systems.statechart.chart_law import ChartState

START = (0.40, -0.20, 0.55, 0.0, 0.0, 0.0, 0.2)
DETECTION = ResolvedTouchDetectionParams(detect=0.3, readings=2)


def beliefs() -> ChargingBeliefs:
    plan = (PlanItem(azimuth=0.5), PlanItem(kind="crown"))
    nuggets = tuple(item.believed_nugget for item in plan)
    where = places(plan, Station(), believed=True)
    return ChargingBeliefs(Station(), plan, nuggets, where, START, START)


def machine() -> ChargingMachine:
    return ChargingMachine(ResolvedChargingParams(detection=DETECTION), beliefs())


def test_before_it_runs_it_stays_and_pushes_nothing() -> None:
    block = machine()
    context = block.CreateDefaultContext()

    def shown(name: str) -> np.ndarray:
        value: np.ndarray = block.GetOutputPort(name).Eval(context)
        return value

    assert shown("segment")[9:16] == pytest.approx(START)
    assert shown("selection") == pytest.approx(np.eye(7).ravel())
    for name in ("hold", "mode", "grip", "tare", "item", "finished", "trouble", "state"):
        assert shown(name).tolist() == [0.0], name
    assert not shown("desired_force").any()
    assert block.reason(context) == ""


INTO = np.array([np.cos(0.5), np.sin(0.5), 0.0])
DOWN = np.array([0.0, 0.0, -1.0])


def commanded(**memory: Any) -> Any:
    """Return the outputs with that in the memory."""
    law = machine().law
    snapshot = law.chart.start()
    changed = snapshot.memory._replace(**memory)
    return law.command(ChartState(snapshot._replace(memory=changed)))


@pytest.mark.parametrize(
    ("mode", "pressed", "force"),
    [
        (CONTACT, [INTO], 1.2 * INTO),
        (LOST, [INTO], 1.2 * INTO),
        (ON_LAYER, [DOWN], 0.8 * DOWN),
        # The wall's friction, 0.21 N, holds it up.
        (ON_BOTH, [INTO, DOWN], 0.7 * INTO + 1.01 * DOWN),
    ],
)
def test_what_is_pressed_on_is_under_force_control(
    mode: int, pressed: list[np.ndarray], force: np.ndarray
) -> None:
    command = commanded(mode=mode)
    P = np.eye(7)
    for normal in pressed:
        P[:3, :3] -= np.outer(normal, normal)
    assert np.reshape(command.selection, (7, 7)) == pytest.approx(P, abs=1e-12)
    assert command.desired_force == pytest.approx([*force, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(("at", "finished"), [("done", 1.0), ("stopped", 2.0)])
def test_it_says_how_it_ended_and_why(at: str, finished: float) -> None:
    where = {"trouble": ChargingTrouble.NO_PART, "trouble_at": "acquire.descend"}
    command = commanded(at=at, item=1, **where)
    assert (command.finished, command.trouble, command.item) == ((finished,), (2.0,), (1.0,))
    memory = machine().chart.memory._replace(at=at, item=1, **where)
    assert memory.said() == "no part in the gripper, in acquire.descend, item 1"


SLIDE, PERIOD = 1.2, 0.005  # N, s
RUNS = 400


def means(force: np.ndarray, noise: float, readings: int) -> np.ndarray:
    """Return the means of noisy readings of a force, N, shape (RUNS, k)."""
    rng = np.random.default_rng(0)
    sums = np.cumsum(force + rng.uniform(-noise, noise, (RUNS, len(force))), axis=1)
    result: np.ndarray = (sums[:, readings:] - sums[:, :-readings]) / readings
    return result


@pytest.mark.parametrize("noise", [0.5, 1.5])
def test_false_losses_and_false_contacts_are_rare(noise: float) -> None:
    # Of the wrist's sensor, and three times that; a slide and a search of 2 s each.
    params = TouchDetectionParams().resolved(noise)
    slide = means(np.full(400, SLIDE), noise, params.readings)
    assert np.mean(np.any(slide <= params.release, axis=1)) <= 0.01
    free = means(np.zeros(400), noise, params.readings)
    assert np.mean(np.any(free > params.detect, axis=1)) <= 0.01


@pytest.mark.parametrize(("noise", "usual", "late"), [(0.5, 0.08, 0.09), (1.5, 0.08, 0.15)])
def test_a_loss_is_soon_seen(noise: float, usual: float, late: float) -> None:
    params = TouchDetectionParams().resolved(noise)
    n = params.readings
    seen = means(np.r_[np.full(n, SLIDE), np.zeros(200)], noise, n) <= params.release
    delay = PERIOD * (1 + np.argmax(seen, axis=1))
    assert np.median(delay) <= usual
    assert np.quantile(delay, 0.95) <= late


def test_thresholds_follow_from_noise_and_bias() -> None:
    assert TouchDetectionParams().resolved(0.0).detect == pytest.approx(0.3)
    assert TouchDetectionParams(readings=12).resolved(0.6).detect == pytest.approx(0.5)
    assert TouchDetectionParams(readings=12).resolved(0.6, 0.2).detect == pytest.approx(0.7)
    given = TouchDetectionParams(detect=0.4)
    assert vars(given.resolved(0.6)) == vars(given)


@pytest.mark.parametrize(
    ("make", "given", "message"),
    [
        (ChargingParams, {"near": 0.02, "drop": 0.02}, "near is 0.02, allowed: less than drop, 0"),
        (TouchDetectionParams, {"detect": 0.15}, "release is 0.15, allowed: less than detect, 0"),
        (
            TouchDetectionParams(detect=0.4).resolved,
            {"noise": 0.1, "bias": 0.5},
            "detect is 0.4, allowed: more than the sensor's bias, 0.5",
        ),
    ],
)
def test_refusals(make: Callable[..., object], given: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        make(**given)
    assert str(caught.value).startswith(message)
