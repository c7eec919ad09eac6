"""Primitives that go to a place, keep a dither there, and look how far something went."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.arms.wrist import tip_displacement, tip_pose
from chamfer.systems.primitives.force_primitives import AXIS_NAMES
from chamfer.systems.primitives.position_primitives import Centre, Held, Place, Way
from chamfer.systems.primitives.primitive import (
    STILL,
    Event,
    Observation,
    Primitive,
    Stepped,
    Vector,
)
from chamfer.systems.primitives.trajectory_primitives import Dither

PERIOD = 0.01  # s


def six(**values: float) -> Vector:
    return tuple(values.get(name, 0.0) for name in AXIS_NAMES)


def at(carriage: Vector = STILL, **fields: Any) -> Observation:
    return Observation(carriage=carriage, motion=STILL, wrench=STILL, **fields)


def followed(
    *primitives: Primitive, ticks: int, start: Vector = STILL, drift: Vector = STILL
) -> tuple[list[Vector], list[Stepped]]:
    """Places of what follows the primitives' velocities and drifts, and their last steps."""
    places, memories = [start], [one.begin(at(start)) for one in primitives]
    steps: list[Stepped] = []
    for i in range(ticks):
        steps = [
            one.step(at(places[-1]), memory, i * PERIOD)
            for one, memory in zip(primitives, memories, strict=True)
        ]
        memories = [one.memory for one in steps]
        total = np.sum([one.velocity for one in steps], axis=0) + drift
        places.append(tuple((np.array(places[-1]) + PERIOD * total).tolist()))
    return places, steps


def test_a_pull_to_a_place_grows_and_ends_where_the_tool_is_held() -> None:
    place = Place(offset=(0.003, 0.0, 0.004), speed=0.02, acceleration=0.05, threshold=5.0)
    memory = place.begin(at())
    speeds = [np.linalg.norm(place.step(at(), memory, t).velocity) for t in (0.1, 0.3, 0.4, 1.0)]
    np.testing.assert_allclose(speeds, [0.005, 0.015, 0.02, 0.02])
    # By what opposes the way, not by what is across or along it.
    for against, event in ((4.9, None), (5.1, "contact"), (-9.0, None)):
        held = at()._replace(wrench=six(x=-0.6 * against - 8.0, z=-0.8 * against + 6.0))
        assert place.step(held, memory, 1.0).event == event


def test_a_place_is_reached_straight_and_no_faster_than_allowed() -> None:
    place = Place(offset=(0.006, 0.0, 0.008), speed=0.02, tolerance=1e-4)
    start = six(rx=0.1, x=0.5, y=-0.2, z=0.3)
    places, (last,) = followed(place, ticks=150, start=start)
    way = np.array(places) - start
    assert last.event == "done"
    np.testing.assert_allclose(way[-1], six(x=0.006, z=0.008), atol=1e-4)
    np.testing.assert_allclose(way[:, 3] * 8, way[:, 5] * 6, atol=1e-12)
    speeds = np.linalg.norm(np.diff(way, axis=0), axis=1) / PERIOD
    assert speeds[0] == pytest.approx(0.02)
    assert speeds.max() < 0.02 + 1e-9


@settings(deadline=None, max_examples=25)
@given(gain=st.floats(0.1, 50), drift=st.floats(-0.01, 0.01))
def test_centring_takes_back_what_is_added_as_a_first_order_lag(gain: float, drift: float) -> None:
    centre = Centre(dither=Dither(amplitude=0.0, cycles=100.0), gain=gain)
    places, _ = followed(centre, ticks=200, drift=six(x=drift))
    expected = drift / gain * (1 - (1 - PERIOD * gain) ** np.arange(201))
    np.testing.assert_allclose([place[3] for place in places], expected, atol=1e-12)


@pytest.mark.parametrize(("offset", "middle"), [(0.0, 0.0), (-0.003, -0.003)])
def test_a_centred_dither_keeps_its_amplitude_about_its_middle(
    offset: float, middle: float
) -> None:
    dither = Dither(axis="y", amplitude=0.001, frequency=1.0, cycles=10.0)
    places, _ = followed(dither, Centre(dither=dither, gain=5.0, offset=offset), ticks=900)
    cycle = np.array(places)[800:900, 4]
    assert cycle.mean() == pytest.approx(middle, abs=1e-5)
    assert np.ptp(cycle) == pytest.approx(0.002, rel=0.04)


def test_centring_ends_with_its_dither() -> None:
    centre = Centre(dither=Dither(cycles=1.0, frequency=1.0), offset=0.5)
    assert any(centre.step(at(), centre.begin(at()), 0.99).velocity)
    assert centre.step(at(), centre.begin(at()), 1.0).velocity == STILL


def event_of(way: Way, start: Vector, places: list[Vector]) -> str | None:
    memory: object = way.begin(at(start))
    events = []
    for i, place in enumerate(places):
        stepped = way.step(at(place), memory, i * PERIOD)
        memory = stepped.memory
        events.append(stepped.event)
        assert stepped.velocity == STILL
    assert events[:-1] == [None] * (len(events) - 1)
    return events[-1]


