"""The command ``chamfer drive``: a controller drives a robot."""

import argparse
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.scenario.errors import UserError

if TYPE_CHECKING:
    from chamfer.analysis.command.running import Job

_DRIVEN: Final = ("insertion",)
_ROBOTS: Final = ("simulated",)
_LOCKSTEP: Final = "lockstep"
_RATE: Final = 0.5  # of real time, that two cores of 2020 keep with cameras


def add_drive(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command with its jobs, :func:`driven`, without the options of `chamfer run`."""
    drive: argparse.ArgumentParser = commands.add_parser(
        "drive",
        help="drive a robot with an experiment's controller",
        description="Runs an experiment's controller in this process and drives a robot with it. "
        "A "
        "guard checks every command. The simulated robot is another process on this "
        "machine and keeps real time. Ctrl-C stops the robot first. Writes "
        "OUT/drive/NAME, with the same files as `chamfer run --log`.",
    )
    drive.add_argument("names", nargs=1, metavar="NAME", choices=_DRIVEN, help=", ".join(_DRIVEN))
    drive.add_argument(
        "--robot", required=True, choices=_ROBOTS, metavar="ROBOT", help=", ".join(_ROBOTS)
    )
    drive.add_argument(
        "--rate",
        type=_rate,
        default=str(_RATE),
        help="simulated seconds per second, at most 1 (default: "
        f"{_RATE:g}), or {_LOCKSTEP}: the robot steps with the controller",
    )
    drive.set_defaults(log=True, fresh=True, strict=False, workers=1, cluster=None)
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


def driven(job: "Job", arguments: argparse.Namespace) -> "Job":
    """Return an experiment's job for a robot."""
    from dataclasses import replace
    from functools import partial

    from chamfer.analysis.drive.drive import drive

    rate = _LOCKSTEP if arguments.rate is None else f"{arguments.rate:g}"
    options = ("--robot", arguments.robot, *(["--rate", rate] if rate != f"{_RATE:g}" else []))
    experiment = replace(job.experiment, run=partial(drive, rate=arguments.rate))
    return replace(job, experiment=experiment, command="drive", options=options)
