"""An experiment's controllers, and the files of what they saw and answered in a run."""

import re
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.report.control_log import log_bytes
from chamfer.analysis.scenario.experiment import Experiment
from chamfer.systems.exact_discretisation import blocks
from chamfer.systems.law_block import LawBlock
from chamfer.systems.recording import AnyLaw, Records

LOG: Final = "log"  # folder


def controllers(experiment: Experiment[Any], scenario: Any) -> dict[str, list[AnyLaw]]:
    """Return the laws of a resolved scenario's loops by the paths of their blocks.

    A path has one law that is the same in every run, or several in their order, for as many runs
    each.
    """
    if experiment.loops is not None:
        loops = experiment.loops(scenario)
    else:
        loops = [experiment.diagram(scenario)] if experiment.diagram is not None else []
    found: dict[str, list[AnyLaw]] = {}
    for block in chain.from_iterable(map(blocks, loops)):
        if isinstance(block, LawBlock):
            found.setdefault(block.path, []).append(block.law)
    return found


def log_files(runs: Mapping[str, Sequence[Records]], about: Mapping[str, Any]) -> dict[str, bytes]:
    """Return a file for each run of each controller, by its name in an experiment's folder.

    It is called after the controller's path, with a number where there were several runs.
    """
    roots = {path.partition("::")[0] for path in runs if "::" in path}
    bare = f"{roots.pop()}::" if len(roots) == 1 else ""
    files = {}
    for path, each in runs.items():
        parts = path.removeprefix(bare).split("::")
        stem = ".".join(re.sub(r"[^\w]+", "-", part).strip("-") for part in parts)
        for i, records in enumerate(each):
            which = {**about, "controller": path, "run": i + 1, "runs": len(each)}
            name = f"{stem}-{i + 1}" if len(each) > 1 else stem
            files[f"{LOG}/{name}.parquet"] = log_bytes(records, which)
    return files


def forget_logs(folder: Path, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    """Remove the logs that a result had and the one in its place has not."""
    for name in set(old.get(LOG, [])) - set(new.get(LOG, [])):
        (folder / name).unlink(missing_ok=True)
