"""The command ``chamfer fields``: what an experiment's scenario is made of."""

import argparse
import json
import shutil
from collections.abc import Callable
from typing import Any, Final, TypeVar

from chamfer.analysis.scenario.experiment import Catalogue, load, select

T = TypeVar("T")

_HEADER: Final = ("field", "default", "unit", "meaning", "allowed")
_WHOLE: Final = "a preset of the whole scenario; what else is set goes on top"
_COLUMNS: Final = 100  # where the terminal's width is not known


def add_fields(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; ``--json`` is left to be added."""
    fields: argparse.ArgumentParser = commands.add_parser(
        "fields",
        help="list the fields of an experiment's scenario",
        description="Lists the fields that --set and --scenario take: default, unit, meaning and "
        "allowed values. A default of null is derived from other fields; its value is in "
        "brackets. For the fields of a design use `chamfer design NAME --fields`.",
    )
    fields.add_argument("name", metavar="NAME", help="an experiment of `chamfer list`")
    fields.add_argument(
        "prefix",
        metavar="PREFIX",
        nargs="?",
        default="",
        help="only fields that begin with this text, such as plant or controller.st",
    )
    fields.set_defaults(command=_fields)
    return fields


def print_fields(scenario: T, resolve: Callable[[T], T], *, prefix: str, as_json: bool) -> None:
    """Print the fields, whose path begins so, of a scenario of defaults that is not resolved.

    Raises:
        UserError: If no field begins with the prefix.
    """
    from chamfer.analysis.command.scenario_fields import allowed, default_texts, leaves, matching
    from chamfer.analysis.report.console import wrapped_table
    from chamfer.analysis.scenario.scenario_io import unstructure

    whole = {
        word: ", ".join(presets)
        for word, presets in getattr(type(scenario), "WHOLE", {}).items()
        if word.startswith(prefix)
    }
    chosen = [] if prefix in whole else matching(list(leaves(scenario)), prefix)
    if as_json:
        described = [
            {"path": word, "default": None, "unit": "", "meaning": _WHOLE, "allowed": names}
            for word, names in whole.items()
        ]
        described += [
            {
                "path": leaf.path,
                "default": unstructure(leaf.value),
                "unit": leaf.unit,
                "meaning": leaf.meaning,
                "allowed": allowed(scenario, leaf),
            }
            for leaf in chosen
        ]
        print(json.dumps(described))
        return
    texts = default_texts(scenario, resolve)
    rows = [(word, "null", "", _WHOLE, names) for word, names in whole.items()]
    rows += [
        (leaf.path, texts[leaf.path], leaf.unit, leaf.meaning, allowed(scenario, leaf))
        for leaf in chosen
    ]
    width = shutil.get_terminal_size((_COLUMNS, 0)).columns
    print("\n".join(wrapped_table([_HEADER, *rows], width)))


def _fields(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    (entry,) = select(catalogue.entries, [arguments.name])
    experiment = load(entry)
    default, resolve = experiment.default, experiment.resolve
    print_fields(default, resolve, prefix=arguments.prefix, as_json=arguments.json)
    return 0
