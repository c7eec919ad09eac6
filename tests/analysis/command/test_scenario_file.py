import json
from pathlib import Path

import pytest

from chamfer.analysis.command.running import read_scenario
from chamfer.analysis.scenario.errors import UserError


def refused(path: Path) -> str:
    with pytest.raises(UserError) as raised:
        read_scenario(path, "fall")
    return str(raised.value)


def write(tmp_path: Path, text: str, name: str = "scenario.yaml") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def test_a_file_of_fields(tmp_path: Path) -> None:
    path = write(tmp_path, "plant:\n  mass: 1e-3\nticks: 010\n")
    assert read_scenario(path, "fall") == {"plant": {"mass": 0.001}, "ticks": 10}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("plant:\n  mass: 1\n  mass: 2\n", ": line 3: the key 'mass' is given twice"),
        ("a: 1\nb: [2\nc: 3\n", ": line 3: expected ',' or ']', but got ':'"),
        ("a: !!python/object:os.system x\n", None),
        ("", " is empty, allowed: a mapping of scenario fields"),
        ("- 1\n", " is a list, allowed: a mapping of scenario fields"),
        ("plant\n", " is a text, allowed: a mapping of scenario fields"),
        ("a: 1\n---\nb: 2\n", ": line 2: but found another document"),
    ],
)
def test_bad_files_are_named_with_the_line(tmp_path: Path, text: str, message: str | None) -> None:
    path = write(tmp_path, text)
    line = refused(path)
    assert "\n" not in line
    if message is None:
        assert line.startswith(f"{path}: line 1: could not determine a constructor for the tag")
    else:
        assert line == f"{path}{message}"


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    assert refused(tmp_path / "no.yaml") == f"{tmp_path}/no.yaml: No such file or directory"
    assert refused(tmp_path / "no.json") == f"{tmp_path}/no.json: No such file or directory"
    assert refused(tmp_path) == f"{tmp_path}: Is a directory"
    (tmp_path / "latin.yaml").write_bytes(b"name: \xe9\n")
    assert refused(tmp_path / "latin.yaml") == f"{tmp_path}/latin.yaml: not a text in UTF-8"


@pytest.mark.parametrize("kind", ["experiment", "design"])
def test_a_result_gives_its_scenario(tmp_path: Path, kind: str) -> None:
    text = json.dumps({kind: "fall", "scenario": {"high": "inf"}, "metrics": {}})
    assert read_scenario(write(tmp_path, text, "result.json"), "fall") == {"high": "inf"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"experiment": "rise", "scenario": {}}', " is a result of rise, not of fall"),
        ('{"design": "rise", "scenario": {}}', " is a result of rise, not of fall"),
        ('{"experiment": "fall"}', " is not a result: it has no scenario"),
        ("[1]", " is not a result: not a mapping"),
        ("{", " is not a result: Expecting property name enclosed in double quotes: line 1 column"
         " 2 (char 1)"),
    ],
)  # fmt: skip
def test_what_is_not_a_result_of_the_experiment_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    path = write(tmp_path, text, "result.json")
    assert refused(path) == f"{path}{message}"
