"""Every old name of a scenario's field is answered by one that is there."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import reduce
from typing import Any

import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Entry, load
from chamfer.analysis.scenario.scenario_io import make_scenario


def renamed(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield old and new paths of a scenario and of what it nests."""
    for ancestor in type(value).__mro__:
        for old, new in vars(ancestor).get("RENAMED", {}).items():
            yield f"{path}{old}", f"{path}{new}"
    for field in fields(value):
        if is_dataclass(inner := getattr(value, field.name)):
            yield from renamed(inner, f"{path}{field.name}.")


@pytest.mark.parametrize("entry", CATALOGUE.entries, ids=lambda entry: entry.name)
def test_old_names_are_answered(entry: Entry) -> None:
    scenario = load(entry).default
    for old, new in renamed(scenario):
        owner, _, name = new.rpartition(".")
        holder = reduce(getattr, owner.split("."), scenario) if owner else scenario
        assert holder is None or hasattr(holder, name)
        with pytest.raises(UserError) as caught:
            make_scenario(scenario, settings=[f"{old}=1"])
        assert f"{old} is now {new}" in str(caught.value).split(", ")
