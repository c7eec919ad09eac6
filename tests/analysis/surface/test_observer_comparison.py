"""All observers on the same slides: rows, ratios, and what the adaptive observer promises."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from chamfer.analysis.campaign.trial_rows import encode
from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.analysis.surface import observer_comparison
from chamfer.analysis.surface.observer_comparison import (
    CASES,
    OBSERVERS,
    ObserverComparisonScenario,
    SlideTrial,
    figures,
    flattened,
    run_comparison,
)
from chamfer.diagrams.surface.surface_scenario import SurfaceSettings
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.normal_filter import KINDS

FEW = ("constant", "sharper", "space_bowl")
TRIALS = 5
COSTS = {f"{observer}.cost" for observer in OBSERVERS}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def shorten(patch: pytest.MonkeyPatch) -> None:
    """Leave three of the cases, all with constant friction."""
    patch.setattr(observer_comparison, "CASES", {name: CASES[name] for name in FEW})
    patch.setattr(observer_comparison, "_TIMED", 200)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    shorten(monkeypatch)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch)
        return run_comparison(ObserverComparisonScenario(trials=TRIALS), 3, quiet)


def value(outcome: Outcome, metric: str) -> float:
    found = outcome.metrics[metric].value
    assert found is not None
    return found


def rows(outcome: Outcome, case: str, observer: str) -> dict[str, np.ndarray]:
    of = outcome.traces["case"] == FEW.index(case)
    of = of & (outcome.traces["observer"] == OBSERVERS.index(observer))
    return {name: values[of] for name, values in outcome.traces.items()}


def test_metrics_are_those_of_the_rows(outcome: Outcome) -> None:
    for case in FEW:
        for observer in OBSERVERS:
            of = rows(outcome, case, observer)
            name = f"{case}.{observer}"
            assert value(outcome, f"{name}.rms") == pytest.approx(np.sqrt(np.mean(of["rms"] ** 2)))
            assert value(outcome, f"{name}.coverage") == pytest.approx(of["coverage"].mean())
            bias = outcome.metrics[f"{name}.bias"]
            if case == "space_bowl":
                assert (bias.value, bias.note) == (None, "an angle in space has no sign")
            else:
                assert bias.value == pytest.approx(of["bias"].mean())
    for name in COSTS:
        assert 0 < value(outcome, name) < 1e5
        assert outcome.metrics[name].unit == "us"


def test_the_adaptive_observer_is_better_where_friction_is_constant(outcome: Outcome) -> None:
    for case in FEW:
        ratio = value(outcome, f"{case}.thesis.rms") / value(outcome, f"{case}.adaptive.rms")
        assert ratio >= 1.4
    # Of few seeds; a surface that is taken to be sharp until it has shown to be smooth costs 5 %.
    assert value(outcome, "adaptive.rms_ratio.worst_constant") <= 0.7
    assert value(outcome, "adaptive.coverage.worst") >= 97  # of few seeds
    assert value(outcome, "constant.thesis.rms") == pytest.approx(2.44, abs=0.4)
    assert value(outcome, "constant.thesis.bias") == pytest.approx(1.93, abs=0.5)
    # A camera that is wrong by a fifth still helps both.
    for blind, seeing in (("prior_weights", "vision"), ("adaptive", "adaptive_vision")):
        assert value(outcome, f"constant.{seeing}.rms") < value(outcome, f"constant.{blind}.rms")


def test_a_trial_does_not_depend_on_those_before() -> None:
    scenario = ObserverComparisonScenario(trials=2)

    def found(seed: int, trial: int) -> bytes:
        return encode(observer_comparison._observe(scenario, seed, SlideTrial("constant", trial)))

    second = found(0, 1)
    assert found(0, 0) != second
    assert found(0, 1) == second
    assert found(1, 1) != second


# The metrics, from rows made by hand.


def table(rms: dict[str, dict[str, float]], coverage: dict[str, float]) -> dict[str, np.ndarray]:
    """Two seeds, whose rms is below and above; 2 deg and 100 % where nothing is said."""
    found = []
    for i, case in enumerate(CASES):
        for j, observer in enumerate(OBSERVERS):
            mean = rms.get(observer, {}).get(case, 2.0)
            for trial, factor in enumerate((math.sqrt(0.5), math.sqrt(1.5))):
                covered = coverage.get(case, 100.0) - (0.5 if trial else -0.5)
                found.append((i, j, trial, mean * factor, 0.1 * mean, covered, 9.0))
    columns = ("case", "observer", "trial", "rms", "bias", "coverage", "largest")
    return dict(zip(columns, np.array(found).T, strict=True))


def test_the_worst_ratio_is_the_largest_of_its_group() -> None:
    traces = table(
        {
            "adaptive": {"ripple": 5.0, "sharper": 1.9, "step_up": 4.0, "space_bowl": 3.0}
            | dict.fromkeys(("constant", "bowl", "falling", "space_paraboloid"), 1.0),
            "gated": {"constant": 2.4},
        },
        {"wave_ripple": 60.0, "step_down": 70.0},
    )
    metrics = observer_comparison._metrics(traces)
    assert metrics["constant.gated.rms"].value == pytest.approx(2.4)
    for metric, worst, case in (
        ("adaptive.rms_ratio.worst", 2.5, "ripple"),
        ("adaptive.rms_ratio.worst_constant", 1.5, "space_bowl"),
        ("adaptive.rms_ratio.worst_reported", 2.0, "step_up"),
        ("gated.rms_ratio.worst", 1.2, "constant"),
    ):
        assert metrics[metric].value == pytest.approx(worst)
        assert metrics[metric].note.endswith(f", {case}")
    assert metrics["adaptive.coverage.worst"].value == pytest.approx(60.0)
    assert metrics["adaptive.coverage.worst"].note == "wave_ripple"
    assert "thesis.rms_ratio.worst" not in metrics


def test_groups_of_cases() -> None:
    constant = {"constant", "sharper", "bowl", "falling", "space_paraboloid", "space_bowl"}
    assert {name for name, case in CASES.items() if case.constant} == constant
    kept_apart = {name for name, case in CASES.items() if not case.tuned}
    assert len(kept_apart) >= len(CASES) / 2
    assert kept_apart & constant
    assert kept_apart - constant
    assert {CASES[name].surface.dimension for name in kept_apart} == {2, 3}


# What the observers are told.


def test_every_observer_is_told_what_there_is_to_know() -> None:
    scenario = ObserverComparisonScenario(smallest_radius=0.6, vision_error=0.5, vision_radius=2.0)
    for case in CASES.values():
        for name in OBSERVERS:
            given = observer_comparison._settings(scenario, case, name)
            seeing = name in ("vision", "adaptive_vision")
            assert (given.prediction is not None) == seeing
            assert given.smallest_radius == (2.0 if seeing else 0.6)
            if seeing:
                assert given.prediction == flattened(case.surface, 0.5)
            else:
                assert given.kind == name
    kinds = {name: observer_comparison._settings(scenario, case, name).kind for name in OBSERVERS}
    assert kinds["vision"] == "prior_weights"
    assert kinds["adaptive_vision"] == "adaptive"
    assert set(KINDS) <= set(OBSERVERS)


def test_a_flattened_surface_bends_less_by_a_part() -> None:
    points = {2: np.array([0.3, 0.0]), 3: np.array([0.3, 0.2, 0.0])}
    for case in CASES.values():
        surface, less = case.surface.make(), flattened(case.surface, 0.2).make()
        assert flattened(case.surface, 0.0).make() == surface
        if case.surface.shape in ("circle", "sphere"):
            assert flattened(case.surface, 0.2).radius == pytest.approx(4.0 / 0.8)
            continue
        p = points[case.surface.dimension]
        np.testing.assert_allclose(less.hessian(p), 0.8 * surface.hessian(p))
        assert less.level(p) == pytest.approx(0.8 * surface.level(p))
    assert flattened(SurfaceSettings(), 0.5) == SurfaceSettings(coefficients=(0.025,))
    wave = flattened(SurfaceSettings(shape="wave"), 0.5)
    assert (wave.amplitudes, wave.wavelengths) == ((0.025,), (2.0,))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"trials": 0}, "trials is 0, allowed: 1 to 10000"),
        ({"trials": 10_001}, "trials is 10001, allowed: 1 to 10000"),
        ({"vision_error": 1.0}, "vision_error is 1.0, allowed: at least 0 and below 1"),
        ({"vision_error": -0.1}, "vision_error is -0.1, allowed: at least 0 and below 1"),
        ({"vision_error": math.nan}, "vision_error is nan, allowed: at least 0 and below 1"),
        ({"vision_radius": 0.0}, "vision_radius is 0.0, allowed: a finite number > 0"),
        ({"smallest_radius": -1.0}, "smallest_radius is -1.0, allowed: a finite number > 0"),
    ],
)
def test_mistakes_are_named(values: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        ObserverComparisonScenario(**values)  # type: ignore[arg-type]
    assert str(caught.value) == message


PAIR = ("ripple", "falling")
SEEDS = 101
PERCENT = {"thesis": 97.0, "adaptive": 99.5}


def made() -> Outcome:
    """Observer j has an rms of 1 + j in the first case, of 11 + j in the second, +-0.5."""
    rows = []
    metrics = {}
    for i, case in enumerate(PAIR):
        for j, observer in enumerate(OBSERVERS):
            rms = 10.0 * i + 1 + j
            metrics[f"{case}.{observer}.rms"] = Metric(value=rms, unit="deg")
            covered = PERCENT.get(observer, 90.0) - i
            metrics[f"{case}.{observer}.coverage"] = Metric(value=covered, unit="%")
            spread = np.linspace(-0.5, 0.5, SEEDS)
            rows += [(i, j, trial, rms + spread[trial]) for trial in range(SEEDS)]
    columns = ("case", "observer", "trial", "rms")
    traces = dict(zip(columns, np.array(rows).T, strict=True))
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=0.0)


@pytest.fixture(scope="module")
def figure() -> Figure:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observer_comparison, "CASES", {name: CASES[name] for name in PAIR})
        return figures(ObserverComparisonScenario(), made())["observer-comparison"]
