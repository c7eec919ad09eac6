"""Steps controllers through logs, and compares their commands with the logged ones.

It is open loop: a law receives the logged inputs, whatever it commands.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.command.controllers import controllers
from chamfer.analysis.command.running import given_scenario, named_failures
from chamfer.analysis.report.control_log import log_records, read_log
from chamfer.analysis.report.results import metric_document, versions
from chamfer.analysis.scenario.errors import UserError, valid_name
from chamfer.analysis.scenario.experiment import Entry, load
from chamfer.analysis.scenario.scenario_io import sha256, unstructure
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.systems.recording import AnyLaw, Record

Array = NDArray[np.float64]


class Output(NamedTuple):
    """The commands of a controller at one of its outputs, shape (steps, size)."""

    name: str
    units: tuple[str, ...]
    states: Sequence[str]  # the names of a chart's states, if it is the index of its state
    logged: Array  # NaN where it is not in the log
    replayed: Array
    differs: NDArray[np.bool_]  # False where it is not in the log

    def value(self, number: float) -> float | str:
        """Return a number as messages show it: a state by its name."""
        known = number in range(len(self.states))
        return self.states[int(number)] if known else float(number)


class Replay(NamedTuple):
    """The replayed commands of a controller next to the logged ones."""

    controller: str  # the path of its block
    times: Array  # s
    outputs: Sequence[Output]

    def document(self) -> dict[str, Any]:
        """Return how many steps differ, and the first number and state that do."""
        differ = np.hstack([one.differs for one in self.outputs]).any(axis=1)
        compared = any(not np.isnan(one.logged).all() for one in self.outputs)
        return {
            "controller": self.controller,
            "steps": len(self.times),
            "mismatches": int(differ.sum()) if compared else None,
            "first_difference": self._first(self.outputs),
            "states_differ": self._first([one for one in self.outputs if one.states]),
        }

    def _first(self, outputs: Sequence[Output]) -> Any:
        differing = [one for one in outputs if one.differs.any()]
        if not differing:
            return None
        one = min(differing, key=lambda one: int(np.argmax(one.differs.any(axis=1))))
        row, i = np.unravel_index(np.argmax(one.differs), one.differs.shape)
        first = {
            "time": float(self.times[row]),
            "column": f"command.{one.name}[{i}]",
            "unit": one.units[i],
            "logged": one.value(one.logged[row, i]),
            "replayed": one.value(one.replayed[row, i]),
        }
        return unstructure(first)

    def side_by_side(self) -> dict[str, Array]:
        """Return a table of logged commands, NaN where missing, and replayed ones."""
        columns = {"time": self.times}
        for one in self.outputs:
            for i, (was, now) in enumerate(zip(one.logged.T, one.replayed.T, strict=True)):
                columns |= {f"logged.{one.name}[{i}]": was, f"replayed.{one.name}[{i}]": now}
        return columns


def replay(controller: str, law: AnyLaw, logged: Sequence[Record]) -> Replay:
    """Step a law through a log, and compare.

    Raises:
        UserError: If the law refuses an input.
    """
    state, commands = law.start(), []
    for record in logged:
        try:
            state, command = law.step(state, law.observe(record.observation), record.time)
        except (ValueError, ArithmeticError) as error:
            raise UserError(f"{controller} at {record.time} s: {error}") from error
        commands.append(command)
    outputs, chart = [], getattr(law, "chart", None)
    for name, signal in law.outputs.items():
        given = [one.command[name] for one in logged]
        known = np.array([one is not None for one in given])
        none = np.full(signal.size, np.nan)
        was = np.array([none if one is None else one for one in given])
        now = np.array([getattr(one, name) for one in commands], dtype=np.float64)
        same = (was == now) | (np.isnan(was) & np.isnan(now))
        states = chart.state_names if chart is not None and name == "state" else ()
        outputs.append(Output(name, signal.units, states, was, now, ~same & known[:, np.newaxis]))
    return Replay(controller, np.array([one.time for one in logged]), outputs)


def replay_logs(
    entry: Entry,
    path: Path,
    *,
    controller: str | None = None,
    file: Path | None = None,
    settings: Sequence[str] = (),
) -> tuple[dict[str, Any], dict[str, Replay]]:
    """Feed logs to an experiment's controllers.

    Args:
        entry: The experiment.
        path: A log, or a folder of logs.
        controller: The path of its block or the end of it; None: the log's own.
        file: The scenario's fields, None: those of the logged run.
        settings: Fields to override, ``path=value``.

    Returns:
        The result's document, and each log's replay by the name of its file.

    Raises:
        UserError: If there is no log, it is no log of the controller, or it doesn't fit.
    """
    folder = [one for one in sorted(path.glob("*")) if one.suffix in (".parquet", ".csv")]
    if path.is_dir() and not folder:
        raise UserError(f"{path} has no logs, files that end with .parquet or .csv")
    logs = {one: read_log(one) for one in folder or [path]}
    for one, (_, about) in logs.items():
        if about["experiment"] not in (None, entry.name):
            raise UserError(f"{one} is a log of {about['experiment']}, not of {entry.name}")
    if len({one.stem for one in logs}) < len(logs):
        raise UserError(f"{path} has two logs of one name, one as Parquet and one as CSV")
    if file is None and len({str(about["overrides"]) for _, about in logs.values()}) > 1:
        raise UserError(f"{path} has logs of several scenarios, each has to be replayed by itself")
    experiment = load(entry)
    scenario, resolve = experiment.default, experiment.resolve
    if file is None:
        _, about = next(iter(logs.values()))
        scenario, _ = given_scenario(entry.name, scenario, resolve, settings=about["overrides"])
    scenario, resolved = given_scenario(
        entry.name, scenario, resolve, file=file, settings=settings
    )
    asked, found = overrides(scenario, experiment.default, resolve), {}
    with named_failures(entry.name, asked):
        known = controllers(experiment, resolved)
        if not known:
            raise UserError("it has no controllers of its own")
        for one, (log, about) in logs.items():
            name, law = _law(known, controller, about, one)
            if about["controller"] in (None, name):
                found[one.stem] = replay(name, law, log_records(law, log, one))
    if not found:
        raise UserError(f"{path} has no log of {controller}")
    documents = [{"log": name, **one.document()} for name, one in found.items()]
    compared = [one["mismatches"] for one in documents if one["mismatches"] is not None]
    firsts = [one["first_difference"]["time"] for one in documents if one["first_difference"]]
    said = "steps at which a command differs" if compared else "no commands in the log"
    metrics = metrics_of(
        {
            "replay.mismatches": (sum(compared) if compared else None, "", said),
            "replay.steps": (sum(one["steps"] for one in documents), ""),
            "replay.first_difference": (min(firsts, default=None), "s", "" if firsts else "none"),
        }
    )
    document = {
        "experiment": entry.name,
        "scenario": (plain := unstructure(resolved)),
        "scenario_sha256": sha256(plain),
        "overrides": asked,
        "versions": versions(entry.module),
        "metrics": {name: metric_document(one) for name, one in metrics.items()},
        "controllers": documents,
    }
    return document, found


def _law(
    known: Mapping[str, Sequence[AnyLaw]], asked: str | None, about: Mapping[str, Any], path: Path
) -> tuple[str, AnyLaw]:
    """Return path and law of the requested controller, or of the one that the log names."""
    wanted = asked or about["controller"] or (next(iter(known)) if len(known) == 1 else None)
    if wanted is None:
        names = ", ".join(known)
        raise UserError(f"{path} doesn't say whose log it is, --controller has to: {names}")
    ends = [name for name in known if name.endswith(f"::{wanted}")]
    name = ends[0] if len(ends) == 1 else valid_name("controller", wanted, known)
    laws, run, runs = known[name], about["run"], about["runs"]
    if runs > 1 and runs % len(laws):
        raise UserError(f"{path} is of one of {runs} runs of {name}, which has {len(laws)} laws")
    return name, laws[(run - 1) * len(laws) // runs]
