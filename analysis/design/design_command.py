"""The command ``chamfer design``: verdict on a cell, limiting link, and what to change."""

import argparse
import time
from typing import Any, Final

from chamfer.analysis.scenario.experiment import Catalogue, valid_integer

_DESIGNS: Final = ("insertion",)


def add_design(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command, without the options for scenario, folder, seed, trials and ``--json``."""
    design: argparse.ArgumentParser = commands.add_parser(
        "design",
        help="predict whether an insertion succeeds, what limits it and what to change",
        description="Checks camera, compensation, arms, support and parts as one chain. Each link "
        "has a bound, an allowed value and a margin in its own unit; the smallest margin "
        "limits the design. The verdict is certain (all bounds are inside their limits), "
        "likely (with the share of drawn errors that pass) or no. If it is certain, the "
        "command simulates insertions as a check. It also shows how the smallest margin "
        "depends on each field, and the smallest change, or pair of changes, that makes "
        "the design certain. "
        "Writes OUT/design-NAME: result.json, scenario.yaml, design.html (one page, one "
        "A4 sheet), and with --map map.parquet and its figure.",
        allow_abbrev=False,
    )
    design.add_argument("name", metavar="NAME", choices=_DESIGNS, help=", ".join(_DESIGNS))
    design.add_argument(
        "--no-changes",
        action="store_true",
        help="skip the search for changes, which takes most of the time",
    )
    design.add_argument(
        "--map",
        nargs=2,
        default=[],
        metavar="PATH:a:b",
        help="draw the verdict over two fields, each from a to b, at 41 x 41 points",
    )
    verify = design.add_mutually_exclusive_group()
    verify.add_argument(
        "--verify",
        metavar="N",
        help="simulate N insertions with drawn errors and compare them with the prediction "
        "(default: 4 if the design is certain)",
    )
    verify.add_argument("--no-verify", action="store_true", help="simulate no insertion")
    design.add_argument(
        "--fields",
        nargs="?",
        const="",
        metavar="PREFIX",
        help="only list the fields that --set and --scenario take, as `chamfer fields` does: "
        "those of the experiment, and spread.*, draws and pictures of the drawn errors",
    )
    design.set_defaults(command=_design)
    return design


def _design(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.command.fields_command import print_fields
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.command.running import given_scenario, named_failures
    from chamfer.analysis.command.session import command_campaign
    from chamfer.analysis.design.design import MOST_TRIALS
    from chamfer.analysis.design.design_answer import (
        answer,
        design_document,
        write_design,
    )
    from chamfer.analysis.design.design_map import POINTS, parse_map
    from chamfer.analysis.design.design_scenario import DesignScenario, resolve_design
    from chamfer.analysis.design.design_words import design_text
    from chamfer.analysis.report.atomic_write import written
    from chamfer.analysis.report.report import write_report
    from chamfer.analysis.report.results import RESULT, json_text
    from chamfer.analysis.scenario.scenario_overrides import overrides

    name, default = arguments.name, DesignScenario()
    given, resolved = given_scenario(
        name, default, resolve_design, file=arguments.scenario, settings=arguments.settings
    )
    if arguments.fields is not None:
        print_fields(given, resolve_design, prefix=arguments.fields, as_json=arguments.json)
        return 0
    trials = valid_integer("--verify", arguments.verify, 1, MOST_TRIALS)
    if arguments.no_verify:
        trials = 0
    axes = parse_map(resolved, arguments.map, POINTS) if arguments.map else None
    asked = tuple(overrides(given, default, resolve_design))
    folder = arguments.out / f"design-{name}"
    require_writable(arguments.out, [folder.name], RESULT)
    started = time.perf_counter()
    with command_campaign(folder, f"design {name}", arguments) as progress:
        with named_failures(name, asked):
            found = answer(
                given,
                what_to_change=not arguments.no_changes,
                axes=axes,
                trials=trials,
                seed=arguments.seed,
                progress=progress,
            )
        document = design_document(
            name, found, overrides=asked, wall_seconds=time.perf_counter() - started
        )
        with written(folder):
            write_design(folder, found, document)
    report = write_report(arguments.out, catalogue)
    if arguments.json:
        print(json_text({**document, "folder": str(folder), "report": str(report)}), end="")
    else:
        print("\n".join(design_text(document)))
        print(f"page: {folder / document['page']}\nreport: {report}")
    return 1 if found.verified is not None and found.verified.failed_trials else 0
