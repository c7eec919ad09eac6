import json
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import chamfer.analysis.design.design_answer as design_answer
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cli import main
from chamfer.analysis.design.assumptions import Assumption
from chamfer.analysis.design.changes import FIELDS, Advice, Change
from chamfer.analysis.design.design import BOUNDED, Bound, Design, Verdict, Verified
from chamfer.analysis.design.design_answer import Answer
from chamfer.analysis.design.design_map import MapAxis
from chamfer.analysis.design.design_scenario import DesignScenario, resolve_design
from chamfer.analysis.design.link import at_least, at_most
from chamfer.analysis.report.traces import read_table
from chamfer.analysis.scenario.experiment import Progress, select


def canned(
    given: DesignScenario,
    *,
    what_to_change: bool,
    axes: Sequence[MapAxis] | None,
    trials: int | None,
    seed: int,
    progress: Progress,
) -> Answer:
    """Answer at once: limited by a link that is unbounded."""
    print("noise on standard output")
    links = (
        at_most("wedging", 0.03, 0.05, "rad", "theory"),
        at_most("settling", float("inf"), 8.0, "s", "theorem"),
        at_least("torque", 20.0, 5.0, "N m", "arm"),
    )
    change = Change(
        path="parts.friction",
        unit="",
        value=given.parts.friction,
        sensitivity=-0.1,
        to=None,
        meaning="between peg and hole",
    )
    verified = Verified(
        trials=(trials or 1) - 1,
        seated=0,
        success=0.0,
        low=0.0,
        high=0.3,
        failed_trials=1,
        endings={"not over after 60 s, in align": (trials or 1) - 1},
        outside={},
        largest_force=0.0,
        warning="",
    )
    return Answer(
        scenario=resolve_design(given),
        seed=seed,
        design=Design(
            links=links,
            verdict="no",
            share=0.0,
            share_low=0.0,
            share_high=0.02,
            draws=given.draws,
        ),
        advice=Advice(changes=(change,)) if what_to_change else None,
        verified=verified if trials else None,
        assumptions=(Assumption("peg.model", (10.0, 2.0), "N m s/rad", "damping", True),),
    )


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design_answer, "answer", canned)


def document(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "design-insertion" / "result.json").read_text())
    return found


