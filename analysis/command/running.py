"""Runs one experiment from its scenario to its files."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.campaign.campaign import Campaign, running
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.controllers import LOG, controllers, forget_logs, log_files
from chamfer.analysis.command.output_folder import require_writable
from chamfer.analysis.report.atomic_write import locked, write_text, written
from chamfer.analysis.report.checks import Paper, Published, check, load_paper
from chamfer.analysis.report.console import say
from chamfer.analysis.report.results import (
    REPLAY,
    RESULT,
    SCENARIO,
    check_document,
    command_text,
    defined_metrics,
    figure_captions,
    figure_files,
    json_text,
    metric_document,
    read_result,
    versions,
    write_folder,
)
from chamfer.analysis.report.traces import table_bytes
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import (
    Catalogue,
    Entry,
    Experiment,
    Outcome,
    Progress,
    Scenario,
    load,
)
from chamfer.analysis.scenario.scenario_io import make_scenario, scenario_text, sha256, unstructure
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.analysis.scenario.scenario_yaml import read_mapping
from chamfer.models.validation import ParameterError
from chamfer.systems.recording import Recorder, recording

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat


# What parameters lead to that are beyond what numbers, memory or the integrator can do. Drake
# raises RuntimeError, also where ports of different sizes are connected.
_OVERVIEW: Final = "-overview"  # end of the stem of a drawing that shows a part
_OF_NUMBERS: Final = (ValueError, ArithmeticError, MemoryError, RuntimeError)


@dataclass(frozen=True, kw_only=True)
class Job:
    """An experiment with everything that is known before it runs."""

    entry: Entry
    experiment: Experiment[Any]
    overrides: tuple[str, ...]  # path=value, the fewest that make it from the default scenario
    scenario: Any  # resolved
    paper: Paper
    command: str = "run"  # that runs it
    options: tuple[str, ...] = ()  # of that command, but for --log

    @property
    def published(self) -> list[Published]:
        """Return the published values and the specifications of the experiment."""
        return [one for one in self.paper.published if one.experiment == self.entry.name]


def prepare(
    entries: Sequence[Entry],
    *,
    file: Path | None = None,
    settings: Sequence[str] = (),
    catalogue: Catalogue = CATALOGUE,
) -> list[Job]:
    """Return the experiments' jobs, each with the same overrides of its own default scenario.

    Raises:
        UserError: If the overrides don't fit one of the experiments.
    """
    jobs = []
    for entry in entries:
        experiment = load(entry)
        default = experiment.default
        try:
            scenario, resolved = given_scenario(
                entry.name, default, experiment.resolve, file=file, settings=settings
            )
        except UserError as error:
            which = f" ({entry.name})" if len(entries) > 1 else ""
            raise UserError(f"{error}{which}") from error
        job = Job(
            entry=entry,
            experiment=experiment,
            overrides=tuple(overrides(scenario, default, experiment.resolve)),
            scenario=resolved,
            paper=load_paper(entry.paper, catalogue),
        )
        jobs.append(job)
    return jobs


def given_scenario(
    name: str,
    default: Scenario,
    resolve: Callable[[Scenario], Scenario],
    *,
    file: Path | None = None,
    settings: Sequence[str] = (),
) -> tuple[Scenario, Scenario]:
    """Return the default with what a file and then the settings override, and that resolved.

    Raises:
        UserError: If the overrides don't fit, or what they ask for can't be.
    """
    asked = [*settings, *([str(file)] if file else [])]
    try:
        given = None if file is None else read_scenario(file, name)
        scenario = make_scenario(default, given=given, settings=settings)
        return scenario, resolve(scenario)
    except (UserError, *_OF_NUMBERS) as error:
        if (reason := _reason(error, asked)) is None:
            raise
        raise UserError(reason) from error


def read_scenario(path: Path, experiment: str) -> Mapping[Any, Any]:
    """Return the fields that a file gives: a YAML file of fields, or a result of the experiment.

    Raises:
        UserError: If the file can't be read, is neither of them, or is a result of another
            experiment.
    """
    if path.suffix != ".json":
        return read_mapping(path)
    try:
        result = read_result(path)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}") from error
    except ValueError as error:
        raise UserError(f"{path} is not a result: {error}") from error
    scenario = result.get("scenario")
    if not isinstance(scenario, dict):
        raise UserError(f"{path} is not a result: it has no scenario")
    of = result.get("experiment", result.get("design"))
    if of != experiment:
        raise UserError(f"{path} is a result of {of}, not of {experiment}")
    return scenario


def run(
    job: Job,
    *,
    seed: int,
    out: Path,
    progress: Progress,
    campaign: Campaign,
    log: bool = False,
    fresh: bool = True,
) -> dict[str, Any]:
    """Run an experiment, write its folder in ``out`` and return the result's document.

    With ``log`` what its controllers saw and answered is written too. What its folder has drawn
    of the same results, with the same versions, stays if the run is not ``fresh``.

    Raises:
        UserError: If a parameter turns out to be impossible only when it is used, or the folder
            can't be written.
        ExperimentError: If Drake ends the run, or every trial fails.
        TrialsWantedError: If there are trials to run that the campaign can't.
    """
    experiment, scenario = job.experiment, job.scenario
    options = job.options or (("--log",) if log else ())
    with named_failures(job.entry.name, job.overrides), running(campaign):
        started = time.perf_counter()
        with recording(recorder := Recorder() if log else None):
            outcome = experiment.run(scenario, seed, progress)
        wall_seconds = campaign.seconds + time.perf_counter() - started
    folder, plain = out / job.entry.name, unstructure(scenario)
    metrics = defined_metrics(outcome.metrics)
    checks = check(job.published, metrics, default=not job.overrides)
    tables = {"traces": outcome.traces, **outcome.tables}
    files: dict[str, str | bytes] = {
        SCENARIO: scenario_text(scenario),
        **{f"{name}.parquet": table_bytes(table) for name, table in tables.items()},
    }
    document: dict[str, Any] = {
        "experiment": job.entry.name,
        "paper": job.entry.paper,
        "figure": job.entry.figure,
        "seed": seed,
        "scenario": plain,
        "scenario_sha256": sha256(plain),
        "overrides": list(job.overrides),
        "versions": versions(job.entry.module),
        "metrics": {name: metric_document(metric) for name, metric in metrics.items()},
        "checks": [check_document(one) for one in checks],
        "failed_trials": [
            {"trial": trial, "seed": seed, "reason": reason} for trial, reason in campaign.failed
        ],
        "simulated_seconds": outcome.simulated_seconds,
        "wall_seconds": round(wall_seconds, 4),
        "command": command_text(job.command, job.entry.name, job.overrides, *options, seed=seed),
    }
    old: dict[str, Any] = {}
    with suppress(OSError, ValueError):
        old = read_result(folder / RESULT)
    kept = None if fresh else finished(job, seed=seed, out=out)
    drawn = _drawn(folder, kept, document, files)
    if drawn is None:
        with named_failures(job.entry.name, job.overrides), running(campaign):
            plots = experiment.plot(scenario, outcome)
            figures, drawings, replay = figure_files(plots), draw(job), _replay(job, outcome)
        document["figures"] = list(figures)
        document["captions"] = figure_captions(plots)
        document["drawings"] = [name for name in drawings if name.endswith(".svg")]
        document |= {} if replay is None else {"replay": REPLAY}
        drawn = {**figures, **drawings, **({} if replay is None else {REPLAY: replay})}
    files |= drawn
    if recorder is not None:
        about = ("experiment", "seed", "overrides", "scenario_sha256", "versions")
        logs = _logs(job, recorder, {name: document[name] for name in about})
        document[LOG] = list(logs)
        files |= logs
    with written(folder):
        write_folder(folder, {**files, RESULT: json_text(document)})
        forget_logs(folder, old, document)
    campaign.finish()
    return document


def _drawn(
    folder: Path, old: Mapping[str, Any] | None, document: dict[str, Any], files: Mapping[str, Any]
) -> dict[str, str | bytes] | None:
    """Return what an earlier run drew if its results are the same ones, and document it."""
    if old is None or old["metrics"] != document["metrics"]:
        return None
    drawn = ("figures", "captions", "drawings", "replay")
    told = {name: old[name] for name in drawn if name in old}
    names = [*told["figures"], *told["drawings"], *([REPLAY] if "replay" in told else [])]
    whole = [name for name in told["drawings"] if f"{_OVERVIEW}." not in name]
    names += [name.replace(".svg", ".mmd") for name in whole]
    try:
        with locked(folder):
            there = {name: (folder / name).read_bytes() for name in (*names, *files)}
    except OSError:
        return None
    if any(there[name] != one for name, one in files.items() if isinstance(one, bytes)):
        return None
    document |= told
    return {name: there[name] for name in names}


def _logs(job: Job, recorder: Recorder, about: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the logs by file name, and say of which controllers there are none."""
    known = controllers(job.experiment, job.scenario)
    runs = {path: runs for path, runs in recorder.runs.items() if path in known}
    lacking = sorted(set(recorder.runs) - set(runs))
    if lacking or not runs:
        names = ", ".join(lacking) or "any controller"
        say(f"{job.entry.name}: no log of {names}, which is not in its loops")
    return log_files(runs, about)


