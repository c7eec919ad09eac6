"""The command ``chamfer replay``: feeds a log to its controller again."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.scenario.experiment import Catalogue, select

FOLDER: Final = "replay"


def add_replay(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command, without the scenario's options, the folder and ``--json``."""
    replay: argparse.ArgumentParser = commands.add_parser(
        "replay",
        help="feed a log to the same controllers again",
        description="Feeds logged observations to an experiment's controllers and compares their "
        "commands with the logged ones. The log comes from `chamfer run --log` or from a robot. "
        "The scenario is the log's, unless you give a file; with --set you see what the "
        "controllers would have commanded with other parameters. A robot's log is Parquet or "
        "CSV with columns such as 'observation.error[0] (m)'. Writes OUT/NAME/replay: "
        "result.json, a figure and a table for each controller.",
    )
    replay.add_argument("name", metavar="NAME", help="an experiment of `chamfer list`")
    replay.add_argument("log", type=Path, metavar="LOG", help="a log, or a folder of logs")
    replay.add_argument(
        "--controller",
        metavar="PATH",
        help="the controller, by its path in the block diagram or the end of that path",
    )
    replay.add_argument(
        "--strict", action="store_true", help="end with status 1 if a step differs"
    )
    replay.set_defaults(command=_replay)
    return replay


def _replay(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.replay.replay import replay_logs
    from chamfer.analysis.replay.replay_figure import replay_figure
    from chamfer.analysis.report.atomic_write import written
    from chamfer.analysis.report.results import (
        RESULT,
        figure_captions,
        figure_files,
        json_text,
        write_folder,
    )
    from chamfer.analysis.report.traces import table_bytes

    (entry,) = select(catalogue.entries, [arguments.name])
    document, found = replay_logs(
        entry,
        arguments.log,
        controller=arguments.controller,
        file=arguments.scenario,
        settings=arguments.settings,
    )
    plots = {name: replay_figure(one) for name, one in found.items()}
    drawn = figure_files(plots)
    document |= {"figures": list(drawn), "captions": figure_captions(plots)}
    tables = {name: one.side_by_side() for name, one in found.items()}
    files = {f"{name}.parquet": table_bytes(one, infinite=True) for name, one in tables.items()}
    require_writable(arguments.out, [entry.name])
    folder = arguments.out / entry.name / FOLDER
    with written(folder):
        folder.parent.mkdir(exist_ok=True)
        write_folder(folder, {**files, **drawn, RESULT: json_text(document)})
    differ = document["metrics"]["replay.mismatches"]["value"]
    if arguments.json:
        print(json_text({**document, "folder": str(folder)}), end="")
    else:
        print("\n".join(map(_line, document["controllers"])))
        if differ:
            print("open loop: after a difference the controller would have met something else")
        print(f"figures and tables: {folder}")
    return 1 if arguments.strict and differ else 0


def _line(found: Mapping[str, Any]) -> str:
    """Return the result of a controller's replay in a line."""
    first, state = found["first_difference"], found["states_differ"]
    said = "no commands in the log" if found["mismatches"] is None else "none differs"
    if first:
        said = f"{found['mismatches']} differ, first at {_told(first)}"
    if state and state != first:
        said += f"; states differ from {_told(state)}"
    return f"{found['controller']} ({found['log']}): {found['steps']} steps, {said}"


def _told(one: Mapping[str, Any]) -> str:
    logged, replayed = (f"{one[side]} {one['unit']}".rstrip() for side in ("logged", "replayed"))
    return f"{one['time']:.9g} s: {one['column']} is {logged} in the log, {replayed} replayed"
