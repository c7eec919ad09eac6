import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

import pytest

from chamfer.analysis.campaign.trial_store import TrialStore
from chamfer.analysis.scenario.errors import UserError

ROOT = Path(__file__).parents[3]
ROWS = [(bytes([i]) * 32, bytes([i]) * 5000) for i in range(50)]
KEYS = [key for key, _ in ROWS]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file that is not there yet, in a folder that is not there either."""
    return tmp_path / "out" / "trials.sqlite"


@contextmanager
def stored(path: Path | None, *, fresh: bool = False) -> Iterator[TrialStore]:
    with closing(TrialStore(path, fresh=fresh)) as store:
        yield store


def test_what_was_added_is_found_again(path: Path) -> None:
    with stored(path) as store:
        assert store.rows(KEYS) == {}
        store.add(ROWS[:3])
        store.add(ROWS[2:5])
        assert store.rows(KEYS[1:4]) == dict(ROWS[1:4])
    with stored(path) as store:
        assert store.rows(KEYS) == dict(ROWS[:5])


def test_only_what_is_kept_stays(path: Path) -> None:
    with stored(path) as store:
        store.add(ROWS)
        store.keep(KEYS[3:5])
        store.keep([*KEYS[3:5], b"unknown"])
        assert store.rows(KEYS) == dict(ROWS[3:5])


def test_without_a_file_nothing_stays() -> None:
    with stored(None) as store:
        store.add(ROWS)
        assert store.rows(KEYS) == dict(ROWS)
    with stored(None) as store:
        assert store.rows(KEYS) == {}


# What becomes of a file's content.
DAMAGES: Final[dict[str, Callable[[bytes], bytes]]] = {
    "text": lambda content: b"not a database\n" * 1000,
    "header": lambda content: content[:16] + b"\xff" * 5000,
    "end": lambda content: content[:9000],
    "pages": lambda content: content[:4096] + b"\x0d" * (len(content) - 4096),
    "row": lambda content: content.replace(bytes([7]) * 100, bytes([7]) * 99 + b"\x08", 1),
    "format": lambda content: content[:60] + (99).to_bytes(4, "big") + content[64:],
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_begun_anew(
    path: Path, damage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with stored(path) as store:
        store.add(ROWS)
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    with stored(path) as store:
        assert store.rows(KEYS) == {}
        store.add(ROWS[:2])
        assert store.rows(KEYS) == dict(ROWS[:2])
    err = capsys.readouterr().err
    assert err.startswith(f"chamfer: {path} can't be read (")
    assert err.endswith("), its trials are run again\n")
    assert err.count("\n") == 1
    with stored(path) as store:
        assert store.rows(KEYS) == dict(ROWS[:2])


def test_a_place_that_can_not_be_written_is_named(path: Path) -> None:
    path.mkdir(parents=True)
    with pytest.raises(UserError) as caught:
        TrialStore(path)
    assert str(caught.value) == f"{path} can't be read and written (unable to open database file)"
    (path.parent / "file").touch()
    with pytest.raises(UserError, match=r"file/trials.sqlite can't be read and written \(File "):
        TrialStore(path.parent / "file" / "trials.sqlite")


def test_a_full_disk_is_said_and_keeps_what_was_there(path: Path) -> None:
    with stored(path) as store:
        store.add(ROWS[:2])
        store._connection.execute("PRAGMA max_page_count = 1")
        with pytest.raises(UserError, match=r"can't be read and written .*full"):
            store.add(ROWS)
        assert store.rows(KEYS) == dict(ROWS[:2])
    with stored(path) as store:
        assert store.rows(KEYS) == dict(ROWS[:2])


WRITER = """
import sys
from pathlib import Path
from chamfer.analysis.campaign.trial_store import TrialStore

path, first = Path(sys.argv[1]), int(sys.argv[2])
for i in range(first, first + 25):
    store = TrialStore(path)
    store.add([(bytes([i]) * 32, bytes([i]) * 5000)])
    store.close()
"""


def test_two_processes_may_write_at_once(path: Path) -> None:
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path), first],
            env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
            stderr=subprocess.PIPE,
            text=True,
        )
        for first in ("0", "25")
    ]
    for process in processes:
        _, err = process.communicate(timeout=60)
        assert (process.returncode, err) == (0, "")
    with stored(path) as store:
        assert store.rows(KEYS) == dict(ROWS)
