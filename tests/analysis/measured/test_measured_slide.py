"""Observers on recordings, and on a log of a slide of which everything is known."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.measured.measured_slide import (
    MEASURED_SLIDE,
    MeasuredSlideScenario,
    figures,
    resolve_measured,
    run_measured,
)
from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.models.recordings.recordings import slide_path
from chamfer.models.validation import ParameterError

STIFFNESS, FRICTION, SINKS = 600.0, 0.3, 1e5
NORMAL = np.array([0.04, -0.03, 1.0]) / np.linalg.norm([0.04, -0.03, 1.0])


def slide_log(path: Path, *, width: float = 0.1, **changes: Any) -> str:
    """Write a log of a tool that touches at 2 s and slides along an ellipse on a tilted table."""
    random, period = np.random.default_rng(7), 0.005
    time = np.arange(0.0, 18.0, period)
    way = np.maximum(time - 2.0, 0.0)
    along = np.column_stack([0.1 * np.sin(0.9 * way), width * (1 - np.cos(0.9 * way)), 0 * way])
    point = along - np.outer(along @ NORMAL, NORMAL)
    velocity = np.gradient(point, period, axis=0)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    push = np.where(time >= 2.0, 30.0 + 5.0 * np.sin(way), 0.0)[:, np.newaxis]
    ahead = np.divide(velocity, speed, out=np.zeros_like(velocity), where=speed > 0)
    force = push * (NORMAL - FRICTION * ahead)
    position = point - push / SINKS * NORMAL
    reference = position - force / STIFFNESS
    offset = np.array([0.5, -0.8, 1.0])
    columns = {
        "time": 100.0 + time,
        "force": force + offset + 0.06 * random.standard_normal(force.shape),
        "position": position + 2e-5 * random.standard_normal(position.shape),
        "virtual_position": reference,
    }
    np.savez(path, **{k: v for k, v in (columns | changes).items() if v is not None})
    return str(path)


def run(recording: str, **changes: Any) -> Outcome:
    scenario = replace(MEASURED_SLIDE, recording=recording, **changes)
    return run_measured(resolve_measured(scenario), 0, quiet)


def values(outcome: Outcome, name: str) -> dict[str, Any]:
    return {
        key.removeprefix(f"{name}."): one.value
        for key, one in outcome.metrics.items()
        if key.startswith(f"{name}.")
    }


def test_a_known_slide_is_told(tmp_path: Path) -> None:
    """The truth, friction, touch and impedance of a log that was made of them."""
    outcome = run(slide_log(tmp_path / "known.npz"), settle=3.0)
    found = values(outcome, "known")
    assert found["friction"] == pytest.approx(FRICTION, rel=0.02)
    assert found["touch"] == pytest.approx(2.0, abs=0.02)
    assert found["bounces"] == found["losses"] == 0
    assert found["contact.stiffness"] == pytest.approx(SINKS, rel=0.2)
    for axis in "xy":
        assert found[f"stiffness.{axis}"] == pytest.approx(STIFFNESS, rel=0.05)
    assert found["residual"] < 1e-3
    for kind in ("adaptive", "thesis", "gated"):
        assert found[f"{kind}.rms"] < 0.8
        assert found[f"{kind}.coverage"] >= 99.0
        assert found[f"{kind}.pulls"] == found[f"{kind}.unfit"] == 0
    assert found["rms_ratio"] == found["adaptive.rms"] / found["thesis.rms"]
    assert outcome.metrics["adaptive.coverage"].trials == (found["adaptive.coverage"],)
    assert list(figures(replace(MEASURED_SLIDE, recording="table_press"), outcome)) == [
        "measured-slide"
    ]


def test_a_straight_path_takes_the_normal_as_believed(tmp_path: Path) -> None:
    path = slide_log(tmp_path / "straight.npz", width=0.0, virtual_position=None)
    believed = (0.04, -0.03, 1.0)
    outcome = run(path, normal=believed)
    found = values(outcome, "straight")
    assert "too straight" in outcome.metrics["straight.adaptive.rms"].note
    assert found["residual"] is None
    assert found["adaptive.rms"] < 1.0  # of a normal that is right
    wrong = values(run(path), "straight")
    assert wrong["thesis.rms"] == pytest.approx(math.degrees(0.05), abs=0.5)


def test_the_arm_in_the_air_has_no_errors_and_no_alarms() -> None:
    outcome = run("free")
    found = values(outcome, "free")
    assert found["false_alarms"] == 0
    assert found["adaptive.rms"] is found["friction"] is None
    assert "touch" not in found
    shown = figures(replace(MEASURED_SLIDE, recording="free"), outcome)["measured-slide"]
    assert [text.get_text() for text in shown.axes[0].texts] == ["no contact: no normal"]


def test_what_half_of_a_slide_told_holds_on_the_other_half(tmp_path: Path) -> None:
    """The observer's numbers are of the first half of table_a."""
    with np.load(slide_path("table_a")) as file:
        whole = {name: file[name] for name in file}
    free = whole["time"] < 2.0
    later = free | (whole["time"] > 21.0)
    halved = {name: column[later] for name, column in whole.items()}
    halved["time"] = 0.005 * np.arange(np.count_nonzero(later))
    np.savez(tmp_path / "half.npz", **halved)
    found = values(run(str(tmp_path / "half.npz")), "half")
    assert found["adaptive.coverage"] >= 95.0
    assert found["rms_ratio"] <= 1.5
    assert found["adaptive.pulls"] == found["adaptive.unfit"] == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"recording": "table_c"}, "recording.*table_c.*table_a"),
        ({"normal": (0.0, 0.0, 0.0)}, "normal"),
        ({"free": 3.0, "recording": "table_a"}, "free.*more than 3 N"),
        ({"observer": replace(MEASURED_SLIDE.observer, stiffness=None)}, "observer.stiffness"),
        ({"observer": replace(MEASURED_SLIDE.observer, period=1e-3)}, "observer.period"),
    ],
)
def test_what_is_no_slide_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        resolve_measured(MeasuredSlideScenario(**changes))


def test_a_log_without_force_is_refused(tmp_path: Path) -> None:
    path = slide_log(tmp_path / "blind.npz", position=None)
    with pytest.raises(ParameterError, match="a log with force and position"):
        resolve_measured(MeasuredSlideScenario(recording=path))


def test_a_sensor_that_is_turned_is_refused(tmp_path: Path) -> None:
    with np.load(slide_path("table_b")) as file:
        columns = {name: file[name] for name in file}
    for name in ("force", "moment"):
        columns[name] = columns[name][:, [1, 0, 2]] * [1.0, -1.0, 1.0]  # by 90 degrees about z
    np.savez(tmp_path / "turned.npz", **columns)
    with pytest.raises(ParameterError, match=r"not turned by 1.5\d rad"):
        resolve_measured(MeasuredSlideScenario(recording=str(tmp_path / "turned.npz")))
