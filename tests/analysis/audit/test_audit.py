import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from chamfer.analysis.audit.__main__ import main, report
from chamfer.analysis.audit.contexts import CONTEXTS, EXEMPTIONS, Context
from chamfer.analysis.audit.field_audit import (
    FieldVerdict,
    Reference,
    audit,
    digests,
    perturbations,
)
from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.scenario_fields import leaves
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import (
    Catalogue,
    Entry,
    Metric,
    Outcome,
    load,
    quiet,
    select,
)
from chamfer.analysis.scenario.scenario_io import make_scenario

TOY = '''
"""An experiment with fields of every kind, and a wall time among what it measures."""

import time
from dataclasses import dataclass

import numpy as np

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.models.validation import ParameterError


@dataclass(frozen=True, kw_only=True)
class Eye:
    gain: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Scenario:
    effective: float = 1.0
    derived: float | None = None
    traced: bool = False
    vector: tuple[float, ...] = (0.0, 0.0, 1.0)
    silent: float = 1.0
    bound: float = 8.0
    amplitude: float = 0.0
    frequency: float = 1.0
    refused: int = 1
    late: float = 1.0
    broken: int = 0
    bounding: float = 1.0
    eye: Eye | None = None
    trials: int = 1000000

    def __post_init__(self):
        if self.refused != 1:
            raise ParameterError("refused", self.refused, "1")
        if self.effective > self.bounding:
            raise ParameterError("effective", self.effective, f"at most {self.bounding}")


def resolve(scenario):
    return scenario


def run(scenario, seed, progress):
    if scenario.late != 1.0:
        raise SystemExit("condition failed")
    if scenario.broken:
        raise ZeroDivisionError("by zero")
    assert scenario.trials < 10, "not the reduced size"
    derived = 3.0 if scenario.derived is None else scenario.derived
    wave = scenario.amplitude * np.sin(scenario.frequency * np.arange(5))
    noise = np.random.default_rng(seed).normal(size=5)
    return Outcome(
        metrics={
            "it": Metric(value=min(scenario.effective * derived, scenario.bound), unit=""),
            "wall": Metric(value=time.perf_counter(), unit="s"),
        },
        traces={"wave": wave + noise, "flag": [scenario.traced] * 5},
        tables={"more": {"v": scenario.vector, "gain": [scenario.eye and scenario.eye.gain]}},
        simulated_seconds=scenario.silent,
    )


@dataclass(frozen=True, kw_only=True)
class SlowScenario:
    slow: int = 0


def run_slow(scenario, seed, progress):
    time.sleep(10 * abs(scenario.slow))
    return Outcome(metrics={}, traces={"time": [0.0]}, simulated_seconds=0.0)


TOY = Scenario()
SLOW = SlowScenario()
'''

WAVES = Context("freq*", ("amplitude=1",))


@pytest.fixture
def catalogue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Catalogue:
    package = f"audited_{abs(hash(tmp_path))}"
    (tmp_path / f"{package}.py").write_text(TOY)
    monkeypatch.syspath_prepend(str(tmp_path))
    names = {
        "paper": "p",
        "summary": "toy",
        "module": package,
        "resolve": "resolve",
        "plot": "run",
    }
    toy = Entry(name="toy", scenario="TOY", reduced=("trials=2",), **names)
    slow = replace(toy, name="slow", scenario="SLOW", run="run_slow", reduced=())
    return Catalogue(entries=(slow, toy), published="none")


def toy(catalogue: Catalogue) -> list[Entry]:
    return select(catalogue.entries, ["toy"])


def test_a_field_is_effective_silent_refused_or_undecided(catalogue: Catalogue) -> None:
    verdicts = {one.path: one for one in audit(toy(catalogue), quiet, contexts=[WAVES])}
    assert {path: verdict.kind for path, verdict in verdicts.items()} == {
        "effective": "effective",
        "derived": "effective",  # perturbed about what it resolves to, or any number
        "traced": "effective",  # told by the traces alone
        "vector": "effective",  # told by a table alone
        "silent": "silent",  # changes how long is simulated
        "bound": "effective",  # out of reach, told by a strong perturbation alone
        "amplitude": "effective",
        "frequency": "effective",  # in its context
        "refused": "refused",
        "late": "refused",  # by Drake, in the run
        "broken": "undecided",
        "bounding": "bounds",
        "eye": "effective",
        "eye.gain": "effective",  # of an eye that is not there by default
        "trials": "silent",
    }
    assert verdicts["bound"].tried[-1] == ("effective", "bound=0.8: a change")
    assert len(verdicts["bound"].tried) > 1
    crash = "broken=1: traceback: ZeroDivisionError: by zero"
    assert verdicts["broken"].tried[0] == ("undecided", crash)


