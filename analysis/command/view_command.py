"""The command ``chamfer view``: a run in three dimensions, served on localhost."""

import argparse
import time
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.scenario.experiment import Catalogue, select, valid_integer

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

_PORTS: Final = (1024, 65535)


def add_view(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the scenario's options and the seed are left to be added."""
    view: argparse.ArgumentParser = commands.add_parser(
        "view",
        help="run an experiment and show the run in 3-D",
        description="Runs an experiment, then serves the run as a 3-D animation on localhost "
        "until "
        "Ctrl-C. Writes nothing.",
    )
    view.add_argument("name", metavar="NAME", help="an experiment of `chamfer list`")
    view.add_argument(
        "--port", metavar="PORT", help="port of the server (default: the first free one from 7000)"
    )
    view.set_defaults(command=_view)
    return view


def _view(arguments: argparse.Namespace, catalogue: Catalogue) -> int:
    from chamfer.analysis.campaign.progress import TerminalProgress
    from chamfer.analysis.command.running import prepare, show
    from chamfer.analysis.report.replay import open_meshcat

    port = valid_integer("--port", arguments.port, *_PORTS)
    chosen = select(catalogue.entries, [arguments.name])
    (job,) = prepare(
        chosen, file=arguments.scenario, settings=arguments.settings, catalogue=catalogue
    )
    meshcat = open_meshcat(port)  # before the run: a port that is taken is said at once
    with TerminalProgress(arguments.name) as progress:
        show(job, seed=arguments.seed, meshcat=meshcat, progress=progress)
    _serve(meshcat)
    return 0


def _serve(meshcat: "Meshcat") -> None:
    """Say where the run is shown and wait for Ctrl-C; Meshcat's own thread serves it."""
    try:
        print(f"{meshcat.web_url()} shows the run until Ctrl-C", flush=True)
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        return
