"""The list of all primitives."""

import importlib
import inspect
import pkgutil

import systems.skills
from systems.skills.primitives import PRIMITIVES


def test_no_primitive_is_forgotten() -> None:
    found = set()
    for module in pkgutil.iter_modules(systems.skills.__path__):
        for name, one in vars(importlib.import_module(f"systems.skills.{module.name}")).items():
            if inspect.isclass(one) and {"begin", "step", "label", "events"} <= vars(one).keys():
                found.add(name)
    assert found - {"Primitive"} == set(PRIMITIVES)