def test_a_way_is_the_mean_after_the_wait() -> None:
    way = Way(direction="-z", least=0.002, most=0.004, wait=0.05, time=0.04)
    before = [six(z=9.0)] * 5

    def event(*depths: float) -> str | None:
        return event_of(way, six(z=1.0), before + [six(z=1.0 - depth) for depth in depths])

    assert event(0.0, 0.0041, 0.0021, 0.0021, 0.0021) == "done"
    assert event(0.0, 0.0019, 0.0019, 0.0019, 0.0041) == "jammed"
    assert event(0.005, 0.003, 0.004, 0.005, 0.004) == "jammed"


def test_a_plug_that_is_out_of_line_is_neither_deep_enough_nor_not() -> None:
    way = Way(least=0.002, tilt=(0.09, 0.03), wait=0.05, time=0.04)
    for turn, event in (((0.089, 0.0), "done"), ((0.0, -0.031), "tilted"), ((0.091, 0), "tilted")):
        there = (*turn, 0.0, 0.0, 0.0, -0.003)
        assert event_of(way, six(), [there] * 10) == event


@given(
    grasp=st.tuples(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08), st.floats(-3.0, 3.0)),
    turned=st.floats(-3.0, 3.0),
    beside=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)),
)
def test_a_depth_counts_from_the_face_that_a_tilted_plug_touched_beside_its_tip(
    grasp: tuple[float, float, float], turned: float, beside: tuple[float, float]
) -> None:
    # The plug's leading plane touches the face, z = 0, at (x, y) of its tip.
    R_TP = tip_pose(np.array([*grasp, 0.0, 0.0, 0.0])).rotation()
    n, (x, y) = R_TP.matrix()[:, 2], beside
    touched = six(z=(n[0] * x + n[1] * y) / n[2])
    depth = 0.005
    R_WT = RotationMatrix.MakeZRotation(turned) @ R_TP.inverse()  # in line
    tool = tip_displacement(RigidTransform(R_WT, [0.0, 0.0, -depth]))
    for least, expected in ((depth - 1e-6, "done"), (depth + 1e-6, "jammed")):
        way = Way(least=least, beside=beside, wait=0.01, time=0.01)
        assert event_of(way, touched, [tuple(tool.tolist())] * 3) == expected


def test_a_grip_is_checked_by_the_grippers_own_sensor() -> None:
    held, watched = Held(time=0.02), Held(time=math.inf)
    felt, not_felt = at(holding=(1.0,)), at(holding=(0.0,))
    begun = held.begin(felt)
    assert [held.step(felt, begun, i * PERIOD).event for i in range(3)] == [None, None, "done"]
    assert watched.step(felt, begun, 1e6).event is None
    assert {one.step(not_felt, begun, 0.0).event for one in (held, watched)} == {"lost"}
    assert held.step(at(), begun, 0.02).event == "done"  # it has no sensor
    closing = Held(wait=0.02, time=0.02)
    assert [closing.step(not_felt, begun, i * PERIOD).event for i in range(3)] == [
        None,
        None,
        "lost",
    ]
    assert [closing.step(felt, begun, i * PERIOD).event for i in (2, 3, 4)] == [None, None, "done"]


@pytest.mark.parametrize(
    ("load", "spread", "event"),
    [
        ((-0.4,), 0.0, "done"),
        ((-0.21,), 0.0, "done"),
        ((-0.19,), 0.0, "lost"),
        ((0.3,), 0.0, "lost"),  # what pushes up is no weight
        ((-0.6, 0.1, -0.2, 0.1, -0.6), 0.0, "done"),  # the mean counts
        # Half of the weight, and three standard deviations of a mean of five, less another's.
        ((0.0,), 0.2 / 3 / math.sqrt(2 / 5) * 0.99, "lost"),
        ((0.0,), 0.2 / 3 / math.sqrt(2 / 5) * 1.01, "done"),
        ((0.0,), None, "done"),  # no zero was taken
    ],
)
def test_a_grip_is_checked_by_the_weight(
    load: tuple[float, ...], spread: float | None, event: Event
) -> None:
    weighed = Held(wait=0.02, time=0.04, weight=0.4)
    of_zero = None if spread is None else (9.0, 9.0, 9.0, 9.0, 9.0, spread)
    memory: object = weighed.begin(at())
    events = []
    for i in range(7):
        # What is read while the wrist comes to rest doesn't count.
        force = 7.0 if i < 2 else load[(i - 2) % len(load)]
        sensed = at(spread=of_zero)._replace(wrench=(9.0, 9.0, 9.0, 9.0, 9.0, force))
        stepped = weighed.step(sensed, memory, i * PERIOD)
        memory = stepped.memory
        events.append(stepped.event)
    assert events == [None] * 6 + [event]
