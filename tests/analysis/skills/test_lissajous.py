import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.sensorimotor_primitives import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.skills.lissajous import LissajousScenario, covering_radius, theory
from chamfer.models.validation import ParameterError

LISSAJOUS = load(select(CATALOGUE.entries, ["lissajous"])[0])

SHORT = LissajousScenario(repeats=(2, 6))
Value = Callable[[str], float]


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return LISSAJOUS.run(LISSAJOUS.resolve(SHORT), 0, quiet)


@pytest.fixture(scope="module")
def value(outcome: Outcome) -> Value:
    def get(name: str) -> float:
        measured = outcome.metrics[name].value
        assert measured is not None
        return measured

    return get


def test_published_values(outcome: Outcome) -> None:
    asked = [one for one in PUBLISHED if one.experiment == "lissajous"]
    checks = check(asked, outcome.metrics)
    assert len(checks) == 1
    assert all(one.ok for one in checks)


def test_metrics_and_units(outcome: Outcome) -> None:
    units = {name: metric.unit for name, metric in outcome.metrics.items()}
    expected = {"repeats_after": "m", "sine_start.offset": "m"}
    for n in (2, 6):
        expected |= {
            f"covering_radius.n{n}": "m",
            f"covering_ratio.n{n}": "",
            f"theory.covering_radius.n{n}": "m",
            f"centre_offset.n{n}": "m",
            f"duration.n{n}": "s",
        }
    assert units == expected


def test_the_pattern_closes_and_is_centred(value: Value) -> None:
    assert value("repeats_after") == pytest.approx(0.0, abs=1e-12)
    assert value("sine_start.offset") == 0.002
    for n in (2, 6):
        assert value(f"centre_offset.n{n}") < 0.005 * 0.002
        assert value(f"duration.n{n}") == pytest.approx(n)


def test_the_covering_radius_is_that_of_the_curve(value: Value) -> None:
    for n in (2, 6):
        time = np.linspace(0.0, n, 4000 * n)
        curve = 0.002 * np.column_stack(
            [np.sin(2 * np.pi * time), np.sin(2 * np.pi * (n + 1) / n * time)]
        )
        expected = covering_radius(curve, 0.002)
        assert value(f"covering_radius.n{n}") == pytest.approx(expected, abs=1e-5)
        assert value(f"covering_ratio.n{n}") == pytest.approx(n * expected / 0.002, abs=0.03)
    # The reference gives about 1.05 A / N.
    assert value("covering_ratio.n6") == pytest.approx(1.05, abs=0.12)


def test_traces_hold_every_pattern(outcome: Outcome) -> None:
    repeats = outcome.traces["repeats"]
    assert set(repeats) == {2.0, 6.0}
    for n in (2, 6):
        of = repeats == n
        assert outcome.traces["time"][of][-1] == pytest.approx(n)
        for name in ("first", "second"):
            assert np.abs(outcome.traces[name][of]).max() == pytest.approx(0.002, rel=0.01)
    # A cycle of the first a second, (N + 1) / N of the second.
    of = repeats == 2
    for name, cycles in (("first", 2), ("second", 3)):
        spectrum = np.abs(np.fft.rfft(outcome.traces[name][of][:-1]))
        assert int(spectrum.argmax()) == cycles
    assert outcome.simulated_seconds == pytest.approx(8.0)


def test_the_same_run_gives_the_same_bytes(outcome: Outcome) -> None:
    again = LISSAJOUS.run(SHORT, 1, quiet)  # nothing is random
    assert again.metrics == outcome.metrics
    for name, column in outcome.traces.items():
        assert column.tobytes() == again.traces[name].tobytes()


def test_the_pattern_is_as_large_and_as_fast_as_told() -> None:
    scenario = LissajousScenario(amplitude=0.001, frequency=2.0, repeats=(1,))
    found = LISSAJOUS.run(scenario, 0, quiet)
    assert np.abs(found.traces["first"]).max() == pytest.approx(0.001, rel=0.01)
    assert found.metrics["duration.n1"].value == pytest.approx(0.5)


def test_a_line_across_the_square_is_half_a_side_from_its_edge() -> None:
    along = np.linspace(-0.002, 0.002, 401)
    line = np.column_stack([along, np.zeros(401)])
    assert covering_radius(line, 0.002) == pytest.approx(0.002)
    assert covering_radius(line[:, ::-1], 0.002) == pytest.approx(0.002)
    beside = line + np.array([0.0, 0.001])
    assert covering_radius(beside, 0.002) == pytest.approx(0.003)


def test_a_diagonal_is_farthest_from_the_corners() -> None:
    along = np.linspace(-0.002, 0.002, 4001)
    diagonal = np.column_stack([along, along])
    assert covering_radius(diagonal, 0.002) == pytest.approx(0.002 * math.sqrt(2), rel=1e-3)


def test_a_point_in_the_middle_is_half_a_diagonal_from_the_corners() -> None:
    assert covering_radius(np.zeros((1, 2)), 0.003) == pytest.approx(0.003 * math.sqrt(2))


@pytest.mark.parametrize(("cells", "amplitude"), [(2, 1.0), (5, 0.003), (20, 0.002)])
def test_a_dense_grid_leaves_half_a_cells_diagonal(cells: int, amplitude: float) -> None:
    side = np.linspace(-amplitude, amplitude, cells + 1)
    x, y = np.meshgrid(side, side)
    found = covering_radius(np.column_stack([x.ravel(), y.ravel()]), amplitude)
    assert found == pytest.approx(math.sqrt(2) * amplitude / cells)


def test_the_theory_is_a_cell_of_the_middle() -> None:
    assert theory(10, 0.002) == pytest.approx(1.1107 * 0.002 / 10, rel=1e-4)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"repeats": ()}, r"repeats is \(\), allowed: one or more whole numbers, 1 to 64"),
        ({"repeats": (2, 0)}, r"repeats is \(2, 0\), allowed: one or more whole numbers"),
        ({"repeats": (65,)}, r"repeats is \(65,\), allowed: one or more whole numbers"),
        ({"repeats": (3, 3)}, r"repeats is \(3, 3\), allowed: different numbers"),
        ({"amplitude": 0.0}, "amplitude is 0.0, allowed: a finite number > 0"),
        ({"frequency": -1.0}, "frequency is -1.0, allowed: a finite number > 0"),
    ],
)
def test_a_scenario_refuses(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        LissajousScenario(**values)
