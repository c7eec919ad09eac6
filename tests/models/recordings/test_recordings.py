"""The recordings are whole, in SI units, and their frames are what is said."""

from pathlib import Path

import numpy as np
import pytest

from chamfer.models.recordings.recordings import (
    CUBE_GROUND,
    CUBE_RATE,
    CUBE_WIDTH,
    PANDA,
    SLIDES,
    TOSSES,
    panda_friction,
    slide_path,
    tosses,
)
from chamfer.models.validation import ParameterError


@pytest.mark.parametrize("name", SLIDES)
def test_a_slide_ascends_in_time_at_200_hz(name: str) -> None:
    with np.load(slide_path(name), allow_pickle=False) as file:
        np.testing.assert_allclose(np.diff(file["time"]), 0.005, atol=1e-6)
        assert {len(file[column]) for column in file} == {len(file["time"])}


def test_a_toss_falls_turns_and_rests_as_a_cube_of_its_width_does() -> None:
    found = tosses()
    assert len(found) == 200
    rest = np.median([one.position[-1, 2] for one in found])
    assert rest - CUBE_GROUND == pytest.approx(CUBE_WIDTH / 2, abs=1e-3)
    for one in found[:20]:
        w, x, y, z = one.orientation.T
        step = np.diff(one.position, axis=0) * CUBE_RATE
        np.testing.assert_allclose(step, one.velocity[1:], atol=0.35)
        np.testing.assert_allclose(w * w + x * x + y * y + z * z, 1.0, atol=1e-5)


def test_the_pandas_friction_is_that_of_its_table() -> None:
    found = panda_friction()
    assert found.coulomb.shape == (7,)
    assert (found.coulomb_plus[3], found.coulomb_minus[3]) == (0.5107, 0.1009)


def test_each_licence_lies_beside_its_recording() -> None:
    beside = {path.name for path in slide_path("free").parent.glob("LICENSE-*")}
    assert beside == {
        "LICENSE-StrokeAIRobotics-MIT", "LICENSE-dair_pll-BSD3", "LICENSE-franka-CC-BY-4.0",
    }  # fmt: skip
    assert {one.licence for one in (*SLIDES.values(), TOSSES, PANDA)} == {
        "MIT", "BSD-3-Clause", "CC-BY-4.0",
    }  # fmt: skip
    assert sum(path.stat().st_size for path in Path(slide_path("free")).parent.iterdir()) < 6e6


def test_an_unknown_recording_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"recording is 'table_c', allowed: table_a, "):
        slide_path("table_c")
