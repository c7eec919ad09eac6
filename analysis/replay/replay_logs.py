"""Replays the logs of an experiment's controllers: the result's document, tables and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from chamfer.analysis.command.controllers import controllers
from chamfer.analysis.command.running import given_scenario, named_failures
from chamfer.analysis.replay.replay import Replay, replay
from chamfer.analysis.replay.replay_figure import replay_figure
from chamfer.analysis.report.console import say, table
from chamfer.analysis.report.control_log import about_log, log_records, read_log
from chamfer.analysis.report.results import figure_files, metric_document, versions
from chamfer.analysis.report.traces import table_bytes
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Entry, Metric, load, valid_name
from chamfer.analysis.scenario.scenario_io import sha256, unstructure
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.systems.recording import AnyLaw

OPEN_LOOP: Final = "open loop: what follows a difference is not what the controller would have met"
_LOGS: Final = (".parquet", ".csv")
_MOST: Final = 12  # states that are printed


@dataclass(frozen=True, kw_only=True)
class Replays:
    """What an experiment's controllers would have done with what is in logs."""

    entry: Entry
    scenario: Any  # resolved
    overrides: list[str]
    found: Mapping[Path, Replay]  # by log


def replay_logs(
    entry: Entry,
    path: Path,
    *,
    controller: str | None = None,
    file: Path | None = None,
    settings: Sequence[str] = (),
) -> Replays:
    """Feed logs to an experiment's controllers.

    Args:
        entry: The experiment.
        path: A log, or a folder of logs.
        controller: Which one, by the path of its block or the end of it; None: what the log says.
        file: The scenario's fields, None: those of the run that the log is of.
        settings: Fields that are to be others, ``path=value``.

    Raises:
        UserError: If there is no log, it is no log of the controller, or it doesn't fit.
    """
    logs = {one: read_log(one) for one in _paths(path)}
    about = {one: about_log(log) for one, log in logs.items()}
    for one, of in about.items():
        if (other := of.get("experiment", entry.name)) != entry.name:
            raise UserError(f"{one} is a log of {other}, not of {entry.name}")
    experiment = load(entry)
    scenario, resolve, ran = experiment.default, experiment.resolve, about[next(iter(about))]
    if file is None:
        made = ran.get("overrides", ())
        scenario, resolved = given_scenario(entry.name, scenario, resolve, settings=made)
        if ran.get("scenario_sha256", digest := sha256(unstructure(resolved))) != digest:
            say(f"{path} was made by another version, whose scenario was another one")
    scenario, resolved = given_scenario(
        entry.name, scenario, resolve, file=file, settings=settings
    )
    asked = overrides(scenario, experiment.default, resolve)
    with named_failures(entry.name, asked):
        known = controllers(experiment, resolved)
        if not known:
            raise UserError("has no controller that can be replayed")
        wanted = None if controller is None else _find(known, controller)
        found = {}
        for one, log in logs.items():
            own = about[one].get("controller")
            if len(logs) > 1 and wanted is not None and own not in (None, wanted):
                continue
            law = _law(known, wanted or own, about[one].get("run", 1), one)
            found[one] = replay(*law, log_records(law[1], log, one))
    if not found:
        raise UserError(f"{path} has no log of {wanted}")
    return Replays(entry=entry, scenario=resolved, overrides=asked, found=found)


def replay_files(replays: Replays) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the result's document, and tables and figures by file name."""
    found, plain = replays.found, unstructure(replays.scenario)
    files = {
        f"{one.stem}.parquet": table_bytes(_table(of), infinite=True) for one, of in found.items()
    }
    drawn = figure_files({one.stem: replay_figure(of) for one, of in found.items()})
    document = {
        "experiment": replays.entry.name,
        "scenario": plain,
        "scenario_sha256": sha256(plain),
        "overrides": replays.overrides,
        "versions": versions(replays.entry.module),
        "metrics": {name: metric_document(one) for name, one in replay_metrics(found).items()},
        "controllers": [_document(one, of) for one, of in found.items()],
        "figures": list(drawn),
    }
    return document, files | drawn


