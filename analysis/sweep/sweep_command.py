"""The command ``chamfer sweep``: an experiment at many points of its scenario."""

import argparse
import time
from collections import Counter
from typing import Any

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, valid_integer


def add_sweep(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; scenario, folder, seed, trials' options and ``--json`` are left."""
    sweep: argparse.ArgumentParser = commands.add_parser(
        "sweep",
        help="run an experiment at many points of its scenario",
        description="Runs an experiment at many points of its scenario and writes OUT/sweep-NAME. "
        "The"
        " files points.csv and points.parquet have one row per point: fields, metrics, "
        "seed, number of broken specifications, and a status (ok, or the reason for no "
        "result). The file trials.parquet has one row per point and seed. A figure shows "
        "the metrics that change. A point that is refused or fails does not stop the "
        "others.",
    )
    sweep.add_argument("name", metavar="NAME", help="an experiment of `chamfer list`")
    sweep.add_argument(
        "--vary",
        action="extend",
        nargs="+",
        default=[],
        metavar="PATH=VALUES",
        help="a field and its values: PATH=a:b:n (n values from a to b), PATH=v1,v2,... or "
        "PATH~a:b (drawn from a to b)",
    )
    sweep.add_argument(
        "--design",
        choices=("grid", "sobol", "random"),
        help="grid: all combinations of the values. sobol and random: --points draws, evenly "
        "spread or independent (default: grid, or sobol if a field is drawn)",
    )
    sweep.add_argument("--points", metavar="N", help="number of drawn points (default: 64)")
    sweep.add_argument(
        "--trials",
        metavar="N",
        help="seeds per point, starting at --seed; metrics are means with 95 %% intervals "
        "(default: 1)",
    )
    sweep.add_argument(
        "--metric",
        action="extend",
        nargs="+",
        metavar="METRIC",
        help="what to keep and draw (default: keep all, draw those with the largest effects)",
    )
    sweep.set_defaults(command=_sweep)
    return sweep


def _sweep(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.command.session import command_campaign
    from chamfer.analysis.report.atomic_write import written
    from chamfer.analysis.report.report import write_report
    from chamfer.analysis.report.results import SWEEP, json_text
    from chamfer.analysis.sweep.sweep import MOST_TRIALS, make_plan, run_sweep
    from chamfer.analysis.sweep.sweep_design import MOST_POINTS, parse_vary
    from chamfer.analysis.sweep.sweep_files import folder_name, sweep_text, write_sweep

    vary = dict(parsed := list(map(parse_vary, arguments.vary)))
    if len(vary) < len(parsed):
        twice = Counter(path for path, _ in parsed).most_common(1)[0][0]
        raise UserError(f"{twice} is varied twice")
    plan = make_plan(
        arguments.name,
        vary,
        metrics=arguments.metric,
        trials=valid_integer("--trials", arguments.trials, 1, MOST_TRIALS) or 1,
        seed=arguments.seed,
        design=arguments.design,
        points=valid_integer("--points", arguments.points, 1, MOST_POINTS),
        settings=arguments.settings,
        scenario=arguments.scenario,
        catalogue=catalogue,
    )
    folder = arguments.out / folder_name(arguments.name)
    require_writable(arguments.out, [folder.name], SWEEP)
    started = time.perf_counter()
    with command_campaign(folder, f"sweep {arguments.name}", arguments) as progress:
        result = run_sweep(plan, progress)
        with written(folder):
            document = write_sweep(arguments.out, result, time.perf_counter() - started)
    report = write_report(arguments.out, catalogue)
    if arguments.json:
        print(json_text({**document, "folder": str(folder), "report": str(report)}), end="")
    else:
        print("\n".join(sweep_text(result, document)))
        print(f"points: {folder / 'points.csv'}\nreport: {report}")
    failed = result.counts["failed"] or not result.counts["ok"]
    return 1 if failed or (arguments.strict and result.broken) else 0
