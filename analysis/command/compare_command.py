"""The command ``chamfer compare``: two results side by side."""

import argparse
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue

_MISSING: Final = "absent"


def add_compare(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; ``--json`` is left to be added."""
    compare: argparse.ArgumentParser = commands.add_parser(
        "compare",
        help="compare two results",
        description="Shows the fields of the scenario and the metrics in which two results "
        "differ.",
    )
    for which in ("first", "second"):
        compare.add_argument(
            which, type=Path, metavar="DIR", help=f"the {which} result's folder, such as out/NAME"
        )
    compare.set_defaults(command=_compare)
    return compare


def _compare(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.report.results import json_text

    folders = (arguments.first, arguments.second)
    first, second = map(_read, folders)
    document = comparison(first, second)
    if arguments.json:
        results = {"first": str(folders[0]), "second": str(folders[1])}
        print(json_text({**results, **document}), end="")
    else:
        print("\n".join(_text(document, folders)))
    return 0


def comparison(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Return what differs between two results' documents.

    Fields and metrics are by name, each with its value in the ``first`` and the ``second``. What
    one of them doesn't have is left out there; a metric that is undefined is None.
    """
    both = (first, second)
    units = {name: str(one["unit"]) for each in both for name, one in each["metrics"].items()}
    values = [{name: _value(one) for name, one in each["metrics"].items()} for each in both]
    metrics = _differing(*values)
    for name, pair in metrics.items():
        pair["unit"] = units[name]
        if pair.get("first") is not None and pair.get("second") is not None:
            difference = pair["second"] - pair["first"]
            pair["difference"] = difference if math.isfinite(difference) else None
    fields = _differing(*map(_fields, both))
    return {
        "fields": fields,
        "metrics": metrics,
        "same_metrics": len(units) - len(metrics),
        "specifications": _limits(*both),
    }


def _limits(*both: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what the results say of each specification: kept or broken."""
    from chamfer.analysis.report.check_text import LIMIT, relation, verdict_text

    found: dict[str, dict[str, Any]] = {}
    for side, document in zip(("first", "second"), both, strict=True):
        for check in document.get("checks", ()):
            if check["kind"] == LIMIT:
                asked = f"{check['metric']} {relation(check)} {check['unit']}".strip()
                found.setdefault(asked, {})[side] = verdict_text(check)
    return found


def _value(metric: Mapping[str, Any]) -> float | None:
    return None if metric["value"] is None else float(metric["value"])


def _fields(result: Mapping[str, Any]) -> dict[str, Any]:
    from chamfer.analysis.report.results import nested_values

    above = {"experiment": result["experiment"], "seed": result["seed"]}
    return dict(nested_values({**above, **result["scenario"]}))


def _differing(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    sides = {"first": first, "second": second}
    pairs = {
        name: {side: values[name] for side, values in sides.items() if name in values}
        for name in {**first, **second}
    }
    return {
        name: pair
        for name, pair in pairs.items()
        if len(pair) < len(sides) or pair["first"] != pair["second"]
    }


def _read(folder: Path) -> dict[str, Any]:
    from chamfer.analysis.report.results import RESULT, read_result

    path = folder / RESULT
    try:
        document = read_result(path)
        comparison(document, document)  # whether it has what it takes
    except OSError as error:
        raise UserError(
            f"{path}: {error.strerror or error}, allowed: the folder of a result, such as out/NAME"
        ) from error
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError) as error:
        raise UserError(f"{path}: not a result of chamfer run") from error
    return document


def _text(document: Mapping[str, Any], folders: tuple[Path, Path]) -> Iterator[str]:
    from chamfer.analysis.report.check_text import number
    from chamfer.analysis.report.console import table
    from chamfer.analysis.scenario.scenario_io import value_text

    names = list(map(str, folders))
    if document["fields"]:
        yield from table(
            [
                ("field", *names),
                *((path, *_sides(pair, value_text)) for path, pair in document["fields"].items()),
            ]
        )
    else:
        yield "no field differs"
    yield ""
    if document["metrics"]:
        rows = [("metric", *names, "difference", "relative", "unit")]
        for name, pair in document["metrics"].items():
            difference = pair.get("difference")
            relative = _relative(difference, pair.get("first"))
            sides = _sides(pair, number)
            rows.append((name, *sides, number(difference), relative, pair["unit"]))
        yield from table(rows, right=(1, 2, 3, 4))
    yield f"{document['same_metrics']} metrics are the same"
    limits = document["specifications"]
    broken = [
        (name, *_sides(pair, str))
        for name, pair in limits.items()
        if _sides(pair, str) != ("kept", "kept")
    ]
    if broken:
        yield from ["", *table([("specification", *names), *broken])]
    if limits:
        yield f"{len(limits) - len(broken)} of {len(limits)} specifications are kept in both"


def _sides(pair: Mapping[str, Any], text: Callable[[Any], str]) -> tuple[str, str]:
    first, second = (text(pair[s]) if s in pair else _MISSING for s in ("first", "second"))
    return first, second


def _relative(difference: float | None, first: float | None) -> str:
    if difference is None or not first:
        return "-"
    share = 100 * difference / abs(first)
    return f"{share:+.3g} %" if math.isfinite(share) else "-"
