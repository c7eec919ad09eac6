from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import ArrayLike

from chamfer.analysis.scenario.experiment import quiet
from chamfer.analysis.sweep.sweep import SweepResult, SweepTable, make_plan, run_sweep
from chamfer.analysis.sweep.sweep_design import Drawn, Spec
from chamfer.analysis.sweep.sweep_figures import plot_sweep, shown_metrics

MASS, INCREMENT = "plant.mass", "fsm.increment"


def made(metrics: Mapping[str, ArrayLike], vary: dict[str, Spec], trials: int = 1) -> SweepResult:
    """A sweep in which metrics have these values, the trials of a point one after the other."""
    plan = make_plan("step-response", vary, trials=trials)
    points = np.array(plan.points, dtype=float)
    table = {path: points[:, i] for i, path in enumerate(vary)}
    every = {name: np.asarray(values, dtype=float) for name, values in metrics.items()}
    table |= {name: values.reshape(-1, trials).mean(axis=1) for name, values in every.items()}
    table["status"] = np.full(len(points), "ok", dtype=object)
    return SweepResult(
        plan=plan,
        table=SweepTable(table, dict.fromkeys(every, "m")),
        trials=every,
        metrics={name: name for name in every},
        counts={"ok": len(points), "refused": 0, "failed": 0},
        simulated_seconds=0.0,
        reasons={},
        broken={},
    )


GRID: dict[str, Spec] = {MASS: [1.0, 2.0, 3.0], INCREMENT: [0.01, 0.02]}


def test_metrics_that_move_by_rounding_are_never_shown() -> None:
    metrics = {
        "rounded": 0.03 + 1e-11 * np.arange(6),
        "zero": 1e-12 * np.arange(6),
        "same": np.ones(6),
        "field": np.repeat([1.0, 2.0, 3.0], 2),  # plant.mass itself
        "x.real_time_factor": np.arange(6),
        "moved": 1 + 1e-3 * np.arange(6),
    }
    shown = shown_metrics(made(metrics, GRID))
    assert shown.metrics == ["moved"]
    assert shown.left_out(1) == (
        "1 of 1 metrics that depend on a varied field, largest effects first; "
        "5 others do not beyond rounding"
    )


def test_each_field_has_a_metric_among_the_first() -> None:
    mass, increment = np.repeat([1.0, 2.0, 3.0], 2), np.tile([0.0, 1.0], 3)
    metrics = {"a": 0.1 + mass, "b": 0.2 + mass, "c": 9 + increment, "d": 9 + increment * mass}
    shown = shown_metrics(made(metrics, GRID))
    assert shown.metrics[:2] == ["a", "d"]
    assert shown.claim("a") == "a rises with mass"
    assert shown.claim("d") == "d rises with mass and increment"
    assert set(shown.metrics) == set(metrics)


def test_a_gap_in_the_grid_is_no_effect_of_the_other_field() -> None:
    values = np.repeat([1.0, 2.0, 3.0], 2)
    values[1] = np.nan  # without it means over the increment differ
    effects = shown_metrics(made({"a": values + 1}, GRID)).effects["a"]
    assert effects[MASS].real
    assert effects[INCREMENT].size == 0


def test_seeds_that_scatter_more_are_no_effect() -> None:
    rng = np.random.default_rng(0)
    noise, seed = rng.normal(size=(9, 5)), rng.normal(size=5)
    metrics = {
        "noise": noise.ravel(),
        "effect": (noise + np.arange(9)[:, None]).ravel(),
        "paired": (seed + 0.01 * np.arange(9)[:, None]).ravel(),  # a seed does the same everywhere
    }
    vary: dict[str, Spec] = {MASS: list(range(1, 10))}
    assert set(shown_metrics(made(metrics, vary, trials=5)).metrics) == {"effect", "paired"}
    only = shown_metrics(made({"noise": metrics["noise"]}, vary, trials=5))
    assert only.metrics == ["noise"]  # better than nothing, and said
    assert "none beyond scatter" in only.left_out(1)
    assert only.claim("noise") == "noise: no effect beyond scatter or rounding"


def test_drawn_fields_need_an_effect_beyond_that_of_the_others() -> None:
    vary: dict[str, Spec] = {MASS: Drawn(1, 5), "plant.damping": Drawn(20, 80)}
    plan = make_plan("step-response", vary, points=64)
    mass = np.array(plan.points)[:, 0]
    result = made({"a": np.zeros(64)}, vary)
    result.table["a"][:] = mass**2
    effects = shown_metrics(result).effects["a"]
    assert effects[MASS].real
    assert not effects["plant.damping"].real


@pytest.mark.slow
def test_example_of_the_readme_shows_fsm_and_pid() -> None:
    vary: dict[str, Spec] = {MASS: [1.0, 3.0, 5.0], INCREMENT: [0.004, 0.012, 0.02]}
    result = run_sweep(make_plan("step-response", vary), quiet)
    figure = plot_sweep(result)
    assert figure is not None
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert any(title.startswith("fsm.rise_time falls with increment") for title in titles)
    assert any(title.startswith("pid.rise_time rises with mass") for title in titles)
    assert not any("steady_state_error" in title for title in titles if title.startswith("pid."))
    assert str(figure.get_label()).startswith(
        f"Sweep of step-response over {MASS} and {INCREMENT}: 6"
    )
    assert figure.get_figwidth() <= 8
