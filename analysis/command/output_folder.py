"""Finds out whether results can be written before anything runs."""

import secrets
from collections.abc import Sequence
from pathlib import Path

from chamfer.analysis.report.console import say
from chamfer.analysis.scenario.errors import UserError


def require_writable(out: Path, names: Sequence[str], result: str = "") -> None:
    """Make ``out`` if it isn't there, and write and remove a file in it and in named folders.

    Where one of them has a result, a file of that name, it is said that this is replaced.

    Permission bits say little (root ignores them, a read-only file system has its own mind), so
    it is tried.

    Raises:
        UserError: If a folder can't be made or written.
    """
    folder = out
    try:
        if not out.exists():
            out.mkdir(parents=True, exist_ok=True)
        for folder in (out, *(out / name for name in names if (out / name).exists())):
            trial = folder / f".chamfer-{secrets.token_hex(6)}"
            trial.touch(exist_ok=False)
            trial.unlink()
    except OSError as error:
        inside = "" if folder == out else f" because of {folder.name}"
        reason = f"can't be written{inside} ({error.strerror or error})"
        raise UserError(f"--out is {str(out)!r}, which {reason}, allowed: a folder") from error
    replaced = [str(out / name) for name in names if result and (out / name / result).exists()]
    if replaced:
        say(f"what is in {', '.join(replaced)} is replaced")
