"""Contact detection: the chart on sequences of forces, and the block."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.contact_detection_law import (
    APPROACH,
    CONTACT,
    ContactDetectionParams,
    Inputs,
    make_contact_chart,
)
from chamfer.systems.force.projection import require_projection
from chamfer.systems.force.selection import Selection

# Binary fractions, so that the ticks' times are exact.
PERIOD = 0.25
WIDE = ContactDetectionParams(detect=2.0, release=0.5, samples=1)
DOWN = np.array([0.0, -1.0])
STATES = ("approach", "contact", "lost")


def run(
    params: ContactDetectionParams, pushes: Sequence[float]
) -> tuple[list[str], list[float], int]:
    """Run the chart on pushes along -y.

    Returns:
        The state and the contact time after each tick, and how many transitions were taken.
    """
    chart = make_contact_chart(params, DOWN)
    snapshot, states, times, taken = chart.start(), [], [], 0
    for i, push in enumerate(pushes):
        snapshot, record = chart.step(snapshot, Inputs((0.0, -push)), i * PERIOD)
        states.append(snapshot.state)
        times.append(snapshot.memory.contact_time)
        taken += record is not None
    return states, times, taken


def test_force_is_taken_along_an_oblique_direction() -> None:
    # (3, 4) / 5: a force (1, 1) pushes with 7 / 5 N.
    for detect, state in ((1.39, "contact"), (1.41, "approach")):
        oblique = np.array([30.0, 40.0])
        chart = make_contact_chart(replace(WIDE, detect=detect), oblique)
        assert chart.step(chart.start(), Inputs((1.0, 1.0)), 0.0)[0].state == state


@given(
    samples=st.integers(1, 4),
    pushes=st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0]), min_size=1, max_size=40),
)
def test_a_state_ends_with_so_many_readings_in_a_row(samples: int, pushes: list[float]) -> None:
    states, times, _ = run(replace(WIDE, samples=samples), pushes)
    state, row, first = "approach", 0, -1.0
    for i, push in enumerate(pushes):
        row = row + 1 if (push <= 0.5 if state == "contact" else push > 2.0) else 0
        if row == samples:
            state, row = ("lost" if state == "contact" else "contact"), 0
            first = i * PERIOD if first < 0 else first
        assert (states[i], times[i]) == (state, first)


def test_thresholds_follow_the_noise() -> None:
    assert ContactDetectionParams().resolved(0.0) == ContactDetectionParams(
        detect=0.1, release=0.0, samples=1
    )
    # Those of the Adept's figures, and with three times its noise.
    assert ContactDetectionParams().resolved(0.5) == ContactDetectionParams(
        detect=0.8, release=0.2, samples=1
    )
    assert ContactDetectionParams().resolved(1.5).detect == pytest.approx(2.4)


@pytest.mark.parametrize("detect", [0.4, 0.8, 1.2])
def test_a_threshold_in_the_noise_takes_several_readings(detect: float) -> None:
    found = ContactDetectionParams(detect=detect).resolved(1.5)
    assert found.detect == detect
    assert found.samples is not None
    assert found.samples > 1
    above = (1.5 - detect) / 3.0  # chance of a reading; 100 runs of 15 s are 3e5 ticks
    assert 3e5 * above**found.samples < 0.01
    assert above ** (found.samples - 1) > 1e-8


def test_a_bias_moves_the_thresholds() -> None:
    found = ContactDetectionParams().resolved(0.5, 1.0)
    assert (found.detect, found.release) == (pytest.approx(1.9), pytest.approx(1.3))
    assert found.samples == 1
    without = ContactDetectionParams().resolved(0.0, 1.0)
    assert without.release == pytest.approx(1.1)  # or the loss would never be seen
    with pytest.raises(ParameterError, match=r"^detect is 0.9, allowed: more than the sensor's"):
        ContactDetectionParams(detect=0.9).resolved(0.0, 1.0)


def test_block_runs_the_chart(driven: Any) -> None:
    block = driven(ContactDetection(WIDE, DOWN, period=PERIOD), PERIOD, "state")
    assert (block.read("state"), block.read("contact_time")) == (APPROACH, -1.0)
    pushes = [0.0, 1.0, 3.0, 1.0, 0.0, 1.0, 3.0]
    found = [
        (block.tick(measured_force=[7.0, -push])[0], block.read("contact_time")[0])
        for push in pushes
    ]
    states, times, _ = run(WIDE, pushes)
    assert found == [(STATES.index(s), t) for s, t in zip(states, times, strict=True)]
    assert found[-1] == (CONTACT, 0.5)
    labels = [record.label for record in block.block.transitions(block.context)]
    assert labels == ["force > 2 N", "force <= 0.5 N", "force > 2 N"]


EXACT = 1e-14


@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 1.0], [0.0, 0.0]],  # a projection, but an oblique one
        [[0.5, 0.0], [0.0, 1.0]],  # a scaling, a reflection, a permutation
        [[-1.0, 0.0], [0.0, 1.0]],
        [[0.0, 1.0], [1.0, 0.0]],
        [[1.0, 0.0], [0.0, 1e-6]],
        [[math.nan, 0.0], [0.0, 1.0]],
        [[1.0, 0.0], [0.0, math.inf]],
    ],
)
def test_what_is_no_projection_is_refused(matrix: list[list[float]]) -> None:
    finite = np.isfinite(matrix).all()
    allowed = "a symmetric projection, P P = P = P^T" if finite else "finite numbers"
    with pytest.raises(ParameterError) as caught:
        require_projection(np.array(matrix))
    assert str(caught.value) == f"selection is {matrix}, allowed: {allowed}"


@pytest.mark.parametrize("normal", [(0.0, -2.0), (1.0, 2.0, -2.0), (0.0, 0.0, 1.0, 0.0)])
def test_block_gives_the_normal_away_at_contact(normal: tuple[float, ...]) -> None:
    block = Selection(np.array(normal))
    context = block.CreateDefaultContext()
    size = len(normal)

    def selection(mode: float) -> np.ndarray:
        block.GetInputPort("mode").FixValue(context, [mode])
        found: np.ndarray = block.GetOutputPort("selection").Eval(context).reshape(size, size)
        return found

    n = np.array(normal) / np.linalg.norm(normal)
    np.testing.assert_array_equal(selection(0), np.eye(size))
    for mode in (1, 2):  # in contact, and while it is lost
        np.testing.assert_allclose(
            selection(mode), np.eye(size) - np.outer(n, n), rtol=0, atol=EXACT
        )
    np.testing.assert_array_equal(selection(0), np.eye(size))
