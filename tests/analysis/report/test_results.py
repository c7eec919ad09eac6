import fcntl
import gc
import json
import math
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from chamfer.analysis.report.checks import Check, Published
from chamfer.analysis.report.results import (
    Artifacts,
    check_document,
    defined_metrics,
    json_text,
    metric_document,
    read_result,
    versions,
    write_result,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome


def figure() -> Figure:
    made = Figure(figsize=(2, 1))
    axes = made.add_subplot()
    axes.plot([0, 1], [1, 0])
    axes.fill_between([0, 1], [0, 1])
    return made


class FailingFigure(Figure):
    failure: BaseException = OSError(28, "No space left on device")

    def savefig(self, *_: Any, **__: Any) -> None:
        raise self.failure


def artifacts(drawn: Figure | None = None, value: float = 1.0) -> Artifacts:
    return Artifacts(
        scenario="height: 5.0\n",
        outcome=Outcome(
            metrics={},
            traces={"time": np.array([0.0, value])},
            tables={"map": {"x": np.zeros(2)}},
            simulated_seconds=1.0,
        ),
        figures={"response": drawn or figure()},
        drawings={"diagram.svg": "<svg/>"},
        replay="<p>π</p>",
    )


def published(**changes: Any) -> Published:
    given: dict[str, Any] = {
        "experiment": "fall",
        "metric": "end",
        "relation": "near",
        "value": 1,
        "tolerance": 0.5,
        "unit": "m",
        "kind": "predicted",
        "source": "Fig. 1",
    }
    return Published(**{**given, **changes})


def test_writes_everything_that_belongs_to_a_result(tmp_path: Path) -> None:
    write_result(tmp_path / "fall", {"figures": artifacts().figure_files()}, artifacts())
    assert {path.name for path in (tmp_path / "fall").iterdir()} == {
        *("diagram.svg", "map.parquet", "response.png", "response.svg"),
        *("replay.html", "result.json", "scenario.yaml", "traces.parquet"),
    }
    assert (tmp_path / "fall" / "replay.html").read_text(encoding="utf-8") == "<p>π</p>"
    assert (tmp_path / "fall" / "scenario.yaml").read_text() == "height: 5.0\n"
    assert read_result(tmp_path / "fall" / "result.json") == {
        "figures": ["response.svg", "response.png"]
    }


def test_same_result_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_result(tmp_path / name, {}, artifacts())
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name
    assert b"<dc:date>" not in (tmp_path / "a" / "response.svg").read_bytes()


@pytest.mark.parametrize("failure", [OSError(28, "full"), KeyboardInterrupt()])
def test_a_failure_midway_leaves_the_old_result_with_its_own_files(
    tmp_path: Path, failure: BaseException
) -> None:
    folder = tmp_path / "fall"
    write_result(folder, {"run": 1}, artifacts())
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    failing = FailingFigure()
    failing.failure = failure
    with pytest.raises(type(failure)):
        write_result(folder, {"run": 2}, artifacts(failing, value=2.0))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_result_that_is_not_json_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_result(tmp_path / "fall", {"value": math.nan}, artifacts())
    assert list((tmp_path / "fall").iterdir()) == []


def test_the_result_is_the_last_file_to_appear(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    appeared: list[str] = []
    replace = os.replace

    def spy(source: Path, target: Path) -> None:
        if Path(target).parent == tmp_path:
            appeared.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr("chamfer.analysis.report.results.os.replace", spy)
    write_result(tmp_path, {}, artifacts())
    assert appeared[-1] == "result.json"
    assert len(appeared) == 8


def test_two_runs_don_t_mix_their_files(tmp_path: Path) -> None:
    gc.collect()  # Meshcats of other tests may not end in another thread
    descriptor = os.open(tmp_path, os.O_RDONLY)  # another run is renaming its files
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    writer = threading.Thread(target=write_result, args=(tmp_path, {}, artifacts()))
    writer.start()
    writer.join(timeout=0.5)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == []
    os.close(descriptor)
    writer.join(timeout=10)
    assert (tmp_path / "result.json").exists()


def test_metrics_that_are_not_finite_are_null_with_a_note() -> None:
    defined = defined_metrics(
        {
            "a": Metric(value=np.float64(1.5), unit="m"),
            "b": Metric(value=math.inf, unit="m"),
            "c": Metric(value=math.nan, unit="", note="no rest"),
            "d": Metric(value=None, unit="s"),
        }
    )
    documents = {name: metric_document(metric) for name, metric in defined.items()}
    assert documents == {
        "a": {"value": 1.5, "unit": "m"},
        "b": {"value": None, "unit": "m", "note": "measured inf"},
        "c": {"value": None, "unit": "", "note": "no rest"},
        "d": {"value": None, "unit": "s", "note": "undefined"},
    }
    json.loads(json_text(documents))


@pytest.mark.parametrize(
    ("changes", "measured", "numbers", "verdict"),
    [
        ({}, 1.5, {"published": 1.0, "tolerance": 0.5}, "holds"),
        ({}, 1.6, {"published": 1.0, "tolerance": 0.5}, "not_reached"),
        ({"otherwise": "does_not_hold"}, 1.5, {"published": 1.0, "tolerance": 0.5}, "holds"),
        (
            {"relation": "at_most", "tolerance": None, "otherwise": "does_not_hold"},
            1.1,
            {"published": 1.0},
            "does_not_hold",
        ),
        ({"relation": "at_least", "tolerance": None}, None, {"published": 1.0}, "not_reached"),
        (
            {"relation": "between", "value": None, "tolerance": None, "low": 0, "high": 2},
            2.0,
            {"low": 0.0, "high": 2.0},
            "holds",
        ),
    ],
)
def test_checks_hold_the_numbers_of_their_relation_only(
    changes: dict[str, Any], measured: float | None, numbers: dict[str, float], verdict: str
) -> None:
    check = Check(published=published(**changes, note="why"), measured=measured)
    assert check_document(check) == {
        "metric": "end",
        "relation": changes.get("relation", "near"),
        **numbers,
        "measured": measured,
        "unit": "m",
        "kind": "predicted",
        "source": "Fig. 1",
        "verdict": verdict,
        "ok": verdict == "holds",
        "note": "why",
    }


def test_a_claim_that_does_not_hold_says_why() -> None:
    with pytest.raises(ValueError, match="a claim that does not hold lacks a note"):
        published(otherwise="does_not_hold")


def test_versions_are_found_without_importing_the_packages() -> None:
    program = (
        "import sys; from chamfer.analysis.report.results import versions; found = versions(); "
        "print(sorted({'pydrake', 'scipy', 'control', 'cv2', 'matplotlib'} & set(sys.modules)))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[3],
    )
    assert ended.stdout == "[]\n"
    found = versions()
    assert list(found) == [
        *("python", "drake", "numpy", "numba", "scipy", "control", "opencv", "matplotlib"),
        *("chamfer", "sources"),
    ]
    assert found["numpy"] == np.__version__