def test_without_its_context_a_field_is_silent(catalogue: Catalogue) -> None:
    contexts = [
        WAVES._replace(experiment="another"),
        WAVES._replace(paths="ampl*"),
        Context("*", ("refused=2",)),  # never allowed
    ]
    kinds = {v.path: v.kind for v in audit(toy(catalogue), quiet, contexts=contexts)}
    assert kinds["frequency"] == "silent"
    assert kinds["amplitude"] == kinds["effective"] == "effective"


@pytest.mark.parametrize(
    ("pattern", "path", "found"),
    [
        ("*wave.frequency", "wave.frequency", ("wave.amplitude=1", "b=2")),
        ("*wave.frequency", "a.b.wave.frequency", ("a.b.wave.amplitude=1", "b=2")),
        ("*wave.f*", "wave.wave.frequency", ("wave.wave.amplitude=1", "b=2")),
    ],
)
def test_a_setting_may_lie_below_the_same_fields(
    pattern: str, path: str, found: tuple[str, ...]
) -> None:
    context = Context(f"other {pattern}", ("*wave.amplitude=1", "b=2"))
    assert context.holds_for("toy", path)
    assert context.settings_for(path) == found


@pytest.mark.slow
def test_every_context_and_exemption_is_for_a_field_that_there_is() -> None:
    found = []
    for entry in CATALOGUE.entries:
        experiment = load(entry)
        reduced = make_scenario(experiment.default, settings=entry.reduced)
        found += [(entry.name, leaf.path, reduced) for leaf in leaves(reduced)]
    for context in CONTEXTS:
        fits = [one for one in found if context.holds_for(one[0], one[1])]
        assert any(is_allowed(one[2], context.settings_for(one[1])) for one in fits), context
    for exemption in EXEMPTIONS:
        assert any(exemption.holds_for(name, path) for name, path, _ in found), exemption


def is_allowed(scenario: object, settings: Sequence[str]) -> bool:
    try:
        make_scenario(scenario, settings=settings)
    except UserError:
        return False
    return True


