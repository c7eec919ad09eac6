import json
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.report.traces import read_table
from chamfer.analysis.scenario.experiment import Catalogue, select

WIRED = """
import warnings

from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Gain

from chamfer.systems.statechart.chart import Chart, State


def make_diagram(scenario):
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
    gain = builder.AddNamedSystem("gain", Gain(scenario.noise, 1))
    builder.Connect(source.get_output_port(), gain.get_input_port())
    return builder.Build()


def make_charts(scenario):
    return [Chart("one axis", states=[State(name="rest")], transitions=[], memory=None)]


def run_doubtful(scenario, seed, progress):
    warnings.warn("nothing was seen")
    return run_trials(scenario, seed, progress)
"""

ENTRIES = """
        trials("wired", diagram="make_diagram", charts="make_charts"),
        trials("doubtful", run="run_doubtful"),
"""

ROOT = Path(__file__).parents[2]
Chamfer = Callable[..., tuple[int, str, str]]


def files(out: Path) -> list[str]:
    return sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())


def result(out: Path, name: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((out / name / "result.json").read_text())
    return document


def test_list_groups_by_paper(chamfer: Chamfer) -> None:
    status, out, _ = chamfer("list")
    assert status == 0
    assert out.splitlines()[-3:] == [
        "toy-paper",
        "  fall         Fig. 1  a body falls",
        "  trials               trials of trials",
    ]
    status, out, _ = chamfer("list", "--json")
    assert status == 0
    assert json.loads(out)[-2] == {
        "name": "fall",
        "paper": "toy-paper",
        "figure": "Fig. 1",
        "summary": "a body falls",
        "study": False,
    }


@pytest.mark.parametrize("arguments", [["list"], ["list", "--json"], ["--help"], ["--version"]])
def test_list_and_help_import_nothing_heavy(arguments: list[str]) -> None:
    program = (
        "import sys\nfrom chamfer.analysis.cli import main\n"
        f"try:\n    main({arguments})\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'pydrake', 'matplotlib', 'scipy', 'yaml', 'pyarrow'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert ended.stdout.splitlines()[-1] == "[]"
    assert ended.stdout.startswith("chamfer") == (arguments == ["--version"])


def test_run_writes_the_result_in_the_form_of_the_design(chamfer: Chamfer, out: Path) -> None:
    assert chamfer("run", "fall", "--out", out, "--seed", 3)[0] == 0
    assert files(out) == [
        "fall/fall.png",
        "fall/fall.svg",
        "fall/result.json",
        "fall/scenario.yaml",
        "fall/traces.parquet",
        "index.html",
    ]
    document = result(out, "fall")
    end = float(read_table(out / "fall" / "traces.parquet")["position"][-1])
    assert document.pop("wall_seconds") >= 0
    assert len(document.pop("scenario_sha256")) == 64
    assert document.pop("versions")["numpy"]
    usual = {"unit": "m", "note": "", "ok": False, "kind": "predicted"}
    near = {"metric": "height", "relation": "near", "published": 5.0, "tolerance": 0.5}
    near |= {"measured": 5.0, "source": "Fig. 1", "verdict": "holds", "ok": True}
    between = {"metric": "end", "relation": "between", "low": -2.0, "high": -1.0, "measured": end}
    between |= {"kind": "calibrated", "source": "section 2", "verdict": "does_not_hold"}
    bound = {"metric": "overflow", "relation": "at_least", "published": 1.0, "measured": None}
    bound |= {"source": "section 3", "verdict": "not_reached"}
    limit = {"metric": "height", "relation": "at_most", "published": 10.0, "measured": 5.0}
    limit |= {"kind": "specification", "source": "section 4", "verdict": "holds", "ok": True}
    assert document == {
        "experiment": "fall",
        "paper": "toy-paper",
        "figure": "Fig. 1",
        "seed": 3,
        "scenario": {"body": {"mass": 2.0, "form": "ball"}, "height": 5.0, "step": 0.1},
        "overrides": [],
        "metrics": {
            "end": {"value": end, "unit": "m"},
            "height": {"value": 5.0, "unit": "m"},
            "overflow": {"value": None, "unit": "m", "note": "measured inf"},
            "undefined": {"value": None, "unit": "s", "note": "it does not bounce"},
        },
        "checks": [
            usual | near,
            usual | between | {"note": "it is not that deep"},
            usual | bound,
            usual | limit,
        ],
        "failed_trials": [],
        "simulated_seconds": 1.0,
        "command": "chamfer run fall --seed 3",
        "figures": ["fall.svg", "fall.png"],
        "captions": {"fall.svg": "It falls & rests."},
        "drawings": [],
    }


def test_what_is_not_as_published_is_said_and_counted_but_no_error(
    chamfer: Chamfer, out: Path
) -> None:
    status, said, _ = chamfer("run", "fall", "--out", out)
    assert status == 0
    lines = said.splitlines()
    words = [line.split() for line in lines]
    assert ["height", "5", "+-", "0.5", "5", "m", "predicted", "holds"] in words
    assert any(line.startswith("  end ") and line.endswith("does not hold") for line in lines)
    assert any(line.startswith("  overflow ") and line.endswith("not reached") for line in lines)
    assert "    it is not that deep" in lines
    assert lines[-2:] == [
        "3 published values: 1 holds, 1 does not hold, 1 not reached; 1 of 1 specification kept",
        f"report: {out}/index.html",
    ]


def test_published_values_apply_to_the_default_scenario_only(chamfer: Chamfer, out: Path) -> None:
    status, said, _ = chamfer("run", "fall", "--out", out, "--set", "body={mass: 3, form: plate}")
    assert status == 0
    document = result(out, "fall")
    assert [one["kind"] for one in document["checks"]] == ["specification"]
    assert document["overrides"] == ["body.mass=3.0", "body.form=plate"]
    assert document["command"] == "chamfer run fall --set body.mass=3.0 --set body.form=plate"
    assert "published values apply to the default scenario only, not to this one" in said
    assert "it does not bounce" in said


@pytest.mark.parametrize("name", ["scenario.yaml", "result.json"])
@pytest.mark.parametrize("given", [[], ["--set", "body.mass=3.0"]])
def test_a_result_is_remade_from_the_scenario_beside_it(
    chamfer: Chamfer, tmp_path: Path, name: str, given: list[str]
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert chamfer("run", "fall", "--out", first, *given)[0] == 0
    assert chamfer("run", "fall", "--scenario", first / "fall" / name, "--out", second)[0] == 0
    a, b = result(first, "fall"), result(second, "fall")
    assert {**a, "wall_seconds": 0} == {**b, "wall_seconds": 0}
    assert len(a["checks"]) == (1 if given else 4)
    assert a["command"] == " ".join(["chamfer run fall", *given])
    for figure in ("fall.svg", "fall.png"):
        assert (first / "fall" / figure).read_bytes() == (second / "fall" / figure).read_bytes()
    drawn = (first / "fall" / "fall.svg").read_text()
    assert "<dc:date>" not in drawn
    assert "<dc:description>It falls &amp; rests.</dc:description>" in drawn


@pytest.mark.parametrize("new", [["--fresh"], ["--seed", 1], ["--set", "height=6"], []])
def test_figures_of_the_same_results_stay_and_others_are_drawn(
    chamfer: Chamfer, out: Path, new: list[str]
) -> None:
    assert chamfer("run", "fall", "--out", out)[0] == 0
    (out / "fall" / "fall.png").write_bytes(b"kept")
    assert chamfer("run", "fall", "--out", out, *new)[0] == 0
    assert result(out, "fall")["figures"] == ["fall.svg", "fall.png"]
    assert result(out, "fall")["captions"] == {"fall.svg": "It falls & rests."}
    assert ((out / "fall" / "fall.png").read_bytes() == b"kept") == (not new)


@pytest.mark.parametrize("strict", [[], ["--strict"]])
def test_a_limit_is_judged_on_every_run_and_strict_ends_with_1_if_it_is_broken(
    chamfer: Chamfer, out: Path, strict: list[str]
) -> None:
    # What is not reached is no limit.
    assert chamfer("run", "fall", "--out", out, *strict)[0] == 0
    status, said, err = chamfer("run", "fall", "--set", "height=20", "--out", out, *strict)
    assert status == len(strict)
    assert ("chamfer: --strict: 1 of 1 specifications broken" in err) == bool(strict)
    assert "0 of 1 specification kept" in said
    assert [line.split()[-1] for line in said.splitlines() if "<= 10" in line] == ["broken"]
    (check,) = result(out, "fall")["checks"]
    assert (check["measured"], check["ok"]) == (20.0, False)
    options = ("--vary", "height=5,20,200", "--trials", 2, "--out", out)
    status, said, _ = chamfer("sweep", "fall", *options, *strict)
    assert status == len(strict)
    table = read_table(out / "sweep-fall" / "points.parquet")
    assert np.array_equal(table["broken"], [0.0, 1.0, np.nan], equal_nan=True)
    assert "1 with a broken specification: height" in said.splitlines()
    page = (out / "index.html").read_text().replace("\n", "")
    assert "Broken specifications: <code>height</code> at 1 point." in page
    assert chamfer("run", "interrupted", "--out", out, *strict)[0] == 130


def test_json_is_one_document_and_nothing_else(chamfer: Chamfer, out: Path) -> None:
    status, said, err = chamfer("run", "fall", "trials", "--out", out, "--json")
    assert (status, err) == (0, "noise on standard output\n")
    document = json.loads(said)
    assert [one["experiment"] for one in document["results"]] == ["fall", "trials"]
    assert document["results"][0] == result(out, "fall")
    assert document["checks"] == {"holds": 1, "does_not_hold": 1, "not_reached": 1}
    assert document["specifications"] == {"kept": 1, "broken": 0}
    assert document["report"] == f"{out}/index.html"


def with_study(toys: Catalogue) -> Catalogue:
    """The toys of one paper, of which the trials go beyond it."""
    fall, trials = select(toys.entries, ["fall", "trials"])
    return replace(toys, entries=(fall, replace(trials, study=True)))


def test_studies_are_marked_and_run_when_asked_for(
    chamfer: Chamfer, toys: Catalogue, out: Path
) -> None:
    toys = with_study(toys)
    assert chamfer("list", catalogue=toys)[1].endswith(
        "  trials          study: trials of trials\n"
    )
    command = ("reproduce", "--workers", 1, "--out", out)
    assert chamfer(*command, catalogue=toys)[0] == 0
    assert not (out / "trials").exists()
    assert chamfer(*command, "--studies", catalogue=toys)[0] == 0
    assert (out / "trials" / "result.json").exists()


@pytest.mark.slow
def test_what_was_reproduced_is_kept_until_seed_or_files_change(
    chamfer: Chamfer, toys: Catalogue, out: Path
) -> None:
    path = out / "fall" / "result.json"

    def again(*arguments: str) -> bool:
        before = path.stat().st_mtime_ns if path.exists() else 0
        command = ("reproduce", "--workers", 1, "--out", out, *arguments)
        _, said, _ = chamfer(*command, catalogue=with_study(toys))
        assert "1 holds, 1 does not hold" in said  # counted all the same
        return path.stat().st_mtime_ns != before

    assert again()
    assert not again()
    assert again("--seed", "1")
    assert again()  # the seed
    assert again("--fresh")
    (out / "fall" / "fall.svg").unlink()
    assert again()
    path.write_text("{}")
    assert again()


@pytest.fixture
def wired(more_toys: Callable[[str, str], Catalogue]) -> Catalogue:
    return more_toys(WIRED, ENTRIES)


def test_diagram_writes_svg_and_mermaid_and_prints_the_paths(
    chamfer: Chamfer, wired: Catalogue, out: Path
) -> None:
    names = ["wired/diagram.svg", "wired/diagram.mmd"]
    said = "".join(f"{out}/{name}\n" for name in names)
    assert chamfer("diagram", "wired", "--out", out, catalogue=wired) == (0, said, "")
    assert files(out) == sorted(names)
    assert "<svg" in (out / "wired" / "diagram.svg").read_text()
    assert (out / "wired" / "diagram.mmd").read_text().startswith("flowchart")

    said += "".join(f"{out}/wired/chart-one-axis.{ending}\n" for ending in ("svg", "mmd"))
    assert chamfer("diagram", "wired", "--chart", "--out", out, catalogue=wired) == (0, said, "")
    assert "stateDiagram" in (out / "wired" / "chart-one-axis.mmd").read_text()


def test_the_report_shows_the_diagram_and_the_charts(
    chamfer: Chamfer, wired: Catalogue, out: Path
) -> None:
    assert chamfer("run", "wired", "--out", out, catalogue=wired)[0] == 0
    assert result(out, "wired")["drawings"] == ["diagram.svg", "chart-one-axis.svg"]
    page = (out / "index.html").read_text()
    assert 'alt="Block diagram"' in page
    assert 'alt="State chart: one axis"' in page


def test_a_run_warns_in_one_line(chamfer: Chamfer, wired: Catalogue, out: Path) -> None:
    before = warnings.showwarning
    status, _, err = chamfer("run", "doubtful", "--out", out, catalogue=wired)
    assert (status, err) == (0, "chamfer: warning: nothing was seen\n")
    assert warnings.showwarning is before