def finished(job: Job, *, seed: int, out: Path) -> dict[str, Any] | None:
    """Return the document of a run that ended before with the same sources, seed and scenario."""
    folder = out / job.entry.name
    try:
        document = read_result(folder / RESULT)
        files = [*document["figures"], *document["drawings"]]
        same = (
            document["seed"] == seed
            and document["scenario_sha256"] == sha256(unstructure(job.scenario))
            and document["overrides"] == list(job.overrides)
            and document["versions"] == versions(job.entry.module)
            and not document["failed_trials"]
        )
    except (OSError, ValueError, LookupError, TypeError):
        return None
    return document if same and all((folder / one).exists() for one in files) else None


def show(job: Job, *, seed: int, meshcat: "Meshcat", progress: Progress) -> None:
    """Run an experiment and show the run in three dimensions; nothing is written.

    Raises:
        UserError: If the experiment has no such view, or as :func:`run`.
        ExperimentError: If Drake ends the run.
    """
    if job.experiment.replay is None:
        raise UserError(f"{job.entry.name} has no 3-D view")
    with named_failures(job.entry.name, job.overrides):
        outcome = job.experiment.run(job.scenario, seed, progress)
        job.experiment.replay(job.scenario, outcome, meshcat)


def draw(job: Job, *, charts: bool = True) -> dict[str, str]:
    """Return the drawings of a block diagram and of state charts by file name, where there are."""
    from chamfer.analysis.drawing.chart_graph import chart_graph
    from chamfer.analysis.drawing.diagram_graph import diagram_graph
    from chamfer.analysis.drawing.graph import Graph
    from chamfer.analysis.drawing.mermaid import flowchart, state_diagram
    from chamfer.analysis.drawing.overview import overview
    from chamfer.analysis.drawing.svg import render

    def drawn(stem: str, graph: Graph, mermaid: str) -> dict[str, str]:
        shown = overview(graph)  # before the full one, where that is wider than a page
        first = {f"{stem}{_OVERVIEW}.svg": render(*shown)} if shown else {}
        return {**first, f"{stem}.svg": render(graph), f"{stem}.mmd": mermaid}

    drawings = {}
    if job.experiment.diagram is not None:
        graph = diagram_graph(job.experiment.diagram(job.scenario))
        drawings = drawn("diagram", graph, flowchart(graph))
    if charts and job.experiment.charts is not None:
        for chart in job.experiment.charts(job.scenario):
            stem = f"chart-{chart.name.replace(' ', '-').replace('/', '-')}"
            drawings |= drawn(stem, chart_graph(chart), state_diagram(chart))
    return drawings