def test_a_run_that_takes_too_long_is_given_up(
    catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("chamfer.analysis.audit.field_audit._LEAST", 0.1)
    (verdict,) = audit(select(catalogue.entries, ["slow"]), quiet)
    assert verdict.kind == "undecided"
    assert verdict.tried[0][1] == "slow=1: given up after 0 s"
    assert verdict.seconds < 9


def test_a_field_that_takes_the_process_along_is_a_crash(
    catalogue: Catalogue, tmp_path: Path
) -> None:
    path = tmp_path / f"{catalogue.entries[0].module}.py"
    path.write_text(path.read_text().replace("raise ZeroDivisionError", "os._exit(3)  #"))
    path.write_text("import os\n" + path.read_text())
    with parallel(2):
        found = {v.path: v for v in audit(toy(catalogue), quiet)}
    crash = ("undecided", "traceback: its process ended with status 3")
    assert found["broken"].tried == (crash,)
    assert found["effective"].kind == "effective"
    assert list(found)[:2] == ["effective", "derived"]


def test_an_experiment_that_does_not_run_is_said(catalogue: Catalogue) -> None:
    with pytest.raises(UserError, match="toy doesn't run: condition failed"):
        audit(toy(catalogue), quiet, settings=["late=2"])
    with pytest.raises(UserError, match="toy can't be reduced: refused is 2"):
        audit(toy(catalogue), quiet, settings=["refused=2"])


def test_the_command_lists_what_has_to_be_looked_at(
    catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("chamfer.analysis.audit.__main__.CONTEXTS", (WAVES,))
    exemptions = (Context("silent broken"),)
    monkeypatch.setattr("chamfer.analysis.audit.__main__.EXEMPTIONS", exemptions)
    assert main(["toy", "--workers", "1"], catalogue=catalogue) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("toy: ")] == [
        "toy: bounding only bounds: bounding=0.9: effective is 1.0, allowed: at most 0.9",
        "toy: broken is undecided",  # a traceback is never exempt
        "toy: trials is silent",
    ]


def test_the_command_succeeds_if_nothing_has_to_be_looked_at(
    catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    exemptions = (Context("s*w"),)
    monkeypatch.setattr("chamfer.analysis.audit.__main__.EXEMPTIONS", exemptions)
    monkeypatch.setattr("chamfer.analysis.audit.field_audit._LEAST", 0.1)
    assert main(["slow", "--workers", "1"], catalogue=catalogue) == 0


def outcome(**changes: object) -> Outcome:
    arrays = {"traces": {"t": np.array([0.0, np.nan])}, "metrics": {}, "simulated_seconds": 1.0}
    return Outcome(**{**arrays, **changes})


@pytest.mark.parametrize(
    "other",
    [
        outcome(traces={"t": np.array([0.0, 1.0])}),
        outcome(traces={"u": np.array([0.0, np.nan])}),
        outcome(traces={"t": ["a", "b"]}),
        outcome(traces={"t": np.array(["a", None])}),
        outcome(traces={}),
        outcome(tables={"more": {"t": np.array([0.0, np.nan])}}),
        outcome(metrics={"m": Metric(value=1.0, unit="")}),
    ],
)
def test_what_is_measured_is_told_by_its_bytes(other: Outcome) -> None:
    reference = Reference(measured=digests(outcome()))
    assert reference.differs(digests(other))
    assert not reference.differs(digests(outcome(simulated_seconds=2.0)))


def test_what_is_never_the_same_is_not_compared() -> None:
    reference = Reference(measured={"metric wall": None, "metric it": "b"})
    assert not reference.differs({"metric wall": "c", "metric it": "b"})
    assert reference.differs({"metric wall": "c", "metric it": "c"})
    assert reference.differs({"metric wall": "c"})


def test_the_report_counts_by_experiment() -> None:
    def verdict(experiment: str, kind: str) -> FieldVerdict:
        tried = ((kind, "x=1: no change"),)
        return FieldVerdict(experiment=experiment, path="x", tried=tried, seconds=1.0)

    found = [verdict("a", "effective"), verdict("a", "bounds"), verdict("b", "silent")]
    assert report(found, ()).splitlines() == [
        "experiment  fields  effective  bounds  silent  undecided  refused  CPU s",
        "a                2          1       1       0          0        0      2",
        "b                1          0       0       1          0        0      1",
        "a: x only bounds: x=1: no change",
        "",
        "b: x is silent",
        "  x=1: no change",
    ]
    assert len(report(found, [Context("x")]).splitlines()) == 4


@dataclass(frozen=True)
class Nested:
    x: float = 1.0


@dataclass(frozen=True)
class Given:
    x: float
    y: float = 1.0


def of(value: Any, kind: Any, resolved: Any = None) -> list[Any]:
    return list(perturbations(value, kind, value if resolved is None else resolved))


@pytest.mark.parametrize(
    ("value", "kind", "first"),
    [
        (2.0, float, [2.2, 1.8]),
        (0.0, float, [0.01, -0.1]),
        (math.inf, float, [1.0, 0.01]),
        (3, int, [4, 2, 6, 0, 8]),
        (True, bool, [False]),
        ("a", Literal["a", "b", "c"], ["b", "c"]),
        (None, float | None, [1.0, 0.1]),
        (None, bool | None, [False, True]),
        (None, tuple[float, ...] | None, [[1.0], [0.1]]),
        (None, tuple[int, int] | None, [[1, 1], [2, 2]]),
        (None, Nested | None, [{}]),
        (None, Given | None, [{"x": 1.0}, {"x": 0.1}]),
        (Nested(), Nested | None, [None]),
        ((1.0, 0.0), tuple[float, ...], [[1.1, 0.01], [0.9, -0.1]]),
        ((), tuple[int, ...], [[0], [1]]),
    ],
)
def test_mild_values_come_first(value: Any, kind: Any, first: list[Any]) -> None:
    found = of(value, kind)[: len(first)]
    if isinstance(value, float) and math.isfinite(value):
        assert found == pytest.approx(first)
    else:
        assert found == first


def test_none_of_them_is_the_value_and_none_comes_twice() -> None:
    for value, kind in ((1, int), (0.0, float), ((0.0,), tuple[float, ...]), ("a", Literal["a"])):
        found = of(value, kind)
        assert value not in found
        assert len(found) == len({repr(one) for one in found})
    assert of(2.0, float | None)[-1] is None
    assert None not in of(2.0, float)
    assert of(None, float | None, 2.0)[:2] == pytest.approx([2.2, 1.8])  # about what it comes to
    for one in ([1.1, 2.0], [1.0, 2.2], [1.0], [1.0, 2.0, 2.0]):
        assert one in of((1.0, 2.0), tuple[float, ...])