@pytest.mark.usefixtures("quick")
def test_folder_has_the_result_the_page_and_the_scenario(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["design", "insertion", "--set", "parts.friction=0.3", "--seed", "4"]
    assert main([*asked, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "noise" not in printed
    assert printed.startswith("insertion  no: ")
    assert "limited by settling: infinite, at most 8 s" in printed
    folder = tmp_path / "design-insertion"
    assert {path.name for path in folder.iterdir()} >= {
        *("design.html", "result.json", "scenario.yaml")
    }
    result = document(tmp_path)
    assert result["verdict"] == "no"
    assert result["limiting_link"] == "settling"
    wedging, settling, _ = result["links"]
    assert wedging == {
        "name": "wedging",
        "bound": 0.03,
        "allowed": 0.05,
        "margin": pytest.approx(0.02),
        "unit": "rad",
        "source": "theory",
        "by_design": False,
        "supposed": False,
        "share": pytest.approx(0.4),
    }
    assert [settling[name] for name in ("bound", "margin", "share")] == [None] * 3
    assert result["changes"][0]["path"] == "parts.friction"
    assert result["verified"] is None
    assert result["assumptions"] == [
        {
            "field": "peg.model",
            "value": [10.0, 2.0],
            "unit": "N m s/rad",
            "says": "damping",
            "suspicious": True,
        }
    ]
    assert "! peg.model: damping" in printed
    assert result["overrides"] == ["parts.friction=0.3"]
    assert result["command"] == "chamfer design insertion --set parts.friction=0.3 --seed 4"
    assert result["scenario"]["impedance"]["stiffness"] == [400.0] * 3


@pytest.mark.usefixtures("quick")
def test_result_and_command_make_the_same_design_again(tmp_path: Path) -> None:
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    assert main(["design", "insertion", "--set", "gap=0.025", "--out", str(first)]) == 0
    result = first / "design-insertion" / "result.json"
    asked = ["design", "insertion", "--scenario", str(result), "--out", str(second)]
    assert main(asked) == 0
    words = shlex.split(document(first)["command"])
    assert main([*words[1:], "--out", str(third)]) == 0
    keys = ("scenario_sha256", "overrides", "links")
    for other in (second, third):
        assert [document(other)[key] for key in keys] == [document(first)[key] for key in keys]


@pytest.mark.usefixtures("quick")
def test_trials_that_fail_show_in_the_status_and_the_report_links_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["design", "insertion", "--verify", "5", "--json", "--out", str(tmp_path)]
    assert main(asked) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["verified"]["failed_trials"] == 1
    assert printed["command"].endswith("--verify 5")
    report = (tmp_path / "index.html").read_text()
    assert 'href="design-insertion/design.html"' in report
    assert "1 design" in report
    assert "Unreadable" not in report


def test_the_design_s_own_fields_are_listed_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    out = ["--out", str(tmp_path / "out")]
    assert main(["design", "insertion", "--fields", "--json", *out]) == 0
    found = {one["path"]: one for one in json.loads(capsys.readouterr().out)}
    assert found["spread.cameras"]["allowed"] == "a share, from 0 to 1"
    assert found["draws"]["default"] == 200
    assert {"pictures", "parts.friction", "insert.depth"} <= set(found)
    assert main(["design", "insertion", "--fields", "spread.l", *out]) == 0
    _, *rows = capsys.readouterr().out.splitlines()
    listed = [row.split()[0] for row in rows if not row.startswith(" ")]
    assert listed == ["spread.lateral", "spread.link_mass"]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["insertion", "--fields", "spreed"], "no field begins with 'spreed'"),
        (["alignment"], "argument NAME: invalid choice: 'alignment'"),
        (["insertion", "--verify", "0"], "--verify is '0', allowed: an integer from 1"),
        (["insertion", "--verify", "many"], "--verify is 'many'"),
        (["insertion", "--map", "gap:1:2"], "expected 2 arguments"),
        (["insertion", "--map", "gap:0.02:0.03", "gip:1:2"], "no field begins with 'gip'"),
        (["insertion", "--set", "parts.peg_radius=0.02"], "parts.peg_radius is 0.02"),
        (["insertion", "--set", "gap=0.4"], "allowed"),
        (["insertion", "--scenario", "missing.yaml"], "missing.yaml"),
    ],
)
def test_mistake_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(["design", *arguments, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert message in said
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_whole_way_from_a_cell_to_an_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("chamfer.analysis.design.design_map.POINTS", 2)
    monkeypatch.setattr(
        "chamfer.analysis.design.changes.FIELDS", dict([*FIELDS.items()][:3])
    )  # each takes a second
    arguments = ["design", "insertion", "--workers", "1", "--out", str(tmp_path)]
    few = ("draws=72", "pictures=1")
    for setting in (
        *select(CATALOGUE.entries, ["insertion"])[0].reduced,
        *few,
        "spread.lateral=5e-4",
        "spread.rotational=0.005",
    ):
        arguments += ["--set", setting]
    arguments += ["--map", "parts.friction:0.2:0.5", "parts.clearance:0.0002:0.0003"]
    assert main([*arguments, "--verify", "1"]) == 0
    result = document(tmp_path)
    assert result["verdict"] in ("certain", "likely", "no")
    assert result["limiting_link"] in [link["name"] for link in result["links"]]
    assert result["assumptions"][0]["field"] == "peg.joint_friction"
    sensitivities = [abs(change["sensitivity"] or 0) for change in result["changes"]]
    assert len(sensitivities) >= 3
    assert result["verdict"] != "certain" or sensitivities == sorted(sensitivities, reverse=True)
    assert sum(result["map"]["verdicts"].values()) == 4
    table = read_table(tmp_path / "design-insertion" / "map.parquet")
    assert table["parts.friction"].tolist() == [0.2, 0.5, 0.2, 0.5]
    assert (result["verified"]["trials"], result["verified"]["seated"]) == (1, 1)
    assert re.search(r"predicted: \w+", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("verdict", "trials", "seated", "run", "said"),
    [
        ("certain", None, 4, 4, "certain"),
        ("certain", None, 3, 4, "likely"),
        ("certain", 0, 0, 0, "certain"),
        ("likely", None, 0, 0, "likely"),
        ("no", 2, 1, 2, "likely"),
    ],
)
def test_insertions_are_simulated_beside_what_is_certain_and_turn_it(
    monkeypatch: pytest.MonkeyPatch,
    verdict: Verdict,
    trials: int | None,
    seated: int,
    run: int,
    said: str,
) -> None:
    link = at_most("one", 1.0, 2.0, "", "")
    numbers = {"share": 1.0, "share_low": 0.9, "share_high": 1.0, "draws": 80}
    bound = Bound(bound=1.0, unit="", coverage=0.98)
    bounds = {"lateral": bound, "force": bound, "depth": bound}
    design = Design(links=(link,), verdict=verdict, bounds=bounds, **numbers)  # type: ignore[arg-type]
    simulated = []

    def insert(scenario: object, seed: int, trial: int) -> Row:
        simulated.append(trial)
        values = dict.fromkeys(BOUNDED, 0.5)
        return {**values, "seated": float(trial < seated), "force": 2.0, "ending": "wedged"}

    monkeypatch.setattr(design_answer, "assess", lambda *_: design)
    monkeypatch.setattr("chamfer.analysis.design.design.insert_drawn", insert)
    found = design_answer.answer(
        DesignScenario(),
        what_to_change=False,
        axes=None,
        trials=trials,
        seed=0,
        progress=lambda *_: None,
    )
    assert (found.verdict, len(simulated)) == (said, run)
    if found.verified is not None:
        assert found.verified.outside == {"force": run, "depth": run}
