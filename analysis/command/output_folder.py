"""Finds out whether results can be written before anything runs."""

import secrets
from collections.abc import Sequence
from pathlib import Path

from chamfer.analysis.report.console import say
from chamfer.analysis.scenario.errors import UserError


def require_writable(out: Path, names: Sequence[str], result: str = "") -> None:
    """Make ``out`` if it isn't there, and try to write a file in it and in named folders.

    Permission bits say little: root ignores them, and a file system may be read-only. Where one
    of the folders has a ``result``, it is said that this is replaced.

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
        say(f"files in {', '.join(replaced)} are replaced")
