import json
from collections.abc import Callable

import pytest

from chamfer.analysis.report.console import wrapped_table

Chamfer = Callable[..., tuple[int, str, str]]


def test_fields_as_a_table(chamfer: Chamfer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "48")
    assert chamfer("fields", "fall", "b")[1].splitlines() == [
        "field      default  unit  meaning    allowed",
        "body.      2.0      kg    of what    a finite",
        "  mass                      falls      number",
        "                                       > 0",
        "body.      ball           of the     ball,",
        "  form                      body       plate",
    ]


def test_fields_as_json_have_these_keys(chamfer: Chamfer) -> None:
    assert json.loads(chamfer("fields", "fall", "--json")[1])[-1] == {
        "path": "step",
        "default": None,
        "unit": "s",
        "meaning": "null: 0.1",
        "allowed": "a finite number or null",
    }


def test_cells_are_wrapped_into_the_width_and_no_word_is_broken() -> None:
    lines = wrapped_table([("a.long.path", "some words here"), ("b", "unbreakable")], 20)
    assert lines == [
        "a.       some words",
        "  long.    here",
        "  path",
        "b        unbreakable",
    ]
    assert wrapped_table([("a", "b c")], 20) == ["a  b c"]
