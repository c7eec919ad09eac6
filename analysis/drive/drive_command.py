"""The command ``chamfer drive``: a controller drives a robot."""

import argparse
from typing import Any, Final

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, select

_DRIVEN: Final = ("insertion",)
_ROBOTS: Final = ("simulated",)
_LOCKSTEP: Final = "lockstep"
_RATE: Final = 0.5  # of real time, that two cores of 2020 keep with cameras


def add_drive(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; scenario, folder, seed and ``--json`` are left to be added."""
    drive: argparse.ArgumentParser = commands.add_parser(
        "drive",
        help="drive a robot by an experiment's controller",
        description="Runs an experiment's controller, as it is in the diagram, in this process, "
        "and lets it drive a robot, with a guard around every command. The simulated one is "
        "another process, on this machine alone, that keeps real time. Ctrl-C stops the robot "
        "first. Writes OUT/drive/NAME as `chamfer run --log` writes OUT/NAME.",
    )
    drive.add_argument("name", metavar="NAME", choices=_DRIVEN, help=", ".join(_DRIVEN))
    drive.add_argument(
        "--robot", required=True, choices=_ROBOTS, metavar="ROBOT", help=", ".join(_ROBOTS)
    )
    drive.add_argument(
        "--rate",
        type=_rate,
        default=str(_RATE),
        help="seconds that the robot simulates in one, at most 1 (default: "
        f"{_RATE:g}), or {_LOCKSTEP}: it steps when it is told to",
    )
    drive.set_defaults(command=_drive)
    return drive


def _rate(text: str) -> float | None:
    if text == _LOCKSTEP:
        return None
    try:
        if 0 < (rate := float(text)) <= 1:
            return rate
    except ValueError:
        pass
    raise UserError(f"--rate is {text!r}, allowed: a number > 0 and <= 1, or {_LOCKSTEP}")


def _drive(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from dataclasses import replace
    from functools import partial

    from chamfer.analysis.campaign.cluster import engines
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.command.running import prepare
    from chamfer.analysis.command.session import Order, Session
    from chamfer.analysis.drive.drive import drive
    from chamfer.analysis.report.results import RESULT

    chosen = select(catalogue.entries, [arguments.name])
    (job,) = prepare(
        chosen, file=arguments.scenario, settings=arguments.settings, catalogue=catalogue
    )
    run = partial(drive, rate=arguments.rate)
    rate = _LOCKSTEP if arguments.rate is None else f"{arguments.rate:g}"
    options = ("--robot", arguments.robot, *(["--rate", rate] if rate != f"{_RATE:g}" else []))
    driven = replace(
        job, experiment=replace(job.experiment, run=run), command="drive", options=options
    )
    out = arguments.out / "drive"
    require_writable(out, [arguments.name], RESULT)
    order = Order(catalogue=catalogue, out=out, seed=arguments.seed, fresh=True, log=True)
    with engines(1, None) as (here, trials):
        session = Session(
            order=order, as_json=arguments.json, strict=False, here=here, trials=trials
        )
        return session.run_all([driven])
