"""The campaign of a command that writes a folder of its own: its trials survive it."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, redirect_stdout
from pathlib import Path

from chamfer.analysis.campaign.campaign import Campaign, running
from chamfer.analysis.campaign.cluster import engines
from chamfer.analysis.campaign.progress import TerminalProgress
from chamfer.analysis.campaign.trial_store import TRIALS
from chamfer.analysis.campaign.workers import cores
from chamfer.analysis.scenario.experiment import Progress


@contextmanager
def command_campaign(
    folder: Path, label: str, arguments: argparse.Namespace
) -> Iterator[Progress]:
    """Let the block's trials be kept in a folder until the block has written its results.

    Args:
        folder: Of the command's results.
        label: What the progress is of.
        arguments: The command's, with ``workers``, ``cluster`` and ``fresh``.
    """
    with engines(arguments.workers or cores(), arguments.cluster) as (_, trials):
        campaign = Campaign(
            path=folder / TRIALS,
            processors=trials.processors,
            engine=trials,
            fresh=arguments.fresh,
        )
        # What prints must not spoil what the command prints.
        quiet, told = redirect_stdout(sys.stderr), TerminalProgress(label)
        with closing(campaign), quiet, told as progress, running(campaign):
            yield progress
            campaign.finish()
