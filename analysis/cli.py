"""The command ``chamfer``.

What is heavy is imported where it is used: listing and help answer at once.
"""

import argparse
import re
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

from chamfer.analysis.calibration.calibrate_command import add_calibrate
from chamfer.analysis.campaign.one_thread import use_one_thread
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.compare_command import add_compare
from chamfer.analysis.command.fields_command import add_fields
from chamfer.analysis.command.standard_streams import OutputError, discard_output, prepare_streams
from chamfer.analysis.command.view_command import add_view
from chamfer.analysis.design.design_command import add_design
from chamfer.analysis.drive.drive_command import add_drive, driven
from chamfer.analysis.export.export_command import add_export
from chamfer.analysis.identify.identify_command import add_identify
from chamfer.analysis.replay.replay_command import add_replay
from chamfer.analysis.report.console import plain_warnings, say
from chamfer.analysis.scenario.errors import ExperimentError, UserError, valid_name
from chamfer.analysis.scenario.experiment import Catalogue, Entry, select, valid_integer
from chamfer.analysis.sweep.sweep_command import add_sweep
from chamfer.analysis.track.track_command import add_track

if TYPE_CHECKING:
    from chamfer.analysis.command.session import Session

_MISTAKE: Final = 2  # exit statuses
_ERROR: Final = 1
_INTERRUPTED: Final = 130
_PIPE_CLOSED: Final = 141
_LARGEST_SEED: Final = 2**32 - 1  # what Drake's random sources take


def main(argv: Sequence[str] | None = None, *, catalogue: Catalogue = CATALOGUE) -> int:
    """Run the command line and return the exit status.

    Args:
        argv: The arguments after the command's name, those of the process unless given.
        catalogue: Where the experiments are.
    """
    use_one_thread()
    prepare_streams()
    try:
        with _terminated_as_interrupted(), plain_warnings():
            try:
                arguments = _parser().parse_args(argv)
                status: int = arguments.command(arguments, catalogue)
            finally:
                sys.stdout.flush()
            return status
    except UserError as error:
        say(str(error))
        return _MISTAKE
    except ExperimentError as error:
        say(str(error))
        return _ERROR
    except (KeyboardInterrupt, SystemError) as error:
        if not _interrupted(error):
            raise
        say("interrupted; finished experiments and trials are kept")
        return _INTERRUPTED
    except OutputError as error:
        discard_output()
        if isinstance(error.__cause__, BrokenPipeError):
            return _PIPE_CLOSED
        say(f"standard output can't be written: {error}")
        return _ERROR


def _interrupted(error: BaseException | None) -> bool:
    """Return whether it is an interrupt, also one that reached compiled code as it was loaded."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None


class _Parser(argparse.ArgumentParser):
    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **{"allow_abbrev": False, **named})
        self.register("action", None, _Once)

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}, see {self.prog} --help")


class _Once(argparse.Action):
    """Stores a value, and refuses an option's second one, which would silently win."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        given = vars(namespace).setdefault("given", set())
        if option_string is not None and self.dest in given:
            parser.error(f"{option_string} is given twice")
        given.add(self.dest)
        setattr(namespace, self.dest, values)


class _Version(argparse.Action):
    def __call__(self, *_: Any, **__: Any) -> None:
        from importlib.metadata import PackageNotFoundError, version

        try:
            print(f"chamfer {version('chamfer')}")
        except PackageNotFoundError:
            print("chamfer, not installed as a package")
        raise SystemExit(0)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="chamfer",
        description="Simulates published experiments on compliant assembly and compares the "
        "measured "
        "numbers with the published ones.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    listing = commands.add_parser("list", help="list the experiments")
    listing.set_defaults(command=_list)
    fields = add_fields(commands)

    run = commands.add_parser("run", help="run experiments by name")
    run.add_argument("names", nargs="+", metavar="NAME", help="an experiment of `chamfer list`")
    run.add_argument(
        "--log",
        action="store_true",
        help="also write the inputs and outputs of each controller, for `chamfer replay`",
    )
    run.set_defaults(command=_run)
    sweep, design, compare = add_sweep(commands), add_design(commands), add_compare(commands)
    drive = add_drive(commands)
    drive.set_defaults(command=_run)

    reproduce = commands.add_parser(
        "reproduce",
        help="run the papers' experiments with their default scenarios",
        description="Runs the papers' figures and tables with their default scenarios. With "
        "--studies"
        " it runs the studies beyond them, which takes longer. Results of an earlier run "
        "with the same sources and seed are kept. An experiment that fails does not stop "
        "the others. OUT/results.md has a table of all checks.",
    )
    reproduce.add_argument("--paper", metavar="PAPER", help="only the experiments of this paper")
    reproduce.add_argument(
        "--studies",
        action="store_true",
        help="run the studies instead: maps, campaigns, ablations, accuracy",
    )
    reproduce.set_defaults(command=_reproduce)

    diagram = commands.add_parser(
        "diagram",
        help="draw an experiment's block diagram",
        description="Draws an experiment's block diagram as OUT/NAME/diagram.svg and as Mermaid "
        "text,"
        " diagram.mmd. No other program is needed.",
    )
    diagram.add_argument("name", metavar="NAME", help="an experiment of `chamfer list`")
    diagram.add_argument("--chart", action="store_true", help="also draw its state charts")
    diagram.set_defaults(command=_diagram)

    export, view = add_export(commands), add_view(commands)
    track, calibrate = add_track(commands), add_calibrate(commands)
    replay, identify = add_replay(commands), add_identify(commands)
    for command in (run, sweep, design, drive, diagram, export, view, track, replay):
        _add_scenario(command)
    results = (run, sweep, design, drive, reproduce, track, calibrate, replay, identify)
    for command in (*results, diagram, export):
        _add_out(command)
    for command in (run, sweep, design, drive, reproduce, view):
        _add_seed(command)
    for command in (run, sweep, design, reproduce):
        _add_trials(command)
    for command in (run, sweep, reproduce):
        command.add_argument(
            "--strict",
            action="store_true",
            help="end with status 1 if a specification is broken: a limit of the task, the arm or "
            "the parts",
        )
    for command in (*results, listing, fields, compare):
        _add_json(command)
    return parser


