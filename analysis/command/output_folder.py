"""Finds out whether results can be written before anything runs."""

import secrets
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from chamfer.analysis.scenario.errors import UserError


def require_writable(out: Path, names: Sequence[str]) -> None:
    """Make ``out`` if it isn't there, and write and remove a file in it and in named folders.

    Permission bits say little (root ignores them, a read-only file system has its own mind), so
    it is tried. Folders that had to be made for a trial that fails are removed again.

    Raises:
        UserError: If a folder can't be made or written.
    """
    made: list[Path] = []
    folder = out
    try:
        for folder in (out, *(out / name for name in names if (out / name).exists())):
            _make(folder, made)
            trial = folder / f".chamfer-{secrets.token_hex(6)}"
            trial.touch(exist_ok=False)
            trial.unlink()
    except OSError as error:
        for empty in reversed(made):
            with suppress(OSError):
                empty.rmdir()
        raise UserError(_message(out, folder, error)) from error


def _make(folder: Path, made: list[Path]) -> None:
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        made.append(folder)


def _message(out: Path, folder: Path, error: OSError) -> str:
    inside = "" if folder == out else f" because of {folder.name}"
    reason = error.strerror or str(error)
    return f"--out is {str(out)!r}, which can't be written{inside} ({reason}), allowed: a folder"
