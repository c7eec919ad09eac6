"""Toy experiments for the tests of the command line and what is below it."""

import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from chamfer.analysis.scenario.experiment import Catalogue, Outcome

ROOT = Path(__file__).parents[2]
# A parent that ignores interrupts, as nohup does, hands that on.
PROGRAM = """
import importlib
import signal
import sys

signal.signal(signal.SIGINT, signal.default_int_handler)
from chamfer.analysis.cli import main

package, *arguments = sys.argv[1:]
sys.exit(main(arguments, catalogue=importlib.import_module(f"{package}.catalogue").CATALOGUE))
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
    figure = Figure(figsize=(2, 1), label="It falls & rests.")
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


def no_figures(scenario, outcome):
    return {}


FALL = FallScenario()
TRIALS = TrialScenario()
"""

LISTED = """
from chamfer.analysis.scenario.experiment import Catalogue, Entry

ALL = "{package}.falling.all"


def trials(name, paper="toy-paper", run="run_trials", **others):
    return Entry(
        name=name, paper=paper, summary=f"{{name}} of trials", module=ALL, scenario="TRIALS",
        run=run, plot="no_figures", **others,
    )


CATALOGUE = Catalogue(
    published="{package}.published",
    entries=(
        trials("interrupted", "other-paper", "run_interrupted"),
        trials("broken", "other-paper", "run_broken"),
        trials("asserting", "other-paper", "run_asserting"),
        trials("slow", "slow-paper", "run_slow"),
        Entry(
            name="fall", paper="toy-paper", figure="Fig. 1", summary="a body falls", module=ALL,
            scenario="FALL", resolve="resolve_fall", run="run_fall", plot="plot_fall",
        ),
        trials("trials"),
    ),
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
    Published(experiment="fall", metric="height", relation="at_most", value=10.0,
              unit="m", kind="specification", source="section 4"),
    Published(experiment="another", metric="x", relation="at_most", value=1.0,
              unit="m", kind="predicted", source="section 3"),
)
"""


@pytest.fixture(scope="session")
def value() -> Callable[[Outcome, str], float]:
    """Finds the value of a metric that has one."""

    def found(outcome: Outcome, name: str) -> float:
        number = outcome.metrics[name].value
        assert number is not None, name
        return number

    return found


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
    (root / package / "catalogue.py").write_text(LISTED.format(package=package))
    (experiments / "all.py").write_text(TOYS)
    (published / "toy_paper.py").write_text(PUBLISHED)
    monkeypatch.syspath_prepend(str(root))
    assert package not in sys.modules
    catalogue: Catalogue = importlib.import_module(f"{package}.catalogue").CATALOGUE
    return catalogue


@pytest.fixture
def falling(toys: Catalogue) -> Path:
    """The file of what the toys run."""
    return folder_of(toys) / "falling" / "all.py"


def folder_of(catalogue: Catalogue) -> Path:
    return Path(str(importlib.import_module(catalogue.published).__file__)).parents[1]


@pytest.fixture
def more_toys(toys: Catalogue, falling: Path) -> Callable[[str, str], Catalogue]:
    """Adds code to what the toys run, and entries to their catalogue."""

    def add(code: str, entries: str) -> Catalogue:
        falling.write_text(falling.read_text() + code)
        path = folder_of(toys) / "catalogue.py"
        path.write_text(path.read_text().removesuffix("    ),\n)\n") + entries + "    ),\n)\n")
        name = f"{toys.published.removesuffix('.published')}.catalogue"
        del sys.modules[name]
        importlib.invalidate_caches()
        catalogue: Catalogue = importlib.import_module(name).CATALOGUE
        return catalogue

    return add


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts the command line in a process, in a group of its own if that is asked for."""
    with ExitStack() as processes:

        def begin(
            catalogue: Catalogue, *arguments: str, group: bool = False
        ) -> subprocess.Popen[str]:
            package = catalogue.published.removesuffix(".published")
            root = folder_of(catalogue).parent
            process = subprocess.Popen(
                [sys.executable, "-c", PROGRAM, package, *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=group,
                env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{root}"},
            )
            processes.enter_context(process)
            processes.callback(process.kill)
            return process

        yield begin


@pytest.fixture
def chamfer(
    toys: Catalogue, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Runs the command line here and returns the status, and what it writes to both streams."""
    from chamfer.analysis.cli import main

    def run(*arguments: object, catalogue: Catalogue = toys) -> tuple[int, str, str]:
        capsys.readouterr()
        status = main([str(one) for one in arguments], catalogue=catalogue)
        return status, *capsys.readouterr()

    return run
