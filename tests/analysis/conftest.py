"""Toy experiments for the tests of the command line and what is below it."""

import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from chamfer.analysis.scenario.experiment import Catalogue, Entry

ROOT = Path(__file__).parents[2]
# A parent that ignores interrupts, as nohup does, hands that on.
PROGRAM = """
import pickle
import signal
import sys

signal.signal(signal.SIGINT, signal.default_int_handler)
from chamfer.analysis.cli import main

catalogue, *arguments = sys.argv[1:]
sys.exit(main(arguments, catalogue=pickle.loads(bytes.fromhex(catalogue))))
"""

TOYS = """
import sys
import time
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.models.validation import ParameterError, require_not_negative, require_positive


@dataclass(frozen=True, kw_only=True)
class Body:
    mass: float = 2.0  # kg, of what falls
    form: Literal["ball", "plate"] = "ball"  # of the body

    def __post_init__(self):
        require_positive(self, "mass")


@dataclass(frozen=True, kw_only=True)
class FallScenario:
    body: Body = field(default_factory=Body)
    height: float = 5.0
    step: float | None = None  # s; None: 0.1


@dataclass(frozen=True, kw_only=True)
class TrialScenario:
    trials: int = 3
    noise: float = 0.1

    def __post_init__(self):
        require_not_negative(self, "noise")


def resolve_fall(scenario):
    if scenario.height > 100:
        raise ParameterError("height", scenario.height, "a number <= 100")
    return replace(scenario, step=scenario.step or 0.1)


def run_fall(scenario, seed, progress):
    print("noise on standard output")
    progress(0.5, "falling")
    if scenario.height == 13.0:
        raise ParameterError("height", scenario.height, "a lucky number")
    time_ = np.arange(0.0, 1.0, scenario.step)
    position = scenario.height + np.random.default_rng(seed).normal(size=time_.shape)
    metrics = {
        "end": Metric(value=float(position[-1]), unit="m"),
        "height": Metric(value=scenario.height, unit="m"),
        "overflow": Metric(value=float("inf"), unit="m"),
        "undefined": Metric(value=None, unit="s", note="it does not bounce"),
    }
    return Outcome(
        metrics=metrics, traces={"time": time_, "position": position}, simulated_seconds=1.0
    )


def plot_fall(scenario, outcome):
    figure = Figure(figsize=(2, 1))
    figure.add_subplot().plot(outcome.traces["time"], outcome.traces["position"])
    return {"fall": figure}


def run_trials(scenario, seed, progress):
    return Outcome(
        metrics={"rate": Metric(value=1.0, unit="")},
        traces={"trial": np.arange(scenario.trials)},
        simulated_seconds=0.0,
    )


def run_slow(scenario, seed, progress):
    print("started", file=sys.stderr, flush=True)
    time.sleep(30)


def run_interrupted(scenario, seed, progress):
    raise KeyboardInterrupt


def run_broken(scenario, seed, progress):
    raise ZeroDivisionError("by zero")


def run_asserting(scenario, seed, progress):
    raise SystemExit("Failure at plant.cc:1 in f():\\ncondition 'x > 0' failed.")


def unresolved(scenario):
    return scenario


def no_figures(scenario, outcome):
    return {}


FALL = FallScenario()
TRIALS = TrialScenario()
"""

PUBLISHED = """
from chamfer.analysis.report.checks import Published

KEY = "toy-paper"
TITLE = "On <falling> & landing"
PUBLISHED = (
    Published(experiment="fall", metric="height", relation="near", value=5.0, tolerance=0.5,
              unit="m", kind="predicted", source="Fig. 1"),
    Published(experiment="fall", metric="end", relation="between", low=-2.0, high=-1.0,
              unit="m", kind="calibrated", source="section 2", note="it is not that deep",
              otherwise="does_not_hold"),
    Published(experiment="fall", metric="overflow", relation="at_least", value=1.0,
              unit="m", kind="predicted", source="section 3"),
    Published(experiment="another", metric="x", relation="at_most", value=1.0,
              unit="m", kind="predicted", source="section 3"),
)
"""


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder for results that is not there yet."""
    return tmp_path / "out"


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The module of the toys, which a test may change before it is imported."""
    package = f"toys_{abs(hash(tmp_path))}"  # its own, modules stay imported between tests
    assert package not in sys.modules
    path = tmp_path / "source" / package / "all.py"
    published = path.parent / "published"
    published.mkdir(parents=True)
    for folder in (path.parent, published):
        (folder / "__init__.py").touch()
    path.write_text(TOYS)
    (published / "toy_paper.py").write_text(PUBLISHED)
    monkeypatch.syspath_prepend(str(path.parents[1]))
    monkeypatch.setenv("PYTHONPATH", f"{ROOT / 'src'}:{path.parents[1]}")
    return path


@pytest.fixture
def toys(source: Path) -> Catalogue:
    """Experiments fall, trials, interrupted, broken, asserting and slow of three papers."""
    package = source.parent.name
    fall = Entry(
        name="fall",
        paper="toy-paper",
        figure="Fig. 1",
        summary="a body falls",
        module=f"{package}.all",
        scenario="FALL",
        resolve="resolve_fall",
        run="run_fall",
        plot="plot_fall",
    )
    papers = {
        "interrupted": "other-paper",
        "broken": "other-paper",
        "asserting": "other-paper",
        "slow": "slow-paper",
        "trials": "toy-paper",
    }
    *others, trials = [
        Entry(
            name=name,
            paper=paper,
            summary=f"{name} of trials",
            module=f"{package}.all",
            scenario="TRIALS",
            resolve="unresolved",
            run=f"run_{name}",
            plot="no_figures",
        )
        for name, paper in papers.items()
    ]
    return Catalogue(entries=(*others, fall, trials), published=f"{package}.published")


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts the command line in a process, in a group of its own if that is asked for."""
    with ExitStack() as processes:

        def begin(
            catalogue: Catalogue, *arguments: str, group: bool = False
        ) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                [sys.executable, "-c", PROGRAM, pickle.dumps(catalogue).hex(), *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=group,
            )
            processes.enter_context(process)
            processes.callback(process.kill)
            return process

        yield begin
