import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.drawing.text import text_block, text_width, typeset, wrap


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("next_desired_position", "next desired position"),
        ("stiffness K_p", "stiffness K_p"),
        ("x_WC and y_position", "x_WC and y position"),
        ("q_1_2", "q 1 2"),
        ("", ""),
    ],
)
def test_underscores_are_spaces_but_in_subscripts(name: str, shown: str) -> None:
    assert typeset(name) == shown


def test_lines_are_filled_evenly() -> None:
    assert wrap("error outside the dead zone", 18) == ("error outside", "the dead zone")
    assert wrap("impedance control A(s)", 18) == ("impedance", "control A(s)")
    assert wrap("one\ntwo three", 18) == ("one", "two three")


@given(st.text("ab ", max_size=60), st.integers(1, 20))
def test_wrapping_keeps_the_words_and_the_limit(text: str, limit: int) -> None:
    lines = wrap(text, limit)
    assert " ".join(lines).split() == text.split()
    assert all(len(line) <= limit or " " not in line for line in lines)


def test_wide_letters_are_wide() -> None:
    assert text_width("WWW", 10) > text_width("aaa", 10) > text_width("iii", 10)
    assert text_width("K_p", 10) == text_width("Kp", 10)


def test_an_empty_label_takes_no_room() -> None:
    block = text_block("", size=11, limit=18)
    assert (block.lines, block.width, block.height) == ((), 0, 0)
