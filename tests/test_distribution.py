"""What is distributed is whole: metadata that agree, a wheel that works far from its sources."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parent.parent
PACKAGES = ("models", "systems", "diagrams", "analysis")
NO_SOURCES = shutil.ignore_patterns(
    ".git", ".venv", ".*cache*", ".hypothesis", "__pycache__", "*.egg-info", "out", "generated"
)


def project() -> dict[str, Any]:
    declared: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    return dict(declared["project"])


def test_version_and_license_are_said_once_and_the_same() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == project()["version"]
    software, *recordings = project()["license"].split(" AND ")
    assert citation["license"] == software
    assert recordings == ["MIT", "CC-BY-4.0"]
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    released = re.findall(r"^## \[?(\d[.\d]*)", changes, flags=re.MULTILINE)
    assert set(released[:1]) <= {project()["version"]}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a source distribution, and of the wheel that is built of that."""
    folder = tmp_path_factory.mktemp("distribution")
    shutil.copytree(ROOT, folder / "sources", ignore=NO_SOURCES)
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, folder / "sources"],
        capture_output=True,
        check=True,
    )
    return folder


@pytest.mark.slow
def test_the_wheel_holds_what_the_packages_hold_and_nothing_else(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    sources = {"chamfer/__init__.py"} | {
        f"chamfer/{path.relative_to(ROOT).as_posix()}"
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix in {".py", ".typed", ".urdf", ".jinja", ".npz", ".csv"}
        or path.name.startswith("LICENSE-")
    }
    assert held == sources
    assert {f"chamfer/{package}/py.typed" for package in PACKAGES} <= held


@pytest.mark.slow
def test_the_source_distribution_holds_what_tests_and_documents_need(built: Path) -> None:
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        held = {name.partition("/")[2] for name in file.getnames()}
    wanted = {
        path.relative_to(ROOT).as_posix()
        for folder in ("docs", "tests")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and not {"__pycache__", "generated"} & set(path.parts)
    }
    assert {*wanted, ".ci/run", "Makefile", "constraints.txt", "CHANGELOG.md", "LICENSE"} <= held


@pytest.mark.slow
def test_the_wheel_runs_from_elsewhere(built: Path, tmp_path: Path) -> None:
    (wheel,) = built.glob("*.whl")
    installed = tmp_path / "installed"
    zipfile.ZipFile(wheel).extractall(installed)
    away = tmp_path / "away"  # a user's project, with packages of the same names
    for package in PACKAGES:
        (away / package).mkdir(parents=True)
        (away / package / "__init__.py").write_text("OWN = True\n")

    def printed_by(*arguments: str) -> str:
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=away,
            env={**os.environ, "PYTHONPATH": str(installed)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    assert printed_by("-c", "import chamfer.analysis as a; print(a.__file__)").startswith(
        str(installed)
    )
    assert printed_by(
        "-c", "import chamfer.analysis.cli, models, analysis; print(models.OWN, analysis.OWN)"
    )
    # Comments of fields are read from sources, arms from their files.
    assert "identified from Fig. 8" in printed_by(
        "-m", "chamfer.analysis", "fields", "step-response", "plant.mass"
    )
    assert (
        printed_by("-c", "from chamfer.models.arms.wam import WAM; print(WAM.num_joints)") == "7\n"
    )
    printed_by("-m", "chamfer.analysis", "run", "step-response")
    assert (away / "out/index.html").exists()
