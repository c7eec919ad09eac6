"""The prose check finds what breaks the rules, and the project's own prose keeps them."""

import pytest
from docs._ext.prose import Text, breaches, sentences, words

LONG = " ".join(["word"] * 31) + "."


@pytest.mark.parametrize(
    ("sentence", "count"),
    [
        ("Run `chamfer list --all` first.", 3),
        ("A force of 3 N/m^2 at $x + y$.", 7),
    ],
)
def test_code_and_formulas_count_as_one_word(sentence: str, count: int) -> None:
    assert words(sentence) == count


def test_a_sentence_ends_neither_at_a_number_nor_at_an_abbreviation() -> None:
    said = "See Fig. 8 and eq. (2) of 0.5 m. The FSM settles (see below). `run` ends."
    assert [one.split()[0] for one in sentences(said)] == ["See", "The", "`run`"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (Text("a", (LONG,)), "a: 31 words, 30 allowed"),
        (Text("a", ("What is touched moves.",)), "free relative"),
        (Text("a", ("The arm bears a load.",)), "'bears', write"),
        (Text("a", ("All is well.",), ("How it ends",)), "a heading is a noun phrase"),
        (Text("a", (" ".join([" ".join(["Word"] * 22) + "."] * 5),)), "22.0 words a sentence"),
    ],
)
def test_each_rule_is_held(text: Text, said: str) -> None:
    (line,) = breaches(text)
    assert said in line


def test_plain_prose_passes() -> None:
    assert not list(breaches(Text("a", ("The arm stops at 5 N. You can raise the limit.",))))