def _paths(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    found = sorted(one for one in path.iterdir() if one.suffix in _LOGS)
    if not found:
        raise UserError(f"{path} has no logs, files that end with {' or '.join(_LOGS)}")
    return found


def _find(known: Mapping[str, Any], name: str) -> str:
    """Return a controller's path from its end, if that is one controller's alone."""
    ends = [path for path in known if path == name or path.endswith(f"::{name}")]
    return ends[0] if len(ends) == 1 else valid_name("controller", name, known)


def _law(
    known: Mapping[str, Sequence[AnyLaw]], controller: str | None, run: int, path: Path
) -> tuple[str, AnyLaw]:
    """Return a controller's path and law."""
    if controller is None and len(known) > 1:
        names = ", ".join(known)
        raise UserError(f"{path} doesn't say whose log it is, --controller has to: {names}")
    name = valid_name("controller", controller or next(iter(known)), known)
    laws = known[name]
    if len(laws) > 1 and run > len(laws):
        raise UserError(f"{path} is of run {run} of {name}, which has {len(laws)}")
    return name, laws[0 if len(laws) == 1 else run - 1]


def replay_metrics(found: Mapping[Path, Replay]) -> dict[str, Metric]:
    """Return at how many steps a command differs, of how many, and when first."""
    compared = [one for one in found.values() if one.compared]
    differ = sum(int(one.differs.sum()) for one in compared)
    first = min((one.first.time for one in compared if one.first), default=None)
    note = "steps at which a command differs" if compared else "no commands in the log"
    return {
        "replay.mismatches": Metric(value=differ if compared else None, unit="", note=note),
        "replay.steps": Metric(value=sum(len(one.times) for one in found.values()), unit=""),
        "replay.first_difference": Metric(
            value=first, unit="s", note="" if first is not None else "none"
        ),
    }


def _document(path: Path, found: Replay) -> dict[str, Any]:
    first = found.first
    return {
        "controller": found.controller,
        "log": str(path),
        "steps": len(found.times),
        "mismatches": int(found.differs.sum()) if found.compared else None,
        "first_difference": None if first is None else unstructure(first._asdict()),
        "states": [list(one) for one in _changes(found)],
    }


def _changes(found: Replay) -> list[tuple[float, str, str]]:
    """Return times, s, and a chart's states in the log and replayed, where one of them changes."""
    changes: list[tuple[float, str, str]] = []
    for row, time in enumerate(found.times.tolist()):
        names = found.state_names(row)
        if names and (not changes or changes[-1][1:] != (names[0], names[-1])):
            changes.append((time, names[0], names[-1]))
    return changes


def _table(found: Replay) -> dict[str, Any]:
    """Return what was commanded beside what would be, NaN where that is not in the log."""
    columns = {"time": found.times}
    for one in found.outputs:
        logged = np.full_like(one.replayed, np.nan) if one.logged is None else one.logged
        for i in range(one.replayed.shape[1]):
            name = f"{one.name.removeprefix('command.')}[{i}]"
            columns |= {f"logged.{name}": logged[:, i], f"replayed.{name}": one.replayed[:, i]}
    return columns


def replay_text(document: Mapping[str, Any]) -> list[str]:
    """Return what a replay found, as lines."""
    lines = []
    for one in document["controllers"]:
        steps, differ, first = one["steps"], one["mismatches"], one["first_difference"]
        said, changes = f"{steps} steps, none differs", []
        if differ is None:
            said, changes = f"{steps} steps, no commands in the log", one["states"]
        elif first is not None:
            said = (
                f"{differ} of {steps} steps differ, first at {first['time']:.9g} s: "
                f"{first['column']} is {first['logged']:.9g} {first['unit']} in the log, "
                f"{first['replayed']:.9g} {first['unit']} replayed"
            )
            before = sum(time <= first["time"] for time, *_ in one["states"])
            changes = one["states"][max(before - 1, 0) :]
        lines.append(f"{one['controller']} ({Path(one['log']).name}): {said}")
        rows = [(f"{time:.9g}", *states) for time, *states in changes[:_MOST]]
        if rows:
            lines += [f"  {line}" for line in table([("time / s", "log", "replayed"), *rows])]
        if len(changes) > _MOST:
            lines.append(f"  and {len(changes) - _MOST} more changes of state")
    if document["metrics"]["replay.mismatches"]["value"]:
        lines.append(OPEN_LOOP)
    return lines
