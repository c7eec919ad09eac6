"""The command ``chamfer replay``: what a controller would have done with what a log saw."""

import argparse
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.scenario.experiment import Catalogue, select

FOLDER: Final = "replay"


def add_replay(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the scenario's options, the folder and ``--json`` are left to be added."""
    replay: argparse.ArgumentParser = commands.add_parser(
        "replay",
        help="feed a log to the same controllers again",
        description="Feeds what controllers saw, in a log of `chamfer run --log` or of a robot, "
        "to an experiment's controllers, and compares what they command with what is logged. The "
        "scenario is the log's unless there is a file; --set asks what another one would have "
        "done. A robot's log is Parquet or CSV with columns such as 'observation.error[0] (m)'. "
        "Writes OUT/NAME/replay: result.json, a figure and a table for each controller.",
    )
    replay.add_argument("name", metavar="NAME", help="an experiment of `chamfer list`")
    replay.add_argument("log", type=Path, metavar="LOG", help="a log, or a folder of logs")
    replay.add_argument(
        "--controller",
        metavar="PATH",
        help="which controller, by its path in the block diagram or the end of it",
    )
    replay.add_argument(
        "--strict", action="store_true", help="end with status 1 if a step differs"
    )
    replay.set_defaults(command=_replay)
    return replay


def _replay(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.replay.replay_logs import replay_files, replay_logs, replay_text
    from chamfer.analysis.report.atomic_write import written
    from chamfer.analysis.report.results import RESULT, json_text, write_folder

    (entry,) = select(catalogue.entries, [arguments.name])
    replays = replay_logs(
        entry,
        arguments.log,
        controller=arguments.controller,
        file=arguments.scenario,
        settings=arguments.settings,
    )
    document, files = replay_files(replays)
    require_writable(arguments.out, [entry.name])
    folder = arguments.out / entry.name / FOLDER
    with written(folder):
        write_folder(folder, {**files, RESULT: json_text(document)})
    if arguments.json:
        print(json_text({**document, "folder": str(folder)}), end="")
    else:
        print("\n".join([*replay_text(document), f"figures and tables: {folder}"]))
    return 1 if arguments.strict and document["metrics"]["replay.mismatches"]["value"] else 0
