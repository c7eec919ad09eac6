"""What is told stands in the terminal, in the result and in a scenario; what is not, says why."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cli import main
from chamfer.analysis.identify.log import Log
from chamfer.analysis.report.report import report_text
from chamfer.analysis.scenario.scenario_yaml import read_mapping
from chamfer.models.recordings.recordings import slide_path


def identified(log: Path, out: Path) -> dict[str, Any]:
    assert main(["identify", str(log), "--out", str(out)]) == 0
    text = (out / "identify" / "result.json").read_text(encoding="utf-8")
    document: dict[str, Any] = json.loads(text)
    return document


def test_a_slide_is_told_with_intervals_and_as_a_scenario(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(slide_path("table_a"), tmp_path)
    friction = found["identify"]["friction"]
    assert 0.2 < friction["low"] < friction["value"] < friction["high"] < 0.26
    folder = tmp_path / "identify"
    assert {"residuals.png", "residuals.svg"} == set(found["figures"])
    assert all((folder / name).stat().st_size > 10_000 for name in found["figures"])
    given = read_mapping(folder / found["scenario"])
    assert given["parts"]["friction"] == pytest.approx(friction["value"], abs=1e-6)
    stiffness = [found["identify"][f"stiffness.{axis}"]["value"] for axis in "xyz"]
    assert given["impedance"]["stiffness"] == pytest.approx(stiffness, abs=1e-6)
    said = capsys.readouterr().out
    assert said.startswith("8400 rows, 41.99 s: time, force, moment, position, rotation, ref")
    assert "\nfriction " in said
    assert "\nsensor.unit: the log does not determine it" in said
    assert "identify" not in report_text(tmp_path, CATALOGUE)  # it is no experiment's result


@pytest.mark.parametrize(
    ("name", "quantity", "note"),
    [
        ("free", "friction", "no contact in the log"),
        ("table_press", "contact.stiffness", "path too straight for a plane"),
        ("wall", "friction", "more than one contact in the log"),
    ],
)
def test_what_a_log_cannot_tell_has_its_reason(
    name: str,
    quantity: str,
    note: str,
    simulated: Callable[..., list[Log]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "wall.npz"
    if name == "wall":
        np.savez(path, **simulated(wall=True)[0].quantities())  # type: ignore[arg-type]
    else:
        path = slide_path(name)
    found = identified(path, tmp_path)["identify"]
    assert found[quantity]["value"] is None
    assert note in found[quantity]["note"]
    assert found["sensor.noise"]["value"] > 0
    assert note in capsys.readouterr().out


def test_pounds_nothing_to_tell_and_nowhere_to_write_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(slide_path("table_b")) as file:
        np.savez(tmp_path / "log.npz", **dict(file) | {"force": file["force"] / 4.448})
    arguments = ["identify", str(tmp_path / "log.npz"), "--out", str(tmp_path)]
    assert main([*arguments, "--stiffness", "800"]) == 0
    assert "forces look as if they were in lbf: --columns force=" in capsys.readouterr().err
    path, still = tmp_path / "still.npz", np.zeros((300, 2))
    np.savez(path, time=np.arange(300) / 100, joint_position=still, joint_torque=still)
    assert main(["identify", str(path), "--out", str(tmp_path / "out")]) == 2
    assert f"{path}: it determines nothing: the joint doesn't turn" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main(["identify", str(slide_path("free")), "--out", str(path)]) == 2
    assert "can't be written" in capsys.readouterr().err