def _add_scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenario",
        type=Path,
        metavar="FILE",
        help="a YAML file of fields that differ from the defaults, or the scenario.yaml or "
        "result.json of a run",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="settings",
        metavar="path=value",
        help="override one field, such as plant.mass=2; can be repeated",
    )


def _add_out(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, default=Path("out"), help="folder of the results (default: out)"
    )


def _add_seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=_seed, default="0", help="random seed (default: 0)")


def _add_trials(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--workers",
        type=_workers,
        metavar="N",
        help="number of processes (default: one per core); results do not depend on it",
    )
    parser.add_argument(
        "--cluster",
        type=_cluster,
        metavar="ADDRESS",
        help="run trials on a Dask cluster: tcp://HOST:PORT of its scheduler, or local",
    )
    parser.add_argument(
        "--fresh",
        action="store_true",
        help="run finished experiments and trials again, and draw all figures again",
    )


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--json", action="store_true", help="print one JSON document instead of text"
    )


def _list(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    entries = catalogue.entries
    if arguments.json:
        import json

        keys = ("name", "paper", "figure", "summary", "study")
        print(json.dumps([{key: getattr(entry, key) for key in keys} for entry in entries]))
        return 0
    from chamfer.analysis.report.console import table

    lines = table(
        [
            (entry.name, entry.figure, f"study: {entry.summary}" if entry.study else entry.summary)
            for entry in entries
        ]
    )
    paper = None
    for entry, line in zip(entries, lines, strict=True):
        if entry.paper != paper:
            paper = entry.paper
            print(paper)
        print(f"  {line}")
    return 0


def _run(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.command.running import prepare

    chosen = select(catalogue.entries, arguments.names)
    jobs = prepare(
        chosen, file=arguments.scenario, settings=arguments.settings, catalogue=catalogue
    )
    if "robot" in arguments:
        jobs = [driven(job, arguments) for job in jobs]
        arguments.out /= "drive"
    with _session(arguments, chosen, catalogue) as session:
        return session.run_all(jobs)


def _reproduce(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    papers = dict.fromkeys(entry.paper for entry in catalogue.entries)
    if arguments.paper is not None:
        papers = {valid_name("paper", arguments.paper, papers): None}
    chosen = [
        entry
        for entry in catalogue.entries
        if entry.study == arguments.studies and entry.paper in papers
    ]
    with _session(arguments, chosen, catalogue) as session:
        return session.reproduce_all(chosen)


@contextmanager
def _session(
    arguments: argparse.Namespace, chosen: Sequence[Entry], catalogue: Catalogue
) -> "Iterator[Session]":
    """Refuse a folder that can't be written, and say which results in it are replaced."""
    from chamfer.analysis.campaign.cluster import engines
    from chamfer.analysis.campaign.workers import cores
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.command.session import Order, Session
    from chamfer.analysis.report.results import RESULT

    out, fresh = arguments.out, arguments.fresh
    require_writable(out, [entry.name for entry in chosen], RESULT)
    log = getattr(arguments, "log", False)
    order = Order(catalogue=catalogue, out=out, seed=arguments.seed, fresh=fresh, log=log)
    with engines(arguments.workers or cores(), arguments.cluster) as (here, trials):
        yield Session(
            order=order, as_json=arguments.json, strict=arguments.strict, here=here, trials=trials
        )


def _diagram(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.command.running import prepare, write_drawings

    chosen = select(catalogue.entries, [arguments.name])
    (job,) = prepare(
        chosen, file=arguments.scenario, settings=arguments.settings, catalogue=catalogue
    )
    for path in write_drawings(job, arguments.out, charts=arguments.chart):
        print(path)
    return 0


def _seed(text: str) -> int | None:
    return valid_integer("--seed", text, 0, _LARGEST_SEED)


def _workers(text: str) -> int | None:
    return valid_integer("--workers", text, 1, 9999)


def _cluster(text: str) -> str:
    if text != "local" and not re.fullmatch(r"(tcp|tls)://[^\s/]+:[0-9]{1,5}", text):
        raise UserError(
            f"--cluster is {text!r}, allowed: tcp://HOST:PORT of a Dask scheduler, or local"
        )
    return text


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Let a request to terminate end the block like Ctrl-C, so that it cleans up."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
