import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.design import design_accuracy
from chamfer.analysis.design.design import BOUNDED, interval, is_within
from chamfer.analysis.design.design_accuracy import (
    REFUSED,
    DrawnDesignsScenario,
    accuracy,
    insert_once,
    run,
)
from chamfer.analysis.report.fingerprint import digest
from chamfer.analysis.scenario.experiment import Table
from chamfer.models.validation import ParameterError


@pytest.fixture
def traces() -> Table:
    seated = [4.0, 3.0, 2.0, 0.0, 0.0, 4.0, 0.0]
    trials = [4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 0.0]
    ends = [
        interval(int(k), int(n)) if n else (np.nan, np.nan)
        for k, n in zip(seated, trials, strict=True)
    ]
    return {
        "verdict": np.array(["certain", "certain", "likely", "no", "likely", "likely", REFUSED]),
        "margin": np.array([0.3, 0.2, -0.1, -4.0, -0.2, 0.0, np.nan]),
        "share": np.array([1.0, 1.0, 0.7, 0.0, 0.1, 0.6, np.nan]),
        "seated": np.array(seated),
        "trials": np.array(trials),
        **{f"{name}_{end}": np.zeros(7) for name in BOUNDED for end in ("within", "of")},
        "force_of": np.array([4.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        "force_within": np.array([4.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        "low": np.array([low for low, _ in ends]),
        "high": np.array([high for _, high in ends]),
    }


def test_verdicts_are_counted_by_what_became_of_them(traces: Table) -> None:
    metrics = accuracy(traces)
    counted = {
        name.removeprefix("confusion."): metric.value
        for name, metric in metrics.items()
        if name.startswith("confusion.") and metric.value
    }
    assert counted == {
        "certain.all": 1,
        "certain.some": 1,
        "likely.some": 1,
        "likely.none": 1,
        "likely.all": 1,
        "no.none": 1,
    }
    assert metrics["refused"].value == 1


def test_shares_are_of_insertions_and_of_designs(traces: Table) -> None:
    metrics = accuracy(traces)
    assert metrics["certain.seated"].value == pytest.approx(100 * 7 / 8)
    assert metrics["no.seated"].value == 0
    # Of two designs of which all were seated one was called certain, of two with none one no.
    assert metrics["all_seated.called_certain"].value == 50
    assert metrics["none_seated.called_no"].value == 50
    expected = 100 * np.mean([0.7 - 0.5, 0.1 - 0.0, 0.6 - 1.0])
    assert metrics["likely.share_error"].value == pytest.approx(expected)
    assert metrics["bounds.force.coverage"].value == 75
    assert metrics["bounds.tilt.coverage"].value is None
    # Of 2, 0 and 4 of 4 seated all intervals but that of 4 of 4 have the predicted share.
    assert metrics["likely.agree"].value == 100


def test_what_nobody_was_called_is_undefined(traces: Table) -> None:
    likely = {**traces, "verdict": np.full(7, "likely")}
    metrics = accuracy(likely)
    assert metrics["certain.seated"].value is None
    assert metrics["certain.seated.low"].value is None
    assert "there are none" in metrics["no.seated"].note


def test_a_depth_is_bounded_from_below() -> None:
    assert is_within("depth", 0.0361, 0.036)
    assert not is_within("depth", 0.0359, 0.036)
    assert is_within("time", 2.0, 2.0)
    assert not is_within("time", 2.1, 2.0)


def test_no_two_designs_share_the_errors_of_their_insertions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seeds: list[int] = []

    def insert(cell: object, seed: int, trial: int) -> None:
        seeds.append(trial_seed(seed, trial))

    monkeypatch.setattr(design_accuracy, "insert_drawn", insert)
    monkeypatch.setattr(design_accuracy, "resolve_design", lambda design: design)
    for task in ((design, trial) for design in range(3) for trial in range(3)):
        insert_once(DrawnDesignsScenario(), 7, task)
    assert len(set(seeds)) == 9


def test_more_designs_and_trials_keep_those_that_have_run(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []

    class RunError(Exception):
        pass

    def stop(function: object, *_: object) -> None:
        asked.append(digest(function))
        raise RunError

    monkeypatch.setattr(design_accuracy, "run_each", stop)
    for designs, trials in ((3, 1), (4, 1), (3, 2)):
        with pytest.raises(RunError):
            run(DrawnDesignsScenario(designs=designs, trials=trials), 0, lambda *_: None)
    assert len(set(asked)) == 1


def test_sizes_lie_in_their_ranges_and_fill_them() -> None:
    scenario = DrawnDesignsScenario()
    sizes = [scenario.sizes(0, design) for design in range(200)]
    for name in ("radius", "clearance", "friction", "stiffness", "width"):
        low, high = getattr(scenario, name)
        of = np.array([one[name] for one in sizes])
        assert low <= of.min() < low + 0.2 * (high - low), name
        assert high - 0.2 * (high - low) < of.max() <= high, name
    middle = np.median([one["stiffness"] for one in sizes])
    assert 500 < middle < 1000  # evenly in its logarithm: the root of 100 times 5000 is 707
    for name in ("hole", "controller", "section"):
        assert 80 < sum(one[name] for one in sizes) < 120
    assert 165 < sum(one["chamfers"] for one in sizes) < 195  # of 200, 90 %


def test_a_design_is_what_was_drawn_and_the_same_again() -> None:
    scenario = DrawnDesignsScenario(hole="fixture", duration=12.0, draws=77)
    for design in range(20):
        sizes, cell = scenario.sizes(3, design), scenario.drawn(3, design)
        assert cell == scenario.drawn(3, design)
        parts = cell.parts
        assert parts.hole_radius == pytest.approx(sizes["radius"])
        assert parts.clearance == pytest.approx(sizes["clearance"] * sizes["radius"])
        assert parts.friction == sizes["friction"]
        assert parts.peg_length / parts.hole_radius == pytest.approx(6.0, rel=0.01)
        assert cell.impedance.stiffness == (sizes["stiffness"],) * 3
        assert cell.cameras.width * cell.cameras.pixel_size == pytest.approx(0.16)
        assert (cell.hole.kind, cell.duration, cell.draws) == ("fixture", 12.0, 77)
        # A step doesn't cross the play, and is a whole part of the controllers' period.
        assert cell.insert.speed * cell.step <= 2 * parts.clearance
        assert cell.impedance.period / cell.step == pytest.approx(
            round(cell.impedance.period / cell.step)
        )
    assert scenario.drawn(4, 0) != scenario.drawn(3, 0)


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"draws": 10}, "draws"),
        ({"radius": (0.01, 0.001)}, "radius"),
        ({"friction": (0.0, 0.5)}, "friction"),
        ({"clearance": (0.1, 1.5)}, "clearance"),
    ],
)
def test_what_is_not_allowed(fields: dict[str, object], name: str) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is"):
        DrawnDesignsScenario(**fields)  # type: ignore[arg-type]