def write_drawings(job: Job, out: Path, *, charts: bool) -> list[Path]:
    """Write a block diagram and, on request, state charts, and return their paths.

    Raises:
        UserError: If the experiment has no such drawing, or they can't be written.
    """
    name = job.entry.name
    with named_failures(name, job.overrides):
        drawings = draw(job, charts=charts)
    if not drawings and not charts:
        raise UserError(f"{name} has no block diagram")
    if charts and not any(drawing.startswith("chart-") for drawing in drawings):
        raise UserError(f"{name} has no state chart")
    require_writable(out, [name])
    with written(out / name):
        (out / name).mkdir(exist_ok=True)
        for drawing, text in drawings.items():
            write_text(out / name / drawing, text)
    return [out / name / drawing for drawing in drawings]


def _replay(job: Job, outcome: Outcome) -> str | None:
    if job.experiment.replay is None:
        return None
    from chamfer.analysis.report.replay import replay_html

    return replay_html(partial(job.experiment.replay, job.scenario, outcome))


@contextmanager
def named_failures(name: str, asked: Sequence[str]) -> Iterator[None]:
    """Make one line of what ends the block, unless it is a bug.

    ``asked`` is what differs from the default scenario.

    Raises:
        UserError: If a parameter turns out to be impossible only when it is used.
        ExperimentError: If Drake ends the run.
    """
    try:
        yield
    except _OF_NUMBERS as error:
        if (reason := _reason(error, asked)) is None:
            raise
        kind = ExperimentError if type(error) is RuntimeError else UserError
        raise kind(f"{name}: {reason}") from error
    except (UserError, ExperimentError) as error:
        raise type(error)(f"{name}: {error}") from error
    except SystemExit as error:
        # Drake turns a failed assertion of its own into this.
        raise ExperimentError(f"{name}: stopped by Drake: {error}") from error


def _reason(error: BaseException, asked: Sequence[str]) -> str | None:
    """Return in a line what made an experiment end, None if that is a bug.

    What the default scenario can't compute is one, nothing being asked.
    """
    given = f" with {', '.join(asked)}" if asked else ""
    if isinstance(error, UserError | ParameterError):
        return str(error)
    if type(error) is RuntimeError:
        return f"stopped by Drake{given}: {error}"
    if isinstance(error, OverflowError | MemoryError) or (
        asked and isinstance(error, ArithmeticError | ValueError)
    ):
        return f"can't be computed{given}: {error}"
    return None
