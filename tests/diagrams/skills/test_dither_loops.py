"""Dithers of a carriage: what they cover, and what the correlator says of them."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.linear.simulate import Run, simulate
from chamfer.diagrams.skills.dither_loops import (
    AxisSensorParams,
    CorrelationScenario,
    make_correlation_diagram,
    resolve,
)
from chamfer.systems.contact.spring_constraint import SpringConstraintParams
from chamfer.systems.force.accommodation_law import AccommodationParams
from chamfer.systems.primitives.dither_blocks import CorrelatorParams
from chamfer.systems.primitives.trajectory_primitives import Dither

PERIOD = 1 / 128  # s, binary, so that the ticks' times are exact
N = 64  # samples of a cycle
DITHER = Dither(frequency=128 / N, cycles=20.0)
ACCOMMODATION = AccommodationParams(period=PERIOD)
FREE: dict[str, Any] = {"sides": "none"}


def scenario(
    *,
    constraint: dict[str, Any] = FREE,
    sensor: dict[str, float] | None = None,
    windows: int = 2,
    **changes: Any,
) -> CorrelationScenario:
    fields: dict[str, Any] = {"dither": DITHER, "accommodation": ACCOMMODATION}
    return CorrelationScenario(
        constraint=SpringConstraintParams(**constraint),
        sensor=AxisSensorParams(**(sensor or {})),
        correlator=CorrelatorParams(windows=windows),
        **{**fields, **changes},
    )


def run(made: CorrelationScenario, cycles: int, seed: int = 0) -> Run:
    """Rows are at the ticks; a row of the motion is what was computed at the one before."""
    count = cycles * made.samples
    return simulate(
        make_correlation_diagram(resolve(made)),
        duration=(count + 0.5) * made.accommodation.period,
        step=made.accommodation.period,
        seed=seed,
    )


def test_a_free_tool_follows_the_command() -> None:
    found = run(scenario(), 2)
    command, motion = found.outputs["command"], found.outputs["motion"]
    k = np.arange(2 * N + 1)
    expected = 0.001 * 2 * np.pi * DITHER.frequency * np.cos(2 * np.pi * k / N)
    np.testing.assert_allclose(command, expected, atol=1e-12)
    np.testing.assert_allclose(motion[1:], command[:-1], atol=1e-15)
    assert np.ptp(found.outputs["displacement"][:, 3]) == pytest.approx(0.002, rel=0.01)
    closed = N**2 / 8 * math.tan(math.pi / N) ** 2
    np.testing.assert_allclose(found.outputs["correlation"][-1], [closed, 1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "hindered"),
    [
        ({}, False),
        ({"constraint": {}}, True),
        ({"constraint": {"stiffness": 100.0}}, False),
        ({"constraint": {"sides": "none", "stiffness": 1e9}}, False),
        ({"constraint": {"index": 4}}, False),  # across the dither
        ({"sensor": {"bias": 2.0}}, False),
        ({"sensor": {"noise": 2.0}}, False),
    ],
)
def test_hindered_says_whether_it_is(changes: dict[str, Any], *, hindered: bool) -> None:
    found = run(scenario(**changes), 4).outputs["hindered"]
    assert bool(found[-1]) is hindered
    assert not found[: 2 * N].any()


@pytest.mark.parametrize(("kind", "axis", "index"), [("rotary", "y", 1), ("linear", "z", 5)])
def test_everything_is_along_the_axis_of_the_dither(kind: Any, axis: Any, index: int) -> None:
    dither = replace(DITHER, kind=kind, axis=axis)
    found = run(scenario(dither=dither, constraint={"stiffness": 20.0}, sensor={"noise": 0.1}), 2)
    assert np.flatnonzero(np.abs(found.outputs["displacement"]).max(axis=0)).tolist() == [index]


def test_what_is_open_follows_from_the_dither() -> None:
    found = resolve(scenario(dither=replace(DITHER, axis="z"), constraint={}))
    assert (found.constraint.index, found.correlator.samples) == (5, N)
    assert found.correlator.period == PERIOD
    given = replace(found, dither=replace(DITHER, frequency=1.0))
    assert resolve(given) == given
    assert CorrelationScenario().samples == 100
