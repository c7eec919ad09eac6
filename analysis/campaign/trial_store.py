"""Finished trials on disk, so that a campaign does not run them twice."""

import hashlib
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from chamfer.analysis.report.console import say
from chamfer.analysis.scenario.errors import UserError

TRIALS: Final = "trials.sqlite"

_FORMAT: Final = 1  # of the tables; others are not read
_PATIENCE: Final = 30.0  # s, that another run may take to write
_SIDES: Final = ("", "-wal", "-shm", "-journal")  # files of one database


class TrialStore:
    """The encoded rows of finished trials by their keys, in an SQLite file.

    A key contains everything that a row depends on. Runs that share a file, one after the other or
    at once, can therefore only find the rows that they would have computed. A damaged file is
    replaced.

    Without a path nothing outlives the store; ``fresh`` starts with an empty one.

    Raises:
        UserError: If the file can't be read and written.
    """

    def __init__(self, path: Path | None, *, fresh: bool = False) -> None:
        self._path = path
        with self._named_errors():
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
            try:
                self._connection = self._open()
                if fresh:
                    self.keep(())
            except sqlite3.DatabaseError as error:
                self._begin_anew(error)

    def rows(self, keys: Iterable[bytes]) -> dict[bytes, bytes]:
        """Return the existing rows of some keys."""
        found: dict[bytes, bytes] = {}
        with self._named_errors():
            try:
                for key in keys:
                    query = "SELECT digest, row FROM trials WHERE key = ?"
                    for digest, row in self._connection.execute(query, (key,)):
                        if digest != _digest(row):
                            raise sqlite3.DatabaseError("a row is not what was written")
                        found[key] = row
            except sqlite3.DatabaseError as error:
                self._connection.close()
                self._begin_anew(error)
                return {}
        return found

    def add(self, rows: Sequence[tuple[bytes, bytes]]) -> None:
        """Write rows; when this returns they are on disk."""
        with self._named_errors(), self._connection:
            self._connection.executemany(
                "INSERT OR REPLACE INTO trials (key, digest, row) VALUES (?, ?, ?)",
                [(key, _digest(row), row) for key, row in rows],
            )

    def keep(self, keys: Iterable[bytes]) -> None:
        """Drop all rows but those of some keys."""
        with self._named_errors(), self._connection:
            self._connection.execute("CREATE TEMPORARY TABLE kept (key BLOB PRIMARY KEY)")
            self._connection.executemany(
                "INSERT OR IGNORE INTO kept VALUES (?)", [(key,) for key in keys]
            )
            self._connection.execute("DELETE FROM trials WHERE key NOT IN kept")
            self._connection.execute("DROP TABLE kept")

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def _open(self) -> sqlite3.Connection:
        connection = sqlite3.connect(
            ":memory:" if self._path is None else self._path, timeout=_PATIENCE
        )
        try:
            connection.execute("PRAGMA synchronous = FULL")
            (found,) = connection.execute("PRAGMA user_version").fetchone()
            if found not in (0, _FORMAT):
                raise sqlite3.DatabaseError(f"it has format {found}, this is {_FORMAT}")
            if not found:
                connection.executescript(
                    "CREATE TABLE IF NOT EXISTS trials "
                    "(key BLOB PRIMARY KEY, digest BLOB NOT NULL, row BLOB NOT NULL);"
                    f"PRAGMA user_version = {_FORMAT}"
                )
        except BaseException:
            connection.close()
            raise
        return connection

    def _begin_anew(self, error: sqlite3.DatabaseError) -> None:
        """Replace a file with damaged content; a subclass of the error means access or space."""
        if type(error) is not sqlite3.DatabaseError:
            raise error
        say(f"{self._path} can't be read ({error}), its trials are run again")
        if self._path is not None:
            for side in _SIDES:
                self._path.with_name(self._path.name + side).unlink(missing_ok=True)
        self._connection = self._open()

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            reason = getattr(error, "strerror", None) or error
            raise UserError(f"{self._path} can't be read and written ({reason})") from error


def _digest(row: bytes) -> bytes:
    return hashlib.blake2b(row, digest_size=8).digest()
