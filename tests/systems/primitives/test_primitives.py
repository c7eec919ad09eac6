"""The list of all primitives."""

import importlib
import inspect
import pkgutil

import chamfer.systems.primitives
from chamfer.systems.primitives.skill import PRIMITIVES


def test_no_primitive_is_forgotten() -> None:
    found = set()
    for module in pkgutil.iter_modules(chamfer.systems.primitives.__path__):
        for name, one in vars(
            importlib.import_module(f"chamfer.systems.primitives.{module.name}")
        ).items():
            if inspect.isclass(one) and {"begin", "step", "label", "events"} <= vars(one).keys():
                found.add(name)
    assert found - {"Primitive"} == set(PRIMITIVES)
