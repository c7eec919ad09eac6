from pathlib import Path

import pytest

from chamfer.analysis.report.size import main, sizes

CODE = '"""Says\nwhat."""\n\n\ndef one() -> int:\n    """Return 1."""\n    return 1\n'


def test_code_docstrings_and_tests_are_counted_by_room(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in ("models/arms/wam.py", "tests/models/arms/test_wam.py", "tests/conftest.py"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(CODE)
    assert sizes(tmp_path) == {
        "models/arms": {"docstrings": 3, "code": 4, "tests": 7},
        "tests": {"tests": 7},
    }
    main(tmp_path)
    assert capsys.readouterr().out.endswith("four packages: 7 lines, tests: 14\n")
