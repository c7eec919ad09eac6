import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.registry import Sources

ROOT = Path(__file__).parents[2]
PROGRAM = """
import sys
from pathlib import Path
from analysis.cli import main
from analysis.registry import Sources
folder, package, published, *arguments = sys.argv[1:]
sources = Sources(folder=Path(folder), package=package, published=published)
sys.exit(main(arguments, sources=sources))
"""


def start(toys: Sources, *arguments: str) -> subprocess.Popen[str]:
    source = [str(toys.folder), toys.package, toys.published]
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *source, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": f"{ROOT}:{toys.folder.parents[1]}"},
    )


def files(out: Path) -> list[str]:
    return sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_in_one_line(toys: Sources, out: Path, sent: int) -> None:
    with start(toys, "run", "trials", "slow", "--out", str(out)) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "started\n"
        process.send_signal(sent)
        _, err = process.communicate(timeout=10)
    assert process.returncode == 130
    assert err == "chamfer: interrupted, the experiments that had ended are kept\n"
    assert files(out) == ["index.html", "trials/result.json", "trials/traces.parquet"]


def test_a_reader_that_leaves_early_is_no_error(toys: Sources) -> None:
    with start(toys, "list") as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 141


def test_a_terminal_that_lacks_a_character_is_no_error(
    toys: Sources, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = toys.folder / "all.py"
    path.write_text(path.read_text().replace("a body falls", "a body falls ± 1 m"))
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    with start(toys, "list") as process:
        out, err = process.communicate(timeout=10)
    assert (process.returncode, err) == (0, "")
    assert "a body falls \\xb1 1 m" in out


def test_two_runs_into_one_folder_at_once(toys: Sources, out: Path) -> None:
    commands = (("fall", "trials"), ("trials", "fall"))
    processes = [start(toys, "run", *names, "--out", str(out)) for names in commands]
    for process in processes:
        _, err = process.communicate(timeout=30)
        assert (process.returncode, err) == (0, "")
    assert files(out) == [
        "fall/fall.png",
        "fall/fall.svg",
        "fall/result.json",
        "fall/traces.parquet",
        "index.html",
        "trials/result.json",
        "trials/traces.parquet",
    ]
    page = (out / "index.html").read_text()
    assert 'id="fall"' in page
    assert 'id="trials"' in page
    assert page.endswith("</html>\n")
