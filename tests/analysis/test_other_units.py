"""What was meant in another unit, or left out, is named in a line: no answer is made of it."""

import re
from pathlib import Path

import numpy as np
import pytest

from chamfer.analysis.cli import main

SIX_JOINTS = Path(__file__).parents[1] / "models/arms/six_joints.urdf"
SKILL = """
name: jump
states:
- name: up
  run: [{MoveDx: {displacement: [0, 0, 0, 0, 0, 10], duration: 0.5}}]
  on: {done: done}
  timeout: 1.0
retract: [{MoveDx: {displacement: [0, 0, 0, 0, 0, 0.02]}}]
"""
INSERTION = (
    ("cameras.frames.period=50", "is 50.0, allowed: a number from 0.0001 to 1 s, not Hz"),
    ("cameras.xy.frames.period=50", "is 50.0, allowed: a number from 0.0001 to 1 s, not Hz"),
    ("parts.friction=25", "is 25.0, allowed: a finite number > 0 and <= 2"),
    ("cameras.pixel_size=0.5", "is 0.5, allowed: a finite number > 0 and <= 0.01 m"),
    ("gap=-0.05", "is -0.05, allowed: a finite number >= 0"),
    (
        "peg.model=arm.urdf",
        "in which every joint moves a link with mass and inertia, unlike turn,",
    ),
)


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write an arm without inertias, a skill, and a step in ms whose position is in mm."""
    text = re.sub(r"<inertial>.*?</inertial>", "", SIX_JOINTS.read_text(), flags=re.DOTALL)
    (tmp_path / "arm.urdf").write_text(text)
    (tmp_path / "jump.yaml").write_text(SKILL)
    ms = np.arange(-500, 3000, 10)
    mm = 20 * (1 - np.exp(-np.maximum(ms, 0) / 150))
    rows = [f"{t},{0.02 * (t >= 0)},{y}" for t, y in zip(ms, mm, strict=True)]
    (tmp_path / "step.csv").write_text("\n".join(["time,command,position", *rows]))
    monkeypatch.chdir(tmp_path)


@pytest.mark.filterwarnings("default:plant.measured")
@pytest.mark.parametrize(
    ("command", "setting", "told"),
    [
        *(("run insertion", *one) for one in INSERTION),
        *(("design insertion", *one) for one in INSERTION),
        ("run vertical-tracking", "gap=-0.1", "is -0.1, allowed: a finite number >= 0"),
        ("run d-connector", "sight.pixel_size=0.5", "is 0.5, allowed: a finite number > 0 and <="),
        ("run servo-comparison", "plant.measured=step.csv", "it lasts 3490 s; is its time in s"),
        ("run servo-comparison", "plant.measured=step.csv", "changes by 1000 times its command;"),
        ("run skill", "skill=jump.yaml", "MoveDx.displacement is (0.0, 0.0, 0.0, 0.0, 0.0, 10.0)"),
    ],
)
def test_what_can_not_be_meant_is_named(
    capsys: pytest.CaptureFixture[str], command: str, setting: str, told: str
) -> None:
    assert main([*command.split(), "--set", setting, "--out", "out"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = (one for one in err.splitlines() if told in one)
    assert any(named in line for named in setting.split("="))  # the field, or the skill's file
    assert not Path("out").exists()
