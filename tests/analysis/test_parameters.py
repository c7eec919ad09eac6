"""What the parameters of all blocks, parts and loops refuse alike: what is no number."""

import importlib
import math
import pkgutil
from dataclasses import fields, is_dataclass, replace
from itertools import chain
from typing import Any

import pytest

import chamfer.diagrams
import chamfer.models
import chamfer.systems
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import load
from chamfer.diagrams.skills.vision_servo import NAMES, VisionServoScenario
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.position_primitives import Centre
from chamfer.systems.primitives.trajectory_primitives import Dither

# By the class: whoever holds it checks.
UNCHECKED = {
    "CellErrorParams.latency",
    "ContactArmSettings.contact_offset",
    *("ControllerSettings.computation_delay", "ControllerSettings.computation_jitter"),
    *(f"HybridStabilityScenario.{name}" for name in ("viscous", "start", "direction")),
    "ViewFrames",
    "FsmRule",
}


def inside(example: Any) -> dict[type, Any]:
    """Return the dataclasses in an example, each by its class."""
    found = {type(example): example}
    for one in fields(example):
        value = getattr(example, one.name)
        if is_dataclass(value):
            found |= inside(value)
    return found


def examples() -> dict[type, Any]:
    """Return one of each class: with its defaults, else out of a scenario."""
    found: dict[type, Any] = {}
    packages = (chamfer.models, chamfer.systems, chamfer.diagrams)
    for module in chain(*(pkgutil.walk_packages(p.__path__, p.__name__ + ".") for p in packages)):
        for kind in vars(importlib.import_module(module.name)).values():
            if is_dataclass(kind) and isinstance(kind, type) and hasattr(kind, "__post_init__"):
                try:
                    found[kind] = kind()
                except (TypeError, ParameterError):  # has no defaults
                    continue
    given = [Centre(dither=Dither()), DConnector().plug_section]
    given += [VisionServoScenario(primitive=name).parameters for name in NAMES]
    given += [load(entry).default for entry in CATALOGUE.entries]
    for one in given:
        found = inside(one) | found
    return {kind: one for kind, one in found.items() if kind.__name__[0] != "_"}


EXAMPLES = examples()


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__qualname__)
def test_what_is_no_number_is_named(kind: type) -> None:
    for one in fields(EXAMPLES[kind]):
        value = getattr(EXAMPLES[kind], one.name)
        if not UNCHECKED.isdisjoint((kind.__name__, f"{kind.__name__}.{one.name}")):
            continue
        broken: Any = math.nan
        if isinstance(value, tuple) and value and isinstance(value[0], float):
            broken = (math.nan, *value[1:])
        elif not (isinstance(value, float) or str(one.type) == "float | None"):
            continue
        with pytest.raises(ParameterError) as refused:
            replace(EXAMPLES[kind], **{one.name: broken})
        assert one.name in refused.value.name
