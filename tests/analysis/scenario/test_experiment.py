"""The catalogue's entries: what they are called, which are chosen, what they load."""

import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, Entry, load, select


def entry(name: str, **fields: str) -> Entry:
    given = {"paper": "p", "summary": "s", "module": "math", "scenario": "pi", "run": "sin"}
    return Entry(name=name, **{**given, "plot": "cos", **fields})  # type: ignore[arg-type]


def test_names_are_unique() -> None:
    with pytest.raises(UserError, match="two experiments are named 'a'"):
        Catalogue(entries=(entry("a"), entry("b"), entry("a")), published="none")


@pytest.mark.parametrize("name", ["", "A", "a--b", "a-", "a/b", "a b"])
def test_names_become_folders(name: str) -> None:
    with pytest.raises(UserError, match="allowed: lower-case letters, digits and single dashes"):
        entry(name)
    with pytest.raises(UserError, match="paper is"):
        entry("a", paper=name)


def test_some_are_chosen_in_the_order_that_they_are_asked_for() -> None:
    entries = [entry("a"), entry("b"), entry("c")]
    assert [one.name for one in select(entries, ["c", "a", "c"])] == ["c", "a"]
    with pytest.raises(UserError, match="unknown experiment 'aa', did you mean 'a'"):
        select(entries, ["aa"])


def test_names_are_of_the_module_or_say_their_own() -> None:
    found = load(entry("a", run="cmath:sin", plot="cos"))
    import cmath
    import math

    assert (found.default, found.run, found.plot) == (math.pi, cmath.sin, math.cos)
    assert found.diagram is None
