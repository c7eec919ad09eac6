"""A calibrated camera in a scenario: it runs, and its result carries the numbers."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from chamfer.analysis.calibration.drawn_boards import BoardPoses
from chamfer.analysis.cli import main
from chamfer.models.cameras.camera import Camera


@pytest.mark.slow
def test_what_is_calibrated_is_what_a_scenario_believes(
    tmp_path: Path,
    place: Callable[..., list[Camera]],
    save: Callable[..., list[Path]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    lens = Camera(
        width=320,
        height=240,
        focal=(1000.0, 1004.0),
        centre=(161.0, 118.0),
        distortion=(-0.2, 0.0, 0.0, 0.0, 0.0),
        R_WC=np.eye(3),
        p_WC=np.zeros(3),
    )
    poses = BoardPoses(extent=(0.5, 0.8))
    save(tmp_path / "left", place(6, poses=poses, camera=lens))
    out = ["--out", str(tmp_path / "out")]
    board = ["--board", "chessboard:9x6:25mm"]
    assert main(["calibrate", str(tmp_path / "left"), *board, *out]) == 0
    file = tmp_path / "out" / "calibrate" / "camera.yaml"
    calibrated = yaml.safe_load(file.read_text())
    assert calibrated["focal_length"] == pytest.approx([1000.0, 1004.0], rel=5e-3)

    scenario = tmp_path / "alignment.yaml"
    believed = {"believed": {"file": str(file)}}
    scenario.write_text(yaml.safe_dump({"compensation_time": 0.05, "cameras": {"xz": believed}}))
    assert main(["run", "alignment", "--scenario", str(scenario), *out]) == 0
    capsys.readouterr()
    result = json.loads((tmp_path / "out" / "alignment" / "result.json").read_text())
    found = result["scenario"]["cameras"]["xz"]["believed"]
    for name in ("focal_length", "principal_point", "distortion"):
        assert found[name] == calibrated[name]
    assert found["file"] is None
