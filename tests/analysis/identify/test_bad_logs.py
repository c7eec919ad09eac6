"""A bad log is told in one line through the command line, and nothing is written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.cli import main
from chamfer.models.recordings.recordings import slide_path

Columns = dict[str, NDArray[np.float64]]


@pytest.fixture(scope="module")
def slide() -> Columns:
    """A recording of a real slide: two seconds in the air, then on a table."""
    with np.load(slide_path("table_a")) as file:
        return {name: file[name].astype(np.float64) for name in file}


def _rows(kept: slice | NDArray[np.int64]) -> Callable[[Columns], Columns]:
    return lambda log: {name: values[kept] for name, values in log.items()}


def _without(name: str) -> Callable[[Columns], Columns]:
    return lambda log: {one: values for one, values in log.items() if one != name}


def _with(name: str, change: Callable[[NDArray[np.float64]], object]) -> Callable[..., Columns]:
    return lambda log: log | {name: np.asarray(change(log[name]))}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_without("force"), "has no force, but time, moment[0], moment[1]"),
        (_without("time"), "has no time, but force[0]"),
        (_with("force", lambda force: force[:-5]), "force has 8395 rows, time has 8400"),
        (_with("position", np.transpose), "has 8400 of position, from position[0] on, allowed: 3"),
        (_rows(slice(150)), "has 150 rows, allowed: 200 or more"),
        (
            _with("force", lambda f: np.where(f == f[41, 1], np.nan, f)),
            "force[1] is no finite number in row 42",
        ),
        (
            _with("time", lambda time: time - 0.2 * (time >= time[100])),
            "0.495 s after its start comes 0.3 s, in row 101",
        ),
        (_with("time", lambda time: 1e3 * time), "if its time is in ms"),
        (
            _rows(np.r_[:3000, 3100:8400]),
            "has a gap of 0.505 s, 14.995 s after its start, where rows are 0.005 s apart",
        ),
        (_with("rotation", np.rad2deg), "rotation is up to 194.3 rad"),
        (_with("position", lambda position: 1e3 * position), "position is up to 719.8 m"),
        (_with("virtual_position", lambda p: 1e3 * p), "reference_position is up to 72"),
        (
            _with("force", lambda force: np.clip(force, -40.0, 40.0)),
            "force along z is 40 N in 1313 rows and never more: the sensor is clipped",
        ),
        (_with("force", lambda force: 0 * force), "force never changes"),
        (_with("force", lambda force: force * [1, -1, 1]), "mirrored, no rotation corrects them"),
        (_with("force", lambda force: force.astype(str)), "force[0] is no column of numbers"),
        (_with("force", lambda force: force.astype(object)), "Object arrays cannot be loaded"),
    ],
)
def test_a_bad_log_is_told_in_one_line(
    slide: Columns,
    change: Callable[[Columns], Columns],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, **change(slide))  # type: ignore[arg-type]
    assert main(["identify", str(path), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"chamfer: {path}")
    assert said in line
    assert not (tmp_path / "out").exists()
