"""Toy experiments for the tests of the command line and what is below it."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from chamfer.analysis.scenario.experiment import Catalogue

ROOT = Path(__file__).parents[2]
# A parent that ignores interrupts, as nohup does, hands that on.
PROGRAM = """
import signal
import sys
from pathlib import Path

signal.signal(signal.SIGINT, signal.default_int_handler)
from chamfer.analysis.cli import main
from chamfer.analysis.scenario.experiment import Catalogue

folder, package, *arguments = sys.argv[1:]
sys.exit(main(arguments, catalogue=Catalogue(folder=Path(folder), package=package)))
"""

TOYS = """
import sys
import time
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Experiment, Metric, Outcome
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


FALL = Experiment(
    name="fall",
    paper="toy-paper",
    figure="Fig. 1",
    summary="a body falls",
    scenario=FallScenario,
    resolve=resolve_fall,
    run=run_fall,
    plot=plot_fall,
)
"""

TRIALS = """
{attribute}: Experiment[TrialScenario] = Experiment(
    name="{name}",
    paper="{paper}",
    figure="",
    summary="{name} of trials",
    scenario=TrialScenario,
    resolve=unresolved,
    run={run},
    plot=no_figures,
)
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
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Catalogue:
    """Experiments fall, trials, interrupted, broken, asserting and slow of two papers."""
    root = tmp_path / "source"
    package = f"toys_{abs(hash(tmp_path))}"  # its own, modules stay imported between tests
    experiments = root / package / "falling"
    published = root / package / "published"
    for folder in (experiments, published):
        folder.mkdir(parents=True)
        (folder / "__init__.py").touch()
    (root / package / "__init__.py").touch()
    text = TOYS
    for name, paper in (
        ("trials", "toy-paper"),
        ("interrupted", "other-paper"),
        ("broken", "other-paper"),
        ("asserting", "other-paper"),
        ("slow", "slow-paper"),
    ):
        text += TRIALS.format(name=name, paper=paper, attribute=name.upper(), run=f"run_{name}")
    (experiments / "all.py").write_text(text)
    (published / "toy_paper.py").write_text(PUBLISHED)
    monkeypatch.syspath_prepend(str(root))
    assert package not in sys.modules
    return Catalogue(folder=root / package, package=package)


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts the command line in a process, in a group of its own if that is asked for."""
    with ExitStack() as processes:

        def begin(
            catalogue: Catalogue, *arguments: str, group: bool = False
        ) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    PROGRAM,
                    str(catalogue.folder),
                    catalogue.package,
                    *arguments,
                ],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=group,
                env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{catalogue.folder.parent}"},
            )
            processes.enter_context(process)
            processes.callback(process.kill)
            return process

        yield begin
