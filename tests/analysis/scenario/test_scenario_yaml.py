import time

import pytest

from chamfer.analysis.scenario.scenario_yaml import parse_value

BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]\n" for i in range(9)
)


def test_an_alias_stands_for_its_value() -> None:
    assert parse_value("{a: &a {b: [1, 2]}, c: *a}") == {"a": {"b": [1, 2]}, "c": {"b": [1, 2]}}
    assert parse_value("{a: &a {b: 1}, c: {<<: *a, d: 2}}")["c"] == {"b": 1, "d": 2}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "line 1: more than 10000 values, with each use of an alias counted"),
        ("&a [*a]", "line 1: more than 10000 values"),
        ("a: &a\n  <<: *a", "line 1: more than 10000 values"),
        ("!!timestamp abc", "line 1: could not determine a constructor for the tag"),
        ("!!bool abc", "'abc' is not true or false"),
        ("!!int []", "line 1: expected a scalar node"),
        ("[" * 3000, "nested too deeply"),
    ],
)
def test_what_is_no_plain_data_is_refused_at_once(text: str, message: str) -> None:
    begin = time.process_time()
    with pytest.raises(ValueError, match="^" + message.replace("(", "\\(")):
        parse_value(text)
    assert time.process_time() - begin < 5


def test_keys_are_texts_whatever_they_look_like() -> None:
    assert parse_value("{true: {a: true}, 1: 2, ~: x}") == {"true": {"a": True}, "1": 2, "~": "x"}
    with pytest.raises(ValueError, match="the key 'true' is given twice"):
        parse_value("{true: 1, 'true': 2}")
    assert parse_value("a: &one {x: 1}\nb: {<<: *one, y: 2}") == {
        "a": {"x": 1},
        "b": {"x": 1, "y": 2},
    }
