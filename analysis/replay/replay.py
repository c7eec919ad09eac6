"""Steps controllers through logs, and compares what they command with what is logged.

It is open loop: a law sees what was logged, whatever it commands.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.command.controllers import controllers
from chamfer.analysis.command.running import given_scenario, named_failures
from chamfer.analysis.report.control_log import about_log, log_records, read_log
from chamfer.analysis.report.results import metric_document, versions
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Entry, Metric, load, valid_name
from chamfer.analysis.scenario.scenario_io import sha256, unstructure
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.systems.recording import AnyLaw, Record, Records, signals

STATE: Final = "command.state"  # the index of a chart's state
Array = NDArray[np.float64]


class Output(NamedTuple):
    """What a controller commands at one of its outputs, shape (steps, size)."""

    name: str  # command.<output>
    units: tuple[str, ...]
    logged: Array  # NaN where it is not in the log
    replayed: Array
    differs: NDArray[np.bool_]  # False where it is not in the log


class Replay(NamedTuple):
    """What a controller would have done beside what it did."""

    controller: str  # the path of its block
    states: Sequence[str]  # the names of its chart's states, if it has one
    times: Array  # s
    outputs: Sequence[Output]
    compared: bool  # whether there are commands in the log

    @property
    def differs(self) -> NDArray[np.bool_]:
        """At which steps a command differs."""
        return np.asarray(np.hstack([one.differs for one in self.outputs]).any(axis=1))

    @property
    def state(self) -> Output | None:
        """The output that is a chart's state."""
        return next((one for one in self.outputs if one.name == STATE and self.states), None)

    def document(self) -> dict[str, Any]:
        """Return how much differs, and the first number that does."""
        document = {"controller": self.controller, "steps": len(self.times)}
        if not self.differs.any():
            mismatches = 0 if self.compared else None
            return {**document, "mismatches": mismatches, "first_difference": None}
        row = int(np.argmax(self.differs))
        one = next(one for one in self.outputs if one.differs[row].any())
        i = int(np.argmax(one.differs[row]))
        first = {
            "time": float(self.times[row]),
            "column": f"{one.name}[{i}]",
            "unit": one.units[i],
            "logged": float(one.logged[row, i]),
            "replayed": float(one.replayed[row, i]),
        }
        return {
            **document,
            "mismatches": int(self.differs.sum()),
            "first_difference": unstructure(first),
            "states_differ": self._states_differ(),
        }

    def _states_differ(self) -> dict[str, Any] | None:
        """Return when a chart is first in another state than in the log, and in which ones."""
        if self.state is None or not self.state.differs.any():
            return None
        row = int(np.argmax(self.state.differs))
        was, now = self.state.logged[row, 0], self.state.replayed[row, 0]
        return {
            "time": float(self.times[row]),
            "logged": dict(enumerate(self.states)).get(was, f"{was}"),
            "replayed": self.states[int(now)],
        }

    def side_by_side(self) -> dict[str, Array]:
        """Return a table of what was commanded, NaN where it is not logged, and what would be."""
        columns = {"time": self.times}
        for one in self.outputs:
            for i, (was, now) in enumerate(zip(one.logged.T, one.replayed.T, strict=True)):
                name = f"{one.name.partition('.')[2]}[{i}]"
                columns |= {f"logged.{name}": was, f"replayed.{name}": now}
        return columns


def replay(controller: str, law: AnyLaw, logged: Records) -> Replay:
    """Step a law through a log, and compare.

    Raises:
        UserError: If the law refuses what it sees.
    """
    state, replayed = law.start(), Records(law)
    for record in logged:
        try:
            state, command = law.step(state, law.observe(record.observation), record.time)
        except (ValueError, ArithmeticError) as error:
            raise UserError(f"{controller} at {record.time} s: {error}") from error
        replayed.append(Record(record.time, record.observation, command._asdict()))
    outputs, compared = [], False
    for (name, was, missing), (_, now, _) in zip(
        logged.vectors(), replayed.vectors(), strict=True
    ):
        if name.startswith("command."):
            compared |= not missing.all()
            same = (was == now) | (np.isnan(was) & np.isnan(now)) | missing[:, np.newaxis]
            outputs.append(Output(name, signals(law)[name].units, was, now, ~same))
    chart = getattr(law, "chart", None)
    states = () if chart is None else chart.state_names
    return Replay(controller, states, logged.times, outputs, compared)


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
        controller: Which one, by the path of its block or the end of it; None: what the log says.
        file: The scenario's fields, None: those of the run that the log is of.
        settings: Fields that are to be others, ``path=value``.

    Returns:
        The result's document, and what each log led to by the name of its file.

    Raises:
        UserError: If there is no log, it is no log of the controller, or it doesn't fit.
    """
    folder = [one for one in sorted(path.glob("*")) if one.suffix in (".parquet", ".csv")]
    if path.is_dir() and not folder:
        raise UserError(f"{path} has no logs, files that end with .parquet or .csv")
    logs = {one: read_log(one) for one in folder or [path]}
    about = {one: about_log(log, one) for one, log in logs.items()}
    for one, of in about.items():
        if of["experiment"] not in (None, entry.name):
            raise UserError(f"{one} is a log of {of['experiment']}, not of {entry.name}")
    experiment = load(entry)
    scenario, resolve = experiment.default, experiment.resolve
    if file is None:
        ran = next(iter(about.values()))["overrides"]
        scenario, _ = given_scenario(entry.name, scenario, resolve, settings=ran)
    scenario, resolved = given_scenario(
        entry.name, scenario, resolve, file=file, settings=settings
    )
    asked = overrides(scenario, experiment.default, resolve)
    found = {}
    with named_failures(entry.name, asked):
        known = controllers(experiment, resolved)
        if not known:
            raise UserError("it has no controllers of its own")
        for one, log in logs.items():
            name, law = _law(known, controller, about[one], one)
            if controller is None or len(logs) == 1 or about[one]["controller"] in (None, name):
                found[one.stem] = replay(name, law, log_records(law, log, one))
    if not found:
        raise UserError(f"{path} has no log of {controller}")
    documents = [{"log": name, **one.document()} for name, one in found.items()]
    compared = [one for one in documents if one["mismatches"] is not None]
    differ = sum(one["mismatches"] for one in compared)
    firsts = [one["first_difference"]["time"] for one in compared if one["first_difference"]]
    metrics = {
        "replay.mismatches": Metric(
            value=differ if compared else None,
            unit="",
            note="steps at which a command differs" if compared else "no commands in the log",
        ),
        "replay.steps": Metric(value=sum(one["steps"] for one in documents), unit=""),
        "replay.first_difference": Metric(
            value=min(firsts, default=None), unit="s", note="" if firsts else "none"
        ),
    }
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
    """Return the path and the law of the controller that is asked for, or that a log is of."""
    wanted = asked or about["controller"] or (next(iter(known)) if len(known) == 1 else None)
    if wanted is None:
        names = ", ".join(known)
        raise UserError(f"{path} doesn't say whose log it is, --controller has to: {names}")
    ends = [name for name in known if name.endswith(f"::{wanted}")]
    name = ends[0] if len(ends) == 1 else valid_name("controller", wanted, known)
    laws, run, runs = known[name], about["run"], about["runs"]
    if not 1 <= run <= runs or (runs > 1 and runs % len(laws)):
        raise UserError(f"{path} is of run {run} of {runs} of {name}, which has {len(laws)} laws")
    return name, laws[(run - 1) * len(laws) // runs]
