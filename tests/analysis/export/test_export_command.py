"""The command ``chamfer export``: what it writes, and what it says where there is nothing."""

from collections.abc import Callable
from pathlib import Path

import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.export.fmu import compiler

Export = Callable[..., tuple[int, list[str], str]]


@pytest.fixture
def export(chamfer: Callable[..., tuple[int, str, str]], tmp_path: Path) -> Export:
    """Exports into a folder of this test; gives the status, the files' names, and complaints."""

    def run(name: str, format_: str, *options: str) -> tuple[int, list[str], str]:
        arguments = ("export", name, "--format", format_, *options, "--out", tmp_path)
        status, said, complaint = chamfer(*arguments, catalogue=CATALOGUE)
        paths = list(map(Path, said.splitlines()))
        assert all(path.parent == tmp_path / name / "export" and path.exists() for path in paths)
        return status, [path.name for path in paths], complaint

    return run


@pytest.mark.parametrize(
    ("name", "format_", "options", "files"),
    [
        ("step-response", "c", ["--set", "plant.mass=3.0"], ["compensator.h", "compensator.c"]),
        ("alignment", "c", ["--set", "controller.kind=pid"], ["pid.h", "pid.c"]),
        ("step-response", "fmu", [], ["step-response-compensator.fmu"]),
        (
            "step-response",
            "scxml",
            [],
            ["trajectory-compensator.scxml", "compensation-of-one-axis.scxml"],
        ),
        ("peg-insertion", "mermaid", [], ["diagram.mmd"]),
    ],
)
def test_every_format_is_written_and_its_paths_are_printed(
    name: str, format_: str, options: list[str], files: list[str], export: Export, tmp_path: Path
) -> None:
    status, written, complaint = export(name, format_, *options)
    assert (status, written) == (0, files)
    assert complaint == "" or compiler() is None
    if options:
        text = (tmp_path / name / "export" / files[1]).read_text("utf-8")
        assert f"chamfer export {name} --set {options[1]} --format c\n" in text


@pytest.mark.parametrize(
    ("name", "format_", "said"),
    [
        ("peg-insertion", "c", "peg-insertion: nothing to export as c, there is: mermaid"),
        ("planar-hold", "fmu", "nothing to export as fmu, there is: scxml, mermaid"),
        ("design-accuracy", "mermaid", "nothing to export as mermaid, there is: nothing"),
        ("step-response", "matlab", "'matlab' (choose from 'c', 'fmu', 'scxml', 'mermaid')"),
        ("steps", "c", "unknown experiment 'steps'"),
    ],
)
def test_what_is_not_there_is_said_in_a_line(
    name: str, format_: str, said: str, export: Export, tmp_path: Path
) -> None:
    status, written, complaint = export(name, format_)
    assert (status, written) == (2, [])
    assert said in complaint
    assert complaint.count("\n") == 1
    assert not (tmp_path / name).exists()


def test_without_a_compiler_a_unit_holds_its_sources(
    export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda *_: None)
    status, written, complaint = export("step-response", "fmu")
    assert (status, written) == (0, ["step-response-compensator.fmu"])
    assert "without a C compiler" in complaint
