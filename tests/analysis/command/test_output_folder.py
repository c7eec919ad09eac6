import errno
from pathlib import Path

import pytest

from chamfer.analysis.command.output_folder import require_writable
from chamfer.analysis.scenario.errors import UserError


def refused(out: Path, *names: str) -> str:
    with pytest.raises(UserError) as raised:
        require_writable(out, names)
    return str(raised.value)


def test_makes_the_folder_leaves_nothing_in_it_and_keeps_what_is_there(tmp_path: Path) -> None:
    fall = tmp_path / "a" / "fall"
    require_writable(fall.parent, ["fall"])
    assert list(fall.parent.iterdir()) == []
    fall.mkdir()
    (fall / "result.json").write_text("old")
    require_writable(fall.parent, ["fall"])
    assert [path.name for path in fall.iterdir()] == ["result.json"]


def test_a_file_in_place_of_an_experiments_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "fall").touch()
    assert refused(tmp_path, "fall") == (
        f"--out is {str(tmp_path)!r}, which can't be written because of fall "
        "(Not a directory), allowed: a folder"
    )


def test_a_read_only_file_system_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(self: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "touch", read_only)
    out = tmp_path / "a" / "b"
    assert refused(out) == (
        f"--out is {str(out)!r}, which can't be written (Read-only file system), allowed: a folder"
    )
