"""The command ``chamfer export``: what it writes, and what it says where there is nothing."""

from collections.abc import Callable
from pathlib import Path

import pytest
from fmpy.validation import validate_fmu

from chamfer.analysis.catalogue import CATALOGUE

Chamfer = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize(
    ("name", "format_", "setting", "files"),
    [
        ("step-response", "c", "plant.mass=3.0", "compensator.h compensator.c"),
        ("alignment", "c", "controller.kind=pid", "pid.h pid.c"),
        ("d-connector", "fmu", "step=0.002", "d-connector-accommodation.fmu"),
        ("planar-hold", "scxml", "trials=1", "contact-detection.scxml"),
        ("peg-insertion", "mermaid", "gap=0.001", "diagram.mmd"),
    ],
)
def test_every_format_is_written_and_its_paths_are_printed(
    name: str, format_: str, setting: str, files: str, chamfer: Chamfer, tmp_path: Path
) -> None:
    options = ("--format", format_, "--set", setting, "--out", tmp_path)
    status, said, _ = chamfer("export", name, *options, catalogue=CATALOGUE)
    written = [tmp_path / name / "export" / file for file in files.split()]
    assert (status, said.splitlines()) == (0, list(map(str, written)))
    if format_ == "c":
        made = f"chamfer export {name} --set {setting} --format c\n"
        assert all(made in path.read_text("utf-8") for path in written)
    if format_ == "fmu":
        assert validate_fmu(str(written[0])) == []


@pytest.mark.parametrize(
    ("name", "format_", "why"),
    [
        ("peg-insertion", "c", "peg-insertion: has nothing to export as c, there is: mermaid"),
        ("planar-hold", "fmu", "nothing to export as fmu, there is: scxml, mermaid"),
        ("design-accuracy", "mermaid", "design-accuracy: has nothing to export"),
        ("step-response", "matlab", "'matlab' (choose from 'c', 'fmu', 'scxml', 'mermaid')"),
    ],
)
def test_what_is_not_there_is_said_in_a_line(
    name: str, format_: str, why: str, chamfer: Chamfer, tmp_path: Path
) -> None:
    options = ("--format", format_, "--out", tmp_path)
    status, said, complaint = chamfer("export", name, *options, catalogue=CATALOGUE)
    assert (status, said, complaint.count("\n")) == (2, "", 1)
    assert why in complaint
    assert not (tmp_path / name).exists()
